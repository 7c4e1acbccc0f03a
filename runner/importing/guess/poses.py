"""Positions and orientations of bodies: groups x, y, z and quaternions, and which axis of the log's world points up."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from runner.importing.guess.names import contains, own_words, words_of
from runner.importing.map_file import TO_FILL
from runner.importing.signals import Part

# what they are of, their axis, and a unit of length behind it
GROUPED = re.compile(r"(.*?)[/_.\[]?(q?[xyzw]|[0-3])\]?(?:[_. ]*[\[(]?(mm|cm|m)[\])]?)?$")
PLACES = frozenset(["position", "translation", "point", "pos"])
TURNS = frozenset(["orientation", "rotation", "quaternion", "quat"])
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

    def channels(self) -> dict[str, dict]:
        """Return the channels of the map."""
        if self.turned:
            names = list(self.signals.values())
            own = {"signals": names, "order": self.order, "body": self.body, "quantity": "orientation"}
            return {f"quat_{self.body}": own}
        return {
            f"{axis}_{self.body}": {
                "signal": name, "body": self.body, "quantity": "position", "axis": axis, "unit": self.unit or "m",
            }
            for axis, name in self.signals.items()
        }  # fmt: skip


@dataclass(frozen=True)
class UpGuess:
    """Which axis points up, and what is to be said of it."""

    axis: str
    note: str


def guess_poses(part: Part, model: mujoco.MjModel) -> tuple[list[Pose], list[str]]:
    """Return the poses in a part, and what is to be said of them."""
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    free = [model.body(int(model.jnt_bodyid[j])).name for j in range(model.njnt) if int(model.jnt_type[j]) == FREE]
    groups: dict[tuple[str, str | None], dict[str, str]] = {}
    for name in part.signals:
        found = GROUPED.match(name)
        if found:
            # x and qx are of two groups
            base = found[1] + "q" * found[2].startswith("q")
            groups.setdefault((base, found[3]), {})[found[2].lstrip("q")] = name
    poses, notes = [], []
    for (base, unit), members in groups.items():
        words = words_of(base)
        turned = bool(set(words) & TURNS) or {"w", "x", "y", "z"} == set(members)
        placed = (bool(set(words) & PLACES) or not base) and not turned
        named = [b for b in bodies if any(contains(words, w) for w in own_words(b))]
        body = max(named, key=len) if named else free[0] if len(free) == 1 else None
        if body is None or not (turned or placed):
            continue
        why = "by its name" if named else "the only free body"
        if turned and len(members) == 4:
            order, said = _order(part, members)
            ordered = dict(sorted(members.items(), key=lambda m: "xyzw".find(m[0])))
            poses.append(Pose(body, ordered, True, order, f"{why}; {said}"))
        elif placed and {"x", "y", "z"} == set(members):
            said = f"{why}; unit {'by its name' if unit else 'assumed'}"
            poses.append(Pose(body, {a: members[a] for a in "xyz"}, False, "", said, unit))
        elif placed and {"0", "1", "2"} == set(members):
            poses.append(Pose(body, dict(zip("xyz", (members[k] for k in "012"), strict=True)), False, "", why, unit))
    if any(p.unit is None and not p.turned for p in poses):
        notes.append("positions of bodies are taken in m, in the model's world; scale and offset are for another one")
    return poses, notes


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
    return TO_FILL, "the numbers do not tell which is the scalar"


def guess_up(part: Part, poses: list[Pose], model: mujoco.MjModel) -> UpGuess:
    """Return which axis points up: the one that puts bodies where the model has them."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for pose in poses:
        if pose.turned:
            continue
        values = np.stack([part.signals[name].values for name in pose.signals.values()], axis=1)
        known = values[np.isfinite(values).all(axis=1)]
        if not len(known):
            continue
        x, y, z = known[0]
        believed = data.body(pose.body).xpos
        as_z = float(np.linalg.norm(known[0] - believed))
        as_y = float(np.linalg.norm(np.array([x, -z, y]) - believed))
        if as_y < NEARER * as_z and as_z - as_y > APART_M:
            return UpGuess(
                "y", f"'{pose.body}' starts {as_y:.3g} m from where the model has it if y points up, else {as_z:.3g} m"
            )
    return UpGuess("z", "z is assumed to point up" if poses else "")
