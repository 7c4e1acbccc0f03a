"""Where a body touches: its corners, or points along the rims of a cylinder."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.drake_body.physics.world import Shape, World

RIM = 32  # points along each rim: a wheel with so many corners bumps by 5 per mille of its radius
RADIUS_M = 1e-4  # of the spheres that stand for sharp corners


def points_of(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners (n, 3) of a body, m in its axes, and for each the way to its outside (n, 3)."""
    hx, hy, hz = world.half_size
    if world.shape is Shape.CYLINDER:
        angle = 2.0 * math.pi * np.arange(RIM) / RIM
        ring = np.column_stack([np.cos(angle), np.sin(angle), np.ones(RIM)])
        outward = np.concatenate([ring, ring * (1.0, 1.0, -1.0)])
    else:
        outward = np.array([[sx, sy, sz] for sx in (1.0, -1.0) for sy in (1.0, -1.0) for sz in (1.0, -1.0)])
    return outward * (hx, hy, hz), outward


def rounding_of(world: World) -> np.ndarray:
    """Return the radius of each corner, m, shape (n,)."""
    outward = points_of(world)[1]
    worn = outward @ np.array(world.strange.worn_side) > 0.0
    return np.where(worn, max(world.strange.worn_m, RADIUS_M), RADIUS_M)


def lowest_m(world: World, turns: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """Return how high the lowest corner is above a level table.

    Args:
        world: Of the body.
        turns: Rotation matrices, body to world, (T, 3, 3).
        heights: Of the geometric centre, m, (T,).
    """
    return heights + (turns[:, 2] @ points_of(world)[0].T).min(axis=1)
