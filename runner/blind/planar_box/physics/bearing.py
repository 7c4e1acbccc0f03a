"""How the base bears in a state: for looking at, an integration does without."""

from __future__ import annotations

import numpy as np

from runner.blind.planar_box.physics import compiled
from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.pack import pack
from runner.blind.planar_box.physics.surface import base_points
from runner.blind.planar_box.physics.world import World


def base_load(world: World, state: np.ndarray, *, wrench: np.ndarray | None = None) -> dict[str, float]:
    """Return how the base bears: centre of load (m), share lifted, friction (N, N m), all in body axes.

    Args:
        world: The box and all around it.
        state: Shape (6,).
        wrench: As `carried_out` gives it, shape (8,); none: no push.
    """
    p = pack(world)
    if wrench is not None:
        p[at.A0 : at.A7 + 1] = wrench
    n = int(p[at.POINTS])
    mu, out = np.empty(n), np.empty(15)
    a, b, d, weight, *_ = compiled.balance(p, np.asarray(state, float), 0.0, mu, out)
    x, y, w, _ = base_points(world)
    load = w * np.maximum(a + b * x + d * y, 0.0)
    return {
        "x_m": float(load @ x),
        "y_m": float(load @ y),
        "total": float(load.sum()),
        "lifted": float(w[load <= 0.0].sum()),
        "fx_n": -weight * float(np.array([a, b, d]) @ out[6:9]),
        "fy_n": -weight * float(np.array([a, b, d]) @ out[9:12]),
        "torque_n_m": -weight * float(np.array([a, b, d]) @ out[12:15]),
    }
