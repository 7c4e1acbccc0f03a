"""Effects that the vocabulary has a word for, each drawn by a function of its name."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from runner.blind.draws import draw_angle, draw_sign
from runner.blind.planar_box.physics import World
from runner.blind.planar_box.plants.plant import Draw, Plant, UnplantedCase, vector


def _mass(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)

    def edit(w: World, size: float) -> World:
        factor = math.exp(sign * size)
        return replace(w, mass=w.mass * factor, inertia=None if w.inertia is None else w.inertia * factor)

    return Plant(
        "mass", 0.7, edit, lambda w, size: {"mass_kg": w.mass * math.exp(sign * size)}, ("actuator_gain", "mass")
    )


def _friction(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)
    return Plant(
        "friction",
        0.5,
        lambda w, size: replace(w, friction=w.friction * math.exp(sign * size)),
        lambda w, size: {"friction": w.friction * math.exp(sign * size)},
        ("friction",),
    )


def _com_offset(s: UnplantedCase, g: np.random.Generator) -> Plant:
    angle, half = draw_angle(g), min(s.world.half_size[:2])
    return Plant(
        "com_offset",
        s.kern,
        lambda w, size: replace(w, com=vector(size * half, angle)),
        lambda w, size: dict(zip(("x_m", "y_m"), vector(size * half, angle), strict=True)),
        ("com_offset",),
    )


def _inertia(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)
    return Plant(
        "inertia",
        1.0 if sign < 0 else 0.7,
        lambda w, size: replace(w, inertia=w.yaw_inertia * math.exp(sign * size)),
        lambda w, size: {"inertia_kg_m2": w.yaw_inertia * math.exp(sign * size)},
        ("inertia",),
    )


def _anisotropic_friction(s: UnplantedCase, g: np.random.Generator) -> Plant:
    angle = float(g.choice([0.0, math.pi / 2, g.uniform(-math.pi / 2, math.pi / 2)]))
    flow = "associated" if g.random() < 0.65 else "scaled"

    def true(w: World, size: float) -> dict[str, float | str]:
        along, across = w.friction * (1 + size), w.friction * (1 - size)
        return {"friction_1": along, "friction_2": across, "axis_1_rad": angle, "flow": flow}

    return Plant(
        "anisotropic_friction",
        0.5,
        lambda w, size: replace(w, anisotropy=(1 + size, 1 - size), anisotropy_angle=angle, anisotropy_flow=flow),
        true,
        ("anisotropic_friction",),
    )


def _viscous_drag(s: UnplantedCase, g: np.random.Generator) -> Plant:
    acts, unit = str(g.choice(["body", "film"])), s.friction_n
    name = "film" if acts == "film" else "viscous_drag"
    return Plant(
        "viscous_drag",
        2.0,
        lambda w, size: replace(w, **{name: size * unit}),
        lambda w, size: {"coefficient_n_s_per_m": size * unit, "acts": acts},
        ("viscous_drag",),
    )


def _air_drag(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return Plant(
        "air_drag",
        2.0,
        lambda w, size: replace(w, air_drag=size * unit),
        lambda w, size: {"coefficient_n_s2_per_m2": size * unit},
        ("air_drag",),
    )


def _stribeck(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign, speed = float(g.choice([-1.0, 1.0, 1.0])), float(np.exp(g.uniform(math.log(0.08), math.log(0.6))))
    return Plant(
        "stribeck",
        0.6 if sign > 0 else 0.5,
        lambda w, size: replace(w, stribeck=sign * size, stribeck_speed=speed),
        lambda w, size: {"change": sign * size, "speed_m_per_s": speed},
        ("stribeck",),
    )


def _stiction(s: UnplantedCase, g: np.random.Generator) -> Plant:
    speed = float(g.uniform(1e-3, 4e-3))
    return Plant(
        "stiction",
        0.6,
        lambda w, size: replace(w, stiction=size, stiction_speed=speed),
        lambda w, size: {"excess": size, "speed_m_per_s": speed},
        ("stiction",),
    )


def _friction_patch(s: UnplantedCase, g: np.random.Generator) -> Plant:
    place, shape = s.place(g), "disc" if g.random() < 0.6 else "gaussian"
    sign = draw_sign(g)
    radius = float(max(s.world.half_size[:2]) * g.uniform(0.8, 2.0) + g.uniform(0.0, 0.3))

    def true(w: World, size: float) -> dict[str, float | str]:
        return {"change": sign * size, "x_m": place[0], "y_m": place[1], "radius_m": radius, "shape": shape}

    return Plant(
        "friction_patch",
        1.2 if sign > 0 else 0.8,
        lambda w, size: replace(w, patch=sign * size, patch_place=place, patch_radius=radius, patch_shape=shape),
        true,
        ("friction_patch",),
    )


def _contact_pressure(s: UnplantedCase, g: np.random.Generator) -> Plant:
    where = str(g.choice(["rim", "middle"]))
    return Plant(
        "contact_pressure",
        0.95,
        lambda w, size: replace(w, pressure=size, pressure_where=where),
        lambda w, size: {"share": size, "where": where},
        ("contact_pressure",),
    )


def _rotational_damping(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit = s.spin_n_m
    return Plant(
        "rotational_damping",
        1.0,
        lambda w, size: replace(w, rotational_damping=size * unit),
        lambda w, size: {"coefficient_n_m_s": size * unit},
        ("rotational_damping",),
    )


def _floor_tilt(s: UnplantedCase, g: np.random.Generator) -> Plant:
    downhill = draw_angle(g)
    return Plant(
        "floor_tilt",
        min(0.15, 0.5 * s.world.friction),
        lambda w, size: replace(w, tilt=size, downhill=downhill),
        lambda w, size: {"angle_rad": size, "downhill_rad": downhill},
        ("floor_tilt", "wind"),
    )


def _wind(s: UnplantedCase, g: np.random.Generator) -> Plant:
    angle, unit = draw_angle(g), s.friction_n
    return Plant(
        "wind",
        0.5,
        lambda w, size: replace(w, wind=vector(size * unit, angle)),
        lambda w, size: {"force_n": size * unit, "direction_rad": angle},
        ("floor_tilt", "wind"),
    )


def _tether(s: UnplantedCase, g: np.random.Generator) -> Plant:
    x, y = s.place(g)
    place, unit = (x + float(g.normal(0, 0.8)), y + float(g.normal(0, 0.8))), s.friction_n
    rest = 0.0 if g.random() < 0.4 else float(g.uniform(0.2, 1.5))

    def true(w: World, size: float) -> dict[str, float | str]:
        return {"stiffness_n_per_m": size * unit, "x_m": place[0], "y_m": place[1], "rest_length_m": rest}

    return Plant(
        "tether",
        0.6,
        lambda w, size: replace(w, tether=size * unit, tether_place=place, tether_rest=rest),
        true,
        ("tether",),
    )


def _mass_leak(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = float(g.choice([1.0, 1.0, 1.0, -1.0]))
    return Plant(
        "mass_leak",
        0.09,
        lambda w, size: replace(w, mass_leak=sign * size),
        lambda w, size: {"share_per_s": sign * size},
        ("mass_leak",),
    )


def _actuator_gain(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)
    return Plant(
        "actuator_gain",
        0.5,
        lambda w, size: replace(w, gain=w.gain * math.exp(sign * size)),
        lambda w, size: {"gain": w.gain * math.exp(sign * size)},
        ("actuator_gain", "mass"),
    )


def _actuator_delay(s: UnplantedCase, g: np.random.Generator) -> Plant:
    return Plant(
        "actuator_delay",
        0.4,
        lambda w, size: replace(w, delay=size),
        lambda w, size: {"delay_s": size},
        ("actuator_delay", "observation_delay"),
    )


def _actuator_lag(s: UnplantedCase, g: np.random.Generator) -> Plant:
    return Plant(
        "actuator_lag",
        0.5,
        lambda w, size: replace(w, lag=size),
        lambda w, size: {"time_constant_s": size},
        ("actuator_lag",),
    )


def _actuator_saturation(s: UnplantedCase, g: np.random.Generator) -> Plant:
    top = max(float(np.max(np.hypot(e.command[:, 0], e.command[:, 1]))) for e in s.episodes)
    return Plant(
        "actuator_saturation",
        0.55,
        lambda w, size: replace(w, saturation=top * (1 - size)),
        lambda w, size: {"limit_n": top * (1 - size)},
        ("actuator_saturation",),
    )


def _application_point_offset(s: UnplantedCase, g: np.random.Generator) -> Plant:
    angle, half = draw_angle(g), min(s.world.half_size[:2])
    return Plant(
        "application_point_offset",
        0.6,
        lambda w, size: replace(w, point_offset=vector(size * half, angle)),
        lambda w, size: dict(zip(("x_m", "y_m"), vector(size * half, angle), strict=True)),
        ("application_point_offset",),
    )


def _force_misalignment(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)
    return Plant(
        "force_misalignment",
        0.5,
        lambda w, size: replace(w, misalignment=sign * size),
        lambda w, size: {"angle_rad": sign * size},
        ("force_misalignment",),
    )


def _observation_delay(s: UnplantedCase, g: np.random.Generator) -> Plant:
    return Plant(
        "observation_delay",
        0.4,
        lambda w, size: replace(w, observation_delay=size),
        lambda w, size: {"delay_s": size},
        ("actuator_delay", "observation_delay"),
    )


def _sensor_scale(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign = draw_sign(g)
    return Plant(
        "sensor_scale",
        0.25,
        lambda w, size: replace(w, sensor_scale=math.exp(sign * size)),
        lambda w, size: {"ratio": math.exp(sign * size)},
        ("sensor_scale",),
    )


VOCABULARY: dict[str, Draw] = {
    f.__name__[1:]: f
    for f in (
        _mass, _friction, _com_offset, _inertia, _anisotropic_friction, _viscous_drag, _air_drag, _stribeck, _stiction,
        _friction_patch, _contact_pressure, _rotational_damping, _floor_tilt, _wind, _tether, _mass_leak,
        _actuator_gain, _actuator_delay, _actuator_lag, _actuator_saturation, _application_point_offset,
        _force_misalignment,
        _observation_delay, _sensor_scale,
    )
}  # fmt: skip
