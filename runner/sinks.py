"""Sinks: what is left of a run on disk. They read a finished run and never take part in it.

Figures and tables are made from Parquet; the `.rrd` is for looking at.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import rerun as rr
import rerun.blueprint as rrb

from runner.errors import check_range
from runner.frames import Frames, RunResult, Status
from runner.scene import rotate

REMOTE = "remote"


class RrdDetail(Enum):
    """How much of a run the `.rrd` holds."""

    full = "full"  # every physics frame
    every_n = "every_n"  # every n-th, and every update
    off = "off"


@dataclass(frozen=True)
class LogConfig:
    """What is written. `every_n` is used by `rrd=every_n`; `frames` off leaves the summary alone."""

    rrd: RrdDetail = RrdDetail.full
    every_n: int = 8
    frames: bool = True

    def __post_init__(self) -> None:
        check_range("every_n", self.every_n, 1, 1_000_000)

    def sinks(self) -> list[AbstractSink]:
        """Return the sinks that this asks for."""
        out: list[AbstractSink] = []
        if self.frames:
            out.append(ParquetSink())
        if self.rrd is not RrdDetail.off:
            out.append(RrdSink(every=1 if self.rrd is RrdDetail.full else self.every_n))
        return out


class AbstractSink(ABC):
    """Writes a finished run into a folder."""

    @abstractmethod
    def write(self, result: RunResult, folder: Path, config: Mapping[str, Any]) -> None:
        """Write the run; `config` is the resolved config as plain containers."""


@dataclass(frozen=True)
class ParquetSink(AbstractSink):
    """`frames.parquet` with every physics frame, `updates.parquet` with every update; all in full precision."""

    FRAMES: ClassVar[str] = "frames.parquet"
    UPDATES: ClassVar[str] = "updates.parquet"

    def write(self, result: RunResult, folder: Path, config: Mapping[str, Any]) -> None:
        _write_frames(result.steps, folder / self.FRAMES)
        _write_frames(result.updates, folder / self.UPDATES)


def _write_frames(frames: Frames, path: Path) -> None:
    # plain pages: dictionaries and statistics of measured numbers cost more time than they save space
    pq.write_table(
        pa.table(dict(frames.columns)), path, compression="lz4", use_dictionary=False, write_statistics=False
    )


REMOTE_COLOUR = (70, 130, 220)
LOCAL_COLOURS = ((240, 140, 40), (60, 190, 130), (200, 90, 200), (220, 200, 60))
FORCE_COLOUR = (230, 60, 60)
ARROW_M_PER_N = 0.05
TRAIL = "world/trail"


@dataclass(frozen=True)
class RrdSink(AbstractSink):
    """`run.rrd` for the Rerun viewer, with its layout inside; sent as whole columns.

    `every` is the number of physics frames from one that is logged to the next. Estimates and errors, which change
    at updates only, are logged at every update.
    """

    FILE: ClassVar[str] = "run.rrd"
    every: int = 1

    def write(self, result: RunResult, folder: Path, config: Mapping[str, Any]) -> None:
        with rr.RecordingStream("runner", recording_id=None) as recording:
            recording.save(folder / self.FILE, default_blueprint=_blueprint(result))
            self.log(recording, result, config, name=folder.name)
            recording.flush()
            recording.disconnect()

    def log(self, recording: rr.RecordingStream, result: RunResult, config: Mapping[str, Any], name: str) -> None:
        """Send a run into an open recording."""
        recording.send_recording_name(name)
        recording.send_property("config", rr.AnyValues(**_flat(config)))
        recording.send_property("result", rr.AnyValues(**_outcome(result)))
        _send_static(recording, result)
        _send_steps(recording, result, self.every)
        _send_updates(recording, result)


def _flat(config: Any, prefix: str = "") -> dict[str, Any]:
    """Return a nested config as one level of `section.key`, with values that Rerun can hold."""
    if not isinstance(config, Mapping):
        plain = isinstance(config, bool | int | float | str)
        return {prefix: config if plain else str(config)}
    out: dict[str, Any] = {}
    for key, value in config.items():
        out |= _flat(value, f"{prefix}.{key}" if prefix else str(key))
    return out


def _outcome(result: RunResult) -> dict[str, Any]:
    out: dict[str, Any] = {"status": result.status.value, "reason": result.reason}
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            out[f"{name}.{parameter}.true"] = truth.true
            out[f"{name}.{parameter}.start"] = truth.start
            if len(result.updates):
                out[f"{name}.{parameter}.final"] = float(result.updates.column(f"{name}_{parameter}")[-1])
    return out


def _colour(result: RunResult, name: str) -> tuple[int, int, int]:
    if name == REMOTE:
        return REMOTE_COLOUR
    return LOCAL_COLOURS[result.estimators.index(name) % len(LOCAL_COLOURS)]


def _send_static(recording: rr.RecordingStream, result: RunResult) -> None:
    half = np.array(result.half_size_m)
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log("summary", rr.TextDocument(_summary(result), media_type="text/markdown"), static=True)
    for name in (REMOTE, *result.estimators):
        colour = _colour(result, name)
        solid = name == REMOTE
        # the local cube is drawn as a frame around the remote one, which it leaves between updates only by a hair
        boxes = rr.Boxes3D(
            half_sizes=[half if solid else 1.02 * half],
            colors=[(*colour, 255)],
            fill_mode="solid" if solid else "majorwireframe",
            radii=0.008,
        )
        recording.log(f"world/{name}", boxes, static=True)
        recording.log(
            f"velocity/linear/{name}", rr.SeriesLines(names=[f"{name} vx", f"{name} vy"], widths=[1.5] * 2), static=True
        )
        recording.log(
            f"velocity/turning/{name}", rr.SeriesLines(names=f"{name} wz", colors=[colour], widths=[1.5]), static=True
        )
    # a mark on the top shows the heading
    mark = rr.Boxes3D(
        centers=[(0.75 * half[0], 0, half[2])], half_sizes=[(0.12 * half[0], 0.3 * half[1], 0.01 * half[2])],
        colors=[(255, 255, 255, 255)], fill_mode="solid",
    )  # fmt: skip
    recording.log(f"world/{REMOTE}/front", mark, static=True)
    recording.log(TRAIL, rr.LineStrips3D.from_fields(colors=REMOTE_COLOUR, radii=0.012), static=True)
    recording.log("world/force", rr.Arrows3D.from_fields(colors=FORCE_COLOUR, radii=0.025), static=True)
    recording.log("force", rr.SeriesLines(names=["Fx", "Fy"], colors=[FORCE_COLOUR, (240, 170, 90)]), static=True)
    for name in result.estimators:
        colour = _colour(result, name)
        for parameter in result.parameters[name]:
            recording.log(
                f"estimate/{parameter}/{name}", rr.SeriesLines(names=name, colors=[colour], widths=[2]), static=True
            )
            recording.log(
                f"error/{parameter}/{name}", rr.SeriesLines(names=name, colors=[colour], widths=[2]), static=True
            )
    for parameter in _parameters(result):
        truth = rr.SeriesLines(names="true", colors=[REMOTE_COLOUR], widths=[1.5])
        recording.log(f"estimate/{parameter}/true", truth, static=True)


def _parameters(result: RunResult) -> list[str]:
    return list(dict.fromkeys(p for parameters in result.parameters.values() for p in parameters))


def _index(time_s: np.ndarray, frame: np.ndarray) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("sim_time", duration=time_s), rr.TimeColumn("frame", sequence=frame)]


def _send_steps(recording: rr.RecordingStream, result: RunResult, every: int) -> None:
    frames = Frames({name: column[::every] for name, column in result.steps.columns.items()})
    if not len(frames):
        return
    column = frames.column
    index = _index(column("time_s"), column("frame"))
    pose = {name: _pose(frames, name, result.half_size_m[2]) for name in (REMOTE, *result.estimators)}
    for name, (position, quaternion) in pose.items():
        recording.send_columns(
            f"world/{name}", index, rr.Transform3D.columns(translation=position, quaternion=quaternion)
        )
        _send_scalars(recording, f"velocity/linear/{name}", index, frames, (f"{name}_vx_m_s", f"{name}_vy_m_s"))
        _send_scalars(recording, f"velocity/turning/{name}", index, frames, (f"{name}_wz_rad_s",))
    force = np.column_stack([column(f"force_{axis}_n") for axis in "xyz"])
    _send_scalars(recording, "force", index, frames, ("force_x_n", "force_y_n"))
    # the arrow's tip is at the point of application, lifted on top of the cube so that it is seen
    position, quaternion = pose[REMOTE]
    point = np.column_stack([column(f"point_{axis}_m") for axis in "xyz"])
    tip = position + rotate(quaternion[:, [3, 0, 1, 2]], point)
    tip[:, 2] = position[:, 2] + 1.1 * result.half_size_m[2]
    vector = ARROW_M_PER_N * force
    recording.send_columns("world/force", index, rr.Arrows3D.columns(origins=tip - vector, vectors=vector))


def _send_updates(recording: rr.RecordingStream, result: RunResult) -> None:
    updates = result.updates
    if not len(updates):
        return
    index = _index(updates.column("time_s"), updates.column("frame"))
    position, _ = _pose(updates, REMOTE, result.half_size_m[2])
    ground = np.column_stack([position[:, :2], position[:, 2] - 0.98 * result.half_size_m[2]])
    segments = np.stack([np.vstack([ground[:1], ground[:-1]]), ground], axis=1)
    recording.send_columns(TRAIL, index, rr.LineStrips3D.columns(strips=segments))
    for name in result.estimators:
        for parameter, truth in result.parameters[name].items():
            _send_scalars(recording, f"estimate/{parameter}/{name}", index, updates, (f"{name}_{parameter}",))
            error = np.abs(updates.column(f"{name}_{parameter}") - truth.true) / abs(truth.true)
            # no logarithmic axis in the viewer; an exact estimate is drawn at the resolution of the numbers
            decades = np.log10(np.maximum(error, 1e-16))
            recording.send_columns(f"error/{parameter}/{name}", index, rr.Scalars.columns(scalars=decades))
    for parameter in _parameters(result):
        truth = next(p[parameter] for p in result.parameters.values() if parameter in p)
        recording.send_columns(
            f"estimate/{parameter}/true", index, rr.Scalars.columns(scalars=np.full(len(updates), truth.true))
        )


def _send_scalars(
    recording: rr.RecordingStream, entity: str, index: list[rr.TimeColumn], frames: Frames, names: tuple[str, ...]
) -> None:
    values = np.column_stack([frames.column(n) for n in names])
    columns = rr.Scalars.columns(scalars=values.ravel())
    recording.send_columns(
        entity, index, columns.partition(np.full(len(values), len(names))) if len(names) > 1 else columns
    )


def _pose(frames: Frames, name: str, rest_height_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return position (n, 3) and quaternion (n, 4), w last, of a cube."""
    n = len(frames)
    z = frames.columns.get(f"{name}_z_m", np.full(n, rest_height_m))
    position = np.column_stack([frames.column(f"{name}_x_m"), frames.column(f"{name}_y_m"), z])
    if f"{name}_qw" in frames.columns:
        return position, np.column_stack([frames.column(f"{name}_q{c}") for c in "xyzw"])
    half_yaw = frames.column(f"{name}_yaw_rad") / 2
    return position, np.column_stack([np.zeros((n, 2)), np.sin(half_yaw), np.cos(half_yaw)])


def _summary(result: RunResult) -> str:
    ok = result.status is Status.done
    lines = [
        "## Paper experiment" if ok else f"## {result.status.value}: {result.reason}",
        "",
        f"{len(result.steps)} physics steps of {1e3 * result.timestep_s:.4g} ms, {len(result.updates)} updates.",
        "",
        "| estimator | parameter | true | start | final | relative error |",
        "|---|---|---|---|---|---|",
    ]
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            last = float(result.updates.column(f"{name}_{parameter}")[-1]) if len(result.updates) else math.nan
            error = (last - truth.true) / truth.true
            lines.append(f"| {name} | {parameter} | {truth.true:g} | {truth.start:g} | {last:.9g} | {error:+.1e} |")
    lines += ["", "Solid: remote cube. Frame: local cube. Red arrow: the push. Line: the way of the remote cube."]
    return "\n".join(lines)


def _blueprint(result: RunResult) -> rrb.Blueprint:
    everything = [
        rrb.VisibleTimeRange(t, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative())
        for t in ("sim_time", "frame")
    ]
    x, y = (result.steps.column(f"{REMOTE}_{a}_m") for a in "xy")
    middle = np.array([(x.min() + x.max()) / 2, (y.min() + y.max()) / 2, 0.5 * result.half_size_m[2]])
    reach = max(np.ptp(x), np.ptp(y), 0.0) / 2 + 2.2 * max(result.half_size_m)
    scene = rrb.Spatial3DView(
        origin="/world",
        name="cubes",
        overrides={f"/{TRAIL}": rrb.VisibleTimeRanges(everything)},
        background=[24, 26, 30],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[110, 115, 125, 120]),
        eye_controls=rrb.EyeControls3D(
            position=tuple(middle + reach * np.array([0.9, -1.5, 1.5])), look_target=tuple(middle), eye_up=(0, 0, 1)
        ),
    )
    plots = [
        view
        for parameter in _parameters(result)
        for view in (
            rrb.TimeSeriesView(origin=f"/estimate/{parameter}", name=f"estimate: {parameter}"),
            rrb.TimeSeriesView(origin=f"/error/{parameter}", name=f"log10 |relative error|: {parameter}"),
        )
    ]
    plots += [
        rrb.TimeSeriesView(origin="/velocity/linear", name="velocity [m/s]"),
        rrb.TimeSeriesView(origin="/velocity/turning", name="yaw rate [rad/s]"),
        rrb.TimeSeriesView(origin="/force", name="force [N]"),
    ]
    summary = rrb.TextDocumentView(origin="/summary", name="summary")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(scene, summary, row_shares=[3, 1]), rrb.Vertical(*plots), column_shares=[1, 1]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
