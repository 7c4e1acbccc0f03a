"""Coloured noise is whitened exactly, and its level and colour are found beneath a motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import cholesky, solve_triangular, toeplitz

from runner.noise.measured import Measured, measure, refine, without_outliers
from runner.noise.model import NoiseModel, estimate
from runner.numerics.differences import third_differences, white_noise
from runner.recording import Span
from runner.systems.channels import Channel
from tests.mechanism_cases import slide_case, system_of


def noise(n: int, k: int, share: float, memory: float, seed: int) -> np.ndarray:
    """Return noise of unit variance, (n, k), from its covariance."""
    lower = cholesky(covariance(n, share, memory), lower=True)
    return lower @ np.random.default_rng(seed).standard_normal((n, k))


def covariance(n: int, share: float, memory: float) -> np.ndarray:
    """Return the covariance of white and slow noise."""
    return share * toeplitz(memory ** np.arange(n)) + (1 - share) * np.eye(n)


@pytest.mark.parametrize(("share", "memory"), [(0.64, 0.72), (0.64, 0.92), (1.0, 0.8), (0.2, 0.5)])
def test_whitening_is_that_of_the_covariance(share: float, memory: float) -> None:
    """The innovations are what the inverse of the Cholesky factor makes of the noise, from the first sample on."""
    n = 150
    x = np.random.default_rng(0).standard_normal((3, n, 2))
    want = np.stack(
        [solve_triangular(cholesky(covariance(n, share, memory), lower=True), one, lower=True) for one in x]
    )
    got = NoiseModel(np.array([share, 0.0]), np.array([memory, 0.0])).whiten(x)
    np.testing.assert_allclose(got[..., 0], want[..., 0], atol=1e-6)
    np.testing.assert_array_equal(got[..., 1], x[..., 1])


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("rate_hz", [60.0, 240.0])
def test_level_and_colour_are_found_beneath_a_motion(rate_hz: float, known: bool) -> None:
    """The slow part lasts 50 ms; a cubic of a hundred noises beneath it changes nothing."""
    memory = np.exp(-1 / (0.05 * rate_hz))
    n = int(6 * rate_hz)
    t = np.linspace(0, 1, n)[:, None]
    sizes = 0.003, 0.02
    kinds = [
        [size * (noise(n, k, 0.64, memory, 10 * k + seed) + 100 * (t**3 - t)) for seed in range(5)]
        for k, size in zip((2, 1), sizes, strict=True)
    ]
    found = estimate(kinds, 1 / rate_hz, np.array([0.003, np.nan]) if known else np.full(2, np.nan))
    assert found is not None
    np.testing.assert_allclose(found.level, sizes, rtol=0.1)
    assert found.share * found.memory == pytest.approx(0.64 * memory, abs=0.07)
    assert found.memory == pytest.approx(memory, abs=0.08)


def test_white_noise_has_no_colour() -> None:
    """Neither does noise with windows in which something else goes on."""
    for seed in range(10):
        stretches = [noise(360, 2, 0.0, 0.5, 10 * seed + i) for i in range(5)]
        stretches[0][100:110] += 20.0
        found = estimate([stretches], 1 / 60, np.array([np.nan]))
        assert found is not None
        assert found.share == 0.0
        assert found.level == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("times", [0.67, 1.5])
def test_what_is_stated_gives_way_to_what_shows(times: float) -> None:
    """Noise of other than the stated size has its size, and no colour that would make up for the difference."""
    stretches = [times * noise(360, 2, 0.0, 0.5, seed) for seed in range(6)]
    found = estimate([stretches], 1 / 60, np.array([1.0]), doubt=0.5)
    assert found is not None
    assert found.share == 0.0
    assert found.level == pytest.approx(times, rel=0.03)


@pytest.mark.parametrize("doubt", [0.02, 0.5])
def test_what_is_stated_is_a_log_normal_prior(doubt: float) -> None:
    """The level is where the posterior of white noise is largest, found here on a grid of the whole range."""
    n, stretch = 30, 3.0 * noise(420, 1, 0.0, 0.5, 3)
    found = estimate([[stretch]], 1 / 60, np.array([1.0]), doubt=doubt)
    rough = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, n), n - 1))[0][:, 4:]
    left = (rough.T @ stretch.reshape(-1, n).T) ** 2
    powers = left.sum(axis=0), left[:8].sum(axis=0)
    left = left[:, np.all([p <= 3.0 * np.median(p) for p in powers], axis=0)]
    level = np.exp(np.linspace(-1.0, 2.0, 30001))
    minus_two_log = left.size * 2 * np.log(level) + left.sum() / level**2 + (np.log(level) / doubt) ** 2
    assert found is not None
    assert found.level == pytest.approx(level[np.argmin(minus_two_log)], rel=1e-3)


def test_too_little_is_not_judged() -> None:
    """A quarter of a second says nothing."""
    assert estimate([[np.zeros((15, 2))]], 1 / 60, np.array([np.nan])) is None


def test_pushes_that_no_log_holds_are_not_noise() -> None:
    """What a model leaves of them in three windows of ten is slow, and hardly more than the noise."""
    rng = np.random.default_rng(5)
    stretches = []
    for _ in range(8):
        left = rng.standard_normal((1000, 2))
        for begin in (180, 500, 820):
            left[begin : begin + 100] += 4.0 * np.abs(np.sin(np.linspace(0, np.pi, 100)))[:, None]
        stretches.append(0.01 * left)
    found = estimate([stretches], 1 / 200, np.array([np.nan]))
    assert found is not None
    assert found.share == 0.0
    np.testing.assert_allclose(found.level, 0.01, rtol=0.05)


@pytest.mark.parametrize(("share", "memory"), [(0.64, 0.72), (0.7, 0.95), (1.0, 0.8), (0.0, 0.0)])
def test_what_is_new_in_a_sample_is_what_the_best_linear_prediction_leaves(share: float, memory: float) -> None:
    n = 300
    whole = covariance(n, share, memory)
    before, last = whole[:-1, :-1], whole[-1, :-1]
    want = np.sqrt(whole[-1, -1] - last @ np.linalg.solve(before, last))
    got = NoiseModel(np.array([share]), np.array([memory])).innovation()
    np.testing.assert_allclose(got, [want], rtol=1e-6)


def test_outliers_stand_out_of_slow_noise() -> None:
    """Of six noise levels each, hardly to be seen beside the noise itself, but nothing else changes so fast."""
    share, memory, n = 0.75, 0.95, 2000
    left = noise(n, 1, share, memory, 3)
    at = np.arange(50, n, 100)
    left[at] += 6.0
    model = NoiseModel(np.array([share]), np.array([memory]))
    measured = Measured((Span(0, 0, n),), (-left,), np.ones(1), model, (np.ones((n, 1), bool),), np.ones(1))
    dropped = np.flatnonzero(~without_outliers(measured, {0: left}).valid[0][:, 0])
    assert set(at) <= set(dropped)
    assert len(dropped) <= len(at) + 2


@pytest.mark.parametrize("steps", [1, 2])
def test_what_turns_about_within_a_sample_is_no_outlier(steps: int, tmp_path: Path) -> None:
    """Of a motion to and fro at a constant speed, of many noise levels a sample; a spike beside it is one."""
    turns = 3.0 * np.abs((np.arange(800) * 0.01 * steps) % 2.0 - 1.0)
    spikes = np.zeros(800)
    spikes[[55, 333, 555]] = (0.3, -0.3, 0.5)
    shown = turns + spikes + 1e-3 * np.random.default_rng(0).normal(size=800)
    system = system_of(slide_case(tmp_path, motion=lambda _: (shown, np.gradient(turns, 0.005)), length_s=3.995))
    assert np.flatnonzero(~measure(system).valid[0][:, 0]).tolist() == [55, 333, 555]


def test_third_differences_leave_nothing_of_a_parabola_by_an_uneven_clock() -> None:
    """Whatever the clock does, a parabola leaves nothing, and white noise 20 of its variances; even: -1, 3, -3, 1."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.008, 0.012, 5000) + 0.05 * (rng.random(5000) < 0.02))
    parabola = 3 - 20 * t + 7 * t**2
    assert np.abs(third_differences(t, parabola)).max() < 1e-9 * np.abs(parabola).max()
    x = rng.standard_normal(len(t))
    x[rng.random(len(t)) < 0.1] = np.nan
    assert np.std(third_differences(t, x)) == pytest.approx(np.sqrt(20), rel=0.05)
    assert white_noise([(t, parabola + 0.01 * x)]) == pytest.approx(0.01, rel=0.05)
    even = np.arange(100) / 64
    np.testing.assert_allclose(third_differences(even, even**4), np.diff(even**4, 3), atol=1e-12)
    assert np.isnan(white_noise([(t[:3], x[:3])]))


@pytest.mark.parametrize("stated", [True, False])
def test_short_flights_tell_their_noise(stated: bool) -> None:
    """None lasts half a second; what is stated of slow noise holds, as a cubic follows most of it in so little."""
    share, memory = (0.6, np.exp(-1 / (0.025 * 200))) if stated else (0.0, 0.5)
    flights = [0.0012 * noise(n, 3, share, memory, seed) for seed, n in enumerate([36, 37, 45, 33, 42, 30, 48, 41] * 2)]
    known = np.array([0.0012 if stated else np.nan])
    assert estimate([flights], 1 / 200, known, doubt=0.5) is None
    found = estimate([flights], 1 / 200, known, doubt=0.5, shorten=True)
    assert found is not None
    np.testing.assert_allclose(found.level, 0.0012, rtol=1e-12 if stated else 0.05)
    assert found.share * found.memory == pytest.approx(share * memory, abs=0.12)


def recorded(values: Sequence[np.ndarray], channels: Sequence[Channel], by_owner: np.ndarray) -> Any:
    """Return what the noise is told of a system: these values (T, C) of each episode, and what its owner states."""
    return SimpleNamespace(
        episodes_differ=False,
        values=lambda: values,
        noise_by_owner=lambda: by_owner,
        channels=tuple(channels),
        rate_hz=100.0,
        recording=SimpleNamespace(episodes=[SimpleNamespace(step_s=0.005) for _ in values]),
    )


@pytest.mark.parametrize("owner", [True, False])
def test_a_rough_level_that_nobody_stated_does_not_hold_in_short_flights(*, owner: bool) -> None:
    """That of an orientation, before a model leaves anything in which its noise shows."""
    rough, residuals = 0.7, {e: noise(40, 3, 0.0, 0.5, e) for e in range(16)}
    values, valid = tuple(residuals.values()), tuple(np.ones((40, 3), bool) for _ in residuals)
    spans = tuple(Span(e, 0, 40) for e in residuals)
    known = Measured(spans, values, np.full(3, rough), NoiseModel.white(3), valid, np.full(3, rough))
    system = recorded(values, [Channel(c, "rad", "turn", c) for c in "xyz"], np.full(3, rough if owner else np.nan))
    np.testing.assert_allclose(refine(known, system, residuals).sensor, rough if owner else 1.0, rtol=0.05)


def test_each_instrument_has_a_colour_of_its_own() -> None:
    """What a force sensor leaves, white noise, says nothing of how slow the noise of the tracking is."""
    residuals = {e: np.hstack([noise(400, 2, 0.9, 0.8, e), 3.0 * noise(400, 1, 0.0, 0.0, 100 + e)]) for e in range(6)}
    values, valid = tuple(residuals.values()), tuple(np.ones((400, 3), bool) for _ in residuals)
    spans = tuple(Span(e, 0, 400) for e in residuals)
    known = Measured(spans, values, np.ones(3), NoiseModel.white(3), valid, np.full(3, np.nan))
    channels = [Channel("x", "m", "position", "x"), Channel("y", "m", "position", "y"), Channel("f", "N", "force", "f")]
    found = refine(known, recorded(values, channels, np.full(3, np.nan)), residuals)
    np.testing.assert_allclose(found.noise_model.share, [0.9, 0.9, 0.0], atol=0.1)
    np.testing.assert_allclose(found.noise_model.memory[:2], 0.8, atol=0.05)
    np.testing.assert_allclose(found.sensor[2], 3.0, rtol=0.05)


def test_an_instrument_has_a_clock_of_its_own() -> None:
    """A force that is read in every tenth row has half-second windows of its own: what changes slowly is no noise."""
    draw = np.random.default_rng(5)
    residuals = {}
    for e in range(6):
        t_s = 0.005 * np.arange(4000)
        force = np.where(np.arange(4000) % 10 == 0, draw.standard_normal(4000) + 2.0 * np.sin(np.pi * t_s + e), np.nan)
        residuals[e] = np.column_stack([draw.standard_normal(4000), force])
    values = tuple(residuals.values())
    valid, spans = tuple(np.isfinite(v) for v in values), tuple(Span(e, 0, 4000) for e in residuals)
    known = Measured(spans, values, np.ones(2), NoiseModel.white(2), valid, np.full(2, np.nan))
    channels = [Channel("x", "m", "position", "x"), Channel("f", "N", "force", "f")]
    found = refine(known, recorded(values, channels, np.full(2, np.nan)), residuals)
    np.testing.assert_allclose(found.sensor, 1.0, rtol=0.1)
    np.testing.assert_allclose(found.noise_model.lag_one, 0.0, atol=0.1)
