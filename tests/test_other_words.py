"""Two words for one motion are both heard, whichever of them a search came across."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from runner.diagnosis.ranking import with_equals
from runner.diagnosis.result import Ranked
from runner.effects.planar_box import ActuatorDelay, Wind
from runner.inference.confounding import Rival, rivals
from runner.inference.contender import likeliest_first
from runner.inference.least_squares import Explanation
from runner.inference.search import search, singles
from runner.inference.warm_start import Beginning, WarmStart, key_of
from tests.cases import fitter_of, made


def test_what_says_the_same_in_other_words_is_found_beside_the_likeliest() -> None:
    """A late push and a constant force: a late measurement, or a slope, in the place of either is the same motion."""
    recording, starts = made((ActuatorDelay(0.05), Wind(0.7, 0.3)), episodes=2, seconds=1.0)
    fitter, episodes = fitter_of(recording), [0, 1]
    vocabulary = fitter.system.vocabulary
    pair = Explanation(tuple(c for n in ("actuator_delay", "wind") for c in vocabulary.by_name[n]))
    fit = fitter.fit(pair, episodes, starts=starts)
    seeds = {key_of(pair): WarmStart(pair, fit.x, fit.starts, fit.total)}
    found = search(fitter, episodes, beginning=Beginning(seeds, singles(vocabulary), answered=True), most=2)
    by_names = {c.fit.explanation.names: c for c in likeliest_first(found.contenders)}
    for names in (("actuator_delay", "wind"), ("observation_delay", "wind"), ("actuator_delay", "floor_tilt")):
        assert abs(by_names[names].log_posterior - found.best.log_posterior) < 1.0
    # what a trial shows to be one motion stands beside the first, though nothing else has put it there
    best = by_names["actuator_delay", "wind"]
    tried = rivals(best.around, best.evidence, fitter, [by_names["actuator_delay", "floor_tilt"].fit])
    assert {r.rival for r in tried if r.one} == {"floor_tilt", "observation_delay"}
    ranked = [entry("actuator_delay", "wind", probability=0.7), entry("mass", probability=0.2)]
    numbers = ({"floor_tilt": {"angle_rad": 0.01}}, {"floor_tilt": {"angle_rad": 0.001}})
    slope = replace(entry("actuator_delay", "floor_tilt", probability=0.1), parameters=numbers[0], errors=numbers[1])
    (first, second) = with_equals([*ranked, slope], best, tried, fitter.context)
    tilt, late = ("actuator_delay", "floor_tilt"), ("observation_delay", "wind")
    assert set(first.equivalent) == {tilt, late}
    assert first.probability == pytest.approx(0.8)
    assert first.equal_numbers[tilt] == numbers
    # what no entry of the ranking says the trial does, without errors
    told, errors = with_equals(ranked, best, tried, fitter.context)[0].equal_numbers[tilt]
    assert told["actuator_delay"]["delay_s"] == pytest.approx(0.05, rel=0.1)
    assert told["floor_tilt"]["angle_rad"] > 0.0
    assert errors == {}
    assert second == ranked[1]


def test_a_ranking_without_rivals_stays_as_it_is() -> None:
    ranked = (entry("mass", probability=0.6), entry("friction", probability=0.4))
    context: Any = None
    top: Any = SimpleNamespace(fit=SimpleNamespace(explanation=SimpleNamespace(names=("mass",))))
    assert with_equals(ranked, top, (), context) == ranked
    assert with_equals(ranked, top, [Rival("mass", "actuator_gain", 0.9, 3.0)], context) == ranked  # alike, and not one


def entry(*effects: str, probability: float) -> Ranked:
    """Return an explanation of a ranking."""
    return Ranked(tuple(sorted(effects)), (), probability, (), {}, {}, None, None)
