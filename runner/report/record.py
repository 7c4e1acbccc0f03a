"""`diagnosis.rrd`: measured, nominal and corrected motion together, the missing force, residuals in noise units.

All episodes lie on one timeline, one after another, those kept from the fit first: they are what the verdict is judged
by. Sent as whole columns; the layout is inside the file (`runner.report.record_layout`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from runner.effects.wording import probability
from runner.report import words
from runner.report.missing_force import missing_force
from runner.report.motions import Paths, replay, whole
from runner.report.record_layout import COLOURS, COMMAND, FORCE, INK, TRAIL_S, Eye, blueprint, drawn_channels, models
from runner.report.statement import NONE, state
from runner.systems.drawing import DrawnBody, Shape
from runner.viewer.rrd import written

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

FILE = "diagnosis.rrd"
PAUSE_S = 1.0  # between two episodes on the timeline
TICK_S = 1 / 15  # of a trail
REACH_OF_ARROW = 1.6  # of the bodies' size: how long the arrow of a typical large force is
ABOVE = 1.04  # trails and arrows of what is seen from above lie so far above it
NEAR, STANDING = 7.0, 2.2  # sizes of a body, or of all that stands somewhere: how far the eye is from it
UNDRAWN_M = 0.1  # the size that is taken where nothing is drawn, as of a wheel without shapes
SHOWN = 8  # explanations in the ranking
WORLD_FORCE = ("fx_n", "fy_n", "fz_n")  # a disturbance that has the first two is a force in world axes


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
    poses = _Poses(diagnosis, paths)
    with written(path, blueprint(diagnosis, poses.eye), "runner diagnosis") as log:
        log.send_recording_name(diagnosis.case)
        log.send_property("verdict", rr.AnyValues(sentence=words.verdict(diagnosis), gap_closed=diagnosis.gap_closed))
        _send_look(log, diagnosis, poses)
        arrows: list[str] = []
        if paths:
            _send_motion(log, diagnosis, paths, poses)
            _send_residuals(log, diagnosis, paths)
            arrows += _send_commands(log, diagnosis, paths, poses)
            arrows += _send_missing_force(log, diagnosis, paths, poses)
        for name, text in (("verdict", _verdict(diagnosis, arrows)), ("ranking", _ranking(diagnosis))):
            log.log(name, rr.TextDocument(text, media_type="text/markdown"), static=True)
    return path


class _Poses:
    """The poses of all bodies in each model, one array for each episode, and what they are drawn by.

    Attributes:
        of: By model and body, per episode (T, 7): x, y, z, qw, qx, qy, qz.
        traced: The body that moves most: it leaves the trail. None: nothing is drawn.
        eye: On what is seen from above it is near, and follows it; of what stands somewhere it sees all.
        size_m: Typical half extent of a body.
        lift_m: How far above a body's origin trails and arrows lie.
    """

    def __init__(self, diagnosis: Diagnosis, paths: Sequence[Paths]) -> None:
        system = diagnosis.system
        bodies = system.drawn()
        self.of: dict[tuple[str, str], list[np.ndarray]] = {}
        for model in models(diagnosis):
            for path in paths:
                for body, pose in system.poses(path.episode, whole(getattr(path, model))).items():
                    self.of.setdefault((model, body), []).append(pose)
        way = {b.name: sum(_length(p[:, :3]) for p in self.of.get(("measured", b.name), ())) for b in bodies}
        self.traced = max(way, key=lambda name: way[name], default=None)
        self.size_m = max((float(np.mean(s.size_m)) for b in bodies for s in b.shapes), default=UNDRAWN_M)
        places = [p[:, :3] for (model, _), each in self.of.items() if model == "measured" for p in each]
        self.eye = _eye(places, self.size_m, None if system.plan_view is None else self.traced)
        tops = [s.position_m[2] + _height(s) for b in bodies for s in b.shapes]
        self.lift_m = 0.0 if system.plan_view is None else ABOVE * max(tops, default=0.0)

    def joined(self, model: str, body: str) -> np.ndarray:
        """Return the poses of a body in all episodes, one after another, (T, 7)."""
        return np.concatenate(self.of[model, body])

    def lifted(self, positions: np.ndarray) -> np.ndarray:
        """Return positions (..., 3) where they are seen."""
        return positions + np.array([0.0, 0.0, self.lift_m])


def _eye(places: Sequence[np.ndarray], size_m: float, followed: str | None) -> Eye:
    """Return where to look, from where the bodies are at all times, (T, 3) each."""
    if not places:
        return Eye(np.zeros(3), NEAR * size_m, followed)
    if followed is not None:
        return Eye(places[0][0], NEAR * size_m, followed)
    low, high = (np.array([getattr(p, side)(axis=0) for p in places]) for side in ("min", "max"))
    low, high = low.min(axis=0), high.max(axis=0)
    return Eye((low + high) / 2, STANDING * (float(np.linalg.norm(high - low)) / 2 + size_m), None)


def _length(way: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def _height(shape: Shape) -> float:
    """Return the half extent of an upright shape along z; a sphere has one size alone, of others it is the last."""
    return shape.size_m[-1]


def _begins(paths: Sequence[Paths]) -> np.ndarray:
    """When each episode begins on the common timeline, s."""
    lengths = [float(p.t_s[-1]) + PAUSE_S for p in paths]
    return np.concatenate([[0.0], np.cumsum(lengths)[:-1]])


def _index(t_s: np.ndarray) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("sim_time", duration=np.round(1e9 * t_s).astype("timedelta64[ns]"))]


def _joined(paths: Sequence[Paths]) -> np.ndarray:
    return np.concatenate([begin + p.t_s for begin, p in zip(_begins(paths), paths, strict=True)])


def _send_look(log: rr.RecordingStream, diagnosis: Diagnosis, poses: _Poses) -> None:
    system = diagnosis.system
    log.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for rank, model in enumerate(models(diagnosis)):
        for body in system.drawn():
            for kind in dict.fromkeys(s.kind for s in body.shapes):
                shapes = _shapes(body, kind, model, grown=1 + 0.012 * rank, line_m=0.016 * poses.size_m)
                log.log(f"world/{model}/{body.name}/{kind}", shapes, static=True)
        trail = rr.LineStrips3D.from_fields(colors=COLOURS[model], radii=0.02 * poses.size_m)
        log.log(f"world/trail/{model}", trail, static=True)
    for name, colour in (("command", COMMAND), ("missing_force", FORCE[0])):
        log.log(f"world/{name}", rr.Arrows3D.from_fields(colors=colour, radii=0.05 * poses.size_m), static=True)
    names = [m for m in models(diagnosis) if m != "measured"]
    for channel in drawn_channels(system):
        lines = rr.SeriesLines(
            colors=[*(COLOURS[n] for n in names), INK, INK],
            names=[*names, "+2 noise", "−2 noise"],
            widths=[1.6] * len(names) + [0.6] * 2,
        )
        log.log(f"residual/{channel.name}", lines, static=True)
    for i, name in enumerate(system.disturbance.names):
        lines = rr.SeriesLines(colors=[FORCE[i % len(FORCE)]], names=["missing force"], widths=[2.0])
        log.log(f"missing_force/{name}", lines, static=True)


def _shapes(body: DrawnBody, kind: str, model: str, *, grown: float, line_m: float) -> rr.AsComponents:
    """Return the shapes of one kind of a body; what is simulated is a wireframe, a little larger than what is real."""
    of_kind = [s for s in body.shapes if s.kind == kind]
    solid = model == "measured"
    # a body's first shape has the colour of its model; others mark it, as the nose of a box
    light = (226, 229, 233)
    colours = [light if solid and s is not body.shapes[0] else COLOURS[model] for s in of_kind]
    fill = "solid" if solid else "majorwireframe"
    size = [grown * np.asarray(s.size_m) for s in of_kind]
    at = [tuple(s.position_m) for s in of_kind]
    turned = [rr.Quaternion(xyzw=[*s.quaternion_wxyz[1:], s.quaternion_wxyz[0]]) for s in of_kind]
    if kind == "box":
        return rr.Boxes3D(half_sizes=size, centers=at, quaternions=turned, colors=colours, fill_mode=fill, radii=line_m)
    if kind == "sphere":
        halves = [np.full(3, s[0]) for s in size]
        return rr.Ellipsoids3D(half_sizes=halves, centers=at, colors=colours, fill_mode=fill, line_radii=line_m)
    radii, lengths = [float(s[0]) for s in size], [2 * float(s[1]) for s in size]
    if kind == "cylinder":
        return rr.Cylinders3D(
            lengths=lengths, radii=radii, centers=at, quaternions=turned, colors=colours, fill_mode=fill,
            line_radii=line_m,
        )  # fmt: skip
    # Rerun's capsule begins at its origin, MuJoCo's is centred there
    ends = [np.asarray(s.position_m) - _turned(s.quaternion_wxyz, np.array([0, 0, s.size_m[1]])) for s in of_kind]
    return rr.Capsules3D(
        lengths=lengths, radii=radii, translations=ends, quaternions=turned, colors=colours, fill_mode=fill,
        line_radii=line_m,
    )  # fmt: skip


def _turned(quaternion_wxyz: Sequence[float], vector: np.ndarray) -> np.ndarray:
    """Return a vector (3,) turned by a unit quaternion."""
    w, axis = quaternion_wxyz[0], np.asarray(quaternion_wxyz[1:])
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


def _send_motion(log: rr.RecordingStream, diagnosis: Diagnosis, paths: Sequence[Paths], poses: _Poses) -> None:
    time_s = _joined(paths)
    for model in models(diagnosis):
        for body in diagnosis.system.drawn():
            pose = poses.joined(model, body.name)
            columns = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, [4, 5, 6, 3]])
            log.send_columns(f"world/{model}/{body.name}", _index(time_s), columns)
        _send_trail(log, model, paths, poses)
    recorded = diagnosis.recording.episodes
    texts = [
        f"### Episode {recorded[p.episode].index}\n"
        + ("kept from the fit: it judges the answer" if p.held_out else "used for the fit")
        for p in paths
    ]
    documents = rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts))
    log.send_columns("episode", _index(_begins(paths)), documents)


def _send_trail(log: rr.RecordingStream, model: str, paths: Sequence[Paths], poses: _Poses) -> None:
    """Send the way of the body that moves most, as one short line per tick; none joins two episodes."""
    if poses.traced is None:
        return
    times, strips = [], []
    for begin, path, pose in zip(_begins(paths), paths, poses.of[model, poses.traced], strict=True):
        every = max(1, round(TICK_S / float(path.t_s[1] - path.t_s[0])))
        place = poses.lifted(pose[::every, :3])
        times.append(begin + path.t_s[::every])
        strips.append(np.stack([np.vstack([place[:1], place[:-1]]), place], axis=1))
    lines = rr.LineStrips3D.columns(strips=np.concatenate(strips).tolist())
    log.send_columns(f"world/trail/{model}", _index(np.concatenate(times)), lines)


def _send_scalars(log: rr.RecordingStream, entity: str, time_s: np.ndarray, values: np.ndarray) -> None:
    scalars = rr.Scalars.columns(scalars=values.ravel())
    log.send_columns(entity, _index(time_s), scalars.partition(np.full(len(values), values.shape[1])))


def _send_residuals(log: rr.RecordingStream, diagnosis: Diagnosis, paths: Sequence[Paths]) -> None:
    time_s = _joined(paths)
    which = [m for m in models(diagnosis) if m != "measured"]
    band = np.tile([2.0, -2.0], (len(time_s), 1))
    for i, channel in enumerate(diagnosis.system.channels):
        if channel not in drawn_channels(diagnosis.system):
            continue
        columns = [
            np.concatenate([(getattr(p, m) - p.measured)[:, i] for p in paths]) / diagnosis.measured.sigma[i]
            for m in which
        ]
        _send_scalars(log, f"residual/{channel.name}", time_s, np.column_stack([*columns, band]))


def _send_commands(
    log: rr.RecordingStream, diagnosis: Diagnosis, paths: Sequence[Paths], poses: _Poses
) -> tuple[str, ...]:
    """Send what was commanded as arrows, their tips where it acts, if the system says so; return what that shows."""
    found = [diagnosis.system.command_arrows(p.episode, whole(p.measured)) for p in paths]
    known = [f for f in found if f is not None]
    if len(known) < len(paths):
        return ()
    tip, force = (np.concatenate([f[k] for f in known]) for k in (0, 1))
    arrows = force * _per_newton(force, poses)
    _send_arrows(log, "world/command", _joined(paths), poses.lifted(tip) - arrows, arrows)
    return ("Green arrow: a commanded force, its tip where it acts.",)


def _per_newton(force: np.ndarray, poses: _Poses) -> float:
    """Return how long an arrow is for each newton."""
    large = float(np.percentile(np.linalg.norm(force, axis=1), 98)) if len(force) else 0.0
    return REACH_OF_ARROW * poses.size_m / max(large, 1e-9)


def _send_missing_force(
    log: rr.RecordingStream, diagnosis: Diagnosis, paths: Sequence[Paths], poses: _Poses
) -> tuple[str, ...]:
    """Send the missing force over time, and as an arrow on the first body where it is a force in world axes.

    Returns what the arrow shows.
    """
    found = [missing_force(diagnosis, diagnosis.where, p.episode) for p in paths]
    parts = [
        (b, f, p, k) for k, (b, f, p) in enumerate(zip(_begins(paths), found, paths, strict=True)) if f is not None
    ]
    if not parts:
        return ()
    time_s = np.concatenate([b + f.t_s for b, f, _, _ in parts])
    value, seen = (np.concatenate([getattr(f, name) for _, f, _, _ in parts]) for name in ("value", "seen"))
    names = diagnosis.system.disturbance.names
    for i, name in enumerate(names):
        if seen[:, i].any():
            _send_scalars(log, f"missing_force/{name}", time_s[seen[:, i]], value[seen[:, i], i : i + 1])
    axes = [names.index(n) for n in WORLD_FORCE if n in names]
    # where friction holds the body no force can be seen: no arrow there
    shown = np.asarray(seen[:, axes].all(axis=1))
    drawn = diagnosis.system.drawn()
    if len(axes) < 2 or not shown.any() or not drawn:
        return ()
    first = drawn[0].name
    at = np.concatenate(
        [
            np.column_stack([np.interp(f.t_s, p.t_s, poses.of["measured", first][k][:, c]) for c in range(3)])
            for _, f, p, k in parts
        ]
    )
    force = np.zeros((len(value), 3))
    force[:, : len(axes)] = np.where(shown[:, None], value[:, axes], 0.0)
    _send_arrows(log, "world/missing_force", time_s, poses.lifted(at), force * _per_newton(force[shown], poses))
    return ("Blue arrow: the force that the simulator as believed lacks.",)


def _send_arrows(
    log: rr.RecordingStream, entity: str, time_s: np.ndarray, origin: np.ndarray, vector: np.ndarray
) -> None:
    log.send_columns(entity, _index(time_s), rr.Arrows3D.columns(origins=origin, vectors=vector))


def _verdict(diagnosis: Diagnosis, arrows: Sequence[str]) -> str:
    lines = [f"### {words.verdict(diagnosis)}", ""]
    if confounded := words.confounded(diagnosis):
        lines += [confounded, ""]
    corrected = ", orange: corrected" if diagnosis.effects else ""
    lines.append(
        f"Black: measured, grey: the simulator as believed{corrected}; the line behind is the way of the last "
        f"{TRAIL_S:.0f} s."
    )
    lines += arrows
    if len(arrows) > 1:
        lines.append("Arrows of each kind have a scale of their own.")
    return "\n".join(lines)


def _ranking(diagnosis: Diagnosis) -> str:
    lines = ["| explanation | probability |", "|---|---|"]
    lines += [
        f"| {words.title(r.effects or (NONE,))} | {probability(r.probability)} |"
        for r in state(diagnosis).order[:SHOWN]
    ]
    return "\n".join(lines)
