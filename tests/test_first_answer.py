"""A search says what it has from its first fit on: all the fits of single effects may take minutes."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from runner.diagnosis.noise_account import has_hidden
from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import Explanation, Fitter
from runner.inference.search import Search, fitted_again, near_likeliest, resumed, search, weighed_again
from runner.inference.warm_start import Beginning, WarmStart, key_of
from runner.progress import Step
from runner.settings import SETTINGS
from tests.cases import fitter_of
from tests.test_multiple_shooting import pushed, random_pushes


class Told:
    """Keeps what it is told, in order: what is fitted, and what is best so far with its probability."""

    def __init__(self) -> None:
        self.fitted: list[tuple[str, ...]] = []
        self.best_after: list[tuple[int, tuple[str, ...], float]] = []

    def step(self, step: Step, what: str = "") -> None:
        """Ignore it."""

    def fitting(self, effects: Sequence[str]) -> None:
        """Count it."""
        self.fitted.append(tuple(effects))

    def best(self, effects: Sequence[str], noises: float, probability: float, part: str = "") -> None:
        """Keep it, with how many fits had begun by then."""
        self.best_after.append((len(self.fitted), tuple(effects), probability))


@functools.cache
def searched() -> tuple[Fitter, Told, Search]:
    """Return the fitter of a recording behind a gain of commands, what its search has told, and found."""
    told = Told()
    fitter = replace(fitter_of(pushed(random_pushes(3, 2.0), [(fx.ActuatorGain(1.3),)] * 3)), observer=told)
    return fitter, told, search(fitter, range(3), most=1)


def test_the_best_so_far_is_told_before_all_single_effects_are_fitted() -> None:
    """The nominal model first, then what takes most off as soon as it is fitted, with a probability."""
    _, told, found = searched()
    assert found.best.fit.explanation.names == ("actuator_gain",)
    assert told.best_after[0][1] == ()
    singles = [i for i, names in enumerate(told.fitted, 1) if len(names) == 1]
    # a mass that is less by as much does the same here: whichever is fitted first is told
    first = next(after for after, names, _ in told.best_after if names in {("actuator_gain",), ("mass",)})
    assert first <= singles[len(singles) // 4]
    assert all(0.0 <= p <= 1.0 for _, _, p in told.best_after)


def test_an_answer_is_told_until_a_second_search_has_fitted_it_again() -> None:
    """A search that goes on with another account of the noise does not begin by telling that nothing is needed."""
    fitter, _, found = searched()
    told = Told()
    again = replace(fitter, observer=told)
    search(again, range(3), starts=found.nominal.starts, beginning=resumed(found, again), most=1)
    assert {names for _, names, _ in told.best_after} == {("actuator_gain",)}


def test_what_is_fitted_again_in_other_steps_is_what_is_near() -> None:
    """Numbers follow the steps, and no other effects are tried; what is hopelessly behind stays as it is."""
    fitter, _, found = searched()
    told = Told()
    again = fitted_again(found, replace(fitter, simulator=fitter.simulator.surveying(), observer=told))
    names = {c.fit.explanation.names for c in found.contenders}
    hopeless = found.best.log_posterior - SETTINGS.held_out.hopeless_log_odds
    near = {c.fit.explanation.names for c in found.contenders if c.log_posterior > hopeless}
    assert ("actuator_gain",) in near < names
    assert {c.fit.explanation.names for c in again.contenders} == names
    assert set(told.fitted) == near | {()}
    kept = {id(c.fit) for c in found.contenders}
    assert all(id(c.fit) in kept for c in again.contenders if c.fit.explanation.names not in near | {()})
    best = next(c.fit for c in again.contenders if c.fit.explanation.names == ("actuator_gain",))
    assert best.x == pytest.approx(found.best.fit.x, abs=0.02)
    assert not np.array_equal(best.x, found.best.fit.x)


def test_with_another_account_of_the_noise_what_is_compared_is_of_that_alone() -> None:
    """Evidence with one noise is not held against that with another; no effect is tried that was not before."""
    fitter, _, found = searched()
    told, noisier = Told(), replace(fitter.measured, sensor=2.0 * fitter.measured.sensor)
    again = weighed_again(found, replace(fitter, measured=noisier, observer=told))
    others = [c.fit.explanation.names for c in found.contenders[1:] if c.fit.explanation.candidates]
    near = {f.explanation.names for f in near_likeliest(found)}
    further = [names for names in others if names not in near][: SETTINGS.search.compared]
    assert set(told.fitted) == {(), *near, *further}
    assert again.best.fit.explanation.names == ("actuator_gain",)
    before = {id(c.fit) for c in found.contenders}
    assert not any(id(c.fit) in before for c in again.contenders)
    assert again.nominal.total == pytest.approx(found.nominal.total / 4.0, rel=0.05)


def test_an_answer_that_does_not_hold_any_more_is_not_told_for_ever() -> None:
    """Two effects were the best by another account of the noise; by this one a single effect is, and that is told."""
    recording = pushed(random_pushes(3, 2.0), [(fx.ActuatorGain(1.3),)] * 3)
    told = Told()
    fitter = replace(fitter_of(recording), observer=told)
    both = Explanation((Candidate(fx.ActuatorGain), Candidate(fx.Mass)))
    fit = fitter.fit(both, range(3))
    seeds = {key_of(both): WarmStart(both, fit.x, fit.starts, fit.total)}
    told.best_after.clear()
    found = search(fitter, range(3), beginning=Beginning(seeds, answered=True), most=2)
    assert told.best_after[-1][1] == found.best.fit.explanation.names
    assert len(found.best.fit.explanation.names) == 1


def test_what_an_effect_is_needed_for_is_told_with_another_account_of_the_noise_too() -> None:
    """However far behind, what has some of the effects of the likeliest is compared with it."""
    fitter, _, found = searched()
    both = Explanation((Candidate(fx.ActuatorGain), Candidate(fx.AirDrag)))
    whole, *others = found.contenders
    first = replace(whole, fit=fitter.fit(both, range(3)))
    gain = replace(whole, log_posterior=whole.log_posterior - 1e4)
    behind = [replace(c, log_posterior=c.log_posterior - 1e3) for c in others]
    many = Search((first, *behind, gain), found.nominal)
    again = weighed_again(many, fitter)
    assert ("actuator_gain",) in {c.fit.explanation.names for c in again.contenders}


def test_noise_hides_nothing_where_more_than_it_is_left() -> None:
    """In each channel by itself: one in which the best leaves the noise may have hidden an effect there."""
    fitter, _, found = searched()
    best, was = found.best.fit, fitter.measured
    small = replace(was, sensor=0.5 * was.sensor)
    assert has_hidden(best, was, small)  # it leaves no more than the noise
    left = tuple(2.0 * r for r in best.residual)
    assert not has_hidden(replace(best, residual=left), was, small)
    scale = np.array([1.0] + [2.0] * (len(was.sensor) - 1))
    some = tuple((r.reshape(-1, len(scale)) * scale).ravel() for r in best.residual)
    assert has_hidden(replace(best, residual=some), was, small)
    assert not has_hidden(replace(best, residual=some), was, replace(was, sensor=was.sensor / scale))
