"""What one explanation is weighed by: how uncertain residuals are, and which effects stand out of their own errors."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from runner.effects.mechanism import ActuatorDelay, Gravity, ObservationDelay
from runner.effects.planar_box import ActuatorLag, ActuatorSaturation, BodySize
from runner.effects.vocabulary import Candidate
from runner.inference.contender import are_confounded, contend, dispersion_of, memory
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.variable_projection import Spread
from runner.noise.measured import measure
from runner.recording import Recording
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from tests.cases import NOMINAL, made
from tests.test_multiple_shooting import pushed, random_pushes


def left(rows: list[np.ndarray]) -> Any:
    """Return what a fit is to those who look at its residuals alone; each (T, C)."""
    flat = tuple(r.ravel() for r in rows)
    total, spread = sum(float(r @ r) for r in flat), Spread.none(len(rows))
    return SimpleNamespace(residual=flat, episodes=range(len(rows)), total=total, spread=spread)


def fitter_of(channels: int) -> Any:
    """Return a fitter that knows how many channels there are."""

    def excess(loss: float, episodes: range) -> float:
        return loss / (SAMPLES * channels * len(episodes)) - 1.0

    return SimpleNamespace(system=SimpleNamespace(channels=range(channels)), measured=SimpleNamespace(excess=excess))


SAMPLES = 4000


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.9])
def test_memory_is_that_of_an_autoregression(alike: float) -> None:
    """Of a first-order autoregression with coefficient a it is (1 + a) / (1 - a)."""
    rng = np.random.default_rng(3)
    rows = [np.asarray(lfilter([1.0], [1.0, -alike], rng.normal(size=(SAMPLES, 2)), axis=0)) for _ in range(4)]
    assert memory(left(rows), fitter_of(2)) == pytest.approx((1 + alike) / (1 - alike), rel=0.12)


def test_errors_that_last_make_residuals_uncertain() -> None:
    """Noise alone leaves them as they are; an error that is constant for 100 samples counts once for those."""
    rng = np.random.default_rng(4)
    noise = [rng.normal(size=(SAMPLES, 1)) for _ in range(3)]
    fit = left(noise)
    assert dispersion_of(fit, fitter_of(1), fit.total) == pytest.approx(1.0, abs=0.1)
    lasting = [n + 3.0 * np.repeat(rng.normal(size=(SAMPLES // 100, 1)), 100, axis=0) for n in noise]
    # a piecewise constant error of variance 9 with a triangular correlation, in white noise of variance 1
    expected = 1.0 + 9.0 * (0.1 + 0.9 * 100.0)
    fit = left(lasting)
    assert dispersion_of(fit, fitter_of(1), fit.total) == pytest.approx(expected, rel=0.25)


def test_other_edges_are_those_of_another_box() -> None:
    """An effect on the base's size moves as the box that is believed to have that size, at the same mass."""
    recording, starts = made(episodes=1, seconds=3.0)
    assert isinstance(NOMINAL.half_size_m, tuple)
    hx, hy, hz = NOMINAL.half_size_m
    larger = replace(NOMINAL, half_size_m=(1.1 * hx, 0.95 * hy, hz))
    other = Recording(recording.path, recording.form, larger, recording.episodes)
    (effect,) = Simulator(recording).predict(0, [Run((BodySize(1.1, 0.95),), starts[0])])
    (built,) = Simulator(other).predict(0, [Run((), starts[0])])
    (believed,) = Simulator(recording).predict(0, [Run((), starts[0])])
    assert np.abs(effect - built).max() < 1e-9
    assert np.abs(believed - built).max() > 1e-3


def test_sizes_are_part_of_the_mismatch_and_never_named() -> None:
    """The edges are among the directions that explanations are compared amid, and no candidate of a verdict."""
    system = PlanarBox(made(episodes=2, seconds=3.0)[0])
    of_size = [d for d in directions(system) if d.candidate.effect is BodySize]
    assert len(of_size) == 2
    assert all(d.mismatch > 0 for d in of_size)
    assert not any(c.effect is BodySize for c in (*system.vocabulary, *system.vocabulary.outside))


@pytest.mark.parametrize(
    ("sole", "alike"), [(True, True), (False, False)], ids=["of the one actuator", "of one actuator of several"]
)
def test_a_command_that_comes_late_is_one_with_a_measurement_that_is_late(sole: bool, alike: bool) -> None:
    """Where all commands do: then neither is tried beside the other, and they are told as one."""
    late = Candidate(ActuatorDelay, "motor", sole=sole)
    fits: list[Any] = [
        SimpleNamespace(explanation=Explanation((c,))) for c in (late, Candidate(ObservationDelay), Candidate(Gravity))
    ]
    assert are_confounded(fits[0], fits[1]) == alike
    assert not are_confounded(fits[0], fits[2])
    assert late.may_join([Candidate(ObservationDelay)]) != alike
    assert Candidate(ObservationDelay).may_join([late]) != alike
    assert late.may_join([Candidate(Gravity)])


def test_a_lag_longer_than_a_command_lasts_promises_most() -> None:
    """It takes most of a push, as a weaker one would; its derivative at nothing only tells that a push comes late."""
    system = PlanarBox(made((ActuatorLag(0.5),), episodes=2, seconds=3.0)[0])
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    nominal = fitter.fit(NONE, [0, 1])
    around = contend(fitter, nominal, sensitivities(fitter, nominal, directions(system)))
    assert max(around.gains, key=lambda c: float(around.gains[c][0])).effect is ActuatorLag


def test_a_limit_far_below_one_large_push_is_looked_at() -> None:
    """The largest push of all may be that of an episode which is held out: there are limits that cut off the others."""
    forces = [(20.0 if e == 2 else 10.0) / 16.0 * f for e, f in enumerate(random_pushes(3, 3.0))]
    limit = 0.8 * min(float(np.linalg.norm(f, axis=1).max()) for f in forces[:2])
    system = PlanarBox(pushed(forces, [(ActuatorSaturation(limit),)] * 3))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    nominal = fitter.fit(NONE, [0, 1])
    around = contend(fitter, nominal, sensitivities(fitter, nominal, directions(system)))
    gains = {c.effect: float(gain) for c, (gain, *_) in around.gains.items()}
    assert gains[ActuatorSaturation] > 0.1 * nominal.total
