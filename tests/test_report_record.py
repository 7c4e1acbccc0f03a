"""The log of a report holds the motions of all models."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from runner.report.record import write_rrd
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
    """Three bodies and the residuals of every channel, all episodes one after another, held-out ones first."""
    rows: dict[str, int] = {}
    times = []
    for chunk in rr.chunk.RrdReader(log).stream():
        batch = chunk.to_record_batch()
        entity = chunk.entity_path.lstrip("/")
        if "sim_time" in batch.schema.names:
            rows[entity] = rows.get(entity, 0) + batch.num_rows
            if entity == "world/nominal/object":
                times.append(batch.column("sim_time").to_numpy(zero_copy_only=False))
    samples = sum(len(e) for e in found.recording.episodes)
    bodies = [f"world/{model}/object" for model in ("measured", "nominal", "corrected")]
    for entity in (*bodies, "world/command", "residual/x", "residual/wz"):
        assert rows[entity] == samples
    assert rows["episode"] == 3
    assert rows["world/missing_force"] == len(found.where.missing_force)
    time_s = np.concatenate(times).astype("timedelta64[ns]").astype(float) * 1e-9
    assert np.all(np.diff(time_s) > 0)
    assert rr.chunk.RrdReader(log).blueprints()


def test_log_of_none_has_no_corrected_body(found: Any, tmp_path: Path) -> None:
    """Where nothing is corrected nothing is shown in orange."""
    nothing = changed(found, ranked=(ranked(("none",), 1.0),), effects=(), corrected_starts=found.nominal_starts)
    path = write_rrd(nothing, tmp_path / "none.rrd")
    entities = {c.entity_path for c in rr.chunk.RrdReader(path).stream()}
    assert "/world/nominal/object" in entities
    assert not any(e.startswith("/world/corrected") for e in entities)
