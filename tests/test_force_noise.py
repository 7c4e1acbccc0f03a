"""The noise of a force: found where a sensor has measured it, none where it was commanded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.recording import read_case, write_case
from runner.recording.force_noise import force_noise
from tests.cases import made

RATE_HZ = 30.0


def smooth(n: int) -> np.ndarray:
    return 6.0 + 2.0 * np.sin(2.0 * np.arange(n) / RATE_HZ)


@pytest.mark.parametrize("level", [0.01, 0.08, 0.5])
def test_noise_is_found_on_a_smooth_force_and_on_lines_between_its_samples(level: float) -> None:
    noisy = [smooth(400) + level * np.random.default_rng(k).standard_normal(400) for k in range(8)]
    assert force_noise([noisy])[0] == pytest.approx(level, rel=0.1)
    assert force_noise([[0.5 * (f[1:] + f[:-1]) for f in noisy]])[0] == pytest.approx(level, rel=0.15)


def test_noise_of_a_few_short_pushes_is_not_taken_for_that_of_lines_between_samples() -> None:
    """Nor the other way round, which would make it three times as large, or as small."""
    off = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        noisy = [smooth(120) + 0.05 * rng.standard_normal(120) for _ in range(3)]
        lines = [0.5 * (f[1:] + f[:-1]) for f in noisy]
        off += [force_noise([series])[0] / 0.05 for series in (noisy, lines)]
    assert np.mean(np.abs(np.log(off)) < np.log(1.4)) >= 0.98


@pytest.mark.parametrize("samples", [12, 16, 20])
def test_pushes_as_short_as_they_are_show_noise(samples: int) -> None:
    """Between them nothing touches; most orders of differences do not fit into one."""
    off = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        push = 6.0 * np.sin(np.pi * (np.arange(samples) + 0.5) / samples) ** 2
        parts = [np.concatenate([np.zeros(9), push + 0.05 * rng.standard_normal(samples)]) for _ in range(24)]
        off.append(force_noise([[np.concatenate(parts)]])[0] / 0.05)
    assert np.median(off) == pytest.approx(1.0, abs=0.25)


def test_a_force_that_changes_within_some_samples_is_not_taken_for_noise_of_lines() -> None:
    """What is left of it in differences falls with their order as such noise does."""
    off = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        t = np.arange(360) / RATE_HZ
        force = sum(a * np.sin(2 * np.pi * hz * t + rng.uniform(0, 6)) for a, hz in ((3.0, 1.5), (2.0, 4.0)))
        off.append(force_noise([[6.0 + force + 0.05 * rng.standard_normal(360)]])[0] / 0.05)
    assert np.mean(np.abs(np.log(np.maximum(off, 1e-3))) < np.log(1.4)) >= 0.95


def test_what_is_noise_along_one_axis_is_noise_of_the_whole_force() -> None:
    """A push straight along x shows nothing along y but the noise of its sensor."""
    noise = 0.08 * np.random.default_rng(1).standard_normal((2, 3000))
    assert force_noise([[smooth(3000) + noise[0]], [noise[1]]]) == pytest.approx([0.08, 0.08], rel=0.1)


@pytest.mark.parametrize("rest", [0, 30, 300])
def test_noise_does_not_hang_on_how_long_nothing_touches(rest: int) -> None:
    """A log has zeros there; they are no samples of the sensor, however many they are."""
    rng, pushes = np.random.default_rng(2), []
    for _ in range(20):
        push = smooth(40) + 0.08 * rng.standard_normal(40)
        pushes.append(np.concatenate([np.zeros(rest), push, np.zeros(rest)]))
    assert force_noise([[np.concatenate(pushes)], [np.concatenate(pushes)]]) == pytest.approx([0.08, 0.08], rel=0.15)


def test_a_force_that_was_commanded_has_no_noise() -> None:
    """Not by more than the rounding of its numbers, whatever its course; nor has one that is too short to tell."""
    t = np.arange(900) / RATE_HZ
    square, bursts = 8.0 * np.sign(1.0 - t % 2), 8.0 * np.sin(0.6 * t**2 * (t < 6))
    rng = np.random.default_rng(3)
    held = [13.0 + np.repeat(rng.uniform(-5, 5, 900 // n + 1), n)[:900] for n in (2, 3, 6, 8)]
    binary = 8.0 * rng.choice([-1.0, 1.0], 900)
    tones = [13.0 + 4.0 * np.sin(2 * np.pi * hz * t) for hz in (5.0, 8.0, 10.0, 11.0, 14.0)]
    for force in (smooth(900), square, bursts, np.zeros(900), binary, rng.uniform(-5, 5, 900), *held, *tones):
        assert force_noise([[force]])[0] < 1e-12
    assert not force_noise([[np.random.default_rng(0).standard_normal(5)], []]).any()
    (rounded,) = force_noise([[smooth(900).round(3)]])
    assert 0.0 < rounded < 0.001


def test_a_measured_force_is_warned_of(tmp_path: Path) -> None:
    write_case(made(episodes=2, seconds=3.0)[0], tmp_path / "case")
    assert read_case(tmp_path / "case").notes == ()
    table = pd.read_parquet(tmp_path / "case/recording.parquet")
    rng = np.random.default_rng(4)
    for name in ("fx", "fy"):
        table[name] += 0.05 * rng.standard_normal(len(table))
    table.to_parquet(tmp_path / "case/recording.parquet", index=False)
    (note,) = read_case(tmp_path / "case").notes
    assert note.startswith("the force 'fx', 'fy' was measured, with noise of about 0.0")
    assert "its path as a `pin` tells more" in note
