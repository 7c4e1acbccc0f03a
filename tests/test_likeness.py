"""What a missing force goes along with is told from windows: shapes, beats, and nothing where there is nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from runner.localise.likeness import likenesses

WINDOWS, EPISODES = 60, 4


def system(shapes: dict[str, np.ndarray]) -> Any:
    """Return what is asked of a system: one force, and the shapes that it may have."""
    disturbance = SimpleNamespace(names=("tau_n_m",), labels=("torque at 'elbow' [N m]",), prior=np.array([2.0]))
    columns = {words: np.asarray(c).reshape(len(c), -1) for words, c in shapes.items()}
    return SimpleNamespace(disturbance=disturbance, force_shapes=lambda _: {"tau_n_m": columns})


def windows(force: np.ndarray, noise: float, seed: int = 0) -> pd.DataFrame:
    """Return a table of a missing force with noise; windows of 0.1 s, episode by episode."""
    measured = force + noise * np.random.default_rng(seed).standard_normal(len(force))
    episode = np.repeat([f"episode {e}" for e in range(EPISODES)], WINDOWS)
    t_s = np.tile(0.1 * np.arange(WINDOWS), EPISODES)
    return pd.DataFrame({"episode": episode, "t_s": t_s, "tau_n_m": measured, "tau_n_m_se": noise})


def speeds() -> np.ndarray:
    """Return a speed that has nothing of a sine of one frequency, (W,)."""
    return np.random.default_rng(3).standard_normal(EPISODES * WINDOWS)


def test_a_force_goes_along_with_what_makes_it() -> None:
    """A force of two parts, 0.3 N m by direction and 0.1 by speed: shares of 90 and 10 %, less what noise makes."""
    v = speeds()
    force = 0.3 * np.sign(v) + 0.1 * np.random.default_rng(4).permutation(np.sign(v))
    (one,) = likenesses(system({"direction": np.sign(v), "place": np.sin(np.arange(len(v)))}), windows(force, 0.05))
    assert one.rms == pytest.approx(np.sqrt(0.1), rel=0.05)
    assert [words for words, _ in one.alike] == ["direction"]
    assert one.alike[0][1] == pytest.approx(0.9, abs=0.05)


def test_noise_goes_along_with_nothing() -> None:
    """Chance is not told, and what is all noise is no missing force."""
    v = speeds()
    shapes = system({"direction": np.sign(v), "place": np.random.default_rng(5).standard_normal((len(v), 6))})
    random = np.random.default_rng(6).standard_normal(len(v))
    (one,) = likenesses(shapes, windows(0.3 * random, 0.05))
    assert one.alike == ()
    table = windows(np.zeros(len(v)), 0.05)
    table["tau_n_m_se"] = 0.1
    assert likenesses(shapes, table) == ()


def test_a_beat_is_told_with_its_frequency() -> None:
    """1.6 Hz, at another phase in each episode."""
    v = speeds()
    t = np.tile(0.1 * np.arange(WINDOWS), EPISODES)
    force = 0.2 * np.sin(2 * np.pi * 1.6 * t + np.repeat(np.arange(EPISODES), WINDOWS))
    (one,) = likenesses(system({"direction": np.sign(v)}), windows(force, 0.02))
    assert one.alike[0][0] in {f"a beat of {hz:.3g} Hz" for hz in np.linspace(1.55, 1.65, 11)}
    assert one.alike[0][1] > 0.9
