"""A force that nothing foretells: what it does, and that it is integrated out exactly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.diagnosis.pipeline import diagnose
from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.inference.directions import Direction, Sensitivities
from runner.inference.evidence import evidence, log_densities
from runner.inference.least_squares import NONE, Explanation, Fit
from runner.inference.normal_equations import normal_equations, together, without_process
from runner.inference.process_noise import pushed
from runner.inference.variable_projection import Basis, Spread
from runner.recording import Recording
from runner.settings import SETTINGS
from runner.systems.planar_box.simulator import context_of
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from runner.systems.windows import Windows
from tests.cases import SIGMA, fitter_of, made
from tests.mechanism_cases import slide_case, system_of

LEVELS = (0.5, 1.0)


def fit_leaving(residual: np.ndarray) -> Fit:
    """Return a fit without effects and without start states that leaves this residual, (n,), in one episode."""
    n = len(residual)
    nothing = np.zeros((n, 0))
    basis = Basis((nothing,), (np.zeros((0, 0)),))
    return Fit(
        NONE,
        np.empty(0),
        np.zeros((1, 0)),
        (0,),
        (residual,),
        (nothing,),
        Spread.none(1),
        basis,
        np.zeros(0, bool),
        converged=True,
    )


def gaussian(x: np.ndarray, covariance: np.ndarray) -> float:
    """Return the log density of a normal distribution about 0 at x, (n,)."""
    size, off = np.linalg.slogdet(covariance).logabsdet, x @ np.linalg.solve(covariance, x)
    return -0.5 * float(len(x) * np.log(2 * np.pi) + size + off)


def test_a_force_that_nothing_foretells_is_integrated_out_exactly() -> None:
    """Together with mismatch, over all scales and levels, in two sets of episodes: the mean of Gaussian densities."""
    rng = np.random.default_rng(5)
    system: Any = SimpleNamespace(context=None, mismatch_levels=LEVELS, episodes_differ=False)
    direction = Direction(Candidate(fx.Friction), np.ones(1), 1.0, 0.3)
    parts, answers, columns, residuals = [], [], [], []
    for n, intervals in ((7, 3), (9, 4)):
        answer, column, residual = 300.0 * rng.normal(size=(n, intervals)), rng.normal(size=(n, 1)), rng.normal(size=n)
        known = Sensitivities((direction,), (column,), (answer,))
        parts.append(normal_equations(fit_leaving(residual), known))
        answers.append(answer)
        columns.append(column)
        residuals.append(residual)
    found = evidence(together(*parts), system)
    column, residual = np.vstack(columns)[:, 0], np.concatenate(residuals)
    n = len(residual)
    forced = np.zeros((n, n))
    forced[:7, :7], forced[7:, 7:] = (a @ a.T for a in answers)
    logs = [
        gaussian(residual, np.eye(n) + scale**2 * forced + (0.3 * level) ** 2 * np.outer(column, column))
        for scale in SETTINGS.process.scales
        for level in LEVELS
    ]
    exact = np.logaddexp.reduce(logs) - np.log(len(logs)) + 0.5 * n * np.log(2 * np.pi)
    assert found.log == pytest.approx(exact, abs=1e-8)
    by_scale = np.logaddexp.reduce(np.reshape(logs, (-1, len(LEVELS))), axis=1) - np.log(len(LEVELS))
    np.testing.assert_allclose(found.scales, by_scale + 0.5 * n * np.log(2 * np.pi), atol=1e-8)


def test_own_parameters_are_integrated_out_with_it() -> None:
    """One parameter, linear, known scale and level: the Gaussian integral over it, by quadrature; and its error."""
    rng = np.random.default_rng(7)
    context = context_of(made(episodes=2, seconds=1.0)[0])
    system: Any = SimpleNamespace(context=context, mismatch_levels=(1.0,), episodes_differ=False)
    n, at = 40, 5
    answer, column, slope = 80.0 * rng.normal(size=(n, 6)), rng.normal(size=(n, 1)), 50.0 * rng.normal(size=n)
    residual = rng.normal(size=n) + answer @ rng.normal(scale=SETTINGS.process.scales[at], size=6)
    fit = fit_leaving(residual)
    fit = replace(
        fit,
        explanation=Explanation((Candidate(fx.Friction),)),
        x=np.array([0.05]),
        jacobian=(slope[:, None],),
        at_bound=np.zeros(1, bool),
    )
    direction = Direction(Candidate(fx.Mass), np.ones(1), 1.0, 0.3)
    around = normal_equations(fit, Sensitivities((direction,), (column,), (answer,)))
    known = np.eye(len(SETTINGS.process.scales))[at]
    found = evidence(around, system, scales=known)
    covariance = np.eye(n) + SETTINGS.process.scales[at] ** 2 * answer @ answer.T + 0.09 * column @ column.T
    density = float(log_densities(fit, context)[0])
    width = 2 * np.pi * np.exp(2 * density)
    steps = np.linspace(-0.3, 0.3, 60_001)
    # residuals move by the slope; the prior is as wide as its density says
    inverse = np.linalg.inv(covariance)
    squares = np.einsum("ki,ij,kj->k", residual + steps[:, None] * slope, inverse, residual + steps[:, None] * slope)
    logs = -0.5 * (squares + width * steps**2 + np.linalg.slogdet(covariance).logabsdet) + density
    exact = np.logaddexp.reduce(logs) + np.log(steps[1] - steps[0])
    assert found.log == pytest.approx(exact, abs=1e-4)
    # fitted by plain least squares, it scatters with all that the residuals scatter by (the sandwich of White 1982)
    plain = 1.0 / (slope @ slope + width)
    assert found.covariance[0, 0] == pytest.approx(plain**2 * (slope @ covariance @ slope), rel=1e-9)


def test_residuals_are_whitened_by_the_force() -> None:
    """Their squares are those of a Gaussian with the covariance of noise and force."""
    rng = np.random.default_rng(9)
    residual, answer, at = rng.normal(size=30), 40.0 * rng.normal(size=(30, 5)), 7
    white = without_process(fit_leaving(residual), (answer,), at).residual[0]
    covariance = np.eye(30) + SETTINGS.process.scales[at] ** 2 * answer @ answer.T
    assert white @ white == pytest.approx(residual @ np.linalg.solve(covariance, residual))


@pytest.mark.parametrize("scale", SETTINGS.process.scales[4:])
def test_the_scale_of_the_force_is_found(scale: float) -> None:
    """Residuals that a force of a scale has made tell how large it is at least; what nobody sees is none."""
    rng = np.random.default_rng(11)
    system: Any = SimpleNamespace(context=None, mismatch_levels=(1.0,), episodes_differ=False)
    answer = 2000.0 * rng.normal(size=(400, 60))
    residual = rng.normal(size=400) + answer @ rng.normal(scale=scale, size=60)
    direction = Direction(Candidate(fx.Friction), np.ones(1), 1.0, 0.01)
    around = normal_equations(
        fit_leaving(residual), Sensitivities((direction,), (rng.normal(size=(400, 1)),), (answer,))
    )
    found = evidence(around, system)
    assert scale / 2.1 < found.process < 1.2 * scale
    # what it takes is left of nothing: the noise remains
    assert found.left == pytest.approx(400, rel=0.2)
    assert evidence(replace(around, amid_process=()), system).log < found.log
    unseen = Sensitivities((direction,), (rng.normal(size=(400, 1)),), (1e-6 * answer,))
    faint = evidence(normal_equations(fit_leaving(rng.normal(size=400)), unseen), system)
    assert faint.process == SETTINGS.process.scales[0]


def test_a_push_over_some_samples_moves_a_carriage_as_newton_has_it(tmp_path: Path) -> None:
    """3 N over the second half of a second on 2 kg: at rest, then x = a t^2 / 2, then at constant speed."""
    simulator = system_of(slide_case(tmp_path)).simulator()
    push = np.zeros((401, 1))
    push[100:200] = 3.0
    rest, pushed = simulator.predict(0, [Run((), np.zeros(2)), Run((), np.zeros(2), push)])
    t = np.arange(401) * 0.005
    pushing = np.clip(t - 0.5, 0.0, 0.5)
    speed = 1.5 * pushing
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)
    np.testing.assert_allclose(pushed[:, 1], speed, atol=1e-6)
    np.testing.assert_allclose(pushed[:, 0], 0.75 * pushing**2 + 0.75 * np.clip(t - 1.0, 0.0, None), atol=1e-6)


def test_a_push_over_some_samples_moves_a_sliding_box_as_newton_has_it() -> None:
    """A box that slides straight is slowed by friction, and by a push along its way less; a moment turns it."""
    recording, _ = made(episodes=2, seconds=1.0)
    still = [
        replace(e, force_n=np.zeros_like(e.force_n), pose=np.zeros_like(e.pose), twist=np.zeros_like(e.twist))
        for e in recording.episodes
    ]
    simulator = PlanarBox(replace(recording, episodes=tuple(still))).simulator(threads=1)
    start = np.array([0.0, 0.0, 0.0, 4.0, 0.0, 0.0])
    push = np.zeros((61, 3))
    push[15:30, 0] = 2.0
    turned = np.zeros((61, 3))
    turned[15:30, 2] = 1.0
    alone, along, spun = simulator.predict(0, [Run((), start), Run((), start, push), Run((), start, turned)])
    t = np.arange(61) / 60
    slowed = 4.0 - 0.3 * 9.81 * t
    np.testing.assert_allclose(alone[:, 3], slowed, atol=1e-3)
    np.testing.assert_allclose(along[:, 3], slowed + 2.0 / 3.0 * np.clip(t - 0.25, 0.0, 0.25), atol=1e-3)
    assert abs(alone[-1, 2]) < 1e-6 < 0.01 < spun[-1, 2]
    # what acts all the time acts as it does in windows
    whole = np.tile([1.0, -0.5, 0.2], (61, 1))
    windows = Windows(np.array([0]), np.array([0]), 61)
    there = simulator.predict_windows((), windows, start[None, None], whole[0])
    np.testing.assert_allclose(simulator.predict(0, [Run((), start, whole)])[0], there[0, 0], atol=1e-9)


def test_forces_answer_in_order_and_in_units_of_the_usual_one() -> None:
    """Before an interval a force does nothing; answers are those of the full simulator, as far as surveys tell them."""
    recording, _ = made(episodes=2, seconds=2.0)
    fitter = fitter_of(recording)
    fit = fitter.fit(NONE, [0, 1], iterations=2)
    answers = pushed(fitter, fit)
    intervals, share = 4, SETTINGS.process.difference_share
    assert [a.shape for a in answers] == [(121 * 6, 3 * intervals)] * 2
    usual = fitter.system.disturbance.prior / SETTINGS.where.max_force
    for k in range(intervals):
        rows = answers[0].reshape(121, 6, intervals, 3)[:, :, k]
        begin = round(120 / intervals * k)
        assert np.abs(rows[:begin]).max(initial=0.0) < 1e-6
        push = np.zeros((121, 3))
        push[begin : begin + 30, 1] = share * usual[1]
        before, after = fitter.whitened(0, [Run((), fit.starts[0]), Run((), fit.starts[0], push)])
        expected = (after - before) / share
        off = np.linalg.norm(rows[:, :, 1].ravel() - expected)
        assert off < 0.2 * np.linalg.norm(expected)


def rough(scale: float, episodes: int, seconds: float) -> Recording:
    """Return a recording of the nominal model on which another force acts every half second, so large a share."""
    recording, starts = made(episodes=episodes, seconds=seconds)
    system, rng = PlanarBox(recording), np.random.default_rng(3)
    usual = system.disturbance.prior / SETTINGS.where.max_force
    simulator, rows = system.simulator(threads=1), []
    for e, episode in enumerate(recording.episodes):
        push = np.repeat(rng.normal(size=(9, 3)) * scale * usual, 30, axis=0)[: len(episode)]
        motion = simulator.predict(e, [Run((), starts[e], push)])[0] + SIGMA * rng.normal(size=(len(episode), 6))
        rows.append(replace(episode, pose=motion[:, :3], twist=motion[:, 3:]))
    return replace(recording, episodes=tuple(rows))


@pytest.mark.parametrize(
    ("scale", "episodes", "seconds", "answer"), [(0.002, 4, 4.0, "none"), (0.02, 3, 3.0, "unknown")]
)
def test_a_rough_world_is_none_until_more_is_missing_than_any_world_lacks(
    scale: float, episodes: int, seconds: float, answer: str
) -> None:
    """Both leave far more than the noise: what counts is the force that is missing."""
    diagnosis = diagnose(PlanarBox(rough(scale, episodes, seconds)), threads=1, advise=False)
    assert diagnosis.nominal_excess > 0.5
    assert diagnosis.ranked[0].effects == (answer,)
    assert diagnosis.ranked[0].probability > 0.9
