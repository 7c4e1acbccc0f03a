"""An episode that goes elsewhere than any model says does not decide what all others say together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from runner.effects.base import Parameter
from runner.inference.variable_projection import Descent, Ending, FitPoint, Residuals, Spread
from runner.noise.measured import Measured, refine
from runner.noise.model import NoiseModel
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Channel, Scatter
from tests.curves import Curves

T = np.linspace(0.0, 1.0, 60)
SHARED, ODD, FROM = 2.0, 40.0, 3.0
PARAMETERS = (Parameter("slope", "", 1.0, -100.0, 100.0),)


def episodes() -> list[NDArray[np.float64]]:
    """Return lines of one slope and starts of their own, with noise of 1, and one of quite another slope."""
    rng = np.random.default_rng(6)
    return [start + slope * T + rng.normal(size=len(T)) for start, slope in ((0, SHARED),) * 7 + ((3, ODD),)]


@dataclass
class Lines(Curves):
    """Lines of one slope, each with a start of its own; the first answers to its start as `first` says.

    Args:
        odd_from: See `Spread.beyond`.
        first: Where the first begins, from its start.
    """

    odd_from: float = np.inf
    first: Callable[[float], float] = float

    def residuals(self, x: NDArray[np.float64], starts: NDArray[np.float64]) -> Residuals:
        begins = [self.first(float(s[0])) if e == 0 else float(s[0]) for e, s in enumerate(starts)]
        residual = [b + x[0] * T - y for b, y in zip(begins, self.measured, strict=True)]
        if not np.isfinite(self.odd_from):
            return Residuals(residual, Spread.none(len(residual)))
        squares, counts = np.array([r @ r for r in residual]), np.full(len(residual), len(T))
        return Residuals(residual, Spread.beyond(self.odd_from, squares, counts))

    def slopes(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return T[:, None]

    def descended(
        self, steps: int, *, parameters: Sequence[Parameter] = PARAMETERS, tolerance: float = 1e-9, jumps: bool = False
    ) -> FitPoint:
        """Return where a descent from nothing ends."""
        count, begin = len(T) * len(self.measured), np.zeros((len(self.measured), 1))
        descent = Descent(parameters, self, count, np.inf, 0, tolerance, polish=True, jumps=jumps)
        return descent.down(self.linearise(np.zeros(1), begin, None, checked=False), steps)


def fitted(odd_from: float, *, parameters: tuple[Parameter, ...] = PARAMETERS, steps: int = 50) -> FitPoint:
    """Return where a fit of the shared slope ends, each episode with a start of its own."""
    return Lines(episodes(), odd_from).descended(steps, parameters=parameters)


def left(slope: float) -> NDArray[np.float64]:
    """Return the sum of squares of each episode at a slope, its start the best one."""
    return np.array([((d := y - slope * T) - d.mean()) @ (d - d.mean()) for y in episodes()])


def test_one_odd_episode_hardly_moves_a_fit() -> None:
    """It ends at the minimum of the sum of n c (1 + log(s / n c)) for what leaves more than c; squares end elsewhere.

    As near as fits come that much is left of: within a standard error of the slope.
    """
    n = len(T)

    def robust(slope: float) -> float:
        s = left(slope)
        return float(np.where(s > FROM * n, FROM * n * (1.0 + np.log(np.maximum(s, 1.0) / (FROM * n))), s).sum())

    told = fitted(FROM)
    best: Any = minimize_scalar(robust, bounds=(-10.0, 20.0), method="bounded", options={"xatol": 1e-9})
    assert told.x[0] == pytest.approx(best.x, abs=np.sqrt(12.0 / (n * 7)))
    assert told.total == pytest.approx(best.fun, rel=1e-3)
    assert abs(told.x[0] - SHARED) < 1.0
    assert fitted(np.inf).x[0] == pytest.approx(SHARED + (ODD - SHARED) / 8, abs=0.5)


def test_what_is_not_odd_is_as_it_was() -> None:
    """Below the limit the loss is the sum of squares, to the last bit."""
    squares = np.array([10.0, 179.0])
    spread = Spread.beyond(3.0, squares, np.array([60, 60]))
    assert spread.dispersion.tolist() == [1.0, 1.0]
    assert spread.volume.tolist() == [0.0, 0.0]
    assert Spread.beyond(3.0, np.array([np.inf]), np.array([60])).dispersion.tolist() == [1.0]


@pytest.mark.parametrize("differ", [True, False])
def test_what_is_odd_is_told_by_the_others(*, differ: bool) -> None:
    """Three times what a model leaves of most episodes; where episodes do not differ none is odd."""
    rng = np.random.default_rng(2)
    values = tuple(rng.normal(size=(400, 1)) for _ in range(5))
    white, valid = NoiseModel.white(1), tuple(np.ones((400, 1), bool) for _ in values)
    spans = tuple(Span(e, 0, 400) for e in range(5))
    known = Measured(spans, values, np.ones(1), white, valid, np.ones(1))
    system: Any = SimpleNamespace(
        episodes_differ=differ,
        values=lambda: values,
        noise_by_owner=lambda: np.ones(1),
        channels=(Channel("x", "m", "position", "x"),),
        rate_hz=100.0,
        recording=SimpleNamespace(episodes=[SimpleNamespace(step_s=0.01) for _ in values]),
    )
    slow = 2.0 * np.sin(np.linspace(0.0, 6.0, 400))[:, None]
    residuals = {e: v + slow * (10.0 if e == 0 else 1.0) for e, v in enumerate(values)}
    found = refine(known, system, residuals).odd_from
    usual = (1.0 + (slow**2).mean()) / found * SETTINGS.noise.odd_episode_ratio
    assert usual == pytest.approx(1.0, rel=0.15) if differ else found == np.inf


def test_an_episode_that_cannot_follow_does_not_hold_the_others() -> None:
    """One whose start derivative is wrong (a kink) stays; the slope that all share is found all the same."""
    # the first answers to its start by a hundredfold of what its derivative says, from where it is on
    found = Lines(episodes()[:7], first=lambda start: 100.0 * abs(start)).descended(50)
    assert found.x[0] == pytest.approx(SHARED, abs=4 * np.sqrt(12.0 / (len(T) * 7)))


def test_what_follows_a_hit_is_as_noisy_as_models_differ() -> None:
    """Before it residuals are in units of the sensor's noise, after it of the scatter; each part begins anew."""
    calm = np.ones(100, bool)
    calm[40:50] = False
    valid = (np.ones((100, 1), bool),)
    scatter = Scatter(np.array([4.0]), (calm,))
    measured = Measured(
        (Span(0, 0, 100),), (np.zeros((100, 1)),), np.array([2.0]), NoiseModel.white(1), valid, np.ones(1), scatter
    )
    assert measured.sigma.tolist() == [4.0]
    assert measured.is_scatter().tolist() == [True]
    told = measured.whiten(0, np.full((100, 1), 8.0))[:, 0]
    assert told.tolist() == [4.0] * 40 + [2.0] * 60
    parts = measured.parts([Span(0, 0, 30), Span(0, 45, 60), Span(0, 60, 100)])
    units = [set(parts.whiten(i, np.full((n, 1), 8.0))[:, 0]) for i, n in enumerate((30, 15, 40))]
    assert units == [{4.0}, {2.0}, {4.0}]


def test_what_is_a_hundred_prior_widths_off_is_reached_in_a_dozen_steps() -> None:
    """A step that was as long as it may be and gained what it promised makes room for one of twice the length."""
    narrow = (Parameter("slope", "", 0.05, -100.0, 100.0),)
    far, whole = fitted(np.inf, parameters=narrow, steps=12), fitted(np.inf)
    assert abs(whole.x[0]) > 100 * narrow[0].scale
    assert far.x[0] == pytest.approx(whole.x[0], rel=0.05)  # it rests where little of what is left is promised


@pytest.mark.parametrize(("jumps", "rests"), [(True, True), (False, False)])
def test_through_a_hit_a_promise_is_worth_what_the_last_one_was(jumps: bool, rests: bool) -> None:
    """After a step that gained a billionth of what it promised none is taken; a smooth motion keeps to its slopes."""
    found = Lines([SHARED * T], gained_share=1e-9).descended(50, tolerance=1e-6, jumps=jumps)
    assert (found.x[0] == 0.0) == rests
    assert rests or found.x[0] == pytest.approx(SHARED, abs=1e-3)


def test_a_descent_rests_where_what_suits_each_episode_gains_next_to_nothing() -> None:
    """Derivatives promise all of an offset, steps of a size that an edge allows take off a thousandth of that."""
    edge = Lines([np.full(len(T), 10.0), np.zeros(len(T))], first=lambda s: 1e-3 * s if s < 5.0 else 100.0)
    fixed = (Parameter("slope", "", 1.0, 0.0, 0.0),)
    assert edge.descended(50, parameters=fixed, tolerance=2.0).ending is Ending.RESTED
    assert len(edge.taken) <= 5  # of 50 steps


def test_a_descent_rests_where_no_step_however_short_leads_down() -> None:
    """An edge, as between holding and slipping: derivatives taken on one side of it promise what neither side has."""
    edge = Lines([np.full(len(T), 10.0), np.zeros(len(T))], first=lambda s: -abs(s))
    fixed = (Parameter("slope", "", 1.0, 0.0, 0.0),)
    assert edge.descended(50, parameters=fixed).ending is Ending.RESTED
    assert edge.descended(3, parameters=fixed).ending is None  # it has not tried short ones by then
