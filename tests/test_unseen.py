"""Start states of episodes that nothing was fitted to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.effects.planar_box import Friction
from runner.inference import unseen
from runner.inference.least_squares import NONE, Explanation
from tests.cases import fitter_of, made


def test_no_start_of_a_model_that_misses_much_is_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nominal model may begin elsewhere, however much it leaves of what was fitted."""
    recording, _ = made((Friction(0.2),), episodes=3, seconds=1.5)
    fitter = fitter_of(recording)
    nominal = fitter.fit(NONE, (0,))
    fit = fitter.fit(Explanation(fitter.system.vocabulary.by_name["friction"]), (0,), near=nominal)
    asked: list[int] = []

    def elsewhere(held: object, episode: int, start: np.ndarray) -> np.ndarray:
        asked.append(episode)
        return start + 1e-3

    monkeypatch.setattr(unseen, "_grown_start", elsewhere)
    bare: Any = SimpleNamespace(fit=nominal)
    before = unseen.unseen(bare, fitter, (1, 2), None)
    assert asked == [1, 2]
    np.testing.assert_allclose(before.starts, fitter.fit(NONE, (1, 2)).starts + 1e-3, atol=1e-9)
    explained: Any = SimpleNamespace(fit=fit)
    unseen.unseen(explained, fitter, (1, 2), before)
    assert asked == [1, 2]
