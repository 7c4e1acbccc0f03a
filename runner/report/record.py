"""`diagnosis.rrd`: measured, nominal and corrected body together, the missing wrench, residuals in noise units.

All episodes lie on one timeline, one after another, those kept from the fit first: they are what the verdict is judged
by. Sent as whole columns; the layout is inside the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from runner.noise.measured import CHANNELS
from runner.report import words
from runner.report.motions import Paths, replay
from runner.report.wrench import missing_wrench
from runner.viewer.rrd import written

if TYPE_CHECKING:
    from runner.diagnosis.pipeline import Diagnosis

FILE = "diagnosis.rrd"
PAUSE_S = 1.0  # between two episodes on the timeline
TRAIL_S = 4.0  # how much of the way is seen behind each body
MEASURED, NOMINAL, CORRECTED = (25, 27, 30), (130, 135, 142), (213, 94, 0)
WRENCH, COMMAND = (0, 114, 178), (0, 158, 115)
PAPER, INK = (247, 247, 245), (60, 62, 66)
REACH_OF_ARROW = 1.2  # of the body's mean half size: how long the arrow of a typical large force is
BODIES = {"measured": MEASURED, "nominal": NOMINAL, "corrected": CORRECTED}


def write_rrd(diagnosis: Diagnosis, path: str | Path) -> Path:
    """Write the log of a diagnosis for the Rerun viewer.

    Args:
        diagnosis: What was found.
        path: The file; a folder: `diagnosis.rrd` in it.

    Returns:
        The file.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    path.parent.mkdir(parents=True, exist_ok=True)
    paths = sorted(replay(diagnosis), key=lambda p: (not p.held_out, p.episode))
    with written(path, _blueprint(diagnosis, paths), "runner diagnosis") as log:
        log.send_recording_name(diagnosis.case)
        log.send_property("verdict", rr.AnyValues(sentence=words.verdict(diagnosis), gap_closed=diagnosis.gap_closed))
        log.log("verdict", rr.TextDocument(_text(diagnosis), media_type="text/markdown"), static=True)
        _send_look(log, diagnosis)
        if paths:
            _send_motion(log, diagnosis, paths)
            _send_residuals(log, diagnosis, paths)
            _send_forces(log, diagnosis, paths)
    return path


def _bodies(diagnosis: Diagnosis) -> list[str]:
    return [b for b in BODIES if b != "corrected" or diagnosis.effects]


def _begins(paths: list[Paths]) -> np.ndarray:
    """When each episode begins on the common timeline, s."""
    lengths = [float(p.t_s[-1]) + PAUSE_S for p in paths]
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


def _index(t_s: np.ndarray) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("sim_time", duration=np.round(1e9 * t_s).astype("timedelta64[ns]"))]


def _joined(paths: list[Paths]) -> np.ndarray:
    return np.concatenate([begin + p.t_s for begin, p in zip(_begins(paths), paths, strict=True)])


def _send_look(log: rr.RecordingStream, diagnosis: Diagnosis) -> None:
    half = np.array(diagnosis.recording.nominal.half_size_m)
    log.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for i, body in enumerate(_bodies(diagnosis)):
        solid = body == "measured"
        # the mark on top shows the heading
        sizes = [half * (1 + 0.012 * i), (0.12 * half[0], 0.3 * half[1], 0.01 * half[2])]
        centres = [(0, 0, 0), (0.75 * half[0], 0, half[2] * (1 + 0.012 * i))]
        colours = [BODIES[body], (240, 240, 240) if solid else BODIES[body]]
        box = rr.Boxes3D(
            half_sizes=sizes,
            centers=centres,
            colors=colours,
            fill_mode="solid" if solid else "majorwireframe",
            radii=0.016 * float(half.mean()),
        )
        log.log(f"world/{body}", box, static=True)
        trail = rr.LineStrips3D.from_fields(colors=BODIES[body], radii=0.02 * float(half.mean()))
        log.log(f"world/trail/{body}", trail, static=True)
    arrow = 0.05 * float(half.mean())
    log.log("world/command", rr.Arrows3D.from_fields(colors=COMMAND, radii=arrow), static=True)
    log.log("world/missing_force", rr.Arrows3D.from_fields(colors=WRENCH, radii=arrow), static=True)
    pair = [NOMINAL, CORRECTED] if diagnosis.effects else [NOMINAL]
    names = ["nominal", "corrected"] if diagnosis.effects else ["nominal"]
    for channel in CHANNELS:
        lines = rr.SeriesLines(
            colors=[*pair, INK, INK], names=[*names, "+2 noise", "−2 noise"], widths=[1.6] * len(pair) + [0.6] * 2
        )
        log.log(f"residual/{channel}", lines, static=True)
    log.log("wrench/force", rr.SeriesLines(colors=[WRENCH, (86, 180, 233)], names=["x", "y"]), static=True)
    log.log("wrench/moment", rr.SeriesLines(colors=[WRENCH], names=["about z"]), static=True)


def _send_motion(log: rr.RecordingStream, diagnosis: Diagnosis, paths: list[Paths]) -> None:
    time_s = _joined(paths)
    height = diagnosis.recording.nominal.half_size_m[2]
    for body in _bodies(diagnosis):
        motion = np.concatenate([_whole(getattr(p, body)) for p in paths])
        half_yaw = motion[:, 2] / 2
        quaternion = np.column_stack([np.zeros((len(motion), 2)), np.sin(half_yaw), np.cos(half_yaw)])
        place = np.column_stack([motion[:, :2], np.full(len(motion), height)])
        log.send_columns(
            f"world/{body}", _index(time_s), rr.Transform3D.columns(translation=place, quaternion=quaternion)
        )
        _send_trail(log, body, paths, 1.02 * 2 * height)
    recorded = diagnosis.recording.episodes
    texts = [
        f"### Episode {recorded[p.episode].index}\n"
        + ("kept from the fit: it judges the answer" if p.held_out else "used for the fit")
        for p in paths
    ]
    log.send_columns(
        "episode",
        _index(_begins(paths)),
        rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts)),
    )


def _send_trail(log: rr.RecordingStream, body: str, paths: list[Paths], height_m: float) -> None:
    """Send the way of a body's top, as one short line per tick of about 1 / 15 s; none joins two episodes."""
    times, strips = [], []
    for begin, path in zip(_begins(paths), paths, strict=True):
        every = max(1, round(1 / 15 / float(path.t_s[1] - path.t_s[0])))
        place = _whole(getattr(path, body))[::every, :2]
        top = np.column_stack([place, np.full(len(place), height_m)])
        times.append(begin + path.t_s[::every])
        strips.append(np.stack([np.vstack([top[:1], top[:-1]]), top], axis=1))
    lines = rr.LineStrips3D.columns(strips=np.concatenate(strips).tolist())
    log.send_columns(f"world/trail/{body}", _index(np.concatenate(times)), lines)


def _whole(motion: np.ndarray) -> np.ndarray:
    """Fill what was not measured in between: a body has to be somewhere."""
    out = np.array(motion)
    at = np.arange(len(out))
    for column in out.T:
        known = np.isfinite(column)
        if known.any() and not known.all():
            column[~known] = np.interp(at[~known], at[known], column[known])
    return out


def _send_scalars(log: rr.RecordingStream, entity: str, time_s: np.ndarray, values: np.ndarray) -> None:
    scalars = rr.Scalars.columns(scalars=values.ravel())
    log.send_columns(entity, _index(time_s), scalars.partition(np.full(len(values), values.shape[1])))


def _send_residuals(log: rr.RecordingStream, diagnosis: Diagnosis, paths: list[Paths]) -> None:
    time_s = _joined(paths)
    which = [b for b in _bodies(diagnosis) if b != "measured"]
    for i, channel in enumerate(CHANNELS):
        columns = [
            np.concatenate([(getattr(p, b) - p.measured)[:, i] for p in paths]) / diagnosis.measured.sigma[i]
            for b in which
        ]
        n = len(time_s)
        _send_scalars(
            log, f"residual/{channel}", time_s, np.column_stack([*columns, np.full(n, 2.0), np.full(n, -2.0)])
        )


def _send_forces(log: rr.RecordingStream, diagnosis: Diagnosis, paths: list[Paths]) -> None:
    nominal = diagnosis.recording.nominal
    reach = REACH_OF_ARROW * float(np.mean(nominal.half_size_m))
    top = 2.1 * nominal.half_size_m[2]
    episodes = [diagnosis.recording.episodes[p.episode] for p in paths]
    command = np.concatenate([np.nan_to_num(e.force_n[:, :2]) for e in episodes])
    point = np.concatenate([np.nan_to_num(e.point_m[:, :2]) for e in episodes])
    motion = np.concatenate([_whole(p.measured) for p in paths])
    time_s = _joined(paths)
    c, s = np.cos(motion[:, 2]), np.sin(motion[:, 2])
    tip = motion[:, :2] + np.column_stack([c * point[:, 0] - s * point[:, 1], s * point[:, 0] + c * point[:, 1]])
    scale = reach / max(float(np.percentile(np.linalg.norm(command, axis=1), 98)), 1e-9)
    _send_arrows(log, "world/command", time_s, tip - scale * command, scale * command, top)
    found = [missing_wrench(diagnosis, diagnosis.where, p.episode) for p in paths]
    parts = [(b + w.t_s, w, p) for b, w, p in zip(_begins(paths), found, paths, strict=True) if w is not None]
    if not parts:
        return
    time_s = np.concatenate([t for t, _, _ in parts])
    force = np.concatenate([w.force_n for _, w, _ in parts])
    where = np.concatenate(
        [np.column_stack([np.interp(w.t_s, p.t_s, _whole(p.measured)[:, k]) for k in (0, 1)]) for _, w, p in parts]
    )
    moment = np.concatenate([w.moment_nm for _, w, _ in parts])
    # where friction holds the body no force can be seen: no arrow there
    seen = np.concatenate([w.seen for _, w, _ in parts])
    if not seen.any():
        return
    scale = reach / max(float(np.percentile(np.linalg.norm(force[seen], axis=1), 98)), 1e-9)
    _send_arrows(log, "world/missing_force", time_s, where, scale * np.where(seen[:, None], force, 0.0), top)
    _send_scalars(log, "wrench/force", time_s[seen], force[seen])
    _send_scalars(log, "wrench/moment", time_s[seen], moment[seen, None])


def _send_arrows(
    log: rr.RecordingStream, entity: str, time_s: np.ndarray, origin: np.ndarray, vector: np.ndarray, height_m: float
) -> None:
    n = len(origin)
    origins, vectors = np.column_stack([origin, np.full(n, height_m)]), np.column_stack([vector, np.zeros(n)])
    log.send_columns(entity, _index(time_s), rr.Arrows3D.columns(origins=origins, vectors=vectors))


def _text(diagnosis: Diagnosis) -> str:
    lines = [f"## {words.verdict(diagnosis)}", ""]
    if confounded := words.confounded(diagnosis):
        lines += [confounded, ""]
    corrected = ", orange: corrected" if diagnosis.effects else ""
    lines += [
        f"Black: measured, grey: the simulator as believed{corrected}. Green arrow: the commanded push, its tip where "
        "it acts. Blue arrow: the force that the simulator as believed lacks. The arrows are drawn on top of the "
        "object, each kind to a scale of its own.",
        "",
        "| explanation | probability |",
        "|---|---|",
    ]
    lines += [
        f"| {words.title(r.effects or (words.NONE,))} | {words.probability(r.probability)} |"
        for r in words.ordered(diagnosis)[:5]
    ]
    return "\n".join(lines)


def _blueprint(diagnosis: Diagnosis, paths: list[Paths]) -> rrb.Blueprint:
    half = max(diagnosis.recording.nominal.half_size_m)
    places = np.concatenate([p.measured[:, :2] for p in paths]) if paths else np.zeros((1, 2))
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    reach = float(np.max(high - low)) / 2 + 2.0 * half
    middle = (*((low + high) / 2).tolist(), half)
    eye = np.array(middle) + 0.8 * reach * np.array([0.6, -1.2, 1.3])
    paper = rrb.archetypes.PlotBackground(color=PAPER)
    recent = rrb.VisibleTimeRange(
        "sim_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    scene = rrb.Spatial3DView(
        origin="/world",
        overrides={f"/world/trail/{body}": rrb.VisibleTimeRanges([recent]) for body in BODIES},
        name="measured (black), as believed (grey), corrected (orange)",
        background=list(PAPER),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[120, 124, 130, 90]),
        eye_controls=rrb.EyeControls3D(position=tuple(eye), look_target=middle, eye_up=(0, 0, 1)),
    )
    plots = [
        rrb.TimeSeriesView(
            origin=f"/residual/{channel}",
            name=f"missed: {channel} [noise levels]",
            background=paper,
            plot_legend=rrb.PlotLegend(visible=i == 0, corner=rrb.Corner2D.RightTop),
        )
        for i, channel in enumerate(CHANNELS)
    ]
    wrench = [
        rrb.TimeSeriesView(origin="/wrench/force", name="missing force [N]", background=paper),
        rrb.TimeSeriesView(origin="/wrench/moment", name="missing moment [N m]", background=paper),
    ]
    texts = rrb.Horizontal(
        rrb.TextDocumentView(origin="/verdict", name="verdict"),
        rrb.TextDocumentView(origin="/episode", name="now"),
        column_shares=[3, 1],
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, texts, row_shares=[2, 1]),
            rrb.Vertical(rrb.Grid(*plots, grid_columns=2), rrb.Horizontal(*wrench), row_shares=[3, 1])
            if diagnosis.where is not None
            else rrb.Grid(*plots, grid_columns=2),
            column_shares=[1, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
