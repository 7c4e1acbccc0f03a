"""`diagnosis.rrd`: measured and simulated bodies side by side, the missing force, residuals in noise units.

Each episode has a tab of its own and begins at zero, those kept from the fit first: they are what the verdict is judged
by. Sent as whole columns; the layout is inside the file (`runner.report.record_layout`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from runner.effects.wording import percent, probability
from runner.importing.record import called
from runner.numerics.arrays import over_gaps
from runner.report import words
from runner.report.missing_force import missing_force
from runner.report.motions import Paths, replay
from runner.report.record_gap import WindowGap, blended, window_gaps
from runner.report.record_layout import (
    COLOURS,
    COMMAND,
    FROM,
    INK,
    MISSING,
    Eye,
    Tab,
    blueprint,
    drawn_channels,
    models,
)
from runner.report.record_shapes import colours, colours_over_time, kinds, shapes
from runner.report.statement import NONE, state
from runner.storage.reading import file_of
from runner.systems.drawing import DrawnBody, Shape
from runner.viewer.rrd import written

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

FILE = "diagnosis.rrd"
REACH_OF_ARROW = 1.6  # of the bodies' size: how long the arrow of a typical large force is
ABOVE = 1.04  # ways and arrows of what is seen from above lie so far above it
NEAR = 5.5  # sizes of a body: how far the eye is from what has no shape
THIN = 0.0016  # half the width of a line that is still seen, of how far the eye is from it
UPWARDS, SIDEWAYS = 0.5, 0.6  # tangents of half of what a viewer shows, of half a window of 16:9 and of narrower ones
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
    path = file_of(path, FILE)
    path.parent.mkdir(parents=True, exist_ok=True)
    paths = sorted(replay(diagnosis), key=lambda p: (not p.held_out, p.episode))
    gaps = window_gaps(diagnosis, paths)
    episodes = [_Episode(diagnosis, p, g) for p, g in zip(paths, gaps, strict=True)]
    tabs = [Tab(e.root, _name(diagnosis, e.path), e.eye, _spans(e.curves)) for e in episodes]
    with written(path, blueprint(diagnosis, tabs), "runner diagnosis") as log:
        log.send_recording_name(diagnosis.case)
        log.send_property("verdict", rr.AnyValues(sentence=words.verdict(diagnosis), gap_closed=diagnosis.gap_closed))
        arrows: list[str] = []
        for episode in episodes:
            episode.send_bodies(log)
            episode.send_curves(log)
            arrows += [*episode.send_commands(log), *episode.send_missing_force(log)]
        texts = {"verdict": _verdict(diagnosis, list(dict.fromkeys(arrows))), "ranking": _ranking(diagnosis)}
        for name, text in texts.items():
            log.log(name, rr.TextDocument(text, media_type="text/markdown"), static=True)
    return path


def _name(diagnosis: Diagnosis, path: Paths) -> str:
    episode = called(diagnosis.recording.path, diagnosis.recording.episodes[path.episode].index)
    return f"episode {episode}" + (" (not fitted)" if path.held_out else "")


@dataclass(frozen=True)
class Curve:
    """Values (T, K) over time (T,), and how their lines look."""

    t_s: np.ndarray
    values: np.ndarray
    lines: rr.SeriesLines


def _spans(curves: Mapping[str, Curve]) -> dict[str, tuple[float, float]]:
    """Return the least and the largest value of each curve that has any."""
    known = {entity: curve.values[np.isfinite(curve.values)] for entity, curve in curves.items()}
    return {entity: (float(v.min()), float(v.max())) for entity, v in known.items() if len(v)}


class _Episode:
    """One episode in the log: its bodies in each model, its residuals, the force that is missing.

    Attributes:
        root: Its entities lie below it.
        poses: By model and body, (T, 7): x, y, z, qw, qx, qy, qz.
        traced: The body that moves most: its way is drawn. None: nothing is drawn.
        size_m: Typical half extent of a body.
        eye: From where all is seen, wherever it goes.
        force: The missing force over time; None: nobody asked for it.
        curves: What is plotted over time, by entity.
    """

    def __init__(self, diagnosis: Diagnosis, path: Paths, gap: WindowGap | None) -> None:
        self.diagnosis, self.path, self.gap = diagnosis, path, gap
        self.system = system = diagnosis.system
        self.bodies = system.drawn()
        self.root = f"episode_{diagnosis.recording.episodes[path.episode].index}"
        self.poses = {
            (model, body): pose
            for model in models(diagnosis)
            for body, pose in system.poses(path.episode, over_gaps(getattr(path, model))).items()
        }
        way = {b.name: _length(self.poses["measured", b.name][:, :3]) for b in self.bodies}
        self.traced = max(way, key=lambda name: way[name], default=None)
        self.size_m = max((float(np.mean(s.size_m)) for b in self.bodies for s in b.shapes), default=UNDRAWN_M)
        self.eye = eye_on_all([(self.poses["measured", b.name], b) for b in self.bodies if b.shapes], self.size_m)
        tops = [s.position_m[2] + _height(s) for b in self.bodies for s in b.shapes]
        self.force = missing_force(diagnosis, diagnosis.where, path.episode)
        self.curves = dict(self._curves())
        self.lift_m = 0.0 if system.plan_view is None else ABOVE * max(tops, default=0.0)

    def _seen_m(self, half_width_m: float) -> float:
        """Return the half width of a line, or more where it could not be seen from so far away."""
        return max(half_width_m, THIN * self.eye.distance_m)

    def send_bodies(self, log: rr.RecordingStream) -> None:
        """Send every body of every model: solid ones for the two views, frames around the simulated one."""
        line_m = self._seen_m(0.016 * self.size_m)
        log.log(self.root, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for rank, model in enumerate(models(self.diagnosis)):
            for body in self.bodies:
                entity = f"{self.root}/{model}/{body.name}"
                self._send_poses(log, entity, model, body.name)
                for kind in kinds(body):
                    colour = None if model == "nominal" else COLOURS[model]
                    solid = shapes(body, kind, solid=True, colour=colour, grown=1.0, line_m=line_m)
                    frame = shapes(
                        body, kind, solid=False, colour=COLOURS[model], grown=1 + 0.012 * (rank + 1), line_m=line_m
                    )
                    if model != "corrected":
                        log.log(f"{entity}/{kind}", solid, static=True)
                    if model != "nominal":
                        log.log(f"{entity}/{kind}_frame", frame, static=True)
                    if model == "nominal":
                        self._send_gap_colours(log, f"{entity}/{kind}", body, kind)
        self._send_ways(log)

    def _send_poses(self, log: rr.RecordingStream, entity: str, model: str, body: str) -> None:
        pose = self.poses[model, body]
        columns = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, [4, 5, 6, 3]])
        log.send_columns(entity, _index(self.path.t_s), columns)

    def _send_gap_colours(self, log: rr.RecordingStream, entity: str, body: DrawnBody, kind: str) -> None:
        """Send the colours of the simulated body: how much of the gap comes about in each window."""
        t_s, strength = (np.zeros(1), np.zeros(1)) if self.gap is None else (self.gap.begin_s, self.gap.strength)
        each = [colours(body, kind, blended(float(s))) for s in strength]
        packed = np.array(each, np.uint8).reshape(-1, 3)
        columns = colours_over_time(kind, packed)
        log.send_columns(entity, _index(t_s), columns.partition(np.full(len(each), len(each[0]))))

    def _send_ways(self, log: rr.RecordingStream) -> None:
        """Send the way of the body that moves most: of the measured one in the colours of the gap."""
        if self.traced is None:
            return
        lift = np.array([0.0, 0.0, self.lift_m])
        for model in models(self.diagnosis):
            place, t_s = self.poses[model, self.traced][:, :3] + lift, self.path.t_s
            look: dict = {"radii": self._seen_m(0.02 * self.size_m), "colors": COLOURS[model]}
            strips = [place]
            if model == "measured" and self.gap is not None:
                edges = [0, *np.searchsorted(t_s, self.gap.begin_s[1:]).tolist(), len(t_s) - 1]
                parts = [
                    (place[a : b + 1], blended(float(s)))
                    for a, b, s in zip(edges[:-1], edges[1:], self.gap.strength, strict=True)
                    if b > a
                ]
                strips, look["colors"] = [p for p, _ in parts], [c for _, c in parts]
            log.log(f"{self.root}/way/{model}", rr.LineStrips3D(strips, **look), static=True)

    def _curves(self) -> Iterator[tuple[str, Curve]]:
        """Yield what each simulator misses of each channel, in noise levels, the gap's share, and the missing force."""
        path, diagnosis = self.path, self.diagnosis
        names = [m for m in models(diagnosis) if m != "measured"]
        lines = rr.SeriesLines(
            colors=[*(COLOURS[n] for n in names), INK, INK],
            names=[*(("as believed" if n == "nominal" else n) for n in names), "+2 noise", "−2 noise"],
            widths=[2.0] * len(names) + [0.6] * 2,
        )
        band = np.tile([2.0, -2.0], (len(path.t_s), 1))
        for i, channel in enumerate(diagnosis.system.channels):
            if channel not in drawn_channels(diagnosis.system):
                continue
            missed = [(getattr(path, m) - path.measured)[:, i] / diagnosis.measured.sigma[i] for m in names]
            yield f"{self.root}/residual/{channel.name}", Curve(path.t_s, np.column_stack([*missed, band]), lines)
        if self.gap is not None:
            gap = rr.SeriesLines(colors=[MISSING], names=["gap"], widths=[3.0])
            every = np.ones(len(self.gap.t_s), bool)
            yield f"{self.root}/gap", self._of_windows(self.gap.t_s, 100 * self.gap.share[:, None], every, gap)
        if self.force is not None:
            lacks = rr.SeriesLines(colors=[MISSING], names=["missing"], widths=[2.0])
            for i, name in enumerate(self.system.disturbance.names):
                values, seen = self.force.value[:, i : i + 1], self.force.seen[:, i]
                yield f"{self.root}/missing_force/{name}", self._of_windows(self.force.t_s, values, seen, lacks)

    def _of_windows(self, t_s: np.ndarray, values: np.ndarray, seen: np.ndarray, lines: rr.SeriesLines) -> Curve:
        """Return the curve of values in windows, of those that are seen; the one of a short episode is all of it."""
        if len(t_s) == 1:
            t_s, values, seen = self.path.t_s[[0, -1]], np.repeat(values, 2, axis=0), np.repeat(seen, 2)
        return Curve(t_s[seen], values[seen], lines)

    def send_curves(self, log: rr.RecordingStream) -> None:
        """Send all that is plotted over time."""
        for entity, curve in self.curves.items():
            log.log(entity, curve.lines, static=True)
            if len(curve.t_s):
                _send_scalars(log, entity, curve.t_s, curve.values)

    def send_commands(self, log: rr.RecordingStream) -> tuple[str, ...]:
        """Send what was commanded as arrows, tips where it acts, if the system says so; return what that shows."""
        found = self.system.command_arrows(self.path.episode, over_gaps(self.path.measured))
        if found is None:
            return ()
        tip, force = found
        arrows = force * self._per_newton(force)
        at = tip + np.array([0.0, 0.0, self.lift_m]) - arrows
        self._send_arrows(log, "command", COMMAND, self.path.t_s, at, arrows)
        return ("**Green arrow**: the commanded force, its tip where it acts.",)

    def send_missing_force(self, log: rr.RecordingStream) -> tuple[str, ...]:
        """Send the missing force as an arrow on the first body where it is a force in world axes.

        Returns what the arrow shows.
        """
        path, names, found = self.path, self.system.disturbance.names, self.force
        if found is None:
            return ()
        value, seen = found.value, found.seen
        axes = [names.index(n) for n in WORLD_FORCE if n in names]
        # where friction holds the body no force can be seen: no arrow there
        shown = np.asarray(seen[:, axes].all(axis=1))
        if len(axes) < 2 or not shown.any() or not self.bodies:
            return ()
        pose = self.poses["measured", self.bodies[0].name]
        at = np.column_stack([np.interp(found.t_s, path.t_s, pose[:, c]) for c in range(3)])
        force = np.zeros((len(value), 3))
        force[:, : len(axes)] = np.where(shown[:, None], value[:, axes], 0.0)
        force *= self._per_newton(force[shown])
        self._send_arrows(log, "missing_arrow", MISSING, found.t_s, at + np.array([0.0, 0.0, self.lift_m]), force)
        return ("**Purple arrow**: the force that the simulator as believed lacks. Each kind of arrow has its scale.",)

    def _send_arrows(
        self, log: rr.RecordingStream, name: str, colour: tuple, t_s: np.ndarray, at: np.ndarray, vector: np.ndarray
    ) -> None:
        entity = f"{self.root}/{name}"
        log.log(entity, rr.Arrows3D.from_fields(colors=colour, radii=0.06 * self.size_m), static=True)
        log.send_columns(entity, _index(t_s), rr.Arrows3D.columns(origins=at, vectors=vector))

    def _per_newton(self, force: np.ndarray) -> float:
        """Return how long an arrow is for each newton."""
        large = float(np.percentile(np.linalg.norm(force, axis=1), 98)) if len(force) else 0.0
        return REACH_OF_ARROW * self.size_m / max(large, 1e-9)


def eye_on_all(moved: Sequence[tuple[np.ndarray, DrawnBody]], size_m: float) -> Eye:
    """Return from where all shapes of bodies are seen, wherever they go.

    Args:
        moved: Poses, (T, 7): x, y, z, qw, qx, qy, qz, of each body with shapes, NaN where not measured.
        size_m: What is taken for their size where there are none.
    """
    places, reaches = [], []
    for pose, body in moved:
        known = pose[np.isfinite(pose).all(axis=1)]
        turns = Rotation.from_quat(known[:, [4, 5, 6, 3]])
        for s in body.shapes:
            centre = known[:, :3] + turns.apply(s.position_m)
            places.append(centre)
            reaches.append(np.full(len(centre), _radius(s)))
    if not places:
        return Eye(np.zeros(3), NEAR * size_m)
    place, reach = np.concatenate(places), np.concatenate(reaches)
    middle = ((place - reach[:, None]).min(axis=0) + (place + reach[:, None]).max(axis=0)) / 2
    aside = np.cross((0, 0, 1), FROM)
    aside /= np.linalg.norm(aside)
    off = place - middle
    wide, tall = (np.abs(off @ aside) + reach) / SIDEWAYS, (np.abs(off @ np.cross(FROM, aside)) + reach) / UPWARDS
    return Eye(middle, float((np.maximum(wide, tall) + off @ FROM + reach).max()))


def _radius(shape: Shape) -> float:
    """Return the radius of the ball around a shape."""
    if shape.kind == "capsule":
        return float(sum(shape.size_m[:2]))
    if shape.kind == "ellipsoid":
        return max(shape.size_m)
    return float(np.linalg.norm(shape.size_m))


def _length(way: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def _height(shape: Shape) -> float:
    """Return the half extent of an upright shape along z; a sphere has one size alone, of others it is the last."""
    return shape.size_m[-1]


def _index(t_s: np.ndarray) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("sim_time", duration=np.round(1e9 * t_s).astype("timedelta64[ns]"))]


def _send_scalars(log: rr.RecordingStream, entity: str, time_s: np.ndarray, values: np.ndarray) -> None:
    scalars = rr.Scalars.columns(scalars=values.ravel())
    log.send_columns(entity, _index(time_s), scalars.partition(np.full(len(values), values.shape[1])))


def _verdict(diagnosis: Diagnosis, arrows: Sequence[str]) -> str:
    lines = [f"### {words.verdict(diagnosis)}", ""]
    if confounded := words.confounded(diagnosis):
        lines += [confounded, ""]
    if diagnosis.flights is not None:
        lines += [diagnosis.flights.note, ""]
    corrected = " **Orange**: corrected." if diagnosis.effects else ""
    said = "grey as believed" + (", orange corrected" if diagnosis.effects else "")
    lines += [
        f"**Blue**: measured.{corrected} **Grey to purple**: the simulator as believed; the more purple, the more "
        "of the gap comes about just then. So is the way of what was measured.",
        "",
        " ".join(arrows),
        "",
        f"Curves of what is missed: {said}; thin lines are twice the noise. Purple: the share of "
        "the gap, and the force that is missing.",
        "",
        "A tab for each episode; all begin at zero on the time line below.",
    ]
    return "\n".join(lines)


def _ranking(diagnosis: Diagnosis) -> str:
    said = state(diagnosis)
    shown, rest = said.shown(SHOWN)
    lines = ["| explanation | probability | gap closed |", "|---|---|---|"]
    for r in shown:
        closed = said.closed_by(r)
        cells = (
            words.title(r.effects or (NONE,)),
            probability(r.probability),
            "" if closed is None else percent(closed),
        )
        lines.append(f"| {' | '.join(cells)} |")
    if rest:
        lines.append(f"| {len(rest)} others | {probability(sum(r.probability for r in rest))} | |")
    return "\n".join(lines)
