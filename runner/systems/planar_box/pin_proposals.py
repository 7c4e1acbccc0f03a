"""Pushes with a pin that could be tried next, as fast and as far as those that were recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runner.effects.planar_box import Context
from runner.numerics.arrays import FloatArray
from runner.physics.dry_friction import STATE_AND_PIN
from runner.recording import Episode, Recording
from runner.systems.base import Proposal
from runner.systems.planar_box.motion import measured_columns

SIDES_RAD = (0.0, np.pi / 2)  # from which the pin comes, in body axes
SLANTS_RAD = (0.0, 0.5)  # of its way, so that it sticks or slides
SHIFTS = (0.0, 0.4)  # of its line beside the centre, as a share of the half size
CLEAR = 0.02  # of the half size: how far from the body it begins
REST_S = 0.5  # after it has stopped: the body may coast


@dataclass(frozen=True)
class ProposedPinPush(Proposal):
    """A push from rest along a line.

    Args:
        start_m: Where the pin begins, relative to the body's centre, axes of the body at the start, (2,).
        way_m: Where it goes from there, (2,).
        speed_m_s: How fast.
    """

    start_m: FloatArray
    way_m: FloatArray
    speed_m_s: float

    def path(self, t_s: FloatArray) -> FloatArray:
        """Return the pin's path relative to the body's centre, (T, 2)."""
        far = np.linalg.norm(self.way_m)
        return self.start_m + np.minimum(t_s * self.speed_m_s / far, 1.0)[:, None] * self.way_m

    @property
    def sentence(self) -> str:
        """What to do."""
        (x, y), angle = self.start_m, float(np.degrees(np.arctan2(*self.way_m[::-1])))
        far = float(np.linalg.norm(self.way_m))
        return (
            f"From rest, begin with the pin at ({x:.2g}, {y:.2g}) m of the body and move it by {far:.2g} m at "
            f"{angle:.0f} degrees to the body's x axis, at {self.speed_m_s:.2g} m/s."
        )


def pin_pushes(recording: Recording, context: Context) -> list[ProposedPinPush]:
    """Return pushes at the usual speed of the recording's pin, over the usual way."""
    nominal = recording.nominal
    paths = [e.pin_m for e in recording.episodes if e.pin_m is not None]
    if nominal.pin is None or not paths:
        return []
    speeds = np.concatenate([np.linalg.norm(np.diff(p, axis=0), axis=1) for p in paths]) * nominal.rate_hz
    speed = float(np.median(speeds[speeds >= np.median(speeds)]))
    travel = float(np.median([np.linalg.norm(p[-1] - p[0]) for p in paths]))
    if not (speed > 0 and travel > 0):
        return []
    reach = float(np.hypot(*nominal.half_size_m[:2])) + nominal.pin.radius_m + CLEAR * context.size_m
    out = []
    for side in SIDES_RAD:
        away, left = np.array([np.cos(side), np.sin(side)]), np.array([-np.sin(side), np.cos(side)])
        for slant in SLANTS_RAD:
            ahead = -np.cos(slant) * away + np.sin(slant) * left
            for shift in SHIFTS:
                # so that it meets the body where it would without the slant
                start = away * reach + left * (shift * context.size_m - np.tan(slant) * (reach - context.size_m))
                out.append(ProposedPinPush(start, ahead * (travel + reach - context.size_m), speed))
    return out


def unmeasured_by_pin(recording: Recording, pushes: Sequence[ProposedPinPush], centre_m: FloatArray) -> Recording:
    """Return a recording in which each episode is one of these pushes, seen as this one's are, at rest at yaw 0."""
    rate, seen = recording.nominal.rate_hz, np.full(STATE_AND_PIN, np.nan)
    seen[measured_columns(recording)] = 0.0
    episodes = []
    for i, push in enumerate(pushes):
        lasts_s = float(np.linalg.norm(push.way_m)) / push.speed_m_s + REST_S
        t = np.arange(round(lasts_s * rate) + 1) / rate
        pose, twist = np.tile(seen[:3], (len(t), 1)), np.tile(seen[3:6], (len(t), 1))
        force, point = np.tile([*seen[6:], 0.0], (len(t), 1)), np.zeros((len(t), 3))
        episodes.append(Episode(i, t, pose, twist, force, point, centre_m + push.path(t)))
    return replace(recording, episodes=tuple(episodes), notes=())
