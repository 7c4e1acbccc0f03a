"""The base as Drake has it: small spheres on springs, at the nodes of a quadrature."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from runner.blind.planar_box.physics import World

NODES = 6  # per side; with Gauss's weights the moments of the load are exact
BOUNCE_HZ = 100.0  # at which the box would bob on its springs: 25 um deep, settled within 5 ms
RADIUS_M = 5e-3


@dataclass(frozen=True)
class Base:
    """Points and springs.

    Args:
        x, y: Body axes from the geometric centre, m, shape (n,).
        share: Of the load at rest, shape (n,).
        stiffness_n_per_m: Of all together.
        sink_m: How deep the box stands.
    """

    x: np.ndarray
    y: np.ndarray
    share: np.ndarray
    stiffness_n_per_m: float
    sink_m: float

    @property
    def dissipation_s_per_m(self) -> float:
        """Hunt and Crossley's, so that bobbing is critically damped: 2 / (w sink)."""
        return 2.0 / (2.0 * math.pi * BOUNCE_HZ * self.sink_m)


def base_of(world: World, nodes: int = NODES) -> Base:
    """Return the points that carry a box: a grid of Gauss-Legendre nodes, or its four corners.

    A pressure at the rim grows with the eighth power of the distance from the middle, in half sizes; one in the middle
    falls off as a bell of 0.35 half sizes.
    """
    hx, hy, _ = world.half_size
    z, v = np.polynomial.legendre.leggauss(nodes)
    if world.contact == "corners":
        z, v = np.array([-1.0, 1.0]), np.array([1.0, 1.0])
    x, y = (a.ravel() for a in np.meshgrid(z, z, indexing="ij"))
    share = np.outer(v, v).ravel() / 4.0
    if world.pressure > 0.0:
        profile = (
            np.maximum(abs(x), abs(y)) ** 8 if world.pressure_where == "rim" else np.exp(-0.5 * (x**2 + y**2) / 0.35**2)
        )
        profile = profile * share
        share = (1.0 - world.pressure) * share + world.pressure * profile / profile.sum()
    omega = 2.0 * math.pi * BOUNCE_HZ
    return Base(x * hx, y * hy, share, world.mass * omega**2, world.gravity / omega**2)
