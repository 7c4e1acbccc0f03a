"""The log of a report holds the motions of all models."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rerun as rr

from runner.report.record import eye_on_all, write_rrd
from runner.report.record_gap import window_gaps
from runner.report.record_layout import FROM, axis
from runner.systems.drawing import DrawnBody, Shape
from tests.report_case import changed, diagnosis, ranked


@pytest.fixture(scope="module")
def found() -> Any:
    """A diagnosis that found the friction."""
    return diagnosis()


@pytest.fixture(scope="module")
def log(found: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of the diagnosis."""
    return write_rrd(found, tmp_path_factory.mktemp("log"))


def test_log_verifies(log: Path) -> None:
    """The file has its footer and is sound."""
    verdict = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(log)], capture_output=True, text=True, timeout=60
    )
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr


def test_log_holds_all_motions(found: Any, log: Path) -> None:
    """Each episode has its own bodies, residuals and missing force, from time zero; a window is coloured by its gap."""
    rows: dict[str, int] = {}
    times, colours = [], []
    for chunk in rr.chunk.RrdReader(log).stream():
        batch = chunk.to_record_batch()
        entity = chunk.entity_path.lstrip("/")
        if "sim_time" in batch.schema.names:
            rows[entity] = rows.get(entity, 0) + batch.num_rows
            if entity == "episode_5/nominal/object":
                times.append(batch.column("sim_time").to_numpy(zero_copy_only=False))
            if entity == "episode_5/nominal/object/box":
                (name,) = (n for n in batch.schema.names if "colors" in n)
                colours += [row[0] for row in batch.column(name).to_pylist()]
    for episode in found.recording.episodes:
        root = f"episode_{episode.index}"
        bodies = [f"{root}/{model}/object" for model in ("measured", "nominal", "corrected")]
        for entity in (*bodies, f"{root}/command", f"{root}/residual/x", f"{root}/residual/wz"):
            assert rows[entity] == len(episode)
    arrows = sum(count for entity, count in rows.items() if entity.endswith("/missing_arrow"))
    assert arrows == len(found.where.missing_force)
    time_s = np.concatenate(times).astype("timedelta64[ns]").astype(float) * 1e-9
    assert time_s[0] == 0
    assert np.all(np.diff(time_s) > 0)
    assert len(set(colours)) > 3
    assert rr.chunk.RrdReader(log).blueprints()


def rows_over_time(log: Path) -> dict[str, int]:
    """Return how many values each entity of a log has over its time."""
    shown: dict[str, int] = {}
    for chunk in rr.chunk.RrdReader(log).stream():
        if "sim_time" in (batch := chunk.to_record_batch()).schema.names:
            entity = chunk.entity_path.lstrip("/")
            shown[entity] = shown.get(entity, 0) + batch.num_rows
    return shown


def test_one_window_is_a_line(found: Any, tmp_path: Path) -> None:
    """A toss of a third of a second has one window, of which a plot of points that are joined would show nothing."""
    where = replace(
        found.where,
        windows=found.where.windows.groupby("episode").head(1),
        missing_force=found.where.missing_force.groupby("episode").head(1),
    )
    shown = rows_over_time(write_rrd(changed(found, where=where), tmp_path))
    forces = {entity: n for entity, n in shown.items() if "/missing_force/" in entity}
    assert forces
    assert set(forces.values()) == {2}
    assert shown[f"episode_{found.recording.episodes[0].index}/gap"] == 2


def test_one_window_that_is_seen_is_not_the_whole_episode(found: Any, tmp_path: Path) -> None:
    """Where a force is told in one window of many, nothing is drawn where none was told."""
    force = found.where.missing_force.copy()
    name = found.system.disturbance.names[0]
    first = force.groupby("episode").cumcount() == 3
    force.loc[~first, [name, f"{name}_se"]] = np.nan
    log = write_rrd(changed(found, where=replace(found.where, missing_force=force)), tmp_path)
    shown = rows_over_time(log)
    assert {n for entity, n in shown.items() if entity.endswith(f"/missing_force/{name}")} == {1}


def test_shares_of_the_gap_are_those_of_the_windows(found: Any) -> None:
    """All windows together are the whole gap; the darkest has most of it."""
    paths: list[Any] = [SimpleNamespace(episode=e) for e in range(3)]
    gaps = [g for g in window_gaps(found, paths) if g is not None]
    share = np.concatenate([g.share for g in gaps])
    strength = np.concatenate([g.strength for g in gaps])
    assert share.sum() == pytest.approx(1.0)
    assert strength.max() == 1.0
    assert strength[np.argmax(share)] == 1.0
    assert all(g.begin_s[0] == 0.0 and np.all(np.diff(g.begin_s) > 0) for g in gaps)


def test_log_of_none_has_no_corrected_body(found: Any, tmp_path: Path) -> None:
    """Where nothing is corrected nothing is shown in orange."""
    nothing = changed(found, ranked=(ranked(("none",), 1.0),), effects=(), corrected_starts=found.nominal_starts)
    path = write_rrd(nothing, tmp_path / "none.rrd")
    entities = {c.entity_path for c in rr.chunk.RrdReader(path).stream()}
    assert "/episode_5/nominal/object" in entities
    assert not any("/corrected" in e for e in entities)


def test_the_eye_sees_all_of_a_lever_that_turns_about_its_end() -> None:
    """Its body stays where the hinge is; the shape reaches 0.5 m from there, and all around in time."""
    lever = DrawnBody("lever", (Shape("capsule", (0.02, 0.23), position_m=(0.0, 0.0, -0.25)),))
    angle = np.linspace(0.0, np.pi, 50)
    pose = np.zeros((50, 7))
    pose[:, :3], pose[:, 3], pose[:, 5] = (1.0, 2.0, 3.0), np.cos(angle / 2), np.sin(angle / 2)
    pose[7] = np.nan  # not measured
    eye = eye_on_all([(pose, lever)], size_m=0.1)
    towards = FROM / np.linalg.norm(FROM)
    for tip in (np.array([1.0, 2.0, 2.5]), np.array([0.5, 2.0, 3.0]), np.array([1.0, 2.0, 3.5])):
        along = (tip - eye.target_m) @ towards
        aside = np.linalg.norm(tip - eye.target_m - along * towards)
        # within some 27 degrees of where the eye looks, and not lost in the distance
        assert 0.15 < aside / (eye.distance_m - along) < 0.5
    assert eye_on_all([], size_m=0.1).distance_m > 0


@pytest.mark.parametrize(
    ("low", "high", "most", "ends"),
    [(-70.0, 65.0, 8, (-100, 100)), (-3.2, 2.8, 4, (-10, 10)), (-3.2, 2.8, 8, None), (0.0, 1.6, 8, None),
     (0.2, 0.9, 8, (0, 1)), (0.0, 0.0, 8, None)],
)  # fmt: skip
def test_axes_end_where_a_viewer_shows_numbers(
    low: float, high: float, most: int, ends: tuple[float, float] | None
) -> None:
    """A little beyond multiples of a power of ten, where between the ends of the curve there are not two to show."""
    found = axis(low, high, most)
    assert (found is None) == (ends is None)
    if found is not None and ends is not None:
        assert ends[0] - 0.1 * (ends[1] - ends[0]) < found[0] < ends[0]
        assert ends[1] < found[1] < ends[1] + 0.1 * (ends[1] - ends[0])
