"""The link delivers each message at most once, in order, never early, and as often as its settings say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runner.errors import ConfigError
from runner.teleop.link import Clock, LinkConfig, received, schedule, update_steps

TIMES_S = np.arange(1, 601) / 60


def rng() -> np.random.Generator:
    """Return a generator of fixed seed."""
    return np.random.default_rng(4)


def test_an_ideal_link_delivers_at_once() -> None:
    """Without delay, jitter and loss every message is taken in at the tick at which it was sent."""
    assert np.array_equal(received(LinkConfig(), TIMES_S, rng()), np.arange(600))


@pytest.mark.parametrize("ticks", [1, 6, 18])
def test_a_delay_of_whole_ticks_is_exact(ticks: int) -> None:
    """A message that takes k ticks is taken in k ticks later, and none before."""
    taken = received(LinkConfig(delay_s=ticks / 60), TIMES_S, rng())
    assert (taken[:ticks] == -1).all()
    assert np.array_equal(taken[ticks:], np.arange(600 - ticks))


def test_loss_is_the_share_that_never_arrives() -> None:
    """With 20 % loss a fifth of the messages is missing, within three standard deviations."""
    taken = received(LinkConfig(loss=0.2), TIMES_S, rng())
    assert abs((taken == -1).sum() - 120) < 3 * np.sqrt(600 * 0.2 * 0.8)
    assert (received(LinkConfig(loss=1.0), TIMES_S, rng()) == -1).all()


@given(st.floats(0, 0.5), st.floats(0, 0.3), st.floats(0, 0.9), st.integers(0, 1000))
def test_messages_come_once_in_order_and_not_early(delay_s: float, jitter_s: float, loss: float, seed: int) -> None:
    """What is taken in is always newer than what was taken in before, and at least `delay_s` old."""
    taken = received(LinkConfig(60.0, delay_s, jitter_s, loss), TIMES_S, np.random.default_rng(seed))
    at = np.flatnonzero(taken >= 0)
    assert (np.diff(taken[at]) > 0).all()
    assert (TIMES_S[at] - TIMES_S[taken[at]] >= delay_s - 1e-9).all()


def test_jitter_overtakes() -> None:
    """With jitter of several periods some messages are overtaken, and are left out."""
    taken = received(LinkConfig(jitter_s=0.1), TIMES_S, rng())
    age_s = TIMES_S[taken >= 0] - TIMES_S[taken[taken >= 0]]
    assert 0.3 < (taken >= 0).mean() < 0.9
    assert age_s.max() < 0.1 + 1 / 60


def test_updates_fall_on_physics_steps() -> None:
    """60 Hz over 1/480 s is every eighth step; the last update is within the run."""
    assert np.array_equal(update_steps(LinkConfig(60), 1 / 480, 30), [8, 16, 24])
    assert len(update_steps(LinkConfig(1), 1 / 480, 479)) == 0


def test_a_rate_between_steps_is_refused_with_what_would_do() -> None:
    """45 Hz over 1/480 s names the nearest rates."""
    with pytest.raises(ConfigError, match=r"link.rate_hz: .* got 45 Hz, i.e. every 10.6667 steps .* 48 or 43.6364 Hz"):
        update_steps(LinkConfig(45), 1 / 480, 100)


@pytest.mark.parametrize("wrong", [{"rate_hz": 0.0}, {"delay_s": -0.1}, {"loss": 1.1}, {"jitter_s": float("nan")}])
def test_wrong_values_are_refused(wrong: dict[str, Any]) -> None:
    """Rates, delays and losses out of range, or NaN, name their key."""
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        LinkConfig(**wrong)


STEPS_S = np.arange(1, 501) / 50


@pytest.mark.parametrize("rate_hz", [30.0, 45.0, 60.0, 120.0])
def test_an_unfixed_clock_finds_the_last_step(rate_hz: float) -> None:
    """On one machine each update brings the state of the last physics step, once; faster than the steps is no more."""
    taken = schedule(LinkConfig(rate_hz, clock=Clock.unfixed), STEPS_S, rng())
    found = np.unique(np.floor(np.arange(1, int(10 * rate_hz) + 1) * 50 / rate_hz + 1e-9).astype(int)) - 1
    assert [i for i, messages in enumerate(taken) if messages] == found[found >= 0].tolist()
    assert all(messages in ((), (i,)) for i, messages in enumerate(taken))


def test_two_unfixed_clocks_compare_different_steps() -> None:
    """The remote is a step behind where its step comes after the update's and the local one before it."""
    taken = schedule(LinkConfig(60.0, clock=Clock.unfixed, phase=0.5), STEPS_S, rng())
    pairs = [(i, messages[0]) for i, messages in enumerate(taken) if messages]
    assert {i - sent for i, sent in pairs} == {0, 1}
    # by hand: updates 2 to 8 find 1, 2, 3, 4, 5, 5, 6 local steps done, and 1, 2, 2, 3, 4, 5, 6 remote ones
    assert pairs[:6] == [(0, 0), (1, 1), (2, 1), (3, 2), (4, 4), (5, 5)]


def test_a_phase_needs_an_unfixed_clock() -> None:
    """With updates on physics steps there is no phase."""
    with pytest.raises(ConfigError, match=r"phase: must be 0 with clock=fixed, got 0\.5"):
        LinkConfig(phase=0.5)
