"""Two words for one motion are both heard, whichever of them a search came across."""

from __future__ import annotations

from runner.effects.planar_box import ActuatorDelay, Wind
from runner.inference.contender import likeliest_first
from runner.inference.least_squares import Explanation
from runner.inference.search import search, singles
from runner.inference.warm_start import Beginning, WarmStart, key_of
from tests.cases import fitter_of, made


def test_what_says_the_same_in_other_words_is_found_beside_the_likeliest() -> None:
    """A late push and a constant force: a late measurement, or a slope, in the place of either is the same motion."""
    recording, starts = made((ActuatorDelay(0.05), Wind(2.0, 0.3)), episodes=2, seconds=1.5)
    fitter, episodes = fitter_of(recording), [0, 1]
    vocabulary = fitter.system.vocabulary
    pair = Explanation(tuple(c for n in ("actuator_delay", "wind") for c in vocabulary.by_name[n]))
    fit = fitter.fit(pair, episodes, starts=starts)
    seeds = {key_of(pair): WarmStart(pair, fit.x, fit.starts, fit.total)}
    found = search(fitter, episodes, beginning=Beginning(seeds, singles(vocabulary), answered=True), most=2)
    by_names = {c.fit.explanation.names: c for c in likeliest_first(found.contenders)}
    for names in (("actuator_delay", "wind"), ("observation_delay", "wind"), ("actuator_delay", "floor_tilt")):
        assert abs(by_names[names].log_posterior - found.best.log_posterior) < 1.0
