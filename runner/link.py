"""The link: how often the remote's state is sent, and when, or whether, it arrives.

The local side looks at what has arrived at each of its own ticks, which have the same rate. The schedule depends on the
seed alone, never on what happens in the run, so it is made before the first step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from runner.errors import ConfigError, check_range


@dataclass(frozen=True)
class LinkConfig:
    """Update rate, delay, jitter and loss.

    A message sent at t arrives at t + delay_s + j, j uniform between 0 and `jitter_s`, or never, with probability
    `loss`. Jitter longer than the update period can put messages out of order.
    """

    rate_hz: float = 60.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

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


def received(link: LinkConfig, times_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return for each tick the message that is taken in at it, by the tick at which it was sent, (m,); -1: none.

    A message is sent at each tick. Of those that have arrived since the last tick the newest is taken in, unless a
    newer one was taken in before.

    Args:
        link: Delay, jitter, loss.
        times_s: Times of the ticks, (m,), s, growing.
        rng: The link's own generator.
    """
    lost = rng.random(len(times_s)) < link.loss
    arrival = times_s + link.delay_s + link.jitter_s * rng.random(len(times_s))
    # the tolerance is for a delay of a whole number of ticks, which rounding must not turn into one more
    tick = np.searchsorted(times_s, arrival - 1e-9)
    arrives = ~lost & (tick < len(times_s))
    newest = np.full(len(times_s), -1)
    np.maximum.at(newest, tick[arrives], np.flatnonzero(arrives))
    before = np.concatenate([[-1], np.maximum.accumulate(newest)[:-1]]) if len(newest) else newest
    return np.where(newest > before, newest, -1)
