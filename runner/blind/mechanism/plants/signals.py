"""Effects of actuators and sensors that the vocabulary has a word for, each drawn by a function of its name."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.draws import draw_sign
from runner.blind.mechanism.case import Unplanted
from runner.blind.mechanism.draw import Needs
from runner.blind.mechanism.physics import World
from runner.blind.mechanism.plants.plant import Kind, Plant, full
from runner.blind.mechanism.plants.vocabulary import joint_with, shifted_target, turned_zero


def _actuator_gain(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = int(g.integers(c.count)), draw_sign(g)
    return Plant(
        "actuator_gain", c.names.actuators[i], 0.6, lambda w, size: w.with_actuator(i, gain=math.exp(s * size)),
        lambda w, size: {"gain": math.exp(s * size)},
    )  # fmt: skip


def _actuator_delay(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    alike = ("observation_delay",) if c.count == 1 else ()
    return Plant(
        "actuator_delay", c.names.actuators[i], 0.1, lambda w, size: w.with_actuator(i, delay_s=size),
        lambda w, size: {"delay_s": size}, alike,
    )  # fmt: skip


def _actuator_lag(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    return Plant(
        "actuator_lag", c.names.actuators[i], 0.2, lambda w, size: w.with_actuator(i, lag_s=size),
        lambda w, size: {"time_constant_s": size},
    )  # fmt: skip


def _actuator_saturation(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    # between samples a little more is asked for
    peak = min(1.1 * c.peak(i), c.world.actuators[i].limit)

    def limit(size: float) -> float:
        return peak * (1.0 - size)

    return Plant(
        "actuator_saturation", c.names.actuators[i], 0.87, lambda w, size: w.with_actuator(i, limit=limit(size)),
        lambda w, size: {"limit": limit(size)},
    )  # fmt: skip


def _dead_band(c: Unplanted, g: np.random.Generator) -> Plant | None:
    i = joint_with(c, g, servo=False)
    if i is None:
        return None
    unit = c.largest_command(i)
    return Plant(
        "dead_band", c.names.actuators[i], 0.5, lambda w, size: w.with_actuator(i, dead_band=size * unit),
        lambda w, size: {"width": size * unit},
    )  # fmt: skip


def _servo_gain(c: Unplanted, g: np.random.Generator) -> Plant | None:
    i, s = joint_with(c, g, servo=True), draw_sign(g)
    if i is None:
        return None
    return Plant(
        "servo_gain", c.names.actuators[i], 0.7,
        lambda w, size: w.with_actuator(i, kp=w.actuators[i].kp * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _servo_damping(c: Unplanted, g: np.random.Generator) -> Plant | None:
    i, s = joint_with(c, g, servo=True), draw_sign(g)
    if i is None:
        return None
    return Plant(
        "servo_damping", c.names.actuators[i], 1.5,
        lambda w, size: w.with_actuator(i, kv=w.actuators[i].kv * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)}, (full("joint_damping", c.names.joints[i]),),
    )  # fmt: skip


def _sensor_offset(c: Unplanted, g: np.random.Generator) -> Plant:
    i, rate, s = int(g.integers(c.count)), bool(g.random() < 0.3), draw_sign(g)
    unit = s * (c.speed(i) if rate else c.reach(i))
    alike = () if rate or i else (*turned_zero(c), *shifted_target(c))
    return Plant(
        "sensor_offset", c.channel(i, of_velocity=rate), 0.4,
        lambda w, size: w.with_sensor(i, rate, offset=size * unit),
        lambda w, size: {"offset": size * unit}, alike,
    )  # fmt: skip


def _sensor_scale(c: Unplanted, g: np.random.Generator) -> Plant:
    i, rate, s = int(g.integers(c.count)), bool(g.random() < 0.4), draw_sign(g)
    return Plant(
        "sensor_scale", c.channel(i, of_velocity=rate), 0.3,
        lambda w, size: w.with_sensor(i, rate, scale=math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _sensor_lag(c: Unplanted, g: np.random.Generator) -> Plant:
    i, rate = int(g.integers(c.count)), bool(g.random() < 0.5)

    def edit(w: World, size: float) -> World:
        return w.with_sensor(i, rate, lag_s=size)

    return Plant("sensor_lag", c.channel(i, of_velocity=rate), 0.1, edit, lambda w, size: {"time_constant_s": size})


MEASURED = Needs(velocities=True)
SIGNALS: dict[str, Kind] = {
    "actuator_gain": Kind(_actuator_gain),
    "actuator_delay": Kind(_actuator_delay),
    "actuator_lag": Kind(_actuator_lag, MEASURED),
    "actuator_saturation": Kind(_actuator_saturation),
    "dead_band": Kind(_dead_band, Needs(motor=True), ("pendulum", "arm2")),
    "servo_gain": Kind(_servo_gain, Needs(servo=True)),
    "servo_damping": Kind(_servo_damping, Needs(servo=True)),
    "sensor_offset": Kind(_sensor_offset, MEASURED),
    "sensor_scale": Kind(_sensor_scale, MEASURED),
    "sensor_lag": Kind(_sensor_lag, MEASURED),
}
