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
    """Return pushes within the forces and the points of application that the recording has."""
    most_n = context.force_n
    levels = sorted({min(share * context.friction_n, most_n) for share in SHARES} | {most_n})
    points = np.concatenate([e.point_m[np.linalg.norm(e.force_n, axis=1) > 0][:, :2] for e in recording.episodes])
    reach = np.abs(points).max(axis=0) if len(points) else np.zeros(2)
    places = [np.zeros(2)] + [np.array(p) for p in ((reach[0], 0.0), (0.0, reach[1])) if np.hypot(*p) > 1e-6]
    out = []
    for size in levels:
        for angle in DIRECTIONS_RAD:
            force = size * np.array([np.cos(angle), np.sin(angle)])
            for place in places:
                out += [ProposedPush(force, place, "pulse", 0.3), ProposedPush(force, place, "pulse", 1.2)]
                out += [ProposedPush(force, place, "there and back", 0.6), ProposedPush(force, place, "ramp", 2.0)]
    return out


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
