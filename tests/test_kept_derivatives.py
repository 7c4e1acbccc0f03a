"""Derivatives are kept where a step did what they foretold, and are taken anew before a fit ends."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from runner.effects import planar_box as fx
from runner.effects.base import Parameter
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import Explanation, _Problem
from runner.inference.variable_projection import Descent, Ending, FitPoint, Residuals, Spread
from tests.cases import fitter_of
from tests.curves import Curves
from tests.test_multiple_shooting import pushed, random_pushes

T = np.linspace(0.0, 2.0, 80)
RATES, LEVELS = np.array([0.8, 2.5]), (0.3, -0.2)
PARAMETERS = (Parameter("slow", "1/s", 0.5, 0.0, 10.0), Parameter("fast", "1/s", 0.5, 0.0, 10.0))


class Decays(Curves):
    """Sums of two decays over time, which all episodes share."""

    def residuals(self, x: NDArray[np.float64], starts: NDArray[np.float64]) -> Residuals:
        curve = np.exp(-np.outer(T, x)).sum(axis=1)
        return Residuals(
            [s[0] + curve - y for s, y in zip(starts, self.measured, strict=True)], Spread.none(len(starts))
        )

    def slopes(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives by the rates, (n, 2)."""
        return -T[:, None] * np.exp(-np.outer(T, x))


def recorded() -> list[NDArray[np.float64]]:
    """Return two episodes with a little noise."""
    rng = np.random.default_rng(2)
    curve = np.exp(-np.outer(T, RATES)).sum(axis=1)
    return [level + curve + 1e-3 * rng.normal(size=len(T)) for level in LEVELS]


def descended(problem: Decays, *, jumps: bool = False) -> FitPoint:
    """Return where a descent from slower decays ends."""
    begin = problem.linearise(np.array([0.4, 1.5]), np.zeros((2, 1)), None, checked=False)
    return Descent(PARAMETERS, problem, 2 * len(T), np.inf, 0, 1e-12, polish=True, jumps=jumps).down(begin, 60)


def test_a_descent_by_kept_derivatives_ends_where_one_by_fresh_ones_does() -> None:
    """Its end is that of `scipy.optimize.least_squares`, and its derivatives there are those of the end."""
    measured = recorded()

    def residuals(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate(Decays(measured).residuals(z[:2], z[2:, None]).each)

    reference = least_squares(residuals, [0.4, 1.5, 0.0, 0.0], xtol=1e-12, ftol=1e-12, gtol=1e-12)
    problem = Decays(measured)
    found = descended(problem)
    assert found.ending is Ending.RESTED
    assert found.total == pytest.approx(2 * reference.cost, rel=1e-6)
    assert found.x == pytest.approx(reference.x[:2], rel=1e-3)
    assert found.taken
    assert found.jacobian[0] == pytest.approx(problem.slopes(found.x))


def test_derivatives_are_taken_less_often_than_steps_are() -> None:
    """Where a step may have jumped, as through a hit, each has its own; where it can't have, those that bent have."""
    by_kept, by_fresh = Decays(recorded()), Decays(recorded())
    ends = [descended(by_kept), descended(by_fresh, jumps=True)]
    assert ends[0].total == pytest.approx(ends[1].total, rel=1e-6)
    assert len(by_kept.taken) < len(by_fresh.taken)


def test_what_is_given_up_has_derivatives_of_its_own() -> None:
    """A fit that will not come near another is judged, and compared, by the derivatives of where it stands."""
    problem = Decays(recorded())
    begin = problem.linearise(np.array([0.7, 2.3]), np.zeros((2, 1)), None, checked=False)
    dx = np.array([0.05, 0.1])
    there = begin.moved(dx, np.zeros((2, 1)), problem.residuals(begin.x + dx, begin.starts))
    assert not there.taken
    hopeless = Descent(PARAMETERS, problem, 10**9, -1e12, -1, 1e-12, polish=True, jumps=False)
    found = hopeless.down(there, 10)
    assert found.ending is Ending.BEHIND
    assert found.jacobian[0] == pytest.approx(problem.slopes(found.x))


def test_a_step_is_foretold_where_little_of_it_is_missed() -> None:
    """Of a short step hardly anything is, of a long one much; and where only starts move, nothing at all."""
    problem = Decays(recorded())
    point = problem.linearise(np.array([0.4, 1.5]), np.zeros((2, 1)), None, checked=False)
    for length, foretold in ((0.01, True), (1.0, False)):
        dx, ds = length * np.array([0.4, 1.0]), np.zeros((2, 1))
        assert point.foretold(dx, ds, problem.residuals(point.x + dx, point.starts)) == foretold
    still, ds = np.zeros(2), np.array([[0.2], [-5.0]])
    assert point.foretold(still, ds, problem.residuals(point.x, point.starts + ds))


@pytest.mark.parametrize("effects", [(), (fx.Friction, fx.ViscousDrag)])
def test_what_was_simulated_alone_serves_derivatives_to_the_bit(effects: tuple[type[fx.PlanarEffect], ...]) -> None:
    """Differences are small: nothing of a simulation may depend on what it is run beside. It is not run again."""
    fitter = fitter_of(pushed(random_pushes(2, 1.0), [()] * 2))
    explanation, starts = Explanation(tuple(Candidate(e) for e in effects)), fitter.first_starts([0, 1])
    problem = _Problem(fitter, explanation, [0, 1])
    x = np.full(len(explanation.parameters(fitter.context)), 0.1)
    there = problem.residuals(x, starts)
    once_s = fitter.simulator.simulated_s
    beside = problem.linearise(x, starts, None, checked=False)
    together_s = fitter.simulator.simulated_s - once_s
    after = problem.linearise(x, starts, None, checked=False, there=there)
    assert fitter.simulator.simulated_s == pytest.approx(2 * together_s)
    for e in (0, 1):
        assert np.array_equal(there.each[e], beside.residual[e])
        assert np.array_equal(after.jacobian[e], beside.jacobian[e])
        assert np.array_equal(after.basis.q[e], beside.basis.q[e])
    bare = problem.linearise(x, starts, after.basis, checked=False, there=there)
    assert np.array_equal(bare.residual[0], there.each[0])
    assert fitter.simulator.simulated_s == pytest.approx(2 * together_s + len(x) * once_s)
