"""Recordings for tests, made by the simulator itself: known effects, known start states, known noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from runner.inference.least_squares import Fitter
from runner.noise.measured import measure
from runner.recording import Episode, Form, Noise, Nominal, Recording
from runner.systems.planar_box.simulator import BASE_POINTS, Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import Effects
from runner.systems.simulator import Run

RATE_HZ = 60.0
NOISE = Noise(0.002, 0.003, 0.01, 0.015)
SIGMA = np.array([0.002, 0.002, 0.003, 0.01, 0.01, 0.015])
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE_HZ, noise=NOISE)


def made(
    effects: Effects = (), *, noise: float = 1.0, seed: int = 0, episodes: int = 5, seconds: float = 6.0
) -> tuple[Recording, np.ndarray]:
    """Return a recording of a box that is pushed about, and its true start states, (E, 6).

    Pushes of 12 to 20 N in changing directions, central and off-centre in turn, 0.8 s each, with rests between.

    Args:
        effects: What differs from the nominal model.
        noise: White noise, in multiples of `SIGMA`.
        seed: Of pushes, starts and noise.
        episodes: How many.
        seconds: Length of each.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ) + 1
    starts = rng.normal(size=(episodes, 6)) * [0.5, 0.5, 1.0, 0.3, 0.3, 0.3]
    blank = []
    for e in range(episodes):
        t = np.arange(count) / RATE_HZ
        k = (t / 0.8).astype(int)
        # to and fro, so that the box stays about
        turn = rng.uniform(-np.pi, np.pi) + np.pi * (k // 2 % 2) + rng.uniform(-0.6, 0.6, size=k.max() + 1)[k]
        size = rng.uniform(12, 20, size=k.max() + 1)[k] * (k % 3 < 2)
        point = rng.uniform(-0.25, 0.25, size=(k.max() + 1, 2))[k] * (k % 2)[:, None]
        force = np.stack([size * np.cos(turn), size * np.sin(turn), 0 * t], axis=1)
        arm = np.column_stack([point * (size > 0)[:, None], 0 * t])
        blank.append(Episode(e, t, np.zeros((count, 3)), np.zeros((count, 3)), force, arm))
    empty = Recording(Path("made"), Form.PLANAR, NOMINAL, tuple(blank))
    return measured_as(empty, [effects] * episodes, rng, starts=starts, sigma=noise * SIGMA), starts


def measured_as(
    commanded: Recording,
    effects: Sequence[Effects],
    rng: np.random.Generator,
    *,
    starts: np.ndarray | None = None,
    sigma: np.ndarray = SIGMA,
    grid: int = BASE_POINTS,
) -> Recording:
    """Return a recording with what would be measured under its commands.

    Args:
        commanded: Episodes with their commands; poses and twists are replaced.
        effects: What differs from the nominal model, of each episode.
        rng: Of the noise, and of the starts where none are given.
        starts: Start states, (E, 6); None: at rest, within a metre, at any yaw.
        sigma: White noise of each channel, (6,).
        grid: Base points along each edge.
    """
    simulator = Simulator(commanded, grid=grid, threads=1)
    full = []
    for e, episode in enumerate(commanded.episodes):
        start = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3), 0, 0, 0]) if starts is None else starts[e]
        motion = simulator.predict(e, [Run(effects[e], start)])[0]
        motion += sigma * rng.normal(size=motion.shape)
        full.append(replace(episode, pose=motion[:, :3], twist=motion[:, 3:]))
    return replace(commanded, episodes=tuple(full))


def fitter_of(recording: Recording) -> Fitter:
    """Return a fitter of a recording, with one thread."""
    system = PlanarBox(recording)
    return Fitter(system, system.simulator(threads=1), measure(system))
