"""What a search ends with has come to rest."""

from __future__ import annotations

from runner.effects.planar_box import Mass
from runner.inference.contender import likeliest_first
from runner.inference.least_squares import Explanation
from runner.inference.rounds import Rounds
from runner.inference.search import _ended
from runner.inference.warm_start import Beginning
from tests.cases import fitter_of, made


def test_the_likeliest_is_carried_on_until_it_rests() -> None:
    """Its numbers are what is told: that its steps had been used up is no reason to tell others."""
    recording, starts = made((Mass(2.0),), episodes=2, seconds=1.0)
    fitter, episodes = fitter_of(recording), [0, 1]
    rounds = Rounds.begun(fitter, episodes, starts, Beginning(), pieces=False)
    mass = Explanation(tuple(fitter.system.vocabulary.by_name["mass"]))
    short = fitter.fit(mass, episodes, starts=starts, iterations=2)
    assert not short.converged
    rounds.take(short, rounds.around(short))
    assert likeliest_first(rounds.contenders)[0].fit is short
    best = _ended(rounds).best.fit
    assert best.explanation == mass
    assert best.converged
    assert best.total < short.total
    assert len([c for c in rounds.contenders if c.fit.explanation == mass]) == 1
