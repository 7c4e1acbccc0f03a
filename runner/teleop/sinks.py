"""Sinks: what is left of a run on disk. They read a finished run and never take part in it.

Figures and tables are made from Parquet; the `.rrd` is for looking at.
"""

from __future__ import annotations

import functools
import math
import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import rerun as rr
import rerun.blueprint as rrb

from runner.errors import ResultError, check_range
from runner.physics.scene import rotate
from runner.storage.writing import replacing
from runner.teleop.frames import Frames, RunResult, Status
from runner.viewer.rrd import written

REMOTE = "remote"
NOTHING: Mapping[str, Any] = MappingProxyType({})


class RrdDetail(Enum):
    """How much of a run the `.rrd` holds."""

    full = "full"  # every frame
    every_n = "every_n"  # every n-th frame
    off = "off"


class FrameKind(Enum):
    """Which frames are written."""

    updates = "updates"  # one for every update
    steps = "steps"  # one for every update, and one for every physics step
    off = "off"


class RrdFiles(Enum):
    """How the runs of a sweep share `.rrd` files."""

    each = "each"  # one in the folder of each run
    one = "one"  # one for the sweep, with a recording for each run


@dataclass(frozen=True)
class LogConfig:
    """What is written.

    `frames` is the kind of frames that are kept, in `frames.parquet` (updates) and `steps.parquet`, and shown in the
    `.rrd`. `rrd` says how many of them the `.rrd` shows, `every_n` which with `rrd=every_n`. `rrd_files` is for sweeps.
    """

    rrd: RrdDetail = RrdDetail.full
    every_n: int = 8
    frames: FrameKind = FrameKind.updates
    rrd_files: RrdFiles = RrdFiles.each

    def __post_init__(self) -> None:
        check_range("every_n", self.every_n, 1, 1_000_000)

    def sinks(self, *, sweep: bool = False) -> list[AbstractSink]:
        """Return the sinks that this asks for; `sweep`: for a run that is part of one."""
        steps = self.frames is FrameKind.steps
        out: list[AbstractSink] = []
        if self.frames is not FrameKind.off:
            out.append(ParquetSink(steps=steps))
        if self.rrd is not RrdDetail.off:
            every = 1 if self.rrd is RrdDetail.full else self.every_n
            part = sweep and self.rrd_files is RrdFiles.one
            out.append(RrdSink(every=every, steps=steps, name=RrdSink.PART if part else RrdSink.FILE))
        return out


class AbstractSink(ABC):
    """Writes a finished run into a folder."""

    @abstractmethod
    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        """Write the run.

        Args:
            result: The run.
            folder: Where to.
            config: The resolved config as plain containers.
            overrides: What of it was set for this run.
        """


@dataclass(frozen=True)
class ParquetSink(AbstractSink):
    """`frames.parquet` with every update, and if asked for `steps.parquet` with every physics step; full precision."""

    FRAMES: ClassVar[str] = "frames.parquet"
    STEPS: ClassVar[str] = "steps.parquet"
    steps: bool = False

    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        _write_frames(result.updates, folder / self.FRAMES)
        if self.steps:
            _write_frames(result.steps, folder / self.STEPS)


def _write_frames(frames: Frames, path: Path) -> None:
    fields = [pa.field(name, pa.from_numpy_dtype(c.dtype), nullable=False) for name, c in frames.columns.items()]
    table = pa.Table.from_arrays([pa.array(c) for c in frames.columns.values()], schema=pa.schema(fields))
    # plain pages: dictionaries and statistics of measured numbers cost more time than they save space
    with replacing(path) as part:
        pq.write_table(table, part, compression="lz4", use_dictionary=False, write_statistics=False)


REMOTE_COLOUR = (70, 130, 220)
LOCAL_COLOURS = ((240, 140, 40), (60, 190, 130), (200, 90, 200), (220, 200, 60))
FORCE_COLOUR = (230, 60, 60)
TRAIL_COLOUR = (250, 225, 110)
ARROW_M_PER_N = 0.05
TRAIL = "world/trail"


@dataclass(frozen=True)
class RrdSink(AbstractSink):
    """`run.rrd` for the Rerun viewer, with its layout inside; sent as whole columns.

    `every` is the number of frames from one that is shown to the next. `steps` shows the physics steps; otherwise the
    updates are shown. Estimates and errors, which change at updates only, are shown at every update.
    """

    FILE: ClassVar[str] = "run.rrd"
    PART: ClassVar[str] = "part.rrd"  # of the file of a whole sweep, see `combine`
    every: int = 1
    steps: bool = False
    name: str = FILE

    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        with written(folder / self.name, _Layout(_layout_key(result))) as recording:
            title = " ".join([folder.name, *(f"{key}={value}" for key, value in overrides.items())])
            self.log(recording, result, config, name=title)
            if overrides:
                typed = dict(_leaves(config))  # a property must have one type in all recordings
                recording.send_property("overrides", [_value(k, typed.get(k, str(v))) for k, v in overrides.items()])

    def log(self, recording: rr.RecordingStream, result: RunResult, config: Mapping[str, Any], name: str) -> None:
        """Send a run into an open recording."""
        recording.send_recording_name(name)
        recording.send_property("config", [_value(key, value) for key, value in _leaves(config)])
        recording.send_property("result", rr.AnyValues(**_outcome(result)))
        recording.log("summary", rr.TextDocument(_summary(result), media_type="text/markdown"), static=True)
        recording.send_chunks(_look(result.estimators, tuple(_parameters(result)), result.half_size_m))
        if result.update_count:
            shown = result.steps if self.steps else result.updates
            _send_motion(recording, result, _thin(shown, self.every))
            _send_trail(recording, result)
            _send_estimates(recording, result)
            _send_com(recording, result)


def combine(parts: Sequence[Path], out: Path) -> None:
    """Make one `.rrd` of several, in which each stays a recording of its own, with the layout of the last.

    Raises:
        ResultError: If Rerun can't.
    """
    with replacing(out) as made:
        command = [sys.executable, "-m", "rerun", "rrd", "merge", *map(str, parts), "-o", str(made)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ResultError(f"log.rrd_files: Rerun can't make '{out}': {done.stderr.strip().splitlines()[-1]}")


def _thin(frames: Frames, every: int) -> Frames:
    return frames if every == 1 else Frames({name: column[::every] for name, column in frames.columns.items()})


def _leaves(config: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a nested config as `section.key`, as what Rerun can hold."""
    if isinstance(config, Mapping):
        for key, value in config.items():
            yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))
    else:
        yield prefix, config if isinstance(config, bool | int | float | str) else str(config)


@functools.lru_cache(maxsize=10_000, typed=True)
def _value(key: str, value: Any) -> rr.DescribedComponentBatch:
    """Return one value of a config; most are the same from run to run."""
    return rr.AnyValues(**{key: value}).as_component_batches()[0]


def _outcome(result: RunResult) -> dict[str, Any]:
    out: dict[str, Any] = {"status": result.status.value, "reason": result.reason}
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            out[f"{name}.{parameter}.true"] = truth.true
            out[f"{name}.{parameter}.start"] = truth.start
            if result.update_count:
                out[f"{name}.{parameter}.final"] = float(result.updates.column(f"{name}_{parameter}")[-1])
    return out


def _local_colour(place: int) -> tuple[int, int, int]:
    return LOCAL_COLOURS[place % len(LOCAL_COLOURS)]


@functools.cache
def _look(
    estimators: tuple[str, ...], parameters: tuple[str, ...], half_size_m: tuple[float, float, float]
) -> list[rr.chunk.Chunk]:
    """Return what does not change in a recording, nor from run to run: shapes, colours, names."""
    half = np.array(half_size_m)
    colours = [_local_colour(i) for i in range(len(estimators))]
    turning = [REMOTE_COLOUR, *colours]
    along = [c for colour in turning for c in (colour, tuple(v // 2 for v in colour))]
    # the mark on top shows the heading; the local cubes are frames around the remote, which they hardly leave
    cubes = {
        REMOTE: rr.Boxes3D(
            half_sizes=[half, (0.12 * half[0], 0.3 * half[1], 0.01 * half[2])],
            centers=[(0, 0, 0), (0.75 * half[0], 0, half[2])],
            colors=[REMOTE_COLOUR, (255, 255, 255)],
            fill_mode="solid",
        )
    } | {
        name: rr.Boxes3D(
            half_sizes=[(1.02 + 0.01 * i) * half], colors=[colours[i]], fill_mode="majorwireframe", radii=0.008
        )
        for i, name in enumerate(estimators)
    }
    names = [REMOTE, *estimators]
    lines = {
        "velocity/linear": rr.SeriesLines(names=[f"{n} {a}" for n in names for a in ("vx", "vy")], colors=along),
        "velocity/turning": rr.SeriesLines(names=[f"{n} wz" for n in names], colors=turning),
        "force": rr.SeriesLines(names=["Fx", "Fy"], colors=[FORCE_COLOUR, (240, 170, 90)]),
    }
    for parameter in parameters:
        lines[f"estimate/{parameter}"] = rr.SeriesLines(names=["true", *estimators], colors=turning)
        lines[f"error/{parameter}"] = rr.SeriesLines(names=list(estimators), colors=colours)
    entities: dict[str, rr.AsComponents] = {
        "world": rr.ViewCoordinates.RIGHT_HAND_Z_UP,
        TRAIL: rr.LineStrips3D.from_fields(colors=TRAIL_COLOUR, radii=0.012),
        "world/force": rr.Arrows3D.from_fields(colors=FORCE_COLOUR, radii=0.03),
    }
    entities |= {f"world/{name}": box for name, box in cubes.items()} | lines
    return [_static(entity, archetype) for entity, archetype in entities.items()]


def _static(entity: str, archetype: rr.AsComponents) -> rr.chunk.Chunk:
    batches = archetype.as_component_batches()
    columns = [rr.ComponentColumn(b.component_descriptor(), b) for b in batches]
    return rr.chunk.Chunk.from_columns(
        entity, [], [c.partition([len(c.component_batch.as_arrow_array())]) for c in columns]
    )


def _parameters(result: RunResult) -> list[str]:
    return list(dict.fromkeys(p for parameters in result.parameters.values() for p in parameters))


def _index(frames: Frames) -> list[rr.TimeColumn]:
    time_ns = np.round(1e9 * frames.column("time_s")).astype("timedelta64[ns]")
    return [rr.TimeColumn("sim_time", duration=time_ns), rr.TimeColumn("frame", sequence=frames.column("frame"))]


def _send_motion(recording: rr.RecordingStream, result: RunResult, frames: Frames) -> None:
    index, names = _index(frames), (REMOTE, *result.estimators)
    pose = {name: _pose(frames, name, result.half_size_m[2]) for name in names}
    for name, (position, quaternion) in pose.items():
        columns = rr.Transform3D.columns(translation=position, quaternion=quaternion)
        recording.send_columns(f"world/{name}", index, columns)
    _send_scalars(
        recording, "velocity/linear", index, [frames.column(f"{n}_{a}_m_s") for n in names for a in ("vx", "vy")]
    )
    _send_scalars(recording, "velocity/turning", index, [frames.column(f"{n}_wz_rad_s") for n in names])
    force = np.column_stack([frames.column(f"force_{axis}_n") for axis in "xyz"])
    _send_scalars(recording, "force", index, [force[:, 0], force[:, 1]])
    # the arrow's tip is at the point of application, lifted on top of the cube so that it is seen
    position, quaternion = pose[REMOTE]
    point = np.column_stack([frames.column(f"point_{axis}_m") for axis in "xyz"])
    tip = position + rotate(quaternion[:, [3, 0, 1, 2]], point)
    tip[:, 2] = position[:, 2] + 1.1 * result.half_size_m[2]
    vector = ARROW_M_PER_N * force
    recording.send_columns("world/force", index, rr.Arrows3D.columns(origins=tip - vector, vectors=vector))


def _send_trail(recording: rr.RecordingStream, result: RunResult) -> None:
    """Send the way of the remote's top, as one short line per tick of at least 1 / 15 s."""
    period_s = result.updates.column("time_s")[0]
    frames = _thin(result.updates, max(1, round(1 / 15 / period_s)))
    top, _ = _pose(frames, REMOTE, result.half_size_m[2])
    top = np.column_stack([top[:, :2], top[:, 2] + 1.03 * result.half_size_m[2]]).astype(np.float32)
    ends = np.stack([np.vstack([top[:1], top[:-1]]), top], axis=1)
    # as Arrow: the conversion of lists takes longer than all else
    kind: Any = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    points = pa.FixedSizeListArray.from_arrays(pa.array(ends.ravel()), type=kind.value_type)
    strips = pa.ListArray.from_arrays(pa.array(np.arange(0, 2 * len(top) + 1, 2, dtype=np.int32)), points, type=kind)
    recording.send_columns(TRAIL, _index(frames), rr.LineStrips3D.columns(strips=strips))


def _send_estimates(recording: rr.RecordingStream, result: RunResult) -> None:
    updates = result.updates
    index = _index(updates)
    for parameter in _parameters(result):
        owners = [name for name in result.estimators if parameter in result.parameters[name]]
        truth = result.parameters[owners[0]][parameter]
        values = [updates.column(f"{name}_{parameter}") for name in owners]
        _send_scalars(recording, f"estimate/{parameter}", index, [np.full(len(updates), truth.true), *values])
        # the viewer has no logarithmic axis; an exact estimate is drawn at the resolution of the numbers
        errors = [np.log10(np.maximum(np.abs(truth.error(v)), 1e-16)) for v in values]
        _send_scalars(recording, f"error/{parameter}", index, errors)


ROUND = np.linspace(0.0, 2 * np.pi, 33)
HOLDS_95 = 2.4477  # standard deviations of two numbers together


def _send_com(recording: rr.RecordingStream, result: RunResult) -> None:
    """Draw the CoM on top of the cubes: the true one, every estimate, and its 95 % ellipse where there is one."""
    updates, top = result.updates, 1.02 * result.half_size_m[2]
    index = _index(updates)
    for i, name in enumerate(result.estimators):
        known = result.parameters[name]
        if not {"com_x_m", "com_y_m"} <= known.keys():
            continue
        true = (known["com_x_m"].true, known["com_y_m"].true, top)
        recording.log(f"world/{REMOTE}/com", rr.Points3D([true], colors=(255, 255, 255), radii=0.015), static=True)
        told = np.column_stack([updates.column(f"{name}_com_{a}_m") for a in "xy"])
        place = np.column_stack([told, np.full(len(told), top)])
        entity, colour = f"world/{name}/com", _local_colour(i)
        recording.log(entity, rr.Points3D.from_fields(colors=colour, radii=0.012), static=True)
        recording.send_columns(entity, index, rr.Points3D.columns(positions=place).partition(np.ones(len(place), int)))
        if f"{name}_com_xy_covariance_m2" not in updates.columns:
            continue
        sx, sy = (updates.column(f"{name}_com_{a}_sd_m") for a in "xy")
        xy = updates.column(f"{name}_com_xy_covariance_m2")
        # Cholesky's root of the covariance takes a circle to the ellipse
        across = xy / np.maximum(sx, 1e-300)
        rest = np.sqrt(np.maximum(sy**2 - across**2, 0.0))
        c, s = HOLDS_95 * np.cos(ROUND), HOLDS_95 * np.sin(ROUND)
        rim = np.stack([told[:, :1] + np.outer(sx, c), told[:, 1:] + np.outer(across, c) + np.outer(rest, s)], axis=-1)
        rim = np.concatenate([rim, np.full((*rim.shape[:2], 1), top)], axis=-1)
        recording.log(f"{entity}/ellipse", rr.LineStrips3D.from_fields(colors=colour, radii=0.004), static=True)
        strips = rr.LineStrips3D.columns(strips=list(rim)).partition(np.ones(len(rim), int))
        recording.send_columns(f"{entity}/ellipse", index, strips)


def _send_scalars(
    recording: rr.RecordingStream, entity: str, index: list[rr.TimeColumn], columns: list[np.ndarray]
) -> None:
    values = np.column_stack(columns)
    scalars = rr.Scalars.columns(scalars=values.ravel())
    recording.send_columns(entity, index, scalars.partition(np.full(len(values), len(columns))))


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
        "## Run" if ok else f"## {result.status.value}: {result.reason}",
        "",
        f"{result.step_count} physics steps of {1e3 * result.timestep_s:.4g} ms, {result.update_count} updates.",
        "",
        "| estimator | parameter | true | start | final | relative error |",
        "|---|---|---|---|---|---|",
    ]
    for name, parameters in result.parameters.items():
        for parameter, truth in parameters.items():
            last = float(result.updates.column(f"{name}_{parameter}")[-1]) if result.update_count else math.nan
            error = truth.error(last)
            lines.append(f"| {name} | {parameter} | {truth.true:g} | {truth.start:g} | {last:.9g} | {error:+.1e} |")
    lines += [
        "",
        "Solid: remote cube. Frame: local cube. Arrow: the push, drawn on top. Yellow line: the way of the remote.",
    ]
    return "\n".join(lines)


Point = tuple[float, float, float]
LayoutKey = tuple[tuple[str, ...], Point, float]  # parameters, middle of the way, how far from there to look


def _layout_key(result: RunResult) -> LayoutKey:
    """Return what the layout depends on, rounded so that runs share it."""
    place = np.zeros((1, 2))
    if result.update_count:
        place = np.column_stack([result.updates.column(f"{REMOTE}_{a}_m") for a in "xy"])
    x, y = np.round(2 * (place.min(axis=0) + place.max(axis=0)) / 2) / 2
    reach = float(np.ptp(place, axis=0).max()) / 2 + 2.0 * max(result.half_size_m)
    middle = (float(x), float(y), 0.5 * result.half_size_m[2])
    return tuple(_parameters(result)), middle, math.ceil(4 * reach) / 4


class _Layout(rrb.Blueprint):
    """A blueprint, made once for each key: `save` logs it as it would log one that is built anew, only sooner."""

    def __init__(self, key: LayoutKey) -> None:
        self._chunks = _layout_chunks(key)

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        stream.send_chunks(self._chunks)


@functools.cache
def _layout_chunks(key: LayoutKey) -> list[rr.chunk.Chunk]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "layout.rrd"
        with written(path, _blueprint(*key)):
            pass
        reader = rr.chunk.RrdReader(path)
        return list(reader.stream(store=reader.blueprints()[0]))


def _blueprint(parameters: tuple[str, ...], middle: Point, reach: float) -> rrb.Blueprint:
    everything = [
        rrb.VisibleTimeRange(t, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative())
        for t in ("sim_time", "frame")
    ]
    eye = np.array(middle) + reach * np.array([0.8, -1.3, 1.4])
    scene = rrb.Spatial3DView(
        origin="/world",
        name="cubes",
        overrides={f"/{TRAIL}": rrb.VisibleTimeRanges(everything)},
        background=[24, 26, 30],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[110, 115, 125, 120]),
        eye_controls=rrb.EyeControls3D(position=tuple(eye), look_target=middle, eye_up=(0, 0, 1)),
    )
    legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
    estimates, errors = [], []
    for parameter in parameters:
        stem, _, unit = parameter.rpartition("_")
        estimates.append(
            rrb.TimeSeriesView(origin=f"/estimate/{parameter}", name=f"{stem} [{unit}]", plot_legend=legend)
        )
        errors.append(
            rrb.TimeSeriesView(
                origin=f"/error/{parameter}", name=f"log10 of the relative error of the {stem}", plot_legend=legend
            )
        )
    motion = [
        rrb.TimeSeriesView(origin="/velocity/linear", name="velocity [m/s]", plot_legend=legend),
        rrb.TimeSeriesView(origin="/velocity/turning", name="yaw rate [rad/s]", plot_legend=legend),
    ]
    if len(parameters) > 2:  # too many to be read side by side
        plots = rrb.Tabs(
            rrb.Vertical(*estimates, name="estimates"),
            rrb.Vertical(*errors, name="errors"),
            rrb.Vertical(*motion, name="motion"),
        )
    else:
        plots = rrb.Vertical(*(view for pair in zip(estimates, errors, strict=True) for view in pair), *motion)
    summary = rrb.TextDocumentView(origin="/summary", name="summary")
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(scene, summary, row_shares=[3, 1]), plots, column_shares=[1, 1]),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
