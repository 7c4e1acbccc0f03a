"""How far a world is from what its owner believes, besides the effect: sizes, floor, timing, the noise as stated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from runner.blind.drake_box.physics import STEP_S, DrakeError, Scene, simulate_all
from runner.blind.make import error_ratio
from runner.blind.planar_box.physics import World
from runner.blind.planar_box.plants import UnplantedCase
from runner.blind.planar_box.reality import mean_texture

# rms on the trajectories at a roughness of 1, in units of the noise
SIZES, TEXTURE, LATE = 2.0, 1.0, 1.0
MISSTATED = 1.5  # factor on the noise
WIDEST = {"half_size": 0.04, "texture": 0.06}  # relative, whatever the roughness
COARSE = {"step_s": STEP_S, "nodes": 6}
FINE = {"step_s": STEP_S / 2.0, "nodes": 8}


def simulate_or_none(scene: Scene, case: UnplantedCase, how: dict = COARSE) -> list[np.ndarray] | None:
    """Return the motion, or none where the engine can't go on or the box tips."""
    try:
        return simulate_all(scene, case.episodes, **how)
    except DrakeError:
        return None


def roughened(
    case: UnplantedCase, roughness: float, sigma: np.ndarray, g: np.random.Generator
) -> tuple[Scene, dict[str, float]]:
    """Return the world as it is but for any effect, and how it differs from what is believed.

    Each departure is drawn by how far it moves the recording, up to its share of the roughness, and found in one step,
    as it moves it about in proportion.
    """
    sides, length, seed = float(g.choice([-1.0, 1.0])), float(g.uniform(0.2, 0.7)), int(g.integers(2**31))
    late_seed = int(g.integers(2**31))
    wanted = roughness * g.uniform(0.0, 1.0, 3) * (SIZES, TEXTURE, LATE)
    if roughness == 0.0:
        return Scene(case.world), {}
    floor = replace(case.world, texture=0.02, texture_seed=seed, texture_length=length)
    floor = replace(floor, texture_mean=mean_texture(floor, case.paths))

    def resized(world: World, share: float) -> World:
        hx, hy, hz = (h * (1.0 + sides * share) for h in world.half_size)
        return replace(world, half_size=(hx, hy, hz))

    def found(size: float, largest: float, want: float, scene_of: Callable[[float], Scene]) -> float:
        moved = error_ratio(simulate_or_none(scene_of(size), case), case.paths, sigma)
        return min(size * want / max(moved, 1e-9), largest) if math.isfinite(moved) else 0.0

    share = found(0.01, WIDEST["half_size"], wanted[0], lambda v: Scene(resized(case.world, v)))
    texture = found(0.02, WIDEST["texture"], wanted[1], lambda v: Scene(replace(floor, texture=v)))
    late = found(0.5, min(roughness, 1.0), wanted[2], lambda v: Scene(case.world, late=v, late_seed=late_seed))
    real = Scene(resized(replace(floor, texture=texture), share), late=late, late_seed=late_seed)
    told = {"half_size": sides * share, "texture": texture, "texture_length_m": length, "late_samples": late}
    # what of the lateness is no more than a constant delay
    told["late_mean_s"] = 0.5 * late / case.episodes[0].rate_hz
    return real, {name: round(float(value), 6) for name, value in told.items()}


def misstated(noise: dict[str, float], roughness: float, g: np.random.Generator) -> dict[str, float]:
    """Return the standard deviations as the owner has them, each off by a factor of its own."""
    factor = {kind: MISSTATED ** (min(roughness, 1.0) * float(g.uniform(-1.0, 1.0))) for kind in noise}
    return {kind: float(f"{value * factor[kind]:.2g}") for kind, value in noise.items()}
