"""What a search ends with has come to rest, and what it goes by on the way is possible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from runner.effects.planar_box import Mass
from runner.inference.contender import likeliest_first
from runner.inference.forward_selection import leap_ahead
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


def test_what_is_out_of_its_range_is_no_mark_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little it leaves: others need not come near that, and no leap begins there."""
    recording, starts = made((Mass(2.0),), episodes=2, seconds=1.0)
    fitter, episodes = fitter_of(recording), [0, 1]
    rounds = Rounds.begun(fitter, episodes, starts, Beginning(), pieces=False)
    worth, dispersion = rounds.worth, rounds.dispersion
    (candidate,) = fitter.system.vocabulary.by_name["mass"]
    (parameter,) = candidate.parameters(fitter.context)
    at_its_end = Explanation((candidate,)), np.array([parameter.upper])
    out = fitter.fit(at_its_end[0], episodes, x=at_its_end[1], starts=starts, iterations=0)
    out = replace(out, residual=tuple(0.01 * r for r in rounds.nominal.residual))
    assert out.total < rounds.nominal.total
    rounds.take(out, rounds.alone)
    rounds.keep_seed(out)
    assert rounds.least_reached == rounds.nominal.total
    assert rounds.least_foreseen == np.inf
    assert (rounds.worth, rounds.dispersion) == (worth, dispersion)
    begun = []
    monkeypatch.setattr(
        "runner.inference.forward_selection.leap", lambda _fitter, fit, *_: (begun.append(fit) or fit, rounds.last)
    )
    leap_ahead(rounds)
    assert begun == [rounds.nominal]
