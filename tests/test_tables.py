"""Summaries say what the frames say, and any number of them make one table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runner.errors import ResultError
from runner.teleop.frames import Frames, RunResult, Status, Truth
from runner.teleop.tables import collect, failure_row, summary_row, time_within, write_summary


def result(mass_kg: list[float], *, names: tuple[str, ...] = ("linear",), status: Status = Status.done) -> RunResult:
    """Return a run of true mass 2 kg, start 1 kg, with these estimates at 10 Hz."""
    columns = {"time_s": (np.arange(len(mass_kg)) + 1) / 10}
    columns |= {f"{name}_mass_kg": np.array(mass_kg) for name in names}
    return RunResult(
        make_steps=lambda: Frames({"time_s": np.zeros(8 * len(mass_kg))}),
        make_updates=lambda: Frames(columns),
        step_count=8 * len(mass_kg),
        update_count=len(mass_kg),
        estimators=names,
        parameters={name: {"mass_kg": Truth(2.0, 1.0)} for name in names},
        half_size_m=(0.5, 0.5, 0.5),
        timestep_s=0.0125,
        wall_s=0.5,
        status=status,
        reason="" if status is Status.done else "why",
    )


def test_a_row_says_what_happened() -> None:
    """True, start and final mass, signed final error, median and peak size, times to within three limits."""
    row = summary_row(result([1.0, 5.0, 2.1, 2.01, 2.001, 2.0001]), {"seed": 4})
    assert list(row)[:3] == ["seed", "status", "reason"]
    assert (row["mass_true_kg"], row["mass_start_kg"], row["mass_final_kg"]) == (2.0, 1.0, 2.0001)
    assert row["mass_final_error"] == pytest.approx(5e-5)
    assert row["mass_median_error"] == pytest.approx(0.0275)
    assert row["mass_peak_error"] == pytest.approx(1.5)
    assert row["mass_to_1pct_s"] == pytest.approx(0.4)
    assert row["mass_to_0p1pct_s"] == pytest.approx(0.5)
    assert row["mass_to_0p01pct_s"] == pytest.approx(0.6)
    assert (row["updates"], row["steps"], row["steps_per_s"]) == (6, 48, 96.0)
    assert row["simulated_s"] == pytest.approx(0.6)


def test_several_estimators_have_columns_of_their_own() -> None:
    """With two estimators the columns begin with their names."""
    row = summary_row(result([1.0, 2.0], names=("linear", "rotational")))
    assert row["linear_mass_final_kg"] == row["rotational_mass_final_kg"] == 2.0
    assert "mass_final_kg" not in row


def test_a_run_without_updates_has_a_row() -> None:
    """What is not known is NaN."""
    row = summary_row(result([], status=Status.diverged))
    assert row["status"] == "diverged"
    assert row["reason"] == "why"
    assert np.isnan(row["mass_final_kg"])
    assert np.isnan(row["mass_to_1pct_s"])


@given(st.lists(st.floats(0, 2), min_size=1, max_size=30), st.floats(0, 2))
def test_time_within_is_the_first_time_after_which_it_stays(error: list[float], limit: float) -> None:
    """All errors from that time on are within, the one before is not; NaN if the last one is outside."""
    time_s, size = np.arange(len(error)) + 1.0, np.array(error)
    found = time_within(time_s, size, limit)
    if np.isnan(found):
        assert size[-1] > limit
        return
    first = int(found) - 1
    assert (size[first:] <= limit).all()
    assert first == 0 or size[first - 1] > limit


def test_collect_joins_folders_in_order(tmp_path: Path) -> None:
    """Runs of a sweep come in the order of their numbers; failed ones are rows; types survive."""
    for k in (10, 2, 0):
        folder = tmp_path / "sweep" / str(k)
        folder.mkdir(parents=True)
        write_summary([summary_row(result([1.0, 2.0]), {"job": k, "link.rate_hz": 10.0 * k})], folder)
    folder = tmp_path / "sweep" / "3"
    folder.mkdir()
    write_summary([failure_row(ValueError("no\n way"), {"job": 3})], folder)
    table = collect([tmp_path])
    assert table["job"].tolist() == [0, 2, 3, 10]
    assert table["status"].tolist() == ["done", "done", "failed", "done"]
    assert table["reason"].tolist()[2] == "ValueError: no way"
    assert table["mass_final_kg"].dtype == float
    assert np.isnan(table["mass_final_kg"][2])
    assert table["run"].tolist()[3] == str(tmp_path / "sweep" / "10")
    twice = collect([tmp_path / "sweep" / "2", tmp_path / "sweep" / "2" / "summary.parquet"])
    assert twice["job"].tolist() == [2, 2]


def test_what_is_missing_or_broken_is_named(tmp_path: Path) -> None:
    """A folder that is not there, one without a run, and a file that is none."""
    with pytest.raises(ResultError, match=r"paths: no folder '.*nowhere'"):
        collect([tmp_path / "nowhere"])
    with pytest.raises(ResultError, match=r"no 'summary\.parquet' in .*: no run has ended there"):
        collect([tmp_path])
    (tmp_path / "summary.parquet").write_text("no table")
    with pytest.raises(ResultError, match="can't be read"):
        collect([tmp_path])


def test_a_sweep_that_was_stopped_before_its_first_row_says_so(tmp_path: Path) -> None:
    """How it ended, and the command that goes on; not that there is nothing."""
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "sweep.txt").write_text("run start.mass_kg=1,2\n")
    for noted, said in (("running", "killed"), ("interrupted", "interrupted")):
        (tmp_path / "s" / "run.yaml").write_text(f"status: {noted}\ncommand: run\n")
        with pytest.raises(
            ResultError, match=rf"no run has ended there: {said}; go on with: runner run resume=.*/s\.$"
        ):
            collect([tmp_path])


def test_a_summary_is_read_back(tmp_path: Path) -> None:
    """What is written is read, for rows that differ in their columns too."""
    write_summary([{"a": 1, "b": 0.5, "c": "x"}, {"a": 2, "d": True}], tmp_path)
    table = pd.read_parquet(tmp_path / "summary.parquet")
    assert table["a"].tolist() == [1, 2]
    assert table["b"].tolist()[0] == 0.5
    assert table["c"].tolist()[0] == "x"
    assert list(table.columns) == ["a", "b", "c", "d"]
