"""Effects that the vocabulary has no word for, and that the first world does not have either."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from runner.blind.drake_box.physics import Scene
from runner.blind.draws import draw_angle
from runner.blind.planar_box.plants import UnplantedCase


@dataclass(frozen=True)
class Outsider:
    """One effect without a word, drawn but for its size; `edit` and `true` as a plant has them."""

    largest: float
    edit: Callable[[Scene, float], Scene]
    true: dict[str, float]


def _strange(largest: float, fields: Callable[[float], dict[str, Any]], **true: float) -> Outsider:
    def edit(scene: Scene, size: float) -> Scene:
        return replace(scene, strange=replace(scene.strange, **fields(size)))

    return Outsider(largest, edit, true)


def _magnet(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    place, reach, unit = s.place(g), float(g.uniform(0.15, 0.5)), s.friction_n
    return _strange(
        1.2,
        lambda size: {"magnet": size * unit, "magnet_place": place, "magnet_reach": reach},
        unit_n=unit, x_m=place[0], y_m=place[1], reach_m=reach,
    )  # fmt: skip


def _root_drag(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    unit = s.friction_n
    return _strange(0.8, lambda size: {"root_drag": size * unit}, unit=unit)


def _caster(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    hx, hy, _ = s.world.half_size
    place, angle = (hx * float(g.uniform(-0.8, 0.8)), hy * float(g.uniform(-0.8, 0.8))), draw_angle(g)
    unit = 3.0 * s.friction_n
    return _strange(
        1.0,
        lambda size: {"caster": size * unit, "caster_place": place, "caster_angle": angle},
        unit_n_s_per_m=unit, x_m=place[0], y_m=place[1], angle_rad=angle,
    )  # fmt: skip


def _nap(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    way = draw_angle(g)
    return _strange(0.7, lambda size: {"nap": size, "nap_direction": way}, direction_rad=way)


def _vibrating_floor(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    hz, phase = float(g.uniform(0.5, 6.0)), draw_angle(g)
    return _strange(
        0.9, lambda size: {"vibration": size, "vibration_hz": hz, "vibration_phase": phase}, frequency_hz=hz
    )


def _warming(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    unit, cooling = 1.0 / s.friction_n, float(g.uniform(2.0, 10.0))
    return _strange(
        1.5, lambda size: {"warming": size * unit, "cooling_s": cooling}, unit_per_j=unit, cooling_s=cooling
    )


def _wall(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    """A wall that the corners of the box touch: size 0 is as far as they come without it, 1 where an episode starts."""
    hx, hy, _ = s.world.half_size

    def reach(rows: np.ndarray, way: float) -> np.ndarray:
        turned = rows[:, 2] - way
        return (
            rows[:, 0] * math.cos(way)
            + rows[:, 1] * math.sin(way)
            + hx * abs(np.cos(turned))
            + hy * abs(np.sin(turned))
        )

    starts, rows = np.array([e.start for e in s.episodes]), np.concatenate(s.paths)
    ways = g.uniform(-math.pi, math.pi, 24)
    depth = [float(np.max(reach(rows, w)) - np.max(reach(starts, w))) for w in ways]
    way = float(ways[int(np.argmax(depth))])
    far, near = float(np.max(reach(rows, way))), float(np.max(reach(starts, way))) + 0.02
    mu = float(g.uniform(0.05, 0.4))
    return _strange(
        1.0,
        lambda size: {
            "wall_distance": far + size * (near - far), "wall_direction": way, "wall_friction": mu,
        },
        direction_rad=way, from_m=far, to_m=near, friction=mu,
    )  # fmt: skip


def _loose_mass(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    hz, damping = float(g.uniform(0.5, 2.5)), float(g.uniform(0.05, 0.3))
    return _strange(
        0.6,
        lambda size: {"loose_share": size, "loose_hz": hz, "loose_damping": damping},
        frequency_hz=hz,
        damping=damping,
    )


def _quantised_push(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    unit = s.friction_n
    return Outsider(
        1.8, lambda scene, size: replace(scene, world=replace(scene.world, quantum=size * unit)), {"unit_n": unit}
    )


def _dropouts(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    seed, mean_s = int(g.integers(2**31)), float(g.uniform(0.04, 0.25))
    return _strange(0.6, lambda size: {"dropouts": size, "dropout_s": mean_s, "dropout_seed": seed}, mean_s=mean_s)


def _slew_limit(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    """The size is the time in which the force grows by the friction."""
    unit = s.friction_n
    return _strange(1.0, lambda size: {"slew_n_per_s": unit / size}, unit_n=unit)


def _kick(s: UnplantedCase, g: np.random.Generator) -> Outsider:
    unit, way, at = s.world.mass, draw_angle(g), float(g.uniform(0.2, 0.7))
    return _strange(
        1.5, lambda size: {"kick": size * unit, "kick_direction": way, "kick_at": at}, unit_n_s=unit, direction_rad=way
    )


OUTSIDE: dict[str, Callable[[UnplantedCase, np.random.Generator], Outsider]] = {
    f.__name__[1:]: f
    for f in (
        _magnet, _root_drag, _caster, _nap, _vibrating_floor, _warming, _wall, _loose_mass, _quantised_push, _dropouts,
        _slew_limit, _kick,
    )
}  # fmt: skip
