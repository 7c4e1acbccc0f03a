"""Effects that the vocabulary has no word for: the right answer to each is `unknown`."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from runner.blind.draws import draw_angle, draw_sign
from runner.blind.planar_box.physics import World
from runner.blind.planar_box.plants.plant import Draw, Plant, UnplantedCase


def _unknown(name: str, largest: float, edit: Callable[[World, float], World], **true: float) -> Plant:
    return Plant(name, largest, edit, lambda w, size: {"size": size, **true}, ("unknown",))


def _periodic_force(s: UnplantedCase, g: np.random.Generator) -> Plant:
    way, hz, phase, unit = draw_angle(g), float(g.uniform(0.3, 1.5)), draw_angle(g), s.friction_n

    def edit(w: World, size: float) -> World:
        return replace(w, periodic=size * unit, periodic_direction=way, periodic_hz=hz, periodic_phase=phase)

    return _unknown("periodic_force", 0.6, edit, unit_n=unit, direction_rad=way, frequency_hz=hz)


def _cogging_torque(s: UnplantedCase, g: np.random.Generator) -> Plant:
    teeth, phase, unit = int(g.integers(2, 6)), draw_angle(g), s.spin_n_m
    return _unknown(
        "cogging_torque",
        0.8,
        lambda w, size: replace(w, cogging=size * unit, cogging_teeth=teeth, cogging_phase=phase),
        unit_n_m=unit,
        teeth=float(teeth),
        phase_rad=phase,
    )


def _deflection(s: UnplantedCase, g: np.random.Generator) -> Plant:
    sign, unit = draw_sign(g), s.friction_n
    return _unknown(
        "deflection", 1.5, lambda w, size: replace(w, deflection=sign * size * unit), sign=sign, unit_n_s_per_m=unit
    )


def _wear(s: UnplantedCase, g: np.random.Generator) -> Plant:
    total, sign = s.episodes[-1].elapsed_s + s.episodes[-1].duration_s, float(g.choice([1.0, 1.0, -0.6]))
    return _unknown("wear", 0.8, lambda w, size: replace(w, wear=sign * size / total), sign=sign, whole_time_s=total)


def _deadband(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return _unknown("deadband", 0.5, lambda w, size: replace(w, deadband=size * unit), unit_n=unit)


def _wandering_force(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit, seed = s.friction_n, int(g.integers(2**31))
    return _unknown(
        "wandering_force", 0.5, lambda w, size: replace(w, wander=size * unit, wander_seed=seed), unit_n=unit
    )


def _barrier(s: UnplantedCase, g: np.random.Generator) -> Plant:
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


def _vortex(s: UnplantedCase, g: np.random.Generator) -> Plant:
    place, radius, unit, sign = s.place(g), float(g.uniform(0.5, 1.3)), s.friction_n, draw_sign(g)
    return _unknown(
        "vortex",
        0.7,
        lambda w, size: replace(w, vortex=sign * size * unit, vortex_place=place, vortex_radius=radius),
        unit_n=unit,
        x_m=place[0],
        y_m=place[1],
        radius_m=radius,
    )


def _quantised_force(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit = s.friction_n
    return _unknown("quantised_force", 1.5, lambda w, size: replace(w, quantum=size * unit), unit_n=unit)


def _crosstalk(s: UnplantedCase, g: np.random.Generator) -> Plant:
    unit, sign = 1.0 / s.friction_n, draw_sign(g)
    return _unknown(
        "crosstalk", 0.4, lambda w, size: replace(w, crosstalk=sign * size * unit), sign=sign, unit_per_n=unit
    )


OUTSIDE: dict[str, Draw] = {
    f.__name__[1:]: f
    for f in (
        _periodic_force, _cogging_torque, _deflection, _wear, _deadband, _wandering_force, _barrier, _vortex,
        _quantised_force, _crosstalk,
    )
}  # fmt: skip
