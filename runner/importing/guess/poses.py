"""Positions and orientations of bodies: groups x, y, z and quaternions, their unit, and which axis points up."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from runner.importing.entries import Z_UP_AXIS
from runner.importing.guess.fall import Fall, falls
from runner.importing.guess.names import BY_NAME, contains, own_words, words_of
from runner.importing.guess.unit import MUCH_M, UNIT_BY_NAME, with_unit
from runner.importing.map_file import TO_FILL
from runner.importing.signals import Part
from runner.importing.units import UNITS
from runner.numerics.arrays import FloatArray

# what they are of, their axis, and a unit of length behind it
GROUPED = re.compile(r"(.*?)[/_.\[]?(q?[xyzw]|[0-4])\]?(?:[_. ]*[\[(]?(mm|cm|m)[\])]?)?$", re.IGNORECASE)
PLACES = frozenset(
    ["position", "translation", "point", "pos", "t", "p", "trans", "tvec", "location", "centre", "center"]
)
TURNS = frozenset(["orientation", "rotation", "quaternion", "quat"])
# Four numbers whose length is that near to 1 all the time are a quaternion, whatever they are called.
UNIT_LENGTH = 0.02
# the last letter of a part's name, or what is written out
PARTS = {"i": "x", "j": "y", "k": "z", "r": "w", "s": "w", "real": "w", "scalar": "w"} | {a: a for a in "xyzw"}
IDENTITY = 0.95  # of the scalar of a quaternion that is hardly turned
FREE = int(mujoco.mjtJoint.mjJNT_FREE)
NEARER, APART_M = 0.3, 0.05  # y points up where that puts a body so much nearer to where the model has it


@dataclass(frozen=True)
class Pose:
    """Where a body is, or how it is turned: signals by axis, in the log's frame."""

    body: str
    signals: Mapping[str, str]
    turned: bool
    order: str
    why: str
    unit: str | None = None  # None: its name tells of none

    def channels(self, up: str) -> dict[str, dict]:
        """Return the channels of the map, called by the axes that the case has, in which z points up."""
        if self.turned:
            names = list(self.signals.values())
            own = {"signals": names, "order": self.order, "body": self.body, "quantity": "orientation"}
            return {f"quat_{self.body}": own}
        return {
            f"{Z_UP_AXIS[axis][0] if up == 'y' else axis}_{self.body}": {
                "signal": name, "body": self.body, "quantity": "position", "axis": axis, "unit": self.unit or "m",
            }
            for axis, name in self.signals.items()
        }  # fmt: skip


@dataclass(frozen=True)
class UpGuess:
    """Which axis points up, and what is to be said of it."""

    axis: str
    note: str


def guess_poses(
    part: Part, model: mujoco.MjModel, *, besides: Collection[str] = (), times_s: FloatArray | None = None
) -> list[Pose]:
    """Return the poses in a part: by names, and of the only free body by what four or three columns in a row show.

    Args:
        part: Of the log.
        model: The compiled MJCF.
        besides: Names of signals that are something else, such as clocks.
        times_s: Of the samples, where the clock tells them.
    """
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    free = [model.body(int(model.jnt_bodyid[j])).name for j in range(model.njnt) if int(model.jnt_type[j]) == FREE]
    groups: dict[tuple[str, str | None], dict[str, str]] = {}
    for name in part.signals:
        found = GROUPED.match(name)
        if found:
            # x and qx are of two groups
            axis, unit = found[2].lower(), (found[3] or "").lower() or None
            groups.setdefault((found[1] + "q" * axis.startswith("q"), unit), {})[axis.lstrip("q")] = name
    poses = []
    for (base, unit), members in groups.items():
        words = words_of(base)
        if set(members) == set("1234"):
            members = {str(int(k) - 1): name for k, name in members.items()}
        turned = bool(set(words) & TURNS) or {"w", "x", "y", "z"} == set(members) or _of_unit_length(part, members)
        named = [b for b in bodies if any(contains(words, w) for w in own_words(b))]
        placed = (bool(set(words) & PLACES) or not base or _is_all(words, named)) and not turned
        body = max(named, key=len) if named else free[0] if len(free) == 1 else None
        if body is None or not (turned or placed):
            continue
        why = BY_NAME if named else "the only free body"
        if turned and len(members) == 4:
            order, said = _order(part, members)
            ordered = dict(sorted(members.items(), key=lambda m: "xyzw".find(m[0])))
            poses.append(Pose(body, ordered, True, order, f"{why}; {said}"))
        elif placed and {"x", "y", "z"} == set(members):
            said = with_unit(why, UNIT_BY_NAME if unit else "")
            poses.append(Pose(body, {a: members[a] for a in "xyz"}, False, "", said, unit))
        elif placed and {"0", "1", "2"} == set(members):
            poses.append(Pose(body, dict(zip("xyz", (members[k] for k in "012"), strict=True)), False, "", why, unit))
    if len(free) == 1:
        taken = {*besides, *(name for p in poses for name in p.signals.values())}
        own = [p for p in poses if p.body == free[0]]
        if not any(p.turned for p in own) and (turn := _unnamed_turn(part, taken, free[0])) is not None:
            poses.append(turn)
            taken |= set(turn.signals.values())
        if all(p.turned for p in own) and (place := _unnamed_place(part, taken, free[0], model, times_s)) is not None:
            poses.append(place)
    return poses


def _in_a_row(part: Part, count: int, taken: Collection[str]) -> Iterator[tuple[str, ...]]:
    """Return so many names that follow each other in the log and are nothing else."""
    names = list(part.signals)
    for k in range(len(names) - count + 1):
        row = tuple(names[k : k + count])
        if not set(row) & set(taken):
            yield row


def _unnamed_turn(part: Part, taken: Collection[str], body: str) -> Pose | None:
    """Return the orientation that no name tells: four columns in a row that make up a unit vector, and move."""
    for row in _in_a_row(part, 4, taken):
        moves = sum(bool(np.ptp(part.signals[n].values[np.isfinite(part.signals[n].values)])) for n in row) > 1
        members = dict(zip("0123", row, strict=True))
        if not moves or not _of_unit_length(part, members):
            continue
        axes = [PARTS.get(last, PARTS.get(last[-1], "")) for last in (words_of(n)[-1] for n in row)]
        if {*axes} == {*"wxyz"}:
            members = dict(zip(axes, row, strict=True))
        order, said = _order(part, members)
        ordered = dict(sorted(members.items(), key=lambda m: "xyzw".find(m[0])))
        return Pose(body, ordered, True, order, f"always of length 1; {said}")
    return None


def _unnamed_place(
    part: Part, taken: Collection[str], body: str, model: mujoco.MjModel, times_s: FloatArray | None
) -> Pose | None:
    """Return the position that no name tells: three columns in a row that fall."""
    if times_s is None:
        return None
    for row in _in_a_row(part, 3, taken):
        values = [part.signals[n].values for n in row]
        if any(len(v) != len(times_s) for v in values):
            continue
        if falls(times_s, np.stack(values, axis=1), -float(model.opt.gravity[2])) is not None:
            return Pose(body, dict(zip("xyz", row, strict=True)), False, "", "the only free body, and it falls")
    return None


def _of_unit_length(part: Part, members: Mapping[str, str]) -> bool:
    """Whether signals are four numbers that make up a unit vector."""
    values = [part.signals[name].values for name in members.values()]
    if len(values) != 4 or len({len(v) for v in values}) > 1:
        return False
    length = np.linalg.norm(np.stack(values, axis=1), axis=1)
    known = length[np.isfinite(length)]
    return bool(len(known)) and bool(np.all(np.abs(known - 1.0) < UNIT_LENGTH))


def _is_all(words: Sequence[str], names: Sequence[str]) -> bool:
    """Whether words are the name of a body and nothing else."""
    return any(tuple(words) in own_words(name) for name in names)


def _order(part: Part, members: Mapping[str, str]) -> tuple[str, str]:
    """Return where the scalar of a quaternion stands, and how that is known."""
    if "w" in members:
        return "xyzw", "order by the names"
    if any(n.endswith("/quaternion[3]") for n in members.values()) and "sim_time" in part.signals[members["0"]].clocks:
        return "xyzw", "rerun's order"
    values = np.stack([part.signals[members[k]].values for k in "0123"], axis=1)
    first = np.abs(values[np.isfinite(values).all(axis=1)][:1])
    if len(first) and first[0, 3] > IDENTITY > first[0, 0]:
        return "xyzw", "hardly turned in the first sample if the last number is the scalar"
    if len(first) and first[0, 0] > IDENTITY > first[0, 3]:
        return "wxyz", "hardly turned in the first sample if the first number is the scalar"
    return TO_FILL, "the numbers do not tell which is the scalar, the one that is 1 or -1 where nothing is turned"


def guess_frame(
    part: Part, poses: Sequence[Pose], model: mujoco.MjModel, times_s: FloatArray | None
) -> tuple[list[Pose], UpGuess]:
    """Return poses with their units, and which axis points up: by how bodies fall, else by where the model has them.

    Args:
        part: Of the log.
        poses: Found by their names.
        model: The compiled MJCF.
        times_s: Of the samples, where the clock tells them.
    """
    places = {k: _places(part, p) for k, p in enumerate(poses) if not p.turned}
    gravity = -float(model.opt.gravity[2])
    fallen = {
        k: found
        for k, v in places.items()
        if times_s is not None and len(v) == len(times_s) and (found := falls(times_s, v, gravity)) is not None
    }
    out = [_with_unit(p, places[k], fallen.get(k)) if k in places else p for k, p in enumerate(poses)]
    for k, fall in fallen.items():
        if fall.unit != out[k].unit:
            said = f"'{poses[k].body}' falls as if its positions were in {fall.unit}; z is assumed to point up"
            return out, UpGuess("z", said)
        said = f"'{poses[k].body}' falls along {fall.up} with {fall.acceleration_m_s2:.3g} m/s2"
        return out, UpGuess(fall.up, f"{said}, so {fall.up} points up and its positions are in {fall.unit}")
    return out, _by_start(out, places, model)


def _places(part: Part, pose: Pose) -> FloatArray:
    return np.stack([part.signals[name].values for name in pose.signals.values()], axis=1)


def _with_unit(pose: Pose, places: FloatArray, fall: Fall | None) -> Pose:
    """Return a pose with its unit: by its name, by how it falls, or m, where that can be."""
    if pose.unit is not None:
        return pose
    if fall is not None:
        return replace(pose, unit=fall.unit, why=f"{pose.why}; unit by how it falls")
    largest = float(np.nanmax(np.abs(places), initial=0.0))
    if largest > MUCH_M:
        return replace(pose, unit=TO_FILL, why=f"{pose.why}; goes up to {largest:.4g}: in which unit?")
    return replace(pose, unit="m", why=f"{pose.why}; unit assumed")


def _by_start(poses: Sequence[Pose], places: Mapping[int, FloatArray], model: mujoco.MjModel) -> UpGuess:
    """Return which axis points up: the one that puts bodies where the model has them."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for k, values in places.items():
        size = UNITS["m"].get(poses[k].unit or "")
        known = values[np.isfinite(values).all(axis=1)]
        if size is None or not len(known):
            continue
        x, y, z = known[0] * size
        believed = data.body(poses[k].body).xpos
        as_z = float(np.linalg.norm(np.array([x, y, z]) - believed))
        as_y = float(np.linalg.norm(np.array([x, -z, y]) - believed))
        if as_y < NEARER * as_z and as_z - as_y > APART_M:
            body = poses[k].body
            return UpGuess(
                "y", f"'{body}' starts {as_y:.3g} m from where the model has it if y points up, else {as_z:.3g} m"
            )
    return UpGuess("z", "z is assumed to point up" if poses else "")
