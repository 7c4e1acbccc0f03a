"""Pushes of other families than the first world's: broad-band, square, swept, half sines, points that wander.

Forces are in units of the friction that the owner believes in, points in units of the half sizes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from runner.blind.planar_box.excite import Drive, growth
from runner.blind.planar_box.physics import PlannedEpisode

GROWTH_LIMIT = 6.0  # of an error of the heading at the start
REDRAWS = 40


def _at_point(drive: Drive, g: np.random.Generator, force: np.ndarray, reach: float) -> np.ndarray:
    """Return commands (n, 5) of forces (n, 2), in units of the friction, at one point."""
    point = (0.0, 0.0) if g.random() < 0.3 else drive.point(g, reach)
    height = drive.height(g, float(np.max(np.hypot(*force.T), initial=1.0)))
    return np.column_stack([force * drive.friction_n, np.full((len(force), 3), [*point, height])])


def _line(size: np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    return np.column_stack([size * np.cos(angle), size * np.sin(angle)])


def multisine(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Sums of three to five sines along each axis, 0.2 to 2 Hz."""
    force = np.zeros((len(t), 2))
    for axis in range(2):
        for _ in range(int(g.integers(3, 6))):
            hz, phase = math.exp(g.uniform(math.log(0.2), math.log(2.0))), g.uniform(-math.pi, math.pi)
            force[:, axis] += g.uniform(0.4, 1.0) * np.sin(2.0 * math.pi * hz * t + phase)
    return _at_point(drive, g, force * g.uniform(1.5, 2.6) / np.max(np.hypot(*force.T)), 0.5)


def band_limited(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """A random force without frequencies above one to three hertz."""
    hz = np.fft.rfftfreq(len(t), t[1])
    inside = (hz > 0.1) & (hz < g.uniform(1.0, 3.0))
    white = g.standard_normal((len(hz), 2)) + 1j * g.standard_normal((len(hz), 2))
    force = np.fft.irfft(white * inside[:, None], len(t), axis=0)
    return _at_point(drive, g, force * g.uniform(0.7, 1.1) / np.std(force), 0.5)


def square(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """A force that is on, reversed and off in turn, along a line that is drawn anew for each round."""
    force, at = np.zeros((len(t), 2)), g.uniform(0.1, 0.3)
    while at < t[-1] - 0.4:
        half, size, way = g.uniform(0.3, 0.8), g.uniform(1.2, 2.4), g.uniform(-math.pi, math.pi)
        for sign in (1.0, -1.0):
            force[(t >= at) & (t < at + half)] = _line(np.array([sign * size]), way)
            at += half
        at += g.uniform(0.2, 0.8)
    return _at_point(drive, g, force, 0.7)


def swept(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Bursts of a sine, each of a higher frequency than the one before, with rests."""
    force, at, hz = np.zeros((len(t), 2)), g.uniform(0.1, 0.4), g.uniform(0.4, 0.8)
    way = g.uniform(-math.pi, math.pi)
    while at < t[-1] - 0.4:
        length, size = max(1.0 / hz, 0.8), g.uniform(1.5, 2.6)
        on = (t >= at) & (t < at + length)
        force[on] = _line(size * np.sin(2.0 * math.pi * hz * (t[on] - at)), way)
        at, hz, way = at + length + g.uniform(0.3, 0.7), min(1.5 * hz, 3.0), way + g.normal(0.0, 0.5)
    return _at_point(drive, g, force, 0.6)


def half_sines(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """Blows: half a sine of 0.1 to 0.4 s, two to four times the friction, each at a point of its own."""
    command, at = np.zeros((len(t), 5)), g.uniform(0.1, 0.3)
    while at < t[-1] - 0.5:
        length, size, way = g.uniform(0.1, 0.4), g.uniform(2.0, 4.0), g.uniform(-math.pi, math.pi)
        on = (t >= at) & (t < at + length)
        force = _line(size * np.sin(math.pi * (t[on] - at) / length), way)
        command[on] = _at_point(drive, g, force, 0.8)
        at += length + g.uniform(0.5, 1.1)
    return command


def wandering_point(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """A force of one size, on and off, whose point goes round on the box while it acts."""
    hx, hy, _ = drive.world.half_size
    turn, phase = g.choice([-1.0, 1.0]) * g.uniform(0.5, 2.5), g.uniform(-math.pi, math.pi)
    drift, period = g.uniform(-0.8, 0.8), g.uniform(0.9, 1.8)
    size = g.uniform(1.2, 1.9) * ((t % period) < 0.6 * period) * (t > 0.15)
    command = _at_point(drive, g, _line(size, g.uniform(-math.pi, math.pi) + drift * t), 0.5)
    reach = g.uniform(0.2, 0.7)
    command[:, 2] = reach * hx * np.cos(turn * t + phase)
    command[:, 3] = reach * hy * np.sin(turn * t + phase)
    return command


def trapezoids(drive: Drive, g: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """A force that rises, stays and falls, from another side each time."""
    command, at = np.zeros((len(t), 5)), g.uniform(0.1, 0.3)
    while at < t[-1] - 0.8:
        rise, stay, size = g.uniform(0.15, 0.5), g.uniform(0.1, 0.6), g.uniform(1.2, 2.2)
        on = (t >= at) & (t < at + 2.0 * rise + stay)
        since = t[on] - at
        shape = size * np.clip(np.minimum(since, 2.0 * rise + stay - since) / rise, 0.0, 1.0)
        command[on] = _at_point(drive, g, _line(shape, g.uniform(-math.pi, math.pi)), 0.8)
        at += 2.0 * rise + stay + g.uniform(0.3, 0.9)
    return command


FAMILIES: tuple[Callable[..., np.ndarray], ...] = (
    multisine, band_limited, square, swept, half_sines, wandering_point, trapezoids,
)  # fmt: skip


def draw_episodes(drive: Drive, g: np.random.Generator) -> list[PlannedEpisode]:
    """Draw 7 to 9 episodes of 4 to 7 s, most families once, one to three of them thrown."""
    count = int(g.integers(7, 10))
    kinds = [*g.permutation(len(FAMILIES)), *g.integers(0, len(FAMILIES), count)][:count]
    thrown = set(g.choice(count, size=int(g.integers(1, 4)), replace=False).tolist())
    episodes: list[PlannedEpisode] = []
    elapsed_s = 0.0
    for number, kind in enumerate(kinds):
        episode = draw_episode(drive, g, int(kind), thrown=number in thrown, elapsed_s=elapsed_s, number=number)
        episodes.append(episode)
        elapsed_s += episode.duration_s
    return episodes


def draw_episode(
    drive: Drive, g: np.random.Generator, kind: int, *, thrown: bool, elapsed_s: float, number: int
) -> PlannedEpisode:
    """Draw one of a family, anew where its outcome hangs on a hair.

    The command rests over the last 0.3 to 1 s, and is rounded to single precision, as it is recorded.
    """
    episode = None
    for attempt in range(REDRAWS):
        n = round(0.25 * int(g.integers(16, 29)) * drive.rate_hz) + 1
        t = np.arange(n) / drive.rate_hz
        start = np.array([g.uniform(-2, 2), g.uniform(-2, 2), g.uniform(-math.pi, math.pi), 0.0, 0.0, 0.0])
        command = FAMILIES[(kind + attempt // 8) % len(FAMILIES)](drive, g, t)
        begin = 0.0
        if thrown:
            start[3:] = drive.throw(g)
            begin = g.uniform(0.4, 1.5)
        command[(t < begin) | (t > t[-1] - g.uniform(0.3, 1.0))] = 0.0
        command[np.all(command[:, :2] == 0.0, axis=1)] = 0.0
        episode = PlannedEpisode(start, command.astype(np.float32).astype(float), drive.rate_hz, elapsed_s, number)
        if growth(drive.world, episode) <= GROWTH_LIMIT:
            break
    assert episode is not None
    return episode
