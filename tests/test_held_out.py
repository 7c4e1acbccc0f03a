"""What explanations leave of episodes counts by the errors of the likeliest, not of one that takes them for its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from runner.inference.held_out import _with_what_is_left
from runner.settings import SETTINGS
from tests.contended import Contended

COUNT = 1000


def contended(log_posterior: float, left: float, *names: str) -> Any:
    """Return one that leaves so much beyond the noise."""
    explanation = SimpleNamespace(candidates=names)
    fit = SimpleNamespace(explanation=explanation, episodes=(0,))
    return Contended(fit, log_posterior, SimpleNamespace(left=COUNT + left))


def lead(*contenders: Any) -> float:
    """Return by how much the first leads the second once what they leave counts, of unseen episodes as of fitted."""
    fitter: Any = SimpleNamespace(measured=SimpleNamespace(count=lambda episodes: COUNT))
    unseen = {id(c.fit): c.evidence for c in contenders}
    first, second = _with_what_is_left(contenders, unseen, (1,), fitter)[:2]
    return first.log_posterior - second.log_posterior


def test_one_effect_more_does_not_set_the_measure() -> None:
    """Evidence takes what a pair leaves for mismatch: that a third effect can do the same makes it no likelier."""
    pair, third = contended(0.0, 2000.0, "gain", "mass"), contended(-9.0, 0.0, "gain", "mass", "clock")
    few = SETTINGS.held_out.independent_errors_unseen  # as many voices have the unseen episodes, one the fitted
    assert lead(pair, third) == pytest.approx(9.0 - 0.5 * few - 0.5, abs=0.1)
    # as little as evidence says for it, or as much
    assert lead(contended(-9.0, 2000.0, "gain", "mass"), contended(0.0, 0.0, "gain", "mass", "clock")) < -500.0


def test_another_cause_that_leaves_little_sets_the_measure() -> None:
    """Where mismatch could do all, the explanation that predicts is the likelier one; so is any beside no effect."""
    assert lead(contended(0.0, 2000.0, "gain", "mass"), contended(-9.0, 0.0, "gain", "clock")) < -500.0
    assert lead(contended(0.0, 2000.0), contended(-9.0, 0.0, "gain")) < -500.0
