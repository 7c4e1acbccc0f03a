"""Causes and small deviations: what moves nothing by the noise is not named beside what does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from runner.effects.planar_box import Inertia, ViscousDrag
from runner.inference.contender import Contender, contend
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import Explanation, Fitter
from runner.inference.materiality import causes_of, influence
from runner.systems.simulator import Run
from tests.cases import fitter_of, made

DRAG = 0.3
EPISODES = (0, 1)


def contenders(ratio: float) -> tuple[Fitter, dict[tuple[str, ...], Contender]]:
    """Plant drag and an inertia that is off by a ratio; return what either and both make of it, by names."""
    recording, _ = made((ViscousDrag(DRAG), Inertia(ratio)), seed=4, episodes=2, seconds=2.0)
    fitter = fitter_of(recording)
    named = {c.effect.name: c for c in fitter.system.vocabulary}
    out: dict[tuple[str, ...], Contender] = {}
    for names in (("viscous_drag",), ("inertia",), ("inertia", "viscous_drag")):
        fit = fitter.fit(Explanation(tuple(named[n] for n in names)), EPISODES, iterations=25)
        out[names] = contend(fitter, fit, sensitivities(fitter, fit, directions(fitter.system)))
    return fitter, out


@pytest.fixture(scope="module")
def slight() -> tuple[Fitter, dict[tuple[str, ...], Contender]]:
    return contenders(1.002)


def test_influence_is_how_far_an_effect_moves_the_prediction_in_noises(slight: Any) -> None:
    """Held against the difference of two simulations, by channel, the largest."""
    fitter, found = slight
    fit = found[("inertia", "viscous_drag")].fit
    moved = {c.name: far for c, far in influence(fit, fitter).items()}
    both = fit.explanation.make(fit.x, fitter.context)
    (drag,) = (e for e in both if isinstance(e, ViscousDrag))
    rows = [
        np.subtract(*fitter.simulator.predict(e, [Run(both, start), Run((drag,), start)])) / fitter.measured.sigma
        for e, start in zip(fit.episodes, fit.starts, strict=True)
    ]
    expected = np.sqrt(np.mean(np.concatenate(rows) ** 2, axis=0)).max()
    assert moved["inertia"] == pytest.approx(expected, rel=1e-6)
    assert moved["viscous_drag"] > 20 * moved["inertia"]


def test_the_cause_stands_for_what_holds_a_small_deviation_beside_it(slight: Any) -> None:
    """However much more likely the two were: the odds go to the one, and the pair is told no more."""
    fitter, found = slight
    likelier = replace(found[("inertia", "viscous_drag")], log_posterior=found[("viscous_drag",)].log_posterior + 60.0)
    told = causes_of([likelier, found[("viscous_drag",)]], fitter, gap=50.0)
    assert [c.fit.explanation.names for c in told] == [("viscous_drag",)]
    assert told[0].log_posterior == pytest.approx(likelier.log_posterior, abs=1e-6)


def test_two_causes_stay_two() -> None:
    """An inertia that is off by 5 % moves the body by many noises."""
    fitter, found = contenders(1.05)
    likelier = replace(found[("inertia", "viscous_drag")], log_posterior=found[("viscous_drag",)].log_posterior + 60.0)
    told = causes_of([likelier, found[("viscous_drag",)]], fitter, gap=50.0)
    assert [c.fit.explanation.names for c in told] == [("inertia", "viscous_drag"), ("viscous_drag",)]
