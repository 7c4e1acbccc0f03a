"""Effects of links, joints and the whole that the vocabulary has a word for, each drawn by a function of its name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from runner.blind.draws import draw_angle, draw_sign
from runner.blind.mechanism.case import Unplanted
from runner.blind.mechanism.draw import Needs
from runner.blind.mechanism.physics import World
from runner.blind.mechanism.plants.plant import Kind, Plant, full, pick
from runner.effects.vocabulary import ALL

HINGED = ("pendulum", "arm2")


def _mass(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = int(g.integers(c.count)), draw_sign(g)

    def edit(w: World, size: float) -> World:
        link, factor = w.links[i], math.exp(s * size)
        return w.with_link(i, mass_kg=link.mass_kg * factor, inertia_kg_m2=link.inertia_kg_m2 * factor)

    # what slides has one inertia, of which part is the drive's
    alike = (full("armature", c.names.joints[0]),) if c.world.slides else ()
    return Plant(
        "mass", c.names.bodies[i], 0.7, edit, lambda w, size: {"mass_kg": edit(w, size).links[i].mass_kg}, alike
    )


def _com_offset(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    arm = math.hypot(*c.world.links[i].com_m)
    # mostly along the link: across it is nearly a turned zero
    angle = g.uniform(-1.0, 1.0) + g.choice([-0.5, 0.5]) * math.pi
    x, z = arm * math.cos(angle), arm * math.sin(angle)

    def edit(w: World, size: float) -> World:
        old = w.links[i].com_m
        return w.with_link(i, com_m=(old[0] + size * x, old[1] + size * z))

    return Plant("com_offset", c.names.bodies[i], 0.6, edit, lambda w, size: {"x_m": size * x, "z_m": size * z})


def _payload(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    own = c.world.links[i]
    arm, angle = math.hypot(*own.com_m), draw_angle(g)
    # as far from the link's own middle as that is from the joint
    at = (own.com_m[0] + arm * math.cos(angle), own.com_m[1] + arm * math.sin(angle))

    def edit(w: World, size: float) -> World:
        link, more = w.links[i], size * w.links[i].mass_kg
        total = link.mass_kg + more
        away = (at[0] - link.com_m[0], at[1] - link.com_m[1])
        return w.with_link(
            i,
            mass_kg=total,
            com_m=(link.com_m[0] + more / total * away[0], link.com_m[1] + more / total * away[1]),
            inertia_kg_m2=link.inertia_kg_m2 + link.mass_kg * more / total * (away[0] ** 2 + away[1] ** 2),
        )

    return Plant(
        "payload",
        c.names.bodies[i],
        1.0,
        edit,
        lambda w, size: {"mass_kg": size * w.links[i].mass_kg, "x_m": at[0], "z_m": at[1]},
    )


def _inertia(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = int(g.integers(c.count)), draw_sign(g)
    alike = () if i else (full("armature", c.names.joints[0]),)
    return Plant(
        "inertia",
        c.names.bodies[i],
        1.5,
        lambda w, size: w.with_link(i, inertia_kg_m2=w.links[i].inertia_kg_m2 * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
        alike,
    )


def _link_length(c: Unplanted, g: np.random.Generator) -> Plant:
    s = draw_sign(g)
    return Plant(
        "link_length",
        c.names.joints[1],
        0.3,
        lambda w, size: replace(w, length_m=w.length_m * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )


def _gravity(c: Unplanted, g: np.random.Generator) -> Plant:
    s = draw_sign(g)

    def edit(w: World, size: float) -> World:
        x, z = w.gravity_m_s2
        return replace(w, gravity_m_s2=(x * math.exp(s * size), z * math.exp(s * size)))

    return Plant("gravity", None, 0.3, edit, lambda w, size: {"ratio": math.exp(s * size)})


def turned_zero(c: Unplanted) -> tuple[str, ...]:
    """Return the names of what turns the first hinge's zero against gravity: all the same where a motor drives it."""
    if c.world.slides or c.world.actuators[0].servo:
        return ()
    # a pendulum's centre of mass may lie in another direction, too
    own = (full("com_offset", c.names.bodies[0]),) if c.count == 1 else ()
    return ("gravity", full("sensor_offset", c.channel(0, of_velocity=False)), *own)


def _gravity_tilt(c: Unplanted, g: np.random.Generator) -> Plant:
    s = draw_sign(g)

    def edit(w: World, size: float) -> World:
        pull = math.hypot(*w.gravity_m_s2)
        return replace(w, gravity_m_s2=(pull * math.sin(s * size), -pull * math.cos(size)))

    return Plant("gravity", None, 0.3, edit, lambda w, size: {"tilt_x_rad": s * size}, turned_zero(c))


def _joint_friction(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    joint, unit = c.world.joints[i], 0.5 * c.force(i)
    less = joint.dry > 0.3 * unit and g.random() < 0.5
    step, largest = (-joint.dry, 1.0) if less else (unit, 1.5)

    def edit(w: World, size: float) -> World:
        return w.with_joint(i, dry=w.joints[i].dry + size * step)

    return Plant(
        "joint_friction", c.names.joints[i], largest, edit, lambda w, size: {"friction": edit(w, size).joints[i].dry}
    )


def _joint_damping(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    joint, unit = c.world.joints[i], 0.5 * c.force(i) / c.speed(i)
    step, largest = (-joint.damping, 1.0) if g.random() < 0.35 else (unit, 2.0)

    def edit(w: World, size: float) -> World:
        return w.with_joint(i, damping=w.joints[i].damping + size * step)

    alike = (full("servo_damping", c.names.actuators[i]),) if c.world.actuators[i].servo else ()
    return Plant(
        "joint_damping", c.names.joints[i], largest, edit,
        lambda w, size: {"damping": edit(w, size).joints[i].damping}, alike,
    )  # fmt: skip


def _armature(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    step, largest = (-c.world.joints[i].armature, 1.0) if g.random() < 0.3 else (c.inertia(i), 1.0)

    def edit(w: World, size: float) -> World:
        return w.with_joint(i, armature=w.joints[i].armature + size * step)

    alike = () if i else (full("mass" if c.world.slides else "inertia", c.names.bodies[0]),)
    return Plant(
        "armature", c.names.joints[i], largest, edit,
        lambda w, size: {"armature": edit(w, size).joints[i].armature}, alike,
    )  # fmt: skip


def _torque_offset(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = int(g.integers(c.count)), draw_sign(g)
    unit = s * c.force(i)
    alike = (full("asymmetric_friction", c.names.joints[i]),) if c.world.joints[i].dry > 0.0 else ()
    alike += shifted_target(c)
    return Plant(
        "torque_offset", c.names.joints[i], 0.8, lambda w, size: w.with_joint(i, offset=size * unit),
        lambda w, size: {"offset": size * unit}, alike,
    )  # fmt: skip


def shifted_target(c: Unplanted) -> tuple[str, ...]:
    """Return the names of what shifts where a servo without a limit holds a slide: all the same without gravity."""
    if not c.world.slides or math.isfinite(c.world.actuators[0].limit):
        return ()
    dry = (full("asymmetric_friction", c.names.joints[0]),) if c.world.joints[0].dry > 0.0 else ()
    return (
        full("torque_offset", c.names.joints[0]),
        full("sensor_offset", c.channel(0, of_velocity=False)),
        *dry,
    )


def _stribeck(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = int(g.integers(c.count)), float(g.choice([-0.9, 1.0, 1.0]))
    speed = c.speed(i) * float(np.exp(g.uniform(math.log(0.05), math.log(0.5))))
    return Plant(
        "stribeck",
        c.names.joints[i],
        3.0 if s > 0 else 1.0,
        lambda w, size: w.with_joint(i, excess=s * size, excess_speed=speed),
        lambda w, size: {"relative_excess": s * size, "speed": speed},
    )


def _asymmetric_friction(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    dry, viscous = [(1.0, 0.0), (0.0, 1.0), (1.0, 0.7)][int(g.integers(3))]
    dry, viscous = draw_sign(g) * dry, draw_sign(g) * viscous
    alike = (full("torque_offset", c.names.joints[i]), *shifted_target(c)) if viscous == 0.0 else ()
    return Plant(
        "asymmetric_friction",
        c.names.joints[i],
        1.5,
        lambda w, size: w.with_joint(i, dry_difference=dry * size, viscous_difference=viscous * size),
        lambda w, size: {"dry": dry * size, "viscous": viscous * size},
        alike,
    )


def _load_friction(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    return Plant(
        "load_friction", c.names.joints[i], 0.6, lambda w, size: w.with_joint(i, load_share=size),
        lambda w, size: {"share": size},
    )  # fmt: skip


def _joint_stiffness(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    unit = c.force(i) / c.reach(i)
    rest = float(np.median(c.column(i, of_velocity=False)) + g.uniform(-1.0, 1.0) * c.reach(i))
    return Plant(
        "joint_stiffness", c.names.joints[i], 1.5, lambda w, size: w.with_joint(i, stiffness=size * unit, rest=rest),
        lambda w, size: {"stiffness": size * unit, "rest": rest},
    )  # fmt: skip


def _torque_ripple(c: Unplanted, g: np.random.Generator) -> Plant:
    i, angle = int(g.integers(c.count)), draw_angle(g)
    unit = c.force(i)
    cycles = float(g.uniform(1.0, 4.0) / c.reach(i)) if c.world.slides else float(g.integers(3, 13))
    rate = cycles * (2.0 * math.pi if c.world.slides else 1.0)
    return Plant(
        "torque_ripple",
        c.names.joints[i],
        1.0,
        lambda w, size: w.with_joint(i, ripple=size * unit, ripple_rate=rate, ripple_phase=angle),
        lambda w, size: {"amplitude": size * unit, "cycles": cycles, "phase_rad": angle},
    )


def _disturbance(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    unit = draw_sign(g) * c.force(i)
    begin = c.shortest_s * float(g.uniform(0.1, 0.5))
    end = begin + c.shortest_s * float(g.uniform(0.15, 0.35))
    return Plant(
        "disturbance",
        c.names.joints[i],
        2.0,
        lambda w, size: w.with_joint(i, push=size * unit, push_from_s=begin, push_until_s=end),
        lambda w, size: {"force": size * unit, "from_s": begin, "until_s": end},
    )


def _backlash(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    unit, share = c.reach(i), float(g.uniform(0.4, 0.8))
    return Plant(
        "backlash", c.names.joints[i], 0.3, lambda w, size: w.with_joint(i, play=size * unit, drive_share=share),
        lambda w, size: {"play": size * unit, "friction_share_of_drive": share},
    )  # fmt: skip


def _compliance(c: Unplanted, g: np.random.Generator) -> Plant:
    i = int(g.integers(c.count))
    unit = c.reach(i) / c.force(i)
    return Plant(
        "compliance", c.names.joints[i], 0.3, lambda w, size: w.with_joint(i, give=size * unit),
        lambda w, size: {"stiffness": 1.0 / (size * unit)},
    )  # fmt: skip


def _clock_scale(c: Unplanted, g: np.random.Generator) -> Plant:
    s = draw_sign(g)
    return Plant(
        "clock_scale", None, 0.1, lambda w, size: replace(w, clock_ratio=math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _observation_delay(c: Unplanted, g: np.random.Generator) -> Plant:
    # every joint is driven, so that all of the motion comes later where all commands do
    commands = full("actuator_delay", c.names.actuators[0] if c.count == 1 else ALL)
    return Plant(
        "observation_delay", None, 0.1, lambda w, size: replace(w, observation_delay_s=size),
        lambda w, size: {"delay_s": size}, (commands,),
    )  # fmt: skip


MECHANICAL: dict[str, Kind] = {
    "mass": Kind(_mass),
    "com_offset": Kind(_com_offset, systems=HINGED),
    "inertia": Kind(_inertia, systems=HINGED),
    "payload": Kind(_payload, systems=HINGED),
    "link_length": Kind(_link_length, systems=("arm2",)),
    "gravity": Kind(_gravity, systems=HINGED),
    "gravity_tilt": Kind(_gravity_tilt, systems=HINGED),
    "joint_friction": Kind(_joint_friction),
    "joint_damping": Kind(_joint_damping),
    "armature": Kind(_armature),
    "torque_offset": Kind(_torque_offset),
    "stribeck": Kind(_stribeck, Needs(dry=True)),
    "asymmetric_friction": Kind(_asymmetric_friction, Needs(dry=True)),
    "load_friction": Kind(_load_friction),
    "joint_stiffness": Kind(_joint_stiffness),
    "torque_ripple": Kind(_torque_ripple),
    "disturbance": Kind(_disturbance),
    "backlash": Kind(_backlash),
    "compliance": Kind(_compliance),
    "clock_scale": Kind(_clock_scale),
    "observation_delay": Kind(_observation_delay),
}


def joint_with(c: Unplanted, g: np.random.Generator, *, servo: bool) -> int | None:
    """Draw a joint with a servo, or with a motor; None if there is none."""
    return pick(c, g, lambda i: bool(c.world.actuators[i].servo) is servo)
