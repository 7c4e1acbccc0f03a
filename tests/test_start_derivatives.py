"""Derivatives by start states are probed before they are taken anew."""

from __future__ import annotations

import numpy as np
import pytest

from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.variable_projection import orthonormal, probing_move, told_move
from tests.cases import fitter_of
from tests.test_multiple_shooting import pushed, random_pushes


def test_a_probe_moves_all_that_is_told_by_a_standard_error() -> None:
    """What nothing measured depends on stays where it is, however coarse the measurement of the rest."""
    for noise in (1e-6, 1.0, 1e6):
        columns = np.random.default_rng(0).uniform(1.0, 3.0, (9, 4)) / noise
        columns[:, 2] = 0.0
        q, r = orthonormal(columns)
        assert q @ r == pytest.approx(columns)
        move = probing_move(r)
        assert move[2] == 0.0
        assert np.abs(q.T @ columns @ move) == pytest.approx([1.0, 1.0, 0.0, 1.0])


def test_a_start_of_which_nothing_is_told_stays() -> None:
    """So it does where a motion diverges whichever way its start is moved."""
    _, r = orthonormal(np.zeros((5, 3)))
    assert not probing_move(r).any()
    assert not told_move(r, np.ones((3, 2)), least_share=0.0).any()


def _from_near(fitter: Fitter, near_x: float) -> tuple[float, float]:
    """Return how far derivatives at the best friction part from those at another, which they are begun with.

    And what it costs to tell, in runs of all episodes.
    """
    explanation, episodes = Explanation((Candidate(fx.Friction),)), range(len(fitter.measured.values))
    rested = fitter.fit(explanation, episodes)
    near = fitter.fit(explanation, episodes, x=np.array([near_x]), iterations=0)
    before_s = fitter.simulator.simulated_s
    again = fitter.fit(explanation, episodes, x=rested.x, near=near, iterations=0)
    runs = (fitter.simulator.simulated_s - before_s) / sum(fitter.seconds(e) for e in episodes)
    return float(np.abs(again.basis.q[0] - near.basis.q[0]).max()), runs


def test_derivatives_that_hold_are_kept() -> None:
    """From nearly the same friction one run tells so; from half of it each start is moved anew."""
    fitter = fitter_of(pushed(random_pushes(3, 2.0), [(fx.Friction(0.31),)] * 3))
    assert fitter.fit(NONE, range(3)).total > fitter.measured.count(range(3))
    changed, few = _from_near(fitter, 0.0)
    assert changed == 0.0
    other, many = _from_near(fitter, -1.5)
    assert other > 0.0
    assert many > few + 4.0
