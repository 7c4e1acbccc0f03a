"""Where box and floor meet: the base points, and the texture of the floor."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.planar_box.physics.layout import TEXTURE_CELLS
from runner.blind.planar_box.physics.world import World

BASE_POINTS = 16  # per side
TEXTURE_CELL_M = 0.125


def base_points(world: World, points: int = BASE_POINTS) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y (m, body axes), share of the load at rest, and share of the area of each point, shape (n,) each.

    Gauss-Legendre in both axes; `corners`: the four corners. A rim is the band of the outer 20 % of each half size, a
    middle is the inner half of it; each takes `pressure` of the whole load, with the nodes laid out in panels that end
    where the pressure jumps.
    """
    hx, hy, _ = world.half_size
    if world.contact == "corners":
        x, y = np.array([1.0, 1.0, -1.0, -1.0]), np.array([1.0, -1.0, 1.0, -1.0])
        return x * hx, y * hy, np.full(4, 0.25), np.full(4, 0.25)
    panels = [(-1.0, 1.0, points)]
    if world.pressure > 0.0:
        outer, inner = max(points * 3 // 16, 1), max(points // 4, 1)
        panels = [(-1.0, -0.8, outer), (-0.8, -0.5, outer), (-0.5, 0.5, inner), (0.5, 0.8, outer), (0.8, 1.0, outer)]
    nodes, weights = [], []
    for low, high, n in panels:
        z, v = np.polynomial.legendre.leggauss(n)
        nodes.append(0.5 * (low + high) + 0.5 * (high - low) * z)
        weights.append(0.25 * (high - low) * v)
    x, y = (a.ravel() for a in np.meshgrid(np.concatenate(nodes), np.concatenate(nodes), indexing="ij"))
    area = np.outer(np.concatenate(weights), np.concatenate(weights)).ravel()
    load = area
    if world.pressure > 0.0:
        radius = np.maximum(abs(x), abs(y))
        chosen = area * ((radius > 0.8) if world.pressure_where == "rim" else (radius < 0.5))
        load = (1.0 - world.pressure) * area + world.pressure * chosen / chosen.sum()
    return x * hx, y * hy, load, area


def floor_texture(world: World) -> np.ndarray:
    """Return the texture at the nodes of its periodic grid, shape (TEXTURE_CELLS, TEXTURE_CELLS): x, then y.

    A Gaussian random field of standard deviation 1 and mean `-texture_mean`, to be multiplied by `texture`.
    """
    white = np.random.default_rng(world.texture_seed).standard_normal((TEXTURE_CELLS, TEXTURE_CELLS))
    k = 2.0 * math.pi * np.fft.fftfreq(TEXTURE_CELLS, TEXTURE_CELL_M)
    spectrum = np.exp(-0.25 * (k[:, None] ** 2 + k[None, :] ** 2) * world.texture_length**2)
    smooth = np.fft.ifft2(np.fft.fft2(white) * spectrum).real
    smooth -= smooth.mean()
    return smooth / smooth.std() - world.texture_mean
