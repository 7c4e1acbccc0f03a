"""What does not change in a recording for the Rerun viewer: shapes, colours, names, and the layout of the views."""

from __future__ import annotations

import functools
import math
import tempfile
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from runner.teleop.experiment import REMOTE
from runner.teleop.frames import RunResult
from runner.viewer.rrd import written

REMOTE_COLOUR = (70, 130, 220)
LOCAL_COLOURS = ((240, 140, 40), (60, 190, 130), (235, 205, 225), (220, 200, 60))
REMOTE_WIDTH, LOCAL_WIDTH = 5.0, 1.6
FORCE_COLOUR = (230, 60, 60)
TRAIL_COLOUR = (250, 225, 110)
TRAIL = "world/trail"


def parameters_of(result: RunResult) -> list[str]:
    return list(dict.fromkeys(p for parameters in result.parameters.values() for p in parameters))


def local_colour(place: int) -> tuple[int, int, int]:
    return LOCAL_COLOURS[place % len(LOCAL_COLOURS)]


@functools.cache
def static_look(
    estimators: tuple[str, ...], parameters: tuple[str, ...], half_size_m: tuple[float, float, float]
) -> list[rr.chunk.Chunk]:
    """Return what does not change in a recording, nor from run to run: shapes, colours, names."""
    half = np.array(half_size_m)
    colours = [local_colour(i) for i in range(len(estimators))]
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
    # the remote's curves are broad, so that they are seen below those of the local cubes, which hardly leave them
    widths = [REMOTE_WIDTH, *[LOCAL_WIDTH] * len(estimators)]
    lines = {
        "velocity/linear": rr.SeriesLines(
            names=[f"{n} {a}" for n in names for a in ("vx", "vy")], colors=along, widths=np.repeat(widths, 2)
        ),
        "velocity/turning": rr.SeriesLines(names=[f"{n} wz" for n in names], colors=turning, widths=widths),
        "force": rr.SeriesLines(names=["Fx", "Fy"], colors=[FORCE_COLOUR, (240, 170, 90)]),
    }
    for parameter in parameters:
        lines[f"estimate/{parameter}"] = rr.SeriesLines(names=["true", *estimators], colors=turning, widths=widths)
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


Point = tuple[float, float, float]
Range = tuple[float, float] | None  # of a plot; None: the viewer's own
# parameters, their ranges, middle of the way, how far from there to look
LayoutKey = tuple[tuple[str, ...], tuple[Range, ...], Point, float]
MOST = 95.0  # percentile of the distances of estimates from the truth that a plot reaches to


def layout_key(result: RunResult) -> LayoutKey:
    """Return what the layout depends on, rounded so that runs share it."""
    place = np.zeros((1, 2))
    if result.update_count:
        place = np.column_stack([result.updates.column(f"{REMOTE}_{a}_m") for a in "xy"])
    x, y = np.round(2 * (place.min(axis=0) + place.max(axis=0)) / 2) / 2
    reach = float(np.ptp(place, axis=0).max()) / 2 + 2.0 * max(result.half_size_m)
    middle = (float(x), float(y), 0.5 * result.half_size_m[2])
    parameters = tuple(parameters_of(result))
    return parameters, tuple(_range(result, p) for p in parameters), middle, math.ceil(4 * reach) / 4


def _range(result: RunResult, parameter: str) -> Range:
    """Return what a plot of estimates shows: the truth and the start, and no spike that would flatten the rest."""
    owners = [n for n in result.estimators if parameter in result.parameters[n]]
    truth = result.parameters[owners[0]][parameter]
    told = np.concatenate([result.updates.column(f"{n}_{parameter}") for n in owners]) if result.update_count else []
    off = np.abs(np.append(told, truth.start) - truth.true)
    off = off[np.isfinite(off)]
    reach = max(abs(truth.start - truth.true), float(np.percentile(off, MOST)) if len(off) else 0.0)
    if not 0.0 < reach < math.inf or len(off) == 0 or reach >= off.max():
        return None
    reach = float(f"{1.15 * reach:.1e}")  # rounded, so that runs share a layout
    return truth.true - reach, truth.true + reach


class Layout(rrb.Blueprint):
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


def _blueprint(parameters: tuple[str, ...], ranges: tuple[Range, ...], middle: Point, reach: float) -> rrb.Blueprint:
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
    for parameter, span in zip(parameters, ranges, strict=True):
        stem, _, unit = parameter.rpartition("_")
        estimates.append(
            rrb.TimeSeriesView(
                origin=f"/estimate/{parameter}",
                name=f"{stem} [{unit}]",
                plot_legend=legend,
                axis_y=None if span is None else rrb.ScalarAxis(range=span),
            )
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
