"""Pushes as people try them: short pushes with rests, staircases, ramps, sines, turning forces, thrown starts.

Forces are stated in units of the friction `mu m g` that the owner believes in, points in units of the half sizes, so
that a light box on ice and a heavy one on rubber are pushed about alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runner.blind.planar_box.physics import IntegrationError, PlannedEpisode, World, simulate

REST_LIMIT = 0.75  # of the half size: how far pushes, friction and height may move the centre of load
GROWTH_LIMIT = 8.0  # an episode that magnifies an error of its start more than this is no use to anybody
REDRAWS = 60


@dataclass(frozen=True)
class Drive:
    """What an excitation is drawn for.

    Args:
        world: As the owner believes it to be.
        rate_hz: Samples per second.
        heights: Whether pushes may act above or below the geometric centre.
    """

    world: World
    rate_hz: float
    heights: bool

    @property
    def friction_n(self) -> float:
        """Friction of the sliding box, N."""
        return self.world.friction * self.world.mass * self.world.gravity

    @property
    def throw_m_per_s(self) -> float:
        """Speed that is coasted off within half a metre, m/s."""
        return math.sqrt(self.world.friction * self.world.gravity)

    def throw(self, generator: np.random.Generator) -> tuple[float, float, float]:
        """Draw the velocity of a box that is thrown: x and y, m/s, and its spin, rad/s."""
        speed, way = self.throw_m_per_s * generator.uniform(0.4, 1.3), generator.uniform(-math.pi, math.pi)
        spin = self.throw_m_per_s / max(self.world.half_size[:2]) * generator.uniform(-1.2, 1.2)
        return speed * math.cos(way), speed * math.sin(way), spin

    def point(self, generator: np.random.Generator, reach: float) -> tuple[float, float]:
        """Draw a point of application within `reach` half sizes, m, body axes."""
        hx, hy, _ = self.world.half_size
        return hx * generator.uniform(-reach, reach), hy * generator.uniform(-reach, reach)

    def height(self, generator: np.random.Generator, force: float) -> float:
        """Draw a height of application that a push of `force` (in units of the friction) does not tip the box by, m."""
        if not self.heights:
            return 0.0
        hx, hy, hz = self.world.half_size
        mu = self.world.friction
        most = (REST_LIMIT * min(hx, hy) - mu * hz) / (mu * force)
        most = min(max(most, 0.0), 0.8 * hz)
        return generator.uniform(-most, most)


def pushes(
    drive: Drive,
    generator: np.random.Generator,
    t: np.ndarray,
    plan: list[tuple[float, float, float, float]],
    points: list,
) -> np.ndarray:
    """Return commands (n, 5) from (start s, length s, force, direction rad) rows, each at its point (m, body axes)."""
    command = np.zeros((len(t), 5))
    for (start, length, force, direction), point in zip(plan, points, strict=True):
        on = (t >= start - 1e-9) & (t < start + length - 1e-9)
        size = force * drive.friction_n
        height = drive.height(generator, force)
        command[on] = [size * math.cos(direction), size * math.sin(direction), *point, height]
    return command


def central(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Pushes through the centre, each coasting to rest before the next."""
    plan, at = [], begin + g.uniform(0.1, 0.4)
    while at < t[-1] - 0.8:
        length = g.uniform(0.4, 1.0)
        plan.append((at, length, g.uniform(1.2, 2.2), g.uniform(-math.pi, math.pi)))
        at += length + g.uniform(0.8, 1.4)
    return pushes(drive, g, t, plan, [(0.0, 0.0)] * len(plan))


def off_centre(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Pushes beside the centre, with rests."""
    plan, at = [], begin + g.uniform(0.1, 0.4)
    while at < t[-1] - 0.7:
        length = g.uniform(0.4, 0.95)
        plan.append((at, length, g.uniform(0.9, 1.8), g.uniform(-math.pi, math.pi)))
        at += length + g.uniform(0.5, 1.2)
    return pushes(drive, g, t, plan, [drive.point(g, 0.95) for _ in plan])


def staircase(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Pushes of growing force, from below friction to twice it, to and fro."""
    point = (0.0, 0.0) if g.random() < 0.5 else drive.point(g, 0.6)
    line = g.uniform(-math.pi, math.pi)
    plan, at, force = [], begin + g.uniform(0.1, 0.4), g.uniform(0.65, 0.9)
    while at < t[-1] - 0.6:
        length = g.uniform(0.4, 0.55)
        plan.append((at, length, force, line + g.choice([0.0, math.pi]) + g.normal(0.0, 0.25) * (force > 1.0)))
        force = min(force + g.uniform(0.12, 0.35), 2.3)
        at += length + g.uniform(0.35, 0.7)
    return pushes(drive, g, t, plan, [point] * len(plan))


def alternating(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Pushes of one force, in turn through the centre and beside it, sometimes before the box is at rest."""
    force = g.uniform(1.2, 2.0)
    plan, points, at = [], [], begin + g.uniform(0.15, 0.4)
    while at < t[-1] - 0.5:
        length = g.uniform(0.35, 0.75)
        plan.append((at, length, force, g.uniform(-math.pi, math.pi)))
        points.append((0.0, 0.0) if len(plan) % 2 else drive.point(g, 0.9))
        at += length + g.uniform(0.25, 0.7)
    return pushes(drive, g, t, plan, points)


def crowded(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """Many pushes one upon the other, with few rests."""
    plan, at = [], begin + g.uniform(0.1, 0.4)
    while at < t[-1] - 0.3:
        length = g.uniform(0.25, 0.6)
        if g.random() < 0.8:
            plan.append((at, length, g.uniform(0.6, 2.2), g.uniform(-math.pi, math.pi)))
        at += length if g.random() < 0.85 else length + g.uniform(0.4, 1.1)
    return pushes(drive, g, t, plan, [drive.point(g, 0.93) for _ in plan])


def _steady(drive: Drive, g: np.random.Generator, t: np.ndarray, size: np.ndarray, direction: np.ndarray) -> np.ndarray:
    point = (0.0, 0.0) if g.random() < 0.5 else drive.point(g, 0.45)
    on = (t >= g.uniform(0.15, 0.35)) & (t <= t[-1] - g.uniform(0.0, 1.2))
    height = drive.height(g, float(np.max(abs(size))))
    command = np.column_stack(
        [size * np.cos(direction), size * np.sin(direction), np.full((len(t), 3), [*point, height])]
    )
    command[:, :2] *= drive.friction_n
    return np.where(on[:, None], command, 0.0)


def turning(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """A force of constant size whose direction turns."""
    rate = g.choice([-1.0, 1.0]) * g.uniform(1.0, 4.0)
    return _steady(drive, g, t, np.full(len(t), g.uniform(1.2, 1.7)), g.uniform(-math.pi, math.pi) + rate * t)


def sine(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """A force to and fro along a line that may turn slowly, its frequency constant or rising."""
    low, high = g.uniform(0.3, 0.9), g.uniform(0.3, 1.5)
    phase = 2.0 * math.pi * (low * t + 0.5 * (high - low) * t**2 / t[-1])
    drift = g.uniform(-0.5, 0.5) * (g.random() < 0.5)
    return _steady(drive, g, t, g.uniform(1.5, 2.3) * np.cos(phase), g.uniform(-math.pi, math.pi) + drift * t)


def ramp(drive: Drive, g: np.random.Generator, t: np.ndarray, begin: float = 0.0) -> np.ndarray:
    """A force that grows steadily from nothing until the box slides, and again from another side."""
    period = g.uniform(2.5, 4.0)
    size = g.uniform(1.5, 2.0) * np.minimum((t % period) / (0.8 * period), 1.0) * (t % period < 0.85 * period)
    side = g.uniform(-math.pi, math.pi, 8)[(t // period).astype(int)]
    return _steady(drive, g, t, size, side)


FAMILIES: tuple[Callable[..., np.ndarray], ...] = (
    central, off_centre, staircase, alternating, crowded, turning, sine, ramp,
)  # fmt: skip
ALWAYS = (central, off_centre, off_centre)


def draw_episodes(drive: Drive, generator: np.random.Generator) -> list[PlannedEpisode]:
    """Draw 7 to 10 episodes of 4 to 8 s: straight and turning pushes, steady forces, and thrown starts.

    Commands are rounded to single precision, as they are recorded. An episode that is unstable (a push from behind that
    the box turns away from, so that no two tries would be alike) is drawn again.
    """
    g = generator
    count = int(g.integers(7, 11))
    kinds = [*ALWAYS, FAMILIES[int(g.integers(5, 8))]]
    kinds += [FAMILIES[int(i)] for i in g.integers(0, len(FAMILIES), count - len(kinds))]
    thrown = set(g.choice(count, size=int(g.integers(1, 4)), replace=False).tolist())
    episodes: list[PlannedEpisode] = []
    elapsed = 0.0
    for number, kind in enumerate([kinds[int(i)] for i in g.permutation(count)]):
        for _ in range(REDRAWS):
            episode = _draw_episode(drive, g, kind, thrown=number in thrown, elapsed_s=elapsed, number=number)
            if growth(drive.world, episode) <= GROWTH_LIMIT:
                break
            kind = kind if g.random() < 0.8 else central
        episodes.append(episode)
        elapsed += episode.duration_s
    return episodes


def _draw_episode(
    drive: Drive,
    g: np.random.Generator,
    kind: Callable[..., np.ndarray],
    *,
    thrown: bool,
    elapsed_s: float,
    number: int,
) -> PlannedEpisode:
    n = round(0.25 * int(g.integers(16, 33)) * drive.rate_hz) + 1
    t = np.arange(n) / drive.rate_hz
    start = np.array([g.uniform(-2, 2), g.uniform(-2, 2), g.uniform(-math.pi, math.pi), 0.0, 0.0, 0.0])
    if thrown:
        kind = central if kind in (turning, sine, ramp) else kind
        start[3:] = drive.throw(g)
        command = kind(drive, g, t, begin=g.uniform(0.3, 1.5))
    else:
        command = kind(drive, g, t)
    command[np.all(command[:, :2] == 0.0, axis=1)] = 0.0
    return PlannedEpisode(start, command.astype(np.float32).astype(float), drive.rate_hz, elapsed_s, number)


def growth(world: World, episode: PlannedEpisode, *, turn_rad: float = 1e-3) -> float:
    """Return how much an error of the heading at the start grows: the largest in yaw, or in place by the half size."""
    start = np.array(episode.start, float)
    start[2] += turn_rad
    try:
        a, b = (simulate(world, e, rtol=1e-6, atol=1e-8, points=8) for e in (episode, replace(episode, start=start)))
    except IntegrationError:
        return math.inf
    apart = np.abs(a - b)
    return float(max(apart[:, 2].max(), apart[:, :2].max() / max(world.half_size[:2])) / turn_rad)
