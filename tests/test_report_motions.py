"""The motions and missing forces that a report draws are those of its models."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

from runner.recording import Span
from runner.report import where_figures
from runner.report.before_after import misses, of_whole_episodes
from runner.report.figures import STYLE, new, svg
from runner.report.missing_force import by_regime
from runner.report.motions import autocorrelation, replay
from tests.report_case import SIGMA, changed, diagnosis


@pytest.fixture(scope="module")
def found() -> Any:
    """A diagnosis that found the friction."""
    return diagnosis()


def test_replay_separates_models(found: Any) -> None:
    """The corrected motion is within the noise, the nominal one is not."""
    for path in replay(found):
        miss = {
            w: np.sqrt(np.mean(((getattr(path, w) - path.measured) / SIGMA) ** 2)) for w in ("nominal", "corrected")
        }
        assert miss["corrected"] == pytest.approx(1.0, abs=0.1)
        assert miss["nominal"] > 3


def test_misses_are_in_small_units(found: Any) -> None:
    """Rows by channel and horizon, whole episodes last, in mm and degrees."""
    rows = misses(found)
    assert [r.horizon for r in rows[:5]] == ["0.1 s", "0.5 s", "1 s", "2 s", "whole episode"]
    yaw = next(r for r in rows if r.channel.name == "yaw" and r.horizon == "whole episode")
    assert yaw.before == pytest.approx(math.degrees(9e-3))
    # the corrected model is the true one: nothing but noise at any horizon
    for row in rows:
        assert row.after < 1.4 * row.noise
        assert row.noise > 0


def test_parts_of_episodes_are_not_called_episodes(found: Any) -> None:
    """Where models are replayed over parts, the last horizon says so, and how long they are."""
    halves = tuple(Span(e, b, b + 90) for e in range(3) for b in (0, 90))
    rows = of_whole_episodes(changed(found, stretches=halves))
    assert {r.horizon for r in rows} == {"parts of 1.5 s"}


def test_nothing_is_claimed_over_longer_times_than_were_replayed(found: Any) -> None:
    """Beyond, what noise of a force makes piles up: a gap there would contradict the gap over parts."""
    halves = tuple(Span(e, b, b + 90) for e in range(3) for b in (0, 90))
    rows = misses(changed(found, stretches=halves))
    assert [r.horizon for r in rows[:4]] == ["0.1 s", "0.5 s", "1 s", "parts of 1.5 s"]


def test_letters_of_a_figure_are_as_drawn() -> None:
    """Coordinates are cut to hundredths, the numbers at an axis are not: 0.0025 is not 0.00."""
    with mpl.rc_context(STYLE):
        figure = new(3.0, 2.0)
        ax = figure.add_subplot()
        ax.plot([0.0, 0.005], [0.0, 1.0])
        ax.set_xticks([0.0, 0.0025, 0.005])
        text = svg(figure, "a", "a line")
    assert ">0.0025<" in text
    assert not re.search(r'="[^"]*\d\.\d{3}', text)


def test_autocorrelation_of_a_first_order_process() -> None:
    """phi^k for x[t] = phi x[t-1] + e, and no more than chance for white noise."""
    rng, phi = np.random.default_rng(0), 0.6
    e = rng.standard_normal((20, 2000))
    x = np.zeros_like(e)
    for t in range(1, e.shape[1]):
        x[:, t] = phi * x[:, t - 1] + e[:, t]
    r, count = autocorrelation(x, 3)
    assert count == x.size
    assert r == pytest.approx(phi ** np.arange(1, 4), abs=0.02)
    white, _ = autocorrelation(e, 100)
    assert np.mean(np.abs(white) > 1.96 / np.sqrt(e.size)) < 0.12


def test_missing_wrench_of_less_friction_is_along_the_motion(found: Any) -> None:
    """A floor with 0.03 less friction lacks 0.03 m g along the motion, and nothing across it."""
    means = {m.component: m for m in by_regime(found, found.where) if m.regime == "coasting"}
    lacking = 0.03 * 3.0 * 9.81
    assert means["along_n"].value == pytest.approx(lacking, abs=max(4 * means["along_n"].error, 0.1 * lacking))
    assert abs(means["left_n"].value) < 4 * means["left_n"].error
    assert means["along_n"].value > 4 * means["along_n"].error


def test_the_missing_wrench_is_drawn_where_longer_windows_were_looked_at(found: Any) -> None:
    """The wrench keeps its short windows when the excess only shows in longer ones."""
    where = found.where
    fewer = replace(where, windows=where.windows.iloc[::2].reset_index(drop=True), window_s=2 * where.window_s)
    assert by_regime(found, fewer) == by_regime(found, where)


def test_a_timeline_tells_of_episodes_without_a_row() -> None:
    """Those in which most is missed have one."""
    count = where_figures.MOST_EPISODES + 2
    episodes = [f"episode {k}" for k in range(count) for _ in range(4)]
    excess = [float(k) for k in range(count) for _ in range(4)]
    at = [0.5 * k for _ in range(count) for k in range(4)]
    svg, _, fewer = where_figures.timeline(
        pd.DataFrame({"episode": episodes, "excess": excess, "freedom": 1.0, "t_s": at}), 0.5, None, "t"
    )
    assert fewer == 2
    assert f"episode {count - 1}" in svg
    assert "episode 1<" not in svg
