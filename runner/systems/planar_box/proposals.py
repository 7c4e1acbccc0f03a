"""Pushes that could be tried next, within the forces and the points of application that were used so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runner.effects.planar_box import Context
from runner.recording import Episode, Recording
from runner.systems.base import Proposal
from runner.systems.planar_box.motion import measured_columns

LENGTH_S = 3.0
SHARES = (1.15, 1.6, 2.4)  # of the force that just moves the body
DIRECTIONS_RAD = (0.0, np.pi / 2)
SHORTEST_M = 1e-6  # of a lever: of less a push goes through the centre


@dataclass(frozen=True)
class ProposedPush(Proposal):
    """A push from rest.

    Args:
        force_n: In body axes at the start, (2,), held in the world's axes.
        point_m: Where it acts, body axes, (2,).
        pattern: "pulse": once, then coasting; "there and back"; "ramp": slowly rising from zero.
        hold_s: How long it is held, or rises.
    """

    force_n: np.ndarray
    point_m: np.ndarray
    pattern: str
    hold_s: float

    def columns(self, t_s: np.ndarray) -> np.ndarray:
        """Return the force over time, (T, 3)."""
        shape = {
            "pulse": (t_s < self.hold_s) * 1.0,
            "there and back": (t_s < self.hold_s) * 1.0 - ((t_s >= self.hold_s) & (t_s < 2 * self.hold_s)),
            "ramp": np.where(t_s < self.hold_s, t_s / self.hold_s, 0.0),
        }[self.pattern]
        return np.column_stack([shape[:, None] * self.force_n, np.zeros(len(t_s))])

    @property
    def sentence(self) -> str:
        """What to do."""
        size, angle = float(np.hypot(*self.force_n)), float(np.degrees(np.arctan2(*self.force_n[::-1])))
        x, y = self.point_m
        where = "at the centre" if np.hypot(x, y) < 1e-9 else f"at the point ({x:.2g}, {y:.2g}) m of the body"
        push = f"with {size:.2g} N at {angle:.0f} degrees to the body's x axis, {where}"
        how = {
            "pulse": f"push {push}, for {self.hold_s:.2g} s, and let it coast",
            "there and back": f"push {push}, for {self.hold_s:.2g} s, then back as long",
            "ramp": f"raise the force slowly, over {self.hold_s:.2g} s, up to a push {push}",
        }[self.pattern]
        return f"From rest, {how}."


def pushes(recording: Recording, context: Context) -> list[ProposedPush]:
    """Return pushes within the forces of the recording: through the centre, and as it has them where they turn most."""
    most_n = context.force_n
    levels = sorted({min(share * context.friction_n, most_n) for share in SHARES} | {most_n})
    along = [(np.array([np.cos(a), np.sin(a)]), np.zeros(2)) for a in DIRECTIONS_RAD] + _turning(recording)
    out = []
    for size in levels:
        for direction, place in along:
            force = size * direction
            out += [ProposedPush(force, place, "pulse", 0.3), ProposedPush(force, place, "pulse", 1.2)]
            out += [ProposedPush(force, place, "there and back", 0.6), ProposedPush(force, place, "ramp", 2.0)]
    return out


def _turning(recording: Recording) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return direction, (2,), and point, (2,), m, of the pushes with the longest levers either way, in body axes.

    Those were done: a finger can push against a face of a box, but not along it.
    """
    yaw = np.concatenate([e.pose[:, 2] for e in recording.episodes])
    force = np.concatenate([e.force_n[:, :2] for e in recording.episodes])
    point = np.concatenate([e.point_m[:, :2] for e in recording.episodes])
    size = np.hypot(*force.T)
    done = (size > 0) & np.isfinite(yaw) & np.isfinite(point).all(axis=1)
    if not done.any():
        return []
    angle = np.arctan2(force[done, 1], force[done, 0]) - yaw[done]
    direction, point = np.column_stack([np.cos(angle), np.sin(angle)]), point[done]
    lever = point[:, 0] * direction[:, 1] - point[:, 1] * direction[:, 0]
    ends = [k for k, way in ((lever.argmax(), 1), (lever.argmin(), -1)) if way * lever[k] > SHORTEST_M]
    return [(direction[k], point[k]) for k in ends]


def unmeasured(recording: Recording, pushes: Sequence[ProposedPush]) -> Recording:
    """Return a recording in which each episode is one of these pushes, seen as this one's are, at rest throughout."""
    rate = recording.nominal.rate_hz
    t = np.arange(round(LENGTH_S * rate) + 1) / rate
    seen = np.full(6, np.nan)
    seen[measured_columns(recording)] = 0.0
    pose, twist = np.tile(seen[:3], (len(t), 1)), np.tile(seen[3:], (len(t), 1))
    episodes = tuple(
        Episode(i, t, pose, twist, push.columns(t), np.tile([*push.point_m, 0.0], (len(t), 1)) * np.ones((len(t), 1)))
        for i, push in enumerate(pushes)
    )
    return replace(recording, episodes=episodes, notes=())
