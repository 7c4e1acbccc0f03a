"""Commands as people try them: chirps, steps, sums of sines, ramps, pulses, and letting go."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from runner.blind.mechanism.physics import COARSE_S, DivergedError, PlannedEpisode, World, simulate

GROWTH_LIMIT = 8.0  # an episode that magnifies an error of its start more than this is no use to anybody
FARTHEST_RAD = 2.6  # a hinge that goes beyond is drawn again: over the top there is no telling two tries apart
REDRAWS = 40
RATES_HZ = (50.0, 100.0, 100.0, 125.0, 200.0, 250.0)
GRAVITY = 9.81


@dataclass(frozen=True)
class Clock:
    """When samples are taken: so many a second, each off its time by up to `jitter` of a period, some not at all."""

    rate_hz: float
    jitter: float = 0.0
    lost: float = 0.0

    def draw(self, seconds: float, g: np.random.Generator) -> np.ndarray:
        """Return stamps (T,) from 0, s."""
        k = np.arange(round(seconds * self.rate_hz) + 1)
        t = k / self.rate_hz
        if self.jitter > 0.0:
            t = (k + g.uniform(-0.5, 0.5, len(k)) * self.jitter) / self.rate_hz
            t = t[(g.random(len(k)) >= self.lost) | (k == 0)]
        return np.round(t - t[0], 7)


def _chirp(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    low, high = top_hz * g.uniform(0.05, 0.15), top_hz * g.uniform(0.6, 1.0)
    return np.sin(2.0 * math.pi * (low * t + 0.5 * (high - low) * t**2 / t[-1]) + g.choice([0.0, math.pi]))


def _multisine(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    tones = top_hz * np.geomspace(0.08, 1.0, 5) * g.uniform(0.8, 1.2, 5)
    weight = g.uniform(0.4, 1.0, 5) / np.sqrt(np.arange(1, 6))
    out = np.sin(2.0 * math.pi * np.outer(t, tones) + g.uniform(-math.pi, math.pi, 5)) @ weight
    return out / np.abs(out).max()


def _steps(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    hold = max(1.2 / top_hz, 0.35)
    edges = np.cumsum(g.uniform(0.6, 1.6, 64) * hold)
    return g.uniform(-1.0, 1.0, 65)[np.searchsorted(edges, t)]


def _ramps(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    period = g.uniform(3.0, 6.0) / top_hz
    phase = (t / period + g.random()) % 1.0
    return (4.0 * np.abs(phase - 0.5) - 1.0) * np.minimum(1.0, 2.0 * t / period)


def _pulses(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    out, at = np.zeros(len(t)), g.uniform(0.1, 0.4)
    while at < t[-1]:
        length = g.uniform(0.15, 0.5) / top_hz
        out[(t >= at) & (t < at + length)] = g.uniform(0.4, 1.0) * g.choice([-1.0, 1.0])
        at += length + g.uniform(0.4, 1.5) / top_hz
    return out


def _release(t: np.ndarray, top_hz: float, g: np.random.Generator) -> np.ndarray:
    return np.zeros(len(t))


FAMILIES: tuple[Callable[..., np.ndarray], ...] = (_chirp, _multisine, _steps, _ramps, _pulses)
ALWAYS = (_chirp, _steps, _multisine)


def draw_episodes(
    world: World,
    clock: Clock,
    g: np.random.Generator,
    *,
    held: bool,
    counts: tuple[int, int] = (6, 8),
    seconds: tuple[float, float] = (3.0, 6.0),
) -> list[PlannedEpisode]:
    """Draw so many episodes of such lengths; what is unstable or goes over the top is drawn again, more gently.

    Commands are rounded to single precision, as they are recorded.
    """
    count = int(g.integers(counts[0], counts[1] + 1))
    kinds = [*ALWAYS, *(FAMILIES[int(i)] for i in g.integers(0, len(FAMILIES), count - len(ALWAYS)))]
    episodes: list[PlannedEpisode] = []
    elapsed = 0.0
    for number, kind in enumerate([kinds[int(i)] for i in g.permutation(count)]):
        strength = 1.0
        for _ in range(REDRAWS):
            t = clock.draw(float(g.uniform(*seconds)), g)
            episode = _draw(world, t, kind, g, strength, held=held)
            episode = replace(episode, elapsed_s=elapsed, number=number)
            if is_calm(world, episode):
                break
            strength *= 0.85
        episodes.append(episode)
        elapsed += episode.duration_s
    return episodes


def _draw(
    world: World, t: np.ndarray, kind: Callable[..., np.ndarray], g: np.random.Generator, strength: float, *, held: bool
) -> PlannedEpisode:
    commands, position, velocity = [], [], []
    let_go = not held and g.random() < 0.12
    for i, actuator in enumerate(world.actuators):
        pull, top_hz = _scales(world, i)
        shape = (_release if let_go and not actuator.servo else kind)(t, top_hz, g)
        reach = strength * (g.uniform(0.05, 0.2) if world.slides else g.uniform(0.4, 1.1))
        if actuator.servo:
            middle = 0.0 if world.slides else g.uniform(-0.4, 0.4) * strength
            target = middle + reach * shape
            commands.append(target)
            position.append(target[0] + g.normal(0.0, 0.1 * reach))
        else:
            commands.append(strength * pull * g.uniform(0.3, 0.8) * shape)
            position.append(
                strength * (g.uniform(0.5, 1.2) * g.choice([-1.0, 1.0]) if let_go else g.uniform(-0.4, 0.4))
            )
        velocity.append(0.0 if held or actuator.servo else strength * g.normal(0.0, 0.6))
    sent = np.column_stack(commands).astype(np.float32).astype(float)
    return PlannedEpisode(t, sent, np.round(np.array([*position, *velocity]), 6), held)


def _scales(world: World, i: int) -> tuple[float, float]:
    """Return the largest torque of gravity on a joint and up to which frequency it is worth driving it."""
    if world.slides:
        return 0.0, 2.0
    arms = [math.hypot(*link.com_m) for link in world.links]
    pull = sum(
        world.links[k].mass_kg * GRAVITY * (arms[k] + (world.length_m if k > i else 0.0))
        for k in range(i, len(world.links))
    )
    return pull, 2.0


def is_calm(world: World, episode: PlannedEpisode, *, change: float = 1e-3) -> bool:
    """Whether an error of the start hardly grows, and no hinge goes over the top."""
    start = np.array(episode.start, float)
    start[: len(world.joints)] += change * (0.1 if world.slides else 1.0)
    try:
        a, b = (simulate(world, e, step_s=COARSE_S) for e in (episode, replace(episode, start=start)))
    except DivergedError:
        return False
    places = a[:, ::2]
    over = not world.slides and float(np.abs(places).max()) > FARTHEST_RAD
    return not over and float(np.abs(a[:, ::2] - b[:, ::2]).max()) <= GROWTH_LIMIT * change
