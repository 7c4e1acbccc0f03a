"""What a model leaves before anything explains it must not pass for slow noise, nor fall between what is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from runner.diagnosis.attempt import _to_search
from runner.diagnosis.noise_account import fit_nominal
from runner.diagnosis.pipeline import diagnose
from runner.effects import mechanism as m
from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.inference.contender import account_densities, log_density
from runner.inference.evidence import Direction, Sensitivities, least_errors
from runner.inference.least_squares import Explanation, Fit, Fitter
from runner.noise.measured import Measured, measure
from runner.noise.model import NoiseModel
from runner.numerics.arrays import spread_over
from runner.numerics.recursive_filter import filtered
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Scatter
from runner.systems.simulator import Run
from tests.mechanism_cases import MOTOR, SLIDE, joint_channels, system_of, write_case

SERVO = '<position name="drive" joint="slide" kp="3000" kv="60"/>'
NOISE_M = 1.3e-4


def targets(t_s: np.ndarray, seed: int) -> np.ndarray:
    """Return a target that jumps every 0.3 s."""
    held = np.random.default_rng(seed).uniform(-0.1, 0.1, int(t_s[-1] / 0.3) + 1)
    return held[(t_s / 0.3 - 1e-9).astype(int)]


def servo_case(folder: Path, measured: list[np.ndarray]) -> Path:
    t = np.arange(len(measured[0])) * 0.005
    return write_case(
        folder,
        SLIDE.format(friction=1.0, damping=4.0, mass=2.0, actuator=SERVO),
        [{"t": t, "u": targets(t, seed), "q_slide": q} for seed, q in enumerate(measured)],
        {
            "commands": {"u": {"actuator": "drive"}},
            "channels": joint_channels(["slide"], velocities=False),
            "noise": None,
            "start": "free",
        },
    )


@pytest.mark.parametrize(("off_m", "told"), [(0.0, True), (3e-3, False)])
def test_noise_is_not_told_from_what_a_model_far_off_leaves(off_m: float, *, told: bool, tmp_path: Path) -> None:
    """Where nobody stated it: correlated noise is told from what a right model leaves, a wave it lacks is none."""
    rng, t = np.random.default_rng(3), np.arange(600) * 0.005
    still = system_of(servo_case(tmp_path / "still", [0.1 * np.sin(t), 0.1 * np.cos(t)]))
    moved = [still.simulator(threads=1).predict(e, [Run((), np.zeros(2))])[0][:, 0] for e in range(2)]
    slow = [filtered(rng.normal(size=len(t)), 1.0, 0.0, 0.9) for _ in moved]
    seen = [
        q + NOISE_M * (rng.normal(size=len(t)) + 0.3 * s) + off_m * np.sin(5 * t)
        for q, s in zip(moved, slow, strict=True)
    ]
    system = system_of(servo_case(tmp_path / "case", seen))
    before = measure(system)
    fitter, _ = fit_nominal(Fitter(system, system.simulator(threads=1), before), (0, 1))
    assert (fitter.measured.noise_model.share > before.noise_model.share).all() == told
    assert fitter.measured.sigma[0] < 2.0 * NOISE_M


@pytest.mark.slow
def test_what_a_servo_lacks_is_no_slow_noise(tmp_path: Path) -> None:
    """A servo whose target jumps is late and damped too little, by 25 noises that nobody stated; both are named.

    What the model as believed leaves of that is alike from sample to sample, as slow noise is.
    """
    system = system_of(servo_case(tmp_path / "still", [np.zeros(601)] * 2))
    planted = m.ActuatorDelay("drive", 0.0049), m.ServoDamping("drive", 0.94)
    rng = np.random.default_rng(3)
    motions = [system.simulator(threads=1).predict(e, [Run(planted, np.zeros(2))])[0, :, 0] for e in range(2)]
    measured = [q + NOISE_M * rng.standard_normal(len(q)) for q in motions]
    found = diagnose(system_of(servo_case(tmp_path / "moved", measured)), threads=1, advise=False)
    assert set(found.ranked[0].effects) == {"actuator_delay[drive]", "joint_damping[slide]"}
    assert found.ranked[0].probability > 0.9
    assert found.measured.sensor == pytest.approx([NOISE_M], rel=0.1)


@pytest.mark.parametrize("velocities", [pytest.param(True, marks=pytest.mark.slow), False])
def test_what_acts_for_a_moment_is_looked_at(tmp_path: Path, *, velocities: bool) -> None:
    """Of two minutes a quarter is searched; the one second in which something pushes is part of it.

    Whatever is measured: how far a measured start is off says nothing, and without a push the spread stays even.
    """
    t = np.arange(6_001) * 0.02
    pushed_s = 87.4, 88.2
    rng = np.random.default_rng(5)

    def searched(pushed_m_s: float) -> tuple[Fitter, tuple[int, ...]]:
        speed = 0.2 * np.sin(0.7 * t) + pushed_m_s * np.clip((t - pushed_s[0]) / 0.8, 0.0, 1.0)
        place = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.02)])
        shown = {"q_slide": place + 1e-3 * rng.standard_normal(len(t))}
        if velocities:
            shown["dq_slide"] = speed + 1e-2 * rng.standard_normal(len(t))
        stated = {"q_slide": 1e-3, "dq_slide": 1e-2}
        case = write_case(
            tmp_path / f"{pushed_m_s}",
            SLIDE.format(friction=0.0, damping=0.0, mass=2.0, actuator=MOTOR),
            [{"t": t, "u": 2.0 * 0.2 * 0.7 * np.cos(0.7 * t), **shown}],
            {
                "commands": {"u": {"actuator": "drive"}},
                "channels": joint_channels(["slide"], velocities=velocities),
                "noise": {name: stated[name] for name in shown},
                "start": "free",
            },
        )
        system = system_of(case)
        root = Fitter(system, system.simulator(threads=1), measure(system))
        fitter = root.stretched(tuple(Span(0, k, min(k + 50, 6_001)) for k in range(0, 6_000, 50)))
        return fitter, _to_search(fitter, [0], 1.0)

    _, even = searched(0.0)
    assert list(even) == spread_over(120, 30).tolist()
    fitter, chosen = searched(0.1)
    missed = next(i for i, s in enumerate(fitter.measured.spans) if s.begin <= 4_370 < s.end)
    assert len(chosen) == len(set(chosen)) == 30
    assert set(chosen) - set(even) == {missed}


@pytest.mark.slow
def test_slow_noise_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing differs and noise is truly slow, what leaps fit to it accounts for less, and nothing is named."""
    system = system_of(servo_case(tmp_path / "still", [np.zeros(601)] * 2))
    rng, share, memory = np.random.default_rng(1), 0.8, 0.97
    measured = []
    for e in range(2):
        motion = system.simulator(threads=1).predict(e, [Run((), np.zeros(2))])[0, :, 0]
        new = np.sqrt(1.0 - memory**2) * rng.standard_normal(len(motion) + 300)
        slow, white = filtered(new, 1.0, 0.0, memory, 0.0)[300:], rng.standard_normal(len(motion))
        measured.append(motion + NOISE_M * (np.sqrt(share) * slow + np.sqrt(1.0 - share) * white))
    compared: list[list[float]] = []

    def heard(accounts: Sequence[tuple[Fitter, Fit]]) -> list[float]:
        compared.append(account_densities(accounts))
        return compared[-1]

    monkeypatch.setattr("runner.diagnosis.attempt.account_densities", heard)
    found = diagnose(system_of(servo_case(tmp_path / "moved", measured)), threads=1, advise=False)
    # leaps that leave noise as slow as before are no other account of it, and are not compared
    assert all(slow_noise > less for slow_noise, less in compared)
    assert found.ranked[0].effects == ("none",)
    assert found.measured.noise_model.lag_one > 0.5


@dataclass(frozen=True)
class Still:
    """A fitter of a model in which nothing moves: all that is measured is noise."""

    measured: Measured

    def fit(self, explanation: Explanation, episodes: Sequence[int], *, x: np.ndarray, starts: np.ndarray) -> Fit:
        left = sum(float((self.measured.whiten(e, self.measured.values[e]) ** 2).sum()) for e in episodes)
        fit = SimpleNamespace(explanation=explanation, episodes=tuple(episodes), x=x, starts=starts, total=left)
        return cast(Any, fit)


def account(
    values: np.ndarray, sensor: float, colour: NoiseModel, effects: int = 0, **otherwise: Any
) -> tuple[Fitter, Fit]:
    """Return an account of the noise of one channel, (n,), beside a fit of effects of one number each."""
    spans, valid = (Span(0, 0, len(values)),), (np.ones((len(values), 1), bool),)
    measured = Measured(spans, (values[:, None],), np.array([sensor]), colour, valid, np.array([np.nan]))
    still = Still(replace(measured, **otherwise))
    explanation = Explanation((Candidate(fx.Friction),) * effects)
    return cast(Any, still), still.fit(explanation, (0,), x=np.zeros(effects), starts=np.zeros((1, 0)))


@pytest.mark.parametrize(("share", "memory"), [(0.0, 0.0), (0.7, 0.9)])
def test_densities_with_other_noise_are_comparable(share: float, memory: float) -> None:
    """That of a long series by its innovations is that of the joint Gaussian, up to what all series of it share."""
    n, normal = 400, cast(Any, multivariate_normal)
    rng = np.random.default_rng(2)
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    covariance = share * memory**lag + (1.0 - share) * np.eye(n)
    colour = NoiseModel(np.array([share]), np.array([memory]))
    for sigma in (1e-3, 0.3):
        values = sigma * normal(np.zeros(n), covariance).rvs(random_state=rng)
        fitter, fit = account(values, sigma, colour)
        exact = normal(np.zeros(n), sigma**2 * covariance).logpdf(values)
        assert log_density(fit, fitter.measured) - 0.5 * n * np.log(2.0 * np.pi) == pytest.approx(exact, abs=1.5)


def test_a_hit_counts_as_noise_from_there_on() -> None:
    """Before it the density is that by the sensor's noise."""
    n, sensor, level = 400, 1.0, 20.0
    begun = np.arange(n) >= 250
    sigma = np.where(begun, level, sensor)
    values = sigma * np.random.default_rng(4).standard_normal(n)
    fitter, fit = account(values, sensor, NoiseModel.white(1), scatter=Scatter(np.array([level]), (~begun,)))
    exact = norm.logpdf(values, scale=sigma).sum() + 0.5 * n * np.log(2.0 * np.pi)
    assert log_density(fit, fitter.measured) == pytest.approx(exact)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_unit_decides_nothing_between_two_accounts(unit: float) -> None:
    """Of one recording, whatever counts by one of them alone: the right noise is likelier than three times as much."""
    n, white = 400, NoiseModel.white(1)
    values = unit * np.random.default_rng(0).standard_normal(n)
    valid = np.ones((n, 1), bool)
    valid[[5, 6, 7]] = False
    right = account(values, unit, white, valid=(valid,), hung={0: 300})
    right_density, wrong_density = account_densities([right, account(values, 3.0 * unit, white, odd_from=3.0)])
    shared = values[:300][valid[:300, 0]]
    likelier = norm.logpdf(shared, scale=unit).sum() - norm.logpdf(shared, scale=3.0 * unit).sum()
    assert right_density - wrong_density == pytest.approx(likelier)
    assert likelier > 0.0
    plain, by_effects = account_densities([right, account(values, unit, white, effects=2)])
    price = np.log(len(shared)) + 2.0 * SETTINGS.odds.effect_log_odds
    assert plain - by_effects == pytest.approx(price)


def test_a_hit_may_come_at_once_or_never() -> None:
    """Too little before it to tell a start is no flight without a hit, and all of an episode is one."""
    calm = np.arange(100) < 8, np.ones(100, bool)
    spans, values = (Span(0, 0, 100), Span(1, 0, 100)), (np.zeros((100, 1)),) * 2
    valid = (np.ones((100, 1), bool),) * 2
    scatter = Scatter(np.ones(1), calm)
    measured = Measured(spans, values, np.ones(1), NoiseModel.white(1), valid, np.array([np.nan]), scatter)
    assert measured.hits([0, 1])
    assert measured.hits([0])
    assert not measured.hits([1])
    assert not replace(measured, scatter=None).hits([0])


def test_a_simulator_has_errors_of_its_own_in_every_channel() -> None:
    """At the least level of mismatch, an eighth, as far as values count."""
    directions = tuple(Direction(Candidate(fx.Friction), np.ones(1), 1.0, mismatch) for mismatch in (0.08, 0.0))
    columns = np.zeros((50, 2, 2))
    columns[:, 0] = 200.0, 1e6  # of the first channel, by each direction
    columns[:, 1] = 5.0, 1e6
    system = SimpleNamespace(mismatch_levels=(0.125, 1.0), channels="xy")
    measured = SimpleNamespace(counted=lambda _: np.ones((50, 2), bool))
    fitter, fit = cast(Any, SimpleNamespace(system=system, measured=measured)), SimpleNamespace(episodes=(0,))
    own = least_errors(cast(Any, fit), Sensitivities(directions, (columns.reshape(100, 2),)), fitter)
    assert own == pytest.approx([4.0, 0.0025])
