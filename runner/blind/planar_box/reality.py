"""How a case departs from the textbook besides its effect: the box, the floor and its size, the noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from scipy.ndimage import map_coordinates

from runner.blind.make.size import error_ratio
from runner.blind.planar_box.physics import (
    TEXTURE_CELL_M,
    Accuracy,
    IntegrationError,
    PlannedEpisode,
    World,
    base_points,
    floor_texture,
    simulate_all,
)
from runner.blind.planar_box.plants import UnplantedCase

COARSE: Accuracy = {"points": 8, "rtol": 1e-6, "atol": 1e-8}  # for finding sizes: a quarter of the time


@dataclass(frozen=True)
class Reality:
    """How a case departs from the textbook besides its effect. Each can be switched off by zero.

    Args:
        texture: Range of the standard deviation of friction over the floor, relative.
        wrong_size: Range of the relative error of the nominal half size.
        mismatch_limit: The rms of both on the trajectories, in units of the noise; each is shrunk to keep it.
        coloured: Share of cases whose noise is slow in part: 40 % to all of its variance, for 20 to 120 ms.
        outliers: Share of cases in which one sample in 200 is far off.
        noise_unknown, noise_partly: Shares of cases whose noise is not stated, or only in part.
        noise_fine: Share of cases with a noise of one or two millimetres, instead of three to thirteen.
        heights: Share of cases with pushes above and below the centre.
        boxes: Share of cases with a box instead of a cube.
        corners: Share of cases whose object bears on its corners and is believed to.
    """

    texture: tuple[float, float] = (0.005, 0.01)
    wrong_size: tuple[float, float] = (0.002, 0.005)
    mismatch_limit: float = 0.6
    coloured: float = 0.18
    outliers: float = 0.08
    noise_unknown: float = 0.25
    noise_partly: float = 0.15
    noise_fine: float = 0.06
    heights: float = 0.2
    boxes: float = 0.35
    corners: float = 0.04


def simulate_or_none(
    world: World, episodes: Sequence[PlannedEpisode], **accuracy: Unpack[Accuracy]
) -> list[np.ndarray] | None:
    """Return the motion, or none where the world can't be integrated (it tips, or it runs away)."""
    try:
        return simulate_all(world, list(episodes), **accuracy)
    except IntegrationError:
        return None


def draw_world(reality: Reality, g: np.random.Generator) -> World:
    """Draw what the owner believes: in a quarter of the cases the cube of half a metre, 3 kg and friction 0.3."""
    if g.random() < 0.25:
        return World(half_size=(0.5, 0.5, 0.5), mass=3.0, friction=0.3)
    half = round(float(g.uniform(0.2, 0.6)), 3)
    sizes = (half, half, half)
    if g.random() < reality.boxes:
        sizes = (half, round(half * float(g.uniform(0.55, 1.5)), 3), round(half * float(g.uniform(0.4, 1.2)), 3))
    mass = round(float(np.exp(g.uniform(math.log(0.5), math.log(6.0)))), 3)
    tips = min(sizes[:2]) / sizes[2]
    friction = round(float(g.uniform(0.1, min(0.6, 0.65 * tips))), 3)
    contact = "corners" if g.random() < reality.corners else "patch"
    return World(half_size=sizes, mass=mass, friction=friction, contact=contact)


def draw_noise(world: World, reality: Reality, g: np.random.Generator) -> dict[str, float]:
    """Draw standard deviations with two digits."""
    fine = g.random() < reality.noise_fine
    position = float(np.exp(g.uniform(*np.log((0.001, 0.002) if fine else (0.003, 0.013)))))
    half = max(world.half_size[:2])
    velocity = position * float(g.uniform(2.5, 5.0))
    drawn = {
        "position": position,
        "yaw": position / half * float(g.uniform(0.35, 0.95)),
        "velocity": velocity,
        "rate": velocity / half * float(g.uniform(0.45, 1.15)),
    }
    return {kind: float(f"{value:.2g}") for kind, value in drawn.items()}


def mismatched(
    case: UnplantedCase, reality: Reality, sigma: np.ndarray, g: np.random.Generator
) -> tuple[World, dict[str, float]]:
    """Return the real world without any effect: an uneven floor and a slightly other size, and by how much."""
    texture = float(g.uniform(*reality.texture))
    wrong = float(g.choice([-1.0, 1.0]) * g.uniform(*reality.wrong_size))
    seed, length = int(g.integers(2**31)), float(g.uniform(0.25, 0.6))
    real = case.world
    if texture > 0.0:
        real = replace(real, texture=texture, texture_seed=seed, texture_length=length)
        real = replace(real, texture_mean=mean_texture(real, case.paths))
    # each by itself within its half (in squares) of the limit
    limit = reality.mismatch_limit / math.sqrt(2.0)

    def shrunk(size: float, world_of: Callable[[float], World]) -> float:
        for _ in range(6):
            ratio = error_ratio(simulate_or_none(world_of(size), case.episodes, **COARSE), case.paths, sigma)
            if size == 0.0 or ratio <= limit:
                break
            size *= max(0.9 * limit / ratio, 0.05)
        return size

    def resized(world: World, share: float) -> World:
        hx, hy, hz = (h * (1.0 + share) for h in case.world.half_size)
        return replace(world, half_size=(hx, hy, hz))

    texture = shrunk(texture, lambda size: replace(real, texture=size))
    wrong = shrunk(wrong, lambda size: resized(case.world, size))
    real = resized(replace(real, texture=texture), wrong)
    return real, {"texture": round(texture, 6), "texture_length_m": round(length, 3), "half_size": round(wrong, 6)}


def mean_texture(world: World, paths: list[np.ndarray]) -> float:
    """Return the mean of the texture under the moving box, in units of its standard deviation."""
    x, y, share, _ = base_points(world, 6)
    path = np.concatenate(paths)
    path = path[np.hypot(path[:, 3], path[:, 4]) + abs(path[:, 5]) * world.half_size[0] > 0.02]
    if not len(path):
        return 0.0
    c, s = np.cos(path[:, 2])[:, None], np.sin(path[:, 2])[:, None]
    places = np.stack([path[:, :1] + c * x - s * y, path[:, 1:2] + s * x + c * y]) / TEXTURE_CELL_M
    values = map_coordinates(floor_texture(world), places.reshape(2, -1), order=1, mode="grid-wrap")
    return float(np.mean(values.reshape(len(path), -1) @ share))
