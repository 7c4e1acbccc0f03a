"""An episode of a mechanism: what it is sent, and what its sensors show at every sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from runner.blind.mechanism.physics import compiled
from runner.blind.mechanism.physics.layout import pack
from runner.blind.mechanism.physics.world import Actuator, Joint, World
from runner.errors import RunnerError

STEP_S = 2e-4  # the longest
COARSE_S = 4e-4  # the longest for finding sizes
FINE = 0.1  # radians of the fastest swing of a spring between drive and link, per step
RIGID_S = 1e-4  # a spring on which the drive swings faster than in so many seconds per radian gives nothing
EQUAL_S = 1e-10  # times nearer than that are one


class DivergedError(RunnerError):
    """A mechanism ran away."""


@dataclass(frozen=True)
class PlannedEpisode:
    """What is done in one episode.

    Args:
        t_s: Stamps of the samples, (T,), the first 0.
        commands: From each sample to the next, (T, count), N m, N, rad or m.
        start: Positions, then velocities, (2 count,).
        held: Whether the mechanism was held until it began: at rest, and sensors settled.
        elapsed_s: Time in use before.
        number: Of the episode.
    """

    t_s: np.ndarray
    commands: np.ndarray
    start: np.ndarray
    held: bool = False
    elapsed_s: float = 0.0
    number: int = 0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample."""
        return float(self.t_s[-1])


def simulate(world: World, episode: PlannedEpisode, *, step_s: float = STEP_S) -> np.ndarray:
    """Return what the sensors show at every sample without noise, position and velocity of each joint, (T, 2 count).

    The start is the true state of the first sample's reading: with an observation delay that of so long before.

    Raises:
        DivergedError: If the motion has no end.
    """
    world = _without_rigid_springs(world)
    true_s = episode.t_s / world.clock_ratio
    read_s = true_s - world.observation_delay_s
    before = np.array([episode.commands[0, j] if a.servo else 0.0 for j, a in enumerate(world.actuators)])
    sent = [
        _arriving(a, true_s, episode.commands[:, j], [world.seed, episode.number, j])
        for j, a in enumerate(world.actuators)
    ]
    pushes = [t for j in world.joints if j.push != 0.0 for t in (j.push_from_s, j.push_until_s)]
    edges = _distinct(np.concatenate([read_s, pushes, *(times for times, _ in sent)]), read_s[0], read_s[-1])
    commands = np.empty((len(edges) - 1, len(sent)))
    middle = 0.5 * (edges[1:] + edges[:-1])
    for j, (times, values) in enumerate(sent):
        k = np.searchsorted(times, middle, side="right") - 1
        commands[:, j] = np.where(k < 0, before[j], values[np.maximum(k, 0)])
    kept = np.full(len(edges), -1)
    kept[np.searchsorted(edges, read_s - EQUAL_S)] = np.arange(len(read_s))
    out = np.empty((len(read_s), 2 * len(world.joints)))
    ok = compiled.run(
        *pack(world), np.array(episode.start, float), episode.held, before, edges, commands, kept, episode.elapsed_s,
        _longest(world, step_s), out,
    )  # fmt: skip
    if not ok or not np.all(np.isfinite(out)):
        raise DivergedError(f"physics: episode {episode.number} ran away.")
    sensors = [sensor for pair in world.sensors for sensor in pair]
    return out * [s.scale for s in sensors] + [s.offset for s in sensors]


def simulate_or_none(
    world: World, episodes: Sequence[PlannedEpisode], *, step_s: float = STEP_S
) -> list[np.ndarray] | None:
    """Return the motion of all episodes, or none where it has no end."""
    try:
        return [simulate(world, episode, step_s=step_s) for episode in episodes]
    except DivergedError:
        return None


def _longest(world: World, step_s: float) -> float:
    """Return the longest step that follows the spring between a drive and its link."""
    for joint in world.joints:
        if joint.give > 0.0:
            return min(step_s, FINE * _swing_s(joint))
    return step_s


def _swing_s(joint: Joint) -> float:
    return float(np.sqrt(joint.give * joint.armature))


def _without_rigid_springs(world: World) -> World:
    for i, joint in enumerate(world.joints):
        if joint.give > 0.0 and _swing_s(joint) < RIGID_S:
            world = world.with_joint(i, give=0.0)
    return world


def _distinct(times: np.ndarray, first: float, last: float) -> np.ndarray:
    """Return the times from the first to the last in order, each once."""
    times = np.sort(times[(times > first) & (times < last)])
    times = np.concatenate([[first], times, [last]])
    keep = np.append(np.diff(times) > EQUAL_S, True)
    keep[0] = True
    return times[keep]


def _arriving(actuator: Actuator, t_s: np.ndarray, commands: np.ndarray, seed: list[int]) -> tuple[np.ndarray, ...]:
    """Return when an actuator is sent something new, rising, and what, (T,) each."""
    g = np.random.default_rng(seed)
    values = np.sign(commands) * np.maximum(np.abs(commands) - actuator.dead_band, 0.0)
    values = values if actuator.dead_band > 0.0 else commands
    if actuator.quantum > 0.0:
        values = actuator.quantum * np.round(values / actuator.quantum)
    lost, late = g.random(len(t_s)), g.random(len(t_s))
    if actuator.dropout > 0.0:
        arrived = lost >= actuator.dropout
        arrived[0] = True
        values = values[np.maximum.accumulate(np.where(arrived, np.arange(len(t_s)), 0))]
    times = np.maximum.accumulate(t_s + actuator.delay_s + actuator.jitter_s * late)
    return times, values
