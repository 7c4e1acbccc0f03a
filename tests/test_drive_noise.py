"""A force that was measured: what its noise makes is no cause, and no comparison is surer than it lets one be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.commands.gap import in_short
from runner.diagnosis.pipeline import diagnose
from runner.effects.base import AbstractEffect
from runner.effects.wording import number
from runner.inference import drive_noise
from runner.inference.drive_noise import ByNoise, as_told, told_apart_from_noise
from runner.inference.least_squares import NONE, Fitter
from runner.noise.measured import measure
from runner.recording import Episode, Form, Nominal, Recording
from runner.settings import SETTINGS
from runner.simulate.gap import WHOLE_EPISODE, measure_gap
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from tests.contended import Contended

RATE_HZ, MASS_KG, FRICTION, G = 30.0, 2.0, 0.3, 9.81
SEEN_M, SEEN_RAD, NOISE_N = 2e-4, 2e-3, 0.08


def measured(episodes: int, seconds: float, *effects: AbstractEffect) -> Recording:
    """Return pushes of a box that is as believed but for some effects, its pose and the force on it told with noise."""
    rng = np.random.default_rng(7)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    nominal = Nominal(half_size_m=(0.1, 0.1, 0.05), mass_kg=MASS_KG, friction=FRICTION, gravity_m_s2=G, rate_hz=RATE_HZ)
    blank, made = np.full((len(t), 3), np.nan), []
    for e in range(episodes):
        phase, along = rng.uniform(0, 6, 2), rng.uniform(-0.5, 0.5)
        size_n = 7.0 + 3.0 * np.sin(2.0 * t + phase[0])
        force_n = np.column_stack([size_n * np.cos(along), size_n * np.sin(along), np.zeros(len(t))])
        point_m = np.column_stack([np.full(len(t), -0.1), np.full(len(t), 0.01 * np.sin(phase[1])), np.zeros(len(t))])
        made.append(Episode(e, t, np.zeros((len(t), 3)), blank, force_n, point_m))
    true = Recording(Path("case"), Form.PLANAR, nominal, tuple(made))
    simulator = PlanarBox(true).simulator(threads=1)
    out = []
    for e, episode in enumerate(made):
        pose = simulator.predict(e, [Run(effects, np.zeros(6))])[0][:, :3]
        pose = pose + rng.standard_normal(pose.shape) * [SEEN_M, SEEN_M, SEEN_RAD]
        shown = episode.force_n + NOISE_N * rng.standard_normal(episode.force_n.shape) * [1.0, 1.0, 0.0]
        out.append(replace(episode, pose=pose, force_n=shown))
    return replace(true, episodes=tuple(out))


def test_what_noise_of_a_force_makes_is_little_for_a_while() -> None:
    """Replayed with what its sensor added the force leaves tens of noises of a model that is right: not for long."""
    system = PlanarBox(measured(3, 2.0))
    whole = Fitter(system, system.simulator(threads=1), measure(system))
    nominal = whole.fit(NONE, range(3))
    over_all = whole.measured.excess(nominal.total, nominal.episodes)
    assert over_all > 10.0
    spans = told_apart_from_noise(whole)
    assert spans is not None
    brief = whole.stretched(spans)
    nominal = brief.fit(NONE, range(len(brief.measured.spans)))
    assert brief.measured.excess(nominal.total, nominal.episodes) < 0.2 * over_all


def test_a_measured_force_is_not_replayed_so_long_that_what_is_little_grows_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whatever its noise makes: where parts begin one grows to 10 at most, where the box turns away."""
    monkeypatch.setattr(drive_noise, "by_noise", lambda *_: ByNoise.none())
    system = PlanarBox(measured(3, 4.0))
    whole = Fitter(system, system.simulator(threads=1), measure(system))
    spans = told_apart_from_noise(whole)
    assert spans is not None
    longest = max(s.end - s.begin for s in spans) / RATE_HZ
    gap = measure_gap(system, whole.measured, horizons_s=(longest, 3.9), whole_episodes=False)
    short, long = gap.growth.values()
    assert short < 1.5 * SETTINGS.pieces.most_growth < long  # by windows that begin elsewhere


def test_a_gap_says_what_the_noise_of_a_force_makes() -> None:
    """A model that is right misses that much, in the middle of few that scatter, and its sentence says so."""
    system = PlanarBox(measured(3, 2.0))
    gap = measure_gap(system, measure(system), horizons_s=(0.3, 1.0))
    fitted = gap.table[gap.table["starts"].eq("fitted") & gap.table["noises"].notna()]
    assert fitted["noises_expected"].to_numpy()[3:6].min() > 1.5  # of a second
    assert fitted["noises_expected"].to_numpy()[-3:].min() > 3.0  # of whole episodes
    middle = np.exp(np.log(fitted["noises"] / fitted["noises_expected"]).mean())
    assert 0.5 < middle < 2.0
    most = number(fitted["noises_expected"].max())
    assert f"noise of the measured force alone makes up to {most}" in in_short(gap, system.recording, WHOLE_EPISODE)


@pytest.mark.slow
def test_what_noise_of_a_force_makes_needs_no_cause() -> None:
    """A whole diagnosis of a model that is right."""
    found = diagnose(PlanarBox(measured(3, 2.0)), threads=1, advise=False)
    assert found.nominal_excess < 1.0
    assert found.ranked[0].effects == ("none",)
    assert found.ranked[0].probability > 0.5
    assert any("noise of the measured force" in note for note in found.notes)


def test_a_drive_that_is_known_is_replayed_over_whole_episodes() -> None:
    """One that is not, over so long as its noise makes about as much as that of the sensors, as it grows with time."""
    recording = measured(1, 4.0)
    system = PlanarBox(recording)
    whole = Fitter(system, system.simulator(threads=1), measure(system))
    spans = told_apart_from_noise(whole)
    assert spans is not None
    assert [s.begin for s in spans] == [0, *(s.end for s in spans[:-1])]
    assert 0.5 <= max(s.end - s.begin for s in spans) / RATE_HZ <= 1.1
    held = np.repeat(recording.episodes[0].force_n[::6], 6, axis=0)[: len(recording.episodes[0])]
    known = PlanarBox(replace(recording, episodes=(replace(recording.episodes[0], force_n=held),)))
    assert told_apart_from_noise(Fitter(known, known.simulator(threads=1), measure(known))) is None


def test_a_force_that_was_commanded_is_replayed_as_it_is() -> None:
    recording = measured(1, 3.0)
    smooth = np.repeat(recording.episodes[0].force_n[::6], 6, axis=0)[: len(recording.episodes[0])]
    held = replace(recording, episodes=(replace(recording.episodes[0], force_n=smooth),))
    assert PlanarBox(held).driven_otherwise(3) == ()
    assert not PlanarBox(held).has_noisy_drive
    assert PlanarBox(recording).has_noisy_drive
    noisy = PlanarBox(recording).driven_otherwise(3)
    assert len(noisy) == 3
    added = np.array([n.recording.episodes[0].force_n - recording.episodes[0].force_n for n in noisy])
    assert added[..., :2].std() == pytest.approx(NOISE_N, rel=0.2)
    assert not added[..., 2].any()


def contended(log_posterior: float, effects: int = 1) -> Any:
    return Contended(SimpleNamespace(explanation=SimpleNamespace(candidates=("made",) * effects)), log_posterior)


def compared(more: float, made: float, scatter: float, *, effects: int = 1) -> float:
    """Return by how much another is behind the first, of whose 1000 it leaves so much more; at 50 log units before."""
    first, other = contended(0.0), contended(-50.0, effects)
    draws = np.tile([-1.0, 1.0], 8)
    still = ByNoise(np.full(16, 500.0), np.zeros(16), 1000)
    moved = ByNoise(np.full(16, 500.0 + made), scatter * draws, 1000)
    left = {id(first.fit): 1000.0, id(other.fit): 1000.0 + more}
    noise = {id(first.fit): still, id(other.fit): moved}
    return -as_told([first, other], left, noise)[1].log_posterior


def test_a_comparison_is_as_sure_as_the_noise_of_the_force_lets_it_be() -> None:
    """By the normal distribution of what that noise does to a difference, less what it makes by itself."""
    assert compared(400.0, 0.0, 200.0) == pytest.approx(np.log(0.97725 / 0.02275), rel=1e-3)  # two of its errors
    assert compared(400.0, 400.0, 200.0) == pytest.approx(0.0, abs=1e-9)  # all of it made by that noise
    assert compared(400.0, 600.0, 200.0) < 0.0  # which makes more of it: the other is the likelier one
    assert compared(1e5, 0.0, 200.0) == 50.0  # no surer than without that noise
    # where it tells nothing, an effect more costs what it cost beforehand
    assert compared(0.0, 0.0, 200.0, effects=2) == pytest.approx(SETTINGS.odds.effect_log_odds)


def test_what_leaves_many_times_what_the_noise_makes_is_ruled_out() -> None:
    """A wrong explanation leaves so much that a little noise turns it by much: the noise alone does not make it."""
    assert compared(2e5, 500.0, 1e5) == 50.0
    assert compared(2e5, 500.0, 1e5, effects=0) == 50.0  # though it needs no effect
    # many times, by one direction of a Gaussian at the least: half of the ratio of the squares
    assert compared(2e4, 500.0, 1e6) == pytest.approx(0.5 * (2e4 - 1000.0) / (1000.0 + np.sqrt(2 * 1000.0)))
