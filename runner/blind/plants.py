"""Effects to plant in the second physics: each drawn at random but for its size, which is found afterwards.

A plant holds everything about one effect except how large it is. Sizes are positive and have a largest value that is
physically sensible; zero is no effect at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runner.blind.physics import Episode, World
from runner.errors import ConfigError, nearest


@dataclass(frozen=True)
class Plant:
    """One effect, drawn but for its size.

    Args:
        name: Word of the vocabulary, or the name of an effect that the vocabulary does not have.
        largest: Largest size that is physically sensible.
        edit: World and size to the world with the effect.
        true: World and size to the true values, SI units.
        accept: Words that count as the right answer, exact equivalents included.
    """

    name: str
    largest: float
    edit: Callable[[World, float], World]
    true: Callable[[World, float], dict[str, float | str]]
    accept: tuple[str, ...]


@dataclass(frozen=True)
class Scene:
    """What a plant is drawn for: the world, its episodes, and where the box goes without any effect.

    Args:
        world: As the owner believes it to be.
        episodes: What is done to it.
        paths: Motion without any effect, one (n, 6) for each episode.
    """

    world: World
    episodes: list[Episode]
    paths: list[np.ndarray]

    @property
    def weight_n(self) -> float:
        """Weight of the box, N."""
        return self.world.mass * self.world.gravity

    @property
    def friction_n(self) -> float:
        """Friction of the sliding box, N."""
        return self.world.friction * self.weight_n

    @property
    def spin_n_m(self) -> float:
        """Friction torque of the box that turns on the spot, about, N m."""
        return self.friction_n * 0.38 * (self.world.half_size[0] + self.world.half_size[1])

    @property
    def kern(self) -> float:
        """How far the centre of mass may be off, in half sizes, before the base would tip when sliding."""
        return min(0.6, 0.85 - self.world.friction * self.world.half_size[2] / min(self.world.half_size[:2]))

    def place(self, g: np.random.Generator) -> tuple[float, float]:
        """Draw a place that the box passes."""
        path = self.paths[int(g.integers(len(self.paths)))]
        row = path[int(g.integers(len(path)))]
        return float(row[0] + g.normal(0, 0.1)), float(row[1] + g.normal(0, 0.1))


def _turn(g: np.random.Generator) -> float:
    return float(g.uniform(-math.pi, math.pi))


def _sign(g: np.random.Generator) -> float:
    return float(g.choice([-1.0, 1.0]))


def _polar(size: float, angle: float) -> tuple[float, float]:
    return size * math.cos(angle), size * math.sin(angle)


def _mass(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)

    def edit(w: World, size: float) -> World:
        factor = math.exp(sign * size)
        return replace(w, mass=w.mass * factor, inertia=None if w.inertia is None else w.inertia * factor)

    return Plant(
        "mass", 0.7, edit, lambda w, size: {"mass_kg": w.mass * math.exp(sign * size)}, ("actuator_gain", "mass")
    )


def _friction(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)
    return Plant(
        "friction",
        0.5,
        lambda w, size: replace(w, friction=w.friction * math.exp(sign * size)),
        lambda w, size: {"friction": w.friction * math.exp(sign * size)},
        ("friction",),
    )


def _com_offset(s: Scene, g: np.random.Generator) -> Plant:
    angle, half = _turn(g), min(s.world.half_size[:2])
    return Plant(
        "com_offset",
        s.kern,
        lambda w, size: replace(w, com=_polar(size * half, angle)),
        lambda w, size: dict(zip(("x_m", "y_m"), _polar(size * half, angle), strict=True)),
        ("com_offset",),
    )


def _inertia(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)
    return Plant(
        "inertia",
        1.0 if sign < 0 else 0.7,
        lambda w, size: replace(w, inertia=w.yaw_inertia * math.exp(sign * size)),
        lambda w, size: {"inertia_kg_m2": w.yaw_inertia * math.exp(sign * size)},
        ("inertia",),
    )


def _anisotropic_friction(s: Scene, g: np.random.Generator) -> Plant:
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


def _viscous_drag(s: Scene, g: np.random.Generator) -> Plant:
    acts, unit = str(g.choice(["body", "film"])), s.friction_n
    name = "film" if acts == "film" else "viscous_drag"
    return Plant(
        "viscous_drag",
        2.0,
        lambda w, size: replace(w, **{name: size * unit}),
        lambda w, size: {"coefficient_n_s_per_m": size * unit, "acts": acts},
        ("viscous_drag",),
    )


def _air_drag(s: Scene, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return Plant(
        "air_drag",
        2.0,
        lambda w, size: replace(w, air_drag=size * unit),
        lambda w, size: {"coefficient_n_s2_per_m2": size * unit},
        ("air_drag",),
    )


def _stribeck(s: Scene, g: np.random.Generator) -> Plant:
    sign, speed = float(g.choice([-1.0, 1.0, 1.0])), float(np.exp(g.uniform(math.log(0.08), math.log(0.6))))
    return Plant(
        "stribeck",
        0.6 if sign > 0 else 0.5,
        lambda w, size: replace(w, stribeck=sign * size, stribeck_speed=speed),
        lambda w, size: {"change": sign * size, "speed_m_per_s": speed},
        ("stribeck",),
    )


def _stiction(s: Scene, g: np.random.Generator) -> Plant:
    speed = float(g.uniform(1e-3, 4e-3))
    return Plant(
        "stiction",
        0.6,
        lambda w, size: replace(w, stiction=size, stiction_speed=speed),
        lambda w, size: {"excess": size, "speed_m_per_s": speed},
        ("stiction",),
    )


def _friction_patch(s: Scene, g: np.random.Generator) -> Plant:
    place, shape = s.place(g), "disc" if g.random() < 0.6 else "gaussian"
    sign = _sign(g)
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


def _contact_pressure(s: Scene, g: np.random.Generator) -> Plant:
    where = str(g.choice(["rim", "middle"]))
    return Plant(
        "contact_pressure",
        0.95,
        lambda w, size: replace(w, pressure=size, pressure_where=where),
        lambda w, size: {"share": size, "where": where},
        ("contact_pressure",),
    )


def _rotational_damping(s: Scene, g: np.random.Generator) -> Plant:
    unit = s.spin_n_m
    return Plant(
        "rotational_damping",
        1.0,
        lambda w, size: replace(w, rotational_damping=size * unit),
        lambda w, size: {"coefficient_n_m_s": size * unit},
        ("rotational_damping",),
    )


def _floor_tilt(s: Scene, g: np.random.Generator) -> Plant:
    downhill = _turn(g)
    return Plant(
        "floor_tilt",
        min(0.15, 0.5 * s.world.friction),
        lambda w, size: replace(w, tilt=size, downhill=downhill),
        lambda w, size: {"angle_rad": size, "downhill_rad": downhill},
        ("floor_tilt", "wind"),
    )


def _wind(s: Scene, g: np.random.Generator) -> Plant:
    angle, unit = _turn(g), s.friction_n
    return Plant(
        "wind",
        0.5,
        lambda w, size: replace(w, wind=_polar(size * unit, angle)),
        lambda w, size: {"force_n": size * unit, "direction_rad": angle},
        ("floor_tilt", "wind"),
    )


def _tether(s: Scene, g: np.random.Generator) -> Plant:
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


def _mass_leak(s: Scene, g: np.random.Generator) -> Plant:
    sign = float(g.choice([1.0, 1.0, 1.0, -1.0]))
    return Plant(
        "mass_leak",
        0.09,
        lambda w, size: replace(w, mass_leak=sign * size),
        lambda w, size: {"share_per_s": sign * size},
        ("mass_leak",),
    )


def _actuator_gain(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)
    return Plant(
        "actuator_gain",
        0.5,
        lambda w, size: replace(w, gain=w.gain * math.exp(sign * size)),
        lambda w, size: {"gain": w.gain * math.exp(sign * size)},
        ("actuator_gain", "mass"),
    )


def _actuator_delay(s: Scene, g: np.random.Generator) -> Plant:
    return Plant(
        "actuator_delay",
        0.4,
        lambda w, size: replace(w, delay=size),
        lambda w, size: {"delay_s": size},
        ("actuator_delay", "observation_delay"),
    )


def _actuator_lag(s: Scene, g: np.random.Generator) -> Plant:
    return Plant(
        "actuator_lag",
        0.5,
        lambda w, size: replace(w, lag=size),
        lambda w, size: {"time_constant_s": size},
        ("actuator_lag",),
    )


def _actuator_saturation(s: Scene, g: np.random.Generator) -> Plant:
    top = max(float(np.max(np.hypot(e.command[:, 0], e.command[:, 1]))) for e in s.episodes)
    return Plant(
        "actuator_saturation",
        0.55,
        lambda w, size: replace(w, saturation=top * (1 - size)),
        lambda w, size: {"limit_n": top * (1 - size)},
        ("actuator_saturation",),
    )


def _application_point_offset(s: Scene, g: np.random.Generator) -> Plant:
    angle, half = _turn(g), min(s.world.half_size[:2])
    return Plant(
        "application_point_offset",
        0.6,
        lambda w, size: replace(w, point_offset=_polar(size * half, angle)),
        lambda w, size: dict(zip(("x_m", "y_m"), _polar(size * half, angle), strict=True)),
        ("application_point_offset",),
    )


def _force_misalignment(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)
    return Plant(
        "force_misalignment",
        0.5,
        lambda w, size: replace(w, misalignment=sign * size),
        lambda w, size: {"angle_rad": sign * size},
        ("force_misalignment",),
    )


def _observation_delay(s: Scene, g: np.random.Generator) -> Plant:
    return Plant(
        "observation_delay",
        0.4,
        lambda w, size: replace(w, observation_delay=size),
        lambda w, size: {"delay_s": size},
        ("actuator_delay", "observation_delay"),
    )


def _sensor_scale(s: Scene, g: np.random.Generator) -> Plant:
    sign = _sign(g)
    return Plant(
        "sensor_scale",
        0.25,
        lambda w, size: replace(w, sensor_scale=math.exp(sign * size)),
        lambda w, size: {"ratio": math.exp(sign * size)},
        ("sensor_scale",),
    )


def _unknown(name: str, largest: float, edit: Callable[[World, float], World], **true: float) -> Plant:
    return Plant(name, largest, edit, lambda w, size: {"size": size, **true}, ("unknown",))


def _periodic_force(s: Scene, g: np.random.Generator) -> Plant:
    way, hz, phase, unit = _turn(g), float(g.uniform(0.3, 1.5)), _turn(g), s.friction_n

    def edit(w: World, size: float) -> World:
        return replace(w, periodic=size * unit, periodic_direction=way, periodic_hz=hz, periodic_phase=phase)

    return _unknown("periodic_force", 0.6, edit, unit_n=unit, direction_rad=way, frequency_hz=hz)


def _cogging_torque(s: Scene, g: np.random.Generator) -> Plant:
    teeth, phase, unit = int(g.integers(2, 6)), _turn(g), s.spin_n_m
    return _unknown(
        "cogging_torque",
        0.8,
        lambda w, size: replace(w, cogging=size * unit, cogging_teeth=teeth, cogging_phase=phase),
        unit_n_m=unit,
        teeth=float(teeth),
        phase_rad=phase,
    )


def _deflection(s: Scene, g: np.random.Generator) -> Plant:
    sign, unit = _sign(g), s.friction_n
    return _unknown(
        "deflection", 1.5, lambda w, size: replace(w, deflection=sign * size * unit), sign=sign, unit_n_s_per_m=unit
    )


def _wear(s: Scene, g: np.random.Generator) -> Plant:
    total, sign = s.episodes[-1].elapsed_s + s.episodes[-1].duration_s, float(g.choice([1.0, 1.0, -0.6]))
    return _unknown("wear", 0.8, lambda w, size: replace(w, wear=sign * size / total), sign=sign, whole_time_s=total)


def _deadband(s: Scene, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return _unknown("deadband", 0.5, lambda w, size: replace(w, deadband=size * unit), unit_n=unit)


def _wandering_force(s: Scene, g: np.random.Generator) -> Plant:
    unit, seed = s.friction_n, int(g.integers(2**31))
    return _unknown(
        "wandering_force", 0.5, lambda w, size: replace(w, wander=size * unit, wander_seed=seed), unit_n=unit
    )


def _barrier(s: Scene, g: np.random.Generator) -> Plant:
    """A soft wall that reaches into the paths by the size: 1 is up to where an episode starts."""
    best = (-math.inf, 0.0, 0.0, 0.0)
    for way in g.uniform(-math.pi, math.pi, 24):
        n = np.array([math.cos(way), math.sin(way)])
        behind = max(float(e.start[:2] @ n) for e in s.episodes) + 0.05
        reach = max(float(np.max(path[:, :2] @ n)) for path in s.paths)
        best = max(best, (reach - behind, float(way), behind, reach))
    _, way, behind, reach = best
    stiff, damping = s.friction_n / 0.05, float(g.uniform(0.0, 0.5)) * math.sqrt(s.friction_n / 0.05 * s.world.mass)

    def edit(w: World, size: float) -> World:
        line = reach + size * (behind - reach)
        return replace(w, barrier=stiff, barrier_direction=way, barrier_distance=line, barrier_damping=damping)

    return _unknown("barrier", 1.0, edit, stiffness_n_per_m=stiff, direction_rad=way, from_m=reach, to_m=behind)


def _vortex(s: Scene, g: np.random.Generator) -> Plant:
    place, radius, unit, sign = s.place(g), float(g.uniform(0.5, 1.3)), s.friction_n, _sign(g)
    return _unknown(
        "vortex",
        0.7,
        lambda w, size: replace(w, vortex=sign * size * unit, vortex_place=place, vortex_radius=radius),
        unit_n=unit,
        x_m=place[0],
        y_m=place[1],
        radius_m=radius,
    )


def _quantised_force(s: Scene, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return _unknown("quantised_force", 1.5, lambda w, size: replace(w, quantum=size * unit), unit_n=unit)


def _crosstalk(s: Scene, g: np.random.Generator) -> Plant:
    unit, sign = 1.0 / s.friction_n, _sign(g)
    return _unknown(
        "crosstalk", 0.4, lambda w, size: replace(w, crosstalk=sign * size * unit), sign=sign, unit_per_n=unit
    )


VOCABULARY: dict[str, Callable[[Scene, np.random.Generator], Plant]] = {
    f.__name__[1:]: f
    for f in (
        _mass, _friction, _com_offset, _inertia, _anisotropic_friction, _viscous_drag, _air_drag, _stribeck, _stiction,
        _friction_patch, _contact_pressure, _rotational_damping, _floor_tilt, _wind, _tether, _mass_leak,
        _actuator_gain, _actuator_delay, _actuator_lag, _actuator_saturation, _application_point_offset,
        _force_misalignment,
        _observation_delay, _sensor_scale,
    )
}  # fmt: skip
OUTSIDE: dict[str, Callable[[Scene, np.random.Generator], Plant]] = {
    f.__name__[1:]: f
    for f in (
        _periodic_force, _cogging_torque, _deflection, _wear, _deadband, _wandering_force, _barrier, _vortex,
        _quantised_force, _crosstalk,
    )
}  # fmt: skip
# Pairs that are one effect to any such data, or that write the same field.
TOGETHER_ALIKE = (
    {"mass", "actuator_gain"}, {"floor_tilt", "wind"}, {"actuator_delay", "observation_delay"},
)  # fmt: skip


def draw(name: str, scene: Scene, generator: np.random.Generator) -> Plant:
    """Draw an effect of the vocabulary, or one that it does not have, by name.

    Raises:
        ConfigError: If there is no such effect.
    """
    every = {**VOCABULARY, **OUTSIDE}
    if name not in every:
        raise ConfigError(f"blind.effect: no effect '{name}'. {nearest(name, every)}")
    return every[name](scene, generator)
