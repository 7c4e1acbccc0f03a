"""Derivatives follow from what a step showed where it did what they foretold, and are taken anew before a fit rests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from runner.effects.base import Parameter
from runner.inference.variable_projection import Basis, Descent, Ending, FitPoint, Shown, Spread, orthonormal

T = np.linspace(0.0, 2.0, 80)
RATES, LEVELS = np.array([0.8, 2.5]), (0.3, -0.2)
PARAMETERS = (Parameter("slow", "1/s", 0.5, 0.0, 10.0), Parameter("fast", "1/s", 0.5, 0.0, 10.0))


@dataclass
class Decays:
    """Sums of two decays over time, which all episodes share, each episode with a level of its own."""

    measured: list[NDArray[np.float64]]
    taken: list[NDArray[np.float64]] = field(default_factory=list)

    def shown(self, x: NDArray[np.float64], starts: NDArray[np.float64]) -> Shown:
        curve = np.exp(-np.outer(T, x)).sum(axis=1)
        return Shown([s[0] + curve - y for s, y in zip(starts, self.measured, strict=True)], Spread.none(len(starts)))

    def linearise(
        self,
        x: NDArray[np.float64],
        starts: NDArray[np.float64],
        basis: Basis | None,
        *,
        checked: bool,
        shown: Shown | None = None,
    ) -> FitPoint:
        self.taken.append(x)
        there = shown or self.shown(x, starts)
        around = Basis(*zip(*[orthonormal(np.ones((len(T), 1))) for _ in starts], strict=True))
        return FitPoint(x, starts, there.residual, [self.slopes(x)] * len(starts), there.spread, around, fresh=True)

    def slopes(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives by the rates, (n, 2)."""
        return -T[:, None] * np.exp(-np.outer(T, x))

    def best(
        self, x: NDArray[np.float64], starts: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        left = np.array([[r @ r for r in self.shown(x, starts[:, k]).residual] for k in range(starts.shape[1])]).T
        return starts[np.arange(len(starts)), left.argmin(axis=1)], left.min(axis=1)


def recorded() -> list[NDArray[np.float64]]:
    """Return two episodes with a little noise."""
    rng = np.random.default_rng(2)
    curve = np.exp(-np.outer(T, RATES)).sum(axis=1)
    return [level + curve + 1e-3 * rng.normal(size=len(T)) for level in LEVELS]


def descended(problem: Decays, *, jumps: bool = False) -> FitPoint:
    """Return where a descent from slower decays ends."""
    begin = problem.linearise(np.array([0.4, 1.5]), np.zeros((2, 1)), None, checked=False)
    return Descent(PARAMETERS, problem, 2 * len(T), np.inf, 0, 1e-12, polish=True, jumps=jumps).down(begin, 60)


def test_a_descent_by_secants_ends_where_one_by_derivatives_does() -> None:
    """Its end is that of `scipy.optimize.least_squares`, and its derivatives there are those of the end."""
    measured = recorded()

    def residuals(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate(Decays(measured).shown(z[:2], z[2:, None]).residual)

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
    by_secants, by_derivatives = Decays(recorded()), Decays(recorded())
    ends = [descended(by_secants), descended(by_derivatives, jumps=True)]
    assert ends[0].total == pytest.approx(ends[1].total, rel=1e-6)
    assert len(by_secants.taken) < len(by_derivatives.taken)


def test_what_is_given_up_has_derivatives_of_its_own() -> None:
    """A fit that will not come near another is judged, and compared, by the derivatives of where it stands."""
    problem = Decays(recorded())
    begin = problem.linearise(np.array([0.7, 2.3]), np.zeros((2, 1)), None, checked=False)
    there = begin.followed(
        problem.shown(np.array([0.75, 2.4]), begin.starts), np.array([0.05, 0.1]), np.zeros((2, 1)), np.ones(2)
    )
    assert not there.taken
    hopeless = Descent(PARAMETERS, problem, 10**9, -1e12, -1, 1e-12, polish=True, jumps=False)
    found = hopeless.down(there, 10)
    assert found.ending is Ending.BEHIND
    assert found.jacobian[0] == pytest.approx(problem.slopes(found.x))


def test_where_starts_move_as_well_each_move_answers_for_its_share() -> None:
    """What was missed is put on the parameters by as much as they were to have done, the rest is left to the starts."""
    problem = Decays(recorded())
    point = problem.linearise(np.array([0.4, 1.5]), np.zeros((2, 1)), None, checked=False)
    dx, ds = np.array([0.1, -0.3]), np.array([[0.2], [0.0]])
    shown = problem.shown(point.x + dx, point.starts + ds)
    there = point.followed(shown, dx, ds, np.array([0.5, 2.0]))
    for k, moved in enumerate(ds):
        own = point.jacobian[k] @ dx
        missed = shown.residual[k] - point.residual[k] - own - moved[0]
        share = (own @ own) / (own @ own + len(T) * moved[0] ** 2)
        assert there.jacobian[k] @ dx == pytest.approx(own + share * missed)


def test_what_a_step_showed_is_what_its_derivatives_would_have_foretold() -> None:
    """Where starts stay, the secant equation holds exactly: the new derivatives times the step are the change."""
    problem = Decays(recorded())
    point = problem.linearise(np.array([0.4, 1.5]), np.zeros((2, 1)), None, checked=False)
    dx, ds = np.array([0.1, -0.3]), np.zeros((2, 1))
    there = point.followed(problem.shown(point.x + dx, point.starts + ds), dx, ds, np.array([0.5, 2.0]))
    for before, after, slopes in zip(point.residual, there.residual, there.jacobian, strict=True):
        assert slopes @ dx == pytest.approx(after - before)
    assert not there.taken
    across = np.array([0.3 * 0.5**2, 0.1 * 2.0**2])  # of which, at right angles to it in prior widths, it shows nothing
    assert there.jacobian[0] @ across == pytest.approx(point.jacobian[0] @ across)
