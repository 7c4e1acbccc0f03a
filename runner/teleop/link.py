"""The link: how often the remote's state is sent, and when, or whether, it arrives.

The local side looks at what has arrived at each of its own ticks, which have the same rate. The schedule depends on the
seed alone, never on what happens in the run, so it is made before the first step.

Order. Of messages that arrive between two ticks all are taken in, in the order in which they were sent. One that was
overtaken, and comes after a newer one was taken in, is dropped. It would only say how the interval that the newer one
closed splits in two: the estimate is no less unbiased without it, as what the link drops does not depend on what the
messages say, and to use it the past would have to be opened again at every late arrival. How many are dropped is
counted in the table of the `latency` experiment.

Clocks. With a fixed clock updates fall on physics steps. With an unfixed one they have a clock of their own, as in a
game engine whose physics runs at 50 Hz while it draws, and sends, at 60 Hz: an update finds whatever physics step came
last. Where remote and local run on two machines, whose steps do not begin together, the remote's state may be a step
older than the local's; and the same state is sent again where no step came between. A receiver that looks at the time
stamp (`follow`) is not misled by either; one that does not (`follow=unaware`) compares the speeds of different times.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from runner.errors import ConfigError, check_range


class Clock(Enum):
    """Whether updates keep step with the physics."""

    fixed = "fixed"  # an update comes after a whole number of physics steps
    unfixed = "unfixed"  # updates have a clock of their own


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
    `loss`. Jitter longer than the update period can put messages out of order. With `clock=unfixed` any rate goes with
    any time step, and the remote's physics steps begin `phase` of a step later than the local ones.
    """

    rate_hz: float = 60.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    clock: Clock = Clock.fixed
    phase: float = 0.0

    def __post_init__(self) -> None:
        check_range("rate_hz", self.rate_hz, 0.01, 10_000.0, unit="Hz")
        check_range("delay_s", self.delay_s, 0.0, 10.0, unit="s")
        check_range("jitter_s", self.jitter_s, 0.0, 10.0, unit="s")
        check_range("loss", self.loss, 0.0, 1.0)
        check_range("phase", self.phase, 0.0, 1.0)
        if self.phase and self.clock is Clock.fixed:
            raise ConfigError(f"phase: must be 0 with clock=fixed, got {self.phase:g}.")


def update_steps(link: LinkConfig, timestep_s: float, steps: int) -> np.ndarray:
    """Return after how many physics steps the local side looks at what has arrived, (m,), growing, at most `steps`.

    With an unfixed clock it is every step; at most of them nothing need have arrived.

    Raises:
        ConfigError: If an update does not fall on a physics step, naming the nearest rates and time steps that do.
    """
    if link.clock is Clock.unfixed:
        return np.arange(1, steps + 1)
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


def schedule(link: LinkConfig, times_s: np.ndarray, rng: np.random.Generator) -> list[tuple[int, ...]]:
    """Return for each tick the messages that are taken in at it, by the ticks at which they were sent, in that order.

    Args:
        link: Delay, jitter, loss, clock.
        times_s: Times of the ticks, (m,), s, growing; with an unfixed clock those of all physics steps.
        rng: The link's own generator.
    """
    if link.clock is Clock.fixed or not len(times_s):
        return taken_in(arrivals(link, times_s, rng))
    period_s, step_s = 1.0 / link.rate_hz, times_s[0]
    updates = np.arange(1, int(times_s[-1] / period_s) + 1)
    lost = rng.random(len(updates)) < link.loss
    travel_s = link.delay_s + link.jitter_s * rng.random(len(updates))
    # tolerances as below; a message is looked at by the first update after it has come
    looked_s = np.ceil(updates + travel_s / period_s - 1e-9) * period_s
    sent = np.floor(updates * period_s / step_s - link.phase + 1e-9).astype(np.int64) - 1
    tick = np.floor(looked_s / step_s + 1e-9).astype(np.int64) - 1
    # the newest of those that come to one tick counts, whether or not it was taken in before
    out = [-1] * len(times_s)
    for message, at in zip(sent[~lost].tolist(), tick[~lost].tolist(), strict=True):
        if message >= 0 and at < len(out):
            out[at] = max(out[at], message)
    newest = np.maximum.accumulate(out)
    return [(m,) if m >= 0 and m == newest[i] else () for i, m in enumerate(out)]


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
    if np.array_equal(tick, np.arange(len(tick))):  # at once, as most often
        return [(message,) for message in range(len(tick))]
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
