"""Bodies, and how they come to the table: tossed from high, let fall from low, slid over it."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from runner.blind.drake_body.physics import Shape, Toss, World, lowest_m

RATES_HZ = (100.0, 120.0, 148.0, 148.0, 200.0)
# at which a body bobs on four corners, and the damping ratio of that: no less than the steps of the engine resolve
BOUNCE_HZ, BOUNCE_RATIO = (60.0, 90.0), (0.35, 0.8)
KINDS = ("tossed", "tossed", "dropped", "slid")
FACES = {  # rotation vectors, in quarter turns, that put a face down
    Shape.CUBE: ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (2, 0, 0)),
    Shape.BOX: ((0, 0, 0), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (2, 0, 0)),
    Shape.CYLINDER: ((0, 0, 0), (2, 0, 0)),
}


def draw_world(g: np.random.Generator) -> World:
    """Draw a body of 5 to 12 cm, as heavy as wood or plastic, and a table; numbers as an owner would state them."""
    shape = list(Shape)[int(g.integers(len(Shape)))]
    edges = {
        Shape.CUBE: np.ones(3),
        Shape.BOX: np.sort(g.uniform(0.5, 1.3, 3))[::-1],
        Shape.CYLINDER: np.array([1.0, 1.0, g.uniform(0.6, 1.6)]),
    }[shape]
    hx, hy, hz = (float(f"{v:.3g}") for v in g.uniform(0.03, 0.055) * edges)
    volume = (2.0 * math.pi if shape is Shape.CYLINDER else 8.0) * hx * hy * hz
    mass = float(f"{volume * g.uniform(400.0, 1200.0):.3g}")
    bounce, ratio = 2.0 * math.pi * float(g.uniform(*BOUNCE_HZ)), float(g.uniform(*BOUNCE_RATIO))
    return World(
        shape, (hx, hy, hz), mass, stiffness_n_per_m=0.25 * mass * bounce**2, relaxation_s=2.0 * ratio / bounce,
        friction=float(f"{g.uniform(0.12, 0.4):.2g}"),
    )  # fmt: skip


def draw_toss(world: World, kind: str, rate_hz: float, g: np.random.Generator) -> Toss:
    """Draw one of a kind, 1 to 2 s long."""
    heading = float(g.uniform(-math.pi, math.pi))
    faces = FACES[world.shape]
    upright = Rotation.from_rotvec(0.5 * math.pi * np.array(faces[int(g.integers(len(faces)))], float))
    flat = Rotation.from_rotvec([0.0, 0.0, g.uniform(-math.pi, math.pi)]) * upright
    if kind == "tossed":
        turn = Rotation.random(rng=g)
        spin = g.normal(0.0, 5.0, 3)
        speed, rising, gap_m = g.uniform(0.2, 1.5), g.uniform(-0.5, 1.5), g.uniform(0.15, 0.5)
    elif kind == "dropped":
        turn = Rotation.from_rotvec(g.normal(0.0, 0.15, 3)) * flat
        spin = g.normal(0.0, 1.5, 3)
        speed, rising, gap_m = g.uniform(0.0, 0.6), g.uniform(-0.2, 0.3), g.uniform(0.01, 0.06)
    else:
        turn = flat
        spin = np.array([0.0, 0.0, g.normal(0.0, 4.0)])
        speed, rising, gap_m = g.uniform(0.5, 1.5), 0.0, 2e-4
    velocity = np.array([speed * math.cos(heading), speed * math.sin(heading), rising])
    height = gap_m - float(lowest_m(world, turn.as_matrix()[None], np.zeros(1))[0])
    place = np.array([*g.uniform(-0.2, 0.2, 2), height])
    samples = round(float(g.uniform(1.0, 2.0)) * rate_hz)
    return Toss(place, turn.as_quat()[[3, 0, 1, 2]], spin, velocity, rate_hz, samples)
