"""The link: how often the remote's state is sent, and when, or whether, it arrives.

The local side looks at what has arrived at each of its own ticks, which have the same rate. The schedule depends on the
seed alone, never on what happens in the run, so it is made before the first step.

Order. Of messages that arrive between two ticks all are taken in, in the order in which they were sent. One that was
overtaken, and comes after a newer one was taken in, is dropped. It would only say how the interval that the newer one
closed splits in two: the estimate is no less unbiased without it, as what the link drops does not depend on what the
messages say, and to use it the past would have to be opened again at every late arrival. How many are dropped is
counted in the table of the `latency` experiment.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from runner.errors import ConfigError, check_range


@dataclass(frozen=True)
class NoiseConfig:
    """Standard deviations of white normal noise on what the remote's sensors measure, the same along each axis."""

    position_m: float = 0.0
    angle_rad: float = 0.0
    velocity_m_s: float = 0.0
    rate_rad_s: float = 0.0

    def __post_init__(self) -> None:
        check_range("position_m", self.position_m, 0.0, 1.0, unit="m")
        check_range("angle_rad", self.angle_rad, 0.0, 1.0, unit="rad")
        check_range("velocity_m_s", self.velocity_m_s, 0.0, 10.0, unit="m/s")
        check_range("rate_rad_s", self.rate_rad_s, 0.0, 10.0, unit="rad/s")

    def __bool__(self) -> bool:
        return any((self.position_m, self.angle_rad, self.velocity_m_s, self.rate_rad_s))

    def draws(self, count: int, linear: int, angular: int, rng: np.random.Generator) -> np.ndarray:
        """Return noise of `count` messages, (count, 2 * (linear + angular)): of the position, then of the velocity.

        Each is in the order of the degrees of freedom, of which there are `linear` straight ones, m, m/s, and then
        `angular` turning ones, rad, rad/s.
        """
        sizes = [self.position_m] * linear + [self.angle_rad] * angular
        sizes += [self.velocity_m_s] * linear + [self.rate_rad_s] * angular
        return rng.standard_normal((count, len(sizes))) * sizes


@dataclass(frozen=True)
class LinkConfig:
    """Update rate, delay, jitter and loss, and the noise of what is sent.

    A message sent at t arrives at t + delay_s + j, j uniform between 0 and `jitter_s`, or never, with probability
    `loss`. Jitter longer than the update period can put messages out of order.
    """

    rate_hz: float = 60.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    noise: NoiseConfig = field(default_factory=NoiseConfig)

    def __post_init__(self) -> None:
        check_range("rate_hz", self.rate_hz, 0.01, 10_000.0, unit="Hz")
        check_range("delay_s", self.delay_s, 0.0, 10.0, unit="s")
        check_range("jitter_s", self.jitter_s, 0.0, 10.0, unit="s")
        check_range("loss", self.loss, 0.0, 1.0)


def update_steps(link: LinkConfig, timestep_s: float, steps: int) -> np.ndarray:
    """Return after how many physics steps each update comes, (m,), growing, at most `steps`.

    Raises:
        ConfigError: If an update does not fall on a physics step, naming the nearest rates and time steps that do.
    """
    every = 1.0 / (link.rate_hz * timestep_s)
    whole = round(every)
    if whole < 1 or abs(every - whole) > 1e-6 * whole:
        more, fewer = max(int(every), 1), max(int(every), 1) + 1
        raise ConfigError(
            f"link.rate_hz: an update must come after a whole number of physics steps, got {link.rate_hz:g} Hz, i.e. "
            f"every {every:g} steps of {timestep_s:g} s. Nearest: {1 / (more * timestep_s):g} or "
            f"{1 / (fewer * timestep_s):g} Hz, or scene.timestep_s=1/{link.rate_hz * max(whole, 1):g}."
        )
    return np.arange(whole, steps + 1, whole)


def arrivals(link: LinkConfig, times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the tick at which the message that was sent at each tick has arrived, (m,); m: not before the end.

    Args:
        link: Delay, jitter, loss.
        times_s: Times of the ticks, (m,), s, growing.
        rng: The link's own generator.
    """
    lost = rng.random(len(times_s)) < link.loss
    arrival = times_s + link.delay_s + link.jitter_s * rng.random(len(times_s))
    # the tolerance is for a delay of a whole number of ticks, which rounding must not turn into one more
    return np.where(lost, len(times_s), np.searchsorted(times_s, arrival - 1e-9))


def taken_in(tick: np.ndarray) -> list[tuple[int, ...]]:
    """Return for each tick the messages that are taken in at it, in the order of sending; see the module's docstring.

    Args:
        tick: At which each message has arrived, see `arrivals`.
    """
    pending: list[list[int]] = [[] for _ in range(len(tick))]
    for message in np.flatnonzero(tick < len(tick)).tolist():
        pending[tick[message]].append(message)
    out, newest = [], -1
    for messages in pending:
        out.append(tuple(m for m in messages if m > newest))
        newest = max([newest, *messages])
    return out


def received(link: LinkConfig, times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return for each tick the newest message that is taken in at it, by the tick of its sending, (m,); -1: none."""
    return newest(taken_in(arrivals(link, times_s, rng)))


def newest(taken: list[tuple[int, ...]]) -> np.ndarray:
    """Return the newest message of each tick, (m,); -1: none."""
    return np.array([messages[-1] if messages else -1 for messages in taken], dtype=np.int64)
