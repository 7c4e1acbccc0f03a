"""An episode of a world, integrated from sample to sample."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np
from scipy.integrate import ODEintWarning, odeint

from runner.blind.planar_box.physics import compiled
from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.actuator import carried_out
from runner.blind.planar_box.physics.forces import wander_terms
from runner.blind.planar_box.physics.pack import SLIP_EPS, pack
from runner.blind.planar_box.physics.surface import BASE_POINTS
from runner.blind.planar_box.physics.world import World
from runner.errors import RunnerError

SHORT = 2.5  # samples: intervals below are first tried in single steps


class IntegrationError(RunnerError):
    """LSODA could not go on: the time, the state and its message."""


class Accuracy(TypedDict, total=False):
    """How finely is integrated, see `simulate`."""

    rtol: float
    atol: float
    points: int
    slip_eps: float


@dataclass(frozen=True)
class PlannedEpisode:
    """Start state and commands of one episode.

    Args:
        start: State of the geometric centre at the first sample, shape (6,).
        command: fx, fy (N, world), px, py, pz (m, body axes, from the geometric centre) from each sample to the
            next, shape (n, 5).
        rate_hz: Samples per second.
        elapsed_s: Time in use before this episode (matters to wear alone).
        number: Number of the episode (the wandering force differs between episodes).
    """

    start: np.ndarray
    command: np.ndarray
    rate_hz: float
    elapsed_s: float = 0.0
    number: int = 0

    @property
    def duration_s(self) -> float:
        """Time from the first to the last sample."""
        return (len(self.command) - 1) / self.rate_hz


def simulate(
    world: World,
    episode: PlannedEpisode,
    *,
    rtol: float = 1e-7,
    atol: float = 1e-8,
    points: int = BASE_POINTS,
    slip_eps: float = SLIP_EPS,
    packed: np.ndarray | None = None,
) -> np.ndarray:
    """Return the state that the sensor shows at every sample, without noise, shape (n, 6).

    With an observation delay the first sample shows the start state, which the body then had one delay earlier; no
    force acts before the first sample. So it equals a delay of the actuator by as much. A scaled sensor shows the start
    state too: the true one is that over the scale.

    Args:
        world: The box and all around it.
        episode: Start state and commands.
        rtol, atol: Tolerances of LSODA.
        points: Base points per side.
        slip_eps: Regularising slip speed, m/s.
        packed: `pack(world, ...)` where it is at hand already.

    Raises:
        IntegrationError: Where LSODA gives up or the load tips the box.
    """
    p = (pack(world, points=points, slip_eps=slip_eps) if packed is None else packed).copy()
    n = len(episode.command)
    dt = 1.0 / episode.rate_hz
    p[at.ELAPSED] = episode.elapsed_s
    if world.wander != 0.0:
        p[at.WANDER_AT : at.POINTS_AT] = wander_terms(world.wander_seed, episode.number).ravel()
    starts, targets = _intervals(world, episode)
    sample = np.arange(n) * dt - world.observation_delay
    end = sample[-1]
    result = np.full((n, 6), math.nan)
    y = np.array(episode.start, float)
    y[[0, 1, 3, 4]] /= world.sensor_scale
    held = np.zeros(8)  # wrench at the start of an interval
    lengths = np.append(np.diff(starts), math.inf)
    filled, k = 0, 0
    while filled < n:
        if lengths[k] < SHORT * dt:
            run = k + int(np.argmax(lengths[k:] >= SHORT * dt))  # the last interval has no end
            k, filled = compiled.march(
                p, y, starts, targets, held, world.lag, k, run, end, sample, filled, result, rtol, atol
            )  # fmt: skip
            if k == run or filled >= n:
                continue
        t_start, t_end = starts[k], starts[k] + lengths[k]
        p[at.T0] = t_start
        p[at.A0 : at.A7 + 1] = targets[k]
        p[at.B0 : at.B7 + 1] = held - targets[k] if world.lag > 0.0 else 0.0
        last = int(np.searchsorted(sample, t_end - 1e-9, side="left"))  # samples before the end of the interval
        times = np.concatenate([[t_start], sample[filled:last], [min(t_end, end)]])
        kept = np.append(True, np.diff(times) > 1e-12)
        path = _odeint(p, y, times[kept], rtol, atol) if kept.sum() > 1 else y[None, :]
        row = np.cumsum(kept) - 1  # of the path, for each time
        result[filled:last] = path[row[1 : 1 + last - filled]]
        filled = max(filled, last)
        y = path[-1].copy()
        if world.lag > 0.0 and math.isfinite(t_end):
            held = targets[k] + (held - targets[k]) * math.exp(-lengths[k] / world.lag)
        k += 1
    result[:, [0, 1, 3, 4]] *= world.sensor_scale
    return result


def _intervals(world: World, episode: PlannedEpisode) -> tuple[np.ndarray, np.ndarray]:
    """Return the intervals of constant force: when each starts, (K,), s, and its wrench before the lag, (K, 8).

    In the time of the body; the sensor's clock is behind by `observation_delay`.
    """
    wrench = carried_out(world, episode.command)
    first = np.concatenate([[0], np.flatnonzero(np.any(wrench[1:] != wrench[:-1], axis=1)) + 1])
    edges = first * (1.0 / episode.rate_hz) + world.delay
    return np.concatenate([[-world.observation_delay], edges]), np.vstack([np.zeros(8), wrench[first]])


def _odeint(p: np.ndarray, y: np.ndarray, times: np.ndarray, rtol: float, atol: float) -> np.ndarray:
    if not np.all(np.isfinite(compiled.rate(y, times[0], p))):
        raise IntegrationError(f"physics: no load on the base balances the moments at {times[0]:.4f} s: the box tips.")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ODEintWarning)  # its message is read below
        path, info = odeint(
            compiled.rate,
            y,
            times,
            args=(p,),
            Dfun=compiled.jacobian,
            rtol=rtol,
            atol=atol,
            mxstep=20000,
            full_output=True,
        )
    if info["message"] != "Integration successful." or not np.all(np.isfinite(path)):
        raise IntegrationError(
            f"physics: LSODA stopped between {times[0]:.4f} s and {times[-1]:.4f} s: {info['message']}"
        )
    return path


def simulate_all(world: World, episodes: list[PlannedEpisode], **accuracy: Unpack[Accuracy]) -> list[np.ndarray]:
    """Return `simulate` of every episode."""
    packed = pack(world, points=accuracy.get("points", BASE_POINTS), slip_eps=accuracy.get("slip_eps", SLIP_EPS))
    return [simulate(world, episode, packed=packed, **accuracy) for episode in episodes]
