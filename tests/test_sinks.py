"""What is written is what happened, can be read by others, and writing it changes nothing."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rerun as rr

from runner.errors import ConfigError
from runner.physics.forces import PaperForces
from runner.physics.scene import Dof, FloorContact, SceneConfig
from runner.teleop import loop
from runner.teleop.estimators import Linear, Rotational
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.frames import RunResult
from runner.teleop.link import LinkConfig
from runner.teleop.sinks import FrameKind, LogConfig, ParquetSink, RrdDetail, RrdSink

CONFIG = {"seed": 3, "scene": {"dof": "planar", "timestep_s": 0.25}, "estimator": {"linear": {}}}


def run(**scene: Any) -> RunResult:
    """Return a short run with two estimators."""
    return loop.run(
        Experiment(
            seed=3,
            scene=SceneConfig(**scene),
            forces=PaperForces(pushes=2, rest_s=0.4),
            remote=RemoteConfig(),
            start=StartConfig(),
            link=LinkConfig(),
            estimator={"linear": Linear(), "rotational": Rotational()},
        )
    )


@pytest.fixture(scope="module")
def result() -> RunResult:
    """Return one run for the tests that only read it."""
    return run()


@pytest.fixture(scope="module")
def rrd(result: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the `.rrd` of that run."""
    folder = tmp_path_factory.mktemp("run")
    RrdSink().write(result, folder, CONFIG)
    return folder / "run.rrd"


def chunks(path: Path) -> dict[str, list[Any]]:
    """Return the record batches of a recording by entity."""
    out = defaultdict(list)
    for chunk in rr.chunk.RrdReader(path).stream():
        out[str(chunk.entity_path)].append(chunk.to_record_batch().to_pandas())
    return out


def moving(path: Path, entity: str, column: str) -> pd.DataFrame:
    """Return the chunk of an entity that has this column."""
    return next(table for table in chunks(path)[entity] if column in table)


def test_parquet_gives_back_every_bit(result: RunResult, tmp_path: Path) -> None:
    """Both kinds of frames are read back exactly, column by column, in order and type."""
    ParquetSink(steps=True).write(result, tmp_path, {})
    for name, frames in (("frames.parquet", result.updates), ("steps.parquet", result.steps)):
        table = pd.read_parquet(tmp_path / name)
        assert list(table.columns) == list(frames.columns)
        for column in table:
            assert table[column].dtype == frames.column(str(column)).dtype
            assert np.array_equal(table[column], frames.column(str(column)), equal_nan=True)


def test_an_update_frame_holds_all_of_it(result: RunResult) -> None:
    """Both poses and velocities, command, estimates, errors and contact stand in one row."""
    names = set(result.updates.columns)
    for who in ("remote", "linear", "rotational"):
        assert {f"{who}_{c}" for c in ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s")} <= names
        assert {f"{who}_{c}" for c in ("friction_x_n", "friction_torque_nm", "pressure_x_m", "load_n")} <= names
    assert {"force_x_n", "point_y_m", "linear_mass_kg", "rotational_mass_error", "linear_outcome"} <= names


def test_the_viewer_verifies_the_file(rrd: Path) -> None:
    """`rerun rrd verify` and `stats` succeed on what was written."""
    viewer = shutil.which("rerun", path=str(Path(sys.executable).parent))
    assert viewer
    for command in ("verify", "stats"):
        done = subprocess.run([viewer, "rrd", command, str(rrd)], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr


def test_numbers_in_the_rrd_are_exact(result: RunResult, rrd: Path) -> None:
    """Estimates and velocities are logged in full precision, with both timelines."""
    table = moving(rrd, "/estimate/mass_kg", "Scalars:scalars")
    wanted = np.column_stack([np.full(len(result.updates), 3.0)] + [
        result.updates.column(f"{n}_mass_kg") for n in result.estimators
    ])  # fmt: skip
    assert np.array_equal(np.stack(table["Scalars:scalars"].to_list()), wanted)
    assert np.array_equal(table["frame"], result.updates.column("frame"))
    times = table["sim_time"].to_numpy().astype("timedelta64[ns]").astype(np.int64)
    np.testing.assert_allclose(times / 1e9, result.updates.column("time_s"), atol=1e-9)
    speeds = np.stack(moving(rrd, "/velocity/linear", "Scalars:scalars")["Scalars:scalars"].to_list())
    assert np.array_equal(speeds[:, 0], result.updates.column("remote_vx_m_s"))
    assert np.array_equal(speeds[:, 2], result.updates.column("linear_vx_m_s"))


def test_the_rrd_shows_cubes_arrow_trail_and_summary(result: RunResult, rrd: Path) -> None:
    """All that the layout shows is there, one row per update; the arrow ends where the push acts."""
    made = chunks(rrd)
    for entity in ("/world/remote", "/world/linear", "/world/rotational"):
        assert len(moving(rrd, entity, "Transform3D:translation")) == len(result.updates)
    assert {"/world/trail", "/world/force", "/summary", "/error/mass_kg", "/velocity/turning"} <= made.keys()
    arrows = moving(rrd, "/world/force", "Arrows3D:vectors")
    vectors = np.stack([v[0] for v in arrows["Arrows3D:vectors"]])
    tips = np.stack([o[0] for o in arrows["Arrows3D:origins"]]) + vectors
    k = int(np.argmax(result.updates.column("point_x_m") != 0))  # the first off-centre push
    frame = result.updates[k]
    c, s = np.cos(frame.remote_yaw_rad), np.sin(frame.remote_yaw_rad)
    wanted = [frame.remote_x_m + c * frame.point_x_m, frame.remote_y_m + s * frame.point_x_m]
    np.testing.assert_allclose(tips[k, :2], wanted, atol=1e-6)
    np.testing.assert_allclose(vectors[k], 0.05 * np.array([frame.force_x_n, frame.force_y_n, 0]), atol=1e-6)


def test_the_layout_and_the_config_are_inside(result: RunResult, rrd: Path) -> None:
    """The file has a blueprint, and the resolved config as properties by full key."""
    assert len(rr.chunk.RrdReader(rrd).blueprints()) == 1
    made = chunks(rrd)
    (config,) = made["/__properties/config"]
    assert config["seed"][0].tolist() == [3]
    assert config["scene.dof"][0].tolist() == ["planar"]
    assert config["scene.timestep_s"][0].tolist() == [0.25]
    (outcome,) = made["/__properties/result"]
    assert outcome["linear.mass_kg.final"][0].tolist() == [result.updates[-1].linear_mass_kg]


def test_how_much_the_rrd_shows(result: RunResult, tmp_path: Path) -> None:
    """Every n-th update, or every physics step, on request; estimates always at every update."""
    for sink, rows in (
        (RrdSink(every=8), len(result.updates) / 8),
        (RrdSink(steps=True), len(result.steps)),
        (RrdSink(steps=True, every=10), len(result.steps) / 10),
    ):
        sink.write(result, tmp_path, CONFIG)
        path = tmp_path / "run.rrd"
        assert len(moving(path, "/world/remote", "Transform3D:translation")) == np.ceil(rows)
        assert len(moving(path, "/estimate/mass_kg", "Scalars:scalars")) == len(result.updates)


def test_written_runs_are_let_go_of(result: RunResult, tmp_path: Path) -> None:
    """Rerun's threads don't pile up: a sweep of thousands of runs writes thousands of files."""
    threads = Path("/proc/self/task")
    if not threads.exists():
        pytest.skip("counts threads as Linux lists them")
    counts = []
    for i in range(6):
        (folder := tmp_path / str(i)).mkdir()
        RrdSink().write(result, folder, {})
        counts.append(len(list(threads.iterdir())))
    assert counts[-1] <= counts[1]


def test_settings_choose_the_sinks() -> None:
    """`rrd` and `frames` say what is written."""
    assert LogConfig().sinks() == [ParquetSink(), RrdSink()]
    assert LogConfig(rrd=RrdDetail.off, frames=FrameKind.off).sinks() == []
    assert LogConfig(rrd=RrdDetail.every_n, every_n=5, frames=FrameKind.steps).sinks() == [
        ParquetSink(steps=True),
        RrdSink(every=5, steps=True),
    ]
    with pytest.raises(ConfigError, match="every_n"):
        LogConfig(every_n=0)


def test_looking_does_not_change_the_motion(result: RunResult, tmp_path: Path) -> None:
    """A run of which everything was logged has the bits of one that nobody looked at."""
    watched, alone = run(), run()
    for sink in LogConfig(frames=FrameKind.steps).sinks():
        sink.write(watched, tmp_path, CONFIG)
    for kind in ("steps", "updates"):
        for name, column in getattr(alone, kind).columns.items():
            assert np.array_equal(column, getattr(watched, kind).column(name), equal_nan=True)


@pytest.mark.parametrize(
    "scene",
    [{"contact": FloorContact.feet, "grid": 2}, {"dof": Dof.free, "contact": FloorContact.corners}],
    ids=["upright", "free"],
)
def test_every_kind_of_motion_is_shown(scene: dict[str, Any], tmp_path: Path) -> None:
    """Upright and free cubes are logged with their height and their quaternion."""
    shown = run(**scene)
    RrdSink().write(shown, tmp_path, CONFIG)
    table = moving(tmp_path / "run.rrd", "/world/remote", "Transform3D:translation")
    place = np.stack([v[0] for v in table["Transform3D:translation"]])
    np.testing.assert_allclose(place[:, 2], 0.5, atol=1e-3)
    turn = np.stack([v[0] for v in table["Transform3D:quaternion"]])
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), 1.0, atol=1e-6)
    assert abs(turn[-1, 2]) > 0.02  # it has turned about z


def test_a_run_without_updates_is_written(tmp_path: Path) -> None:
    """One update per second and half a second of run: frames are empty, files are whole."""
    short = Experiment(
        seed=0,
        scene=SceneConfig(),
        forces=PaperForces(pushes=1, push_s=0.1, rest_s=0.1, lead_s=0.1),
        remote=RemoteConfig(),
        start=StartConfig(),
        link=LinkConfig(1.0),
        estimator={"linear": Linear()},
    )
    made = loop.run(short)
    for sink in LogConfig(frames=FrameKind.steps).sinks():
        sink.write(made, tmp_path, CONFIG)
    assert len(pd.read_parquet(tmp_path / "frames.parquet")) == 0
    assert len(pd.read_parquet(tmp_path / "steps.parquet")) == 144
    assert "/summary" in chunks(tmp_path / "run.rrd")
