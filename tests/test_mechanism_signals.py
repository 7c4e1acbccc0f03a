"""Effects on what is commanded, exerted and measured, against closed forms."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from mechanisms import (
    ARM,
    FREE_SLIDER,
    SLIDER_KG,
    compiled,
    move,
    scope,
)

from runner.effects import mechanism as m
from runner.effects.mechanism import Command, MechanismEffect, Reading

# Actuators


def force_of(model: mujoco.MjModel, actuator: str, command: float, q: float = 0.0, v: float = 0.0) -> float:
    data = mujoco.MjData(model)
    joint = int(model.actuator(actuator).trnid[0])
    data.qpos[int(model.jnt_qposadr[joint])], data.qvel[int(model.jnt_dofadr[joint])] = q, v
    data.actuator(actuator).ctrl[0] = command
    mujoco.mj_forward(model, data)
    return float(data.actuator(actuator).force[0])


@pytest.mark.parametrize(
    ("effect", "actuator", "force"),
    [
        (m.ActuatorGain("shoulder", 0.8), "shoulder", 0.8 * 2.0),
        (m.ActuatorGain("elbow", 0.8), "elbow", 0.8 * (4 * 0.5 - 0.3 * 0.6)),
        (m.ServoGain("elbow", 1.25), "elbow", 5 * 0.5 - 0.3 * 0.6),
        (m.ServoDamping("elbow", 2.0), "elbow", 4 * 0.5 - 0.6 * 0.6),
        (m.ActuatorSaturation("shoulder", 1.7), "shoulder", 1.7),
        (m.ActuatorSaturation("elbow", 1.1), "elbow", 1.1),
    ],
    ids=lambda value: getattr(value, "full_name", None),
)
def test_forces_of_actuators(effect: MechanismEffect, actuator: str, force: float) -> None:
    """A motor at 2 N m, and a servo (kp 4, kv 0.3) 0.5 rad before its target at 0.6 rad/s, exert this."""
    model = compiled(ARM, effect)
    command = 2.0 if actuator == "shoulder" else 0.7
    assert force_of(model, actuator, command, 0.2, 0.6) == pytest.approx(force, rel=1e-12)


def test_saturation_may_lift_a_limit() -> None:
    """A negative share is a limit above the believed one of 3 N m."""
    effect = m.ActuatorSaturation.from_vector([-0.5], scope(ARM, "elbow"))
    assert effect.limit == pytest.approx(4.5)
    assert force_of(compiled(ARM, effect), "elbow", 2.0) == pytest.approx(4.5)
    assert force_of(compiled(ARM), "elbow", 2.0) == pytest.approx(3.0)


def command_of(column: np.ndarray, before: float = 0.0, step_s: float = 0.001) -> Command:
    return Command(step_s, {"u": column, "other": column}, {"u": before, "other": before})


def test_delay_is_exact_on_the_grid() -> None:
    """A command comes late by whole steps, preceded by what was commanded before; the other actuator's does not."""
    column = np.random.default_rng(1).normal(size=50)
    sent = m.ActuatorDelay("u", 0.007).edit_command(command_of(column, 0.6))
    assert np.array_equal(sent.columns["u"], np.r_[np.full(7, 0.6), column[:-7]])
    assert sent.columns["other"] is column


def test_delay_between_steps_is_the_mean() -> None:
    """A command that is held over each step has, 2.3 steps late, the mean of what holds over each step."""
    column = np.random.default_rng(1).normal(size=50)
    sent = m.ActuatorDelay("u", 0.0023).edit_command(command_of(column)).columns["u"]
    fine = np.repeat(column, 10)
    expected = np.r_[np.zeros(23), fine[:-23]].reshape(50, 10).mean(axis=1)
    np.testing.assert_allclose(sent, expected, atol=1e-12)


def test_lag_follows_a_step() -> None:
    """After a step from 0.5 to 2 the mean over each step is that of the exponential."""
    tau, h = 0.02, 0.001
    sent = m.ActuatorLag("u", tau).edit_command(command_of(np.full(80, 2.0), 0.5)).columns["u"]
    t = h * np.arange(81)
    integral = 2.0 * t - 1.5 * tau * (1 - np.exp(-t / tau))
    np.testing.assert_allclose(sent, np.diff(integral) / h, rtol=1e-10)


def test_dead_band() -> None:
    """Of every command the width is lost, and smaller ones do nothing."""
    sent = m.DeadBand("u", 0.5).edit_command(command_of(np.array([-2.0, -0.4, 0.0, 0.5, 0.7]))).columns["u"]
    np.testing.assert_allclose(sent, [-1.5, 0.0, 0.0, 0.0, 0.2], atol=1e-15)


# Sensors and clocks


def reading_of(values: np.ndarray, *, held_before: bool = False) -> Reading:
    return Reading(0.001 * np.arange(values.shape[-1]), {"q": values, "other": values}, held_before)


def test_sensor_offset_and_scale() -> None:
    """One channel shows a multiple, or more by a constant; the other the truth."""
    values = np.random.default_rng(1).normal(size=(3, 20))
    assert np.array_equal(m.SensorScale("q", 1.1).edit_reading(reading_of(values)).channels["q"], 1.1 * values)
    shown = m.SensorOffset("q", 0.2).edit_reading(reading_of(values))
    assert np.array_equal(shown.channels["q"], values + 0.2)
    assert shown.channels["other"] is values


def test_sensor_lag_follows_what_it_measures() -> None:
    """Of t^2 / 2 from rest a filter shows its exact answer; of a steady ramp it is behind by its time constant."""
    tau, t = 0.03, 0.001 * np.arange(200)
    shown = m.SensorLag("q", tau).edit_reading(reading_of(0.5 * t**2, held_before=True)).channels["q"]
    exact = 0.5 * t**2 - tau * t + tau**2 * (1 - np.exp(-t / tau))
    np.testing.assert_allclose(shown, exact, atol=2e-7)  # it takes the parabola as a polygon
    ramp = np.stack([3.0 + 2.0 * t, -t])
    shown = m.SensorLag("q", tau).edit_reading(reading_of(ramp)).channels["q"]
    np.testing.assert_allclose(shown, ramp - tau * np.array([[2.0], [-1.0]]), atol=1e-12)


def test_sensor_lag_follows_a_kink() -> None:
    """From rest, a speed that begins at once is shown as v (t - tau (1 - exp(-t / tau)))."""
    tau, t = 0.03, 0.001 * np.arange(200)
    shown = m.SensorLag("q", tau).edit_reading(reading_of(1.5 * t, held_before=True)).channels["q"]
    np.testing.assert_allclose(shown, 1.5 * (t - tau * (1 - np.exp(-t / tau))), atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.02, -0.02])
def test_observation_delay(delay_s: float) -> None:
    """What is shown at a time is the state of delay_s before (or after), for all commands alike."""
    rate, h = 7.0, 0.0002
    n = 4000
    t = h * (np.arange(n) + 0.5)
    sent = m.ObservationDelay(delay_s).edit_command(Command(h, {"slide": np.cos(rate * t)}, {"slide": 0.0}))
    model = compiled(FREE_SLIDER)
    _, _, true = move(model, n * h, command=lambda t: [math.cos(rate * t)])
    start = {"slide": math.sin(rate * max(-delay_s, 0.0)) / rate / SLIDER_KG}  # of the state that is shown first
    _, _, shown = move(model, n * h, speed=start, command=lambda t: [sent.columns["slide"][int(t / h)]])
    k = round(delay_s / h)
    pair = (shown[max(k, 0) :, 0], true[: n + 1 - k, 0]) if k > 0 else (shown[: n + 1 + k, 0], true[-k:, 0])
    np.testing.assert_allclose(*pair, atol=1e-6)


def test_clock_scale() -> None:
    """A clock that shows 1.02 s in a second has the slider where it is after t / 1.02."""
    model = compiled(FREE_SLIDER, m.ClockScale(1.02))
    _, q, v = move(model, 0.5 / 1.02, command=lambda _t: [3.0])
    assert len(q) == 2501  # steps that the recording has in 0.5 s of its own
    assert v[-1, 0] == pytest.approx(3.0 / SLIDER_KG * 0.5 / 1.02, rel=1e-9)
