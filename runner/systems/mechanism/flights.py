"""Where in a recording models of a body that hits things can be replayed: from free flight into what follows it.

Through impacts, small differences of the start grow until another corner hits first, and a start between two impacts is
known badly: what was measured around it is no smooth motion. In flight, position and spin are known to what many
samples tell of a parabola and a steady turn. So models are replayed over stretches that begin in flight and end soon
after the next impacts; what comes later says little that a fit could use, and is left to the check over whole episodes.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from runner.effects.mechanism import parts
from runner.numerics.arrays import spread_over
from runner.recording import Span
from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.settings import SETTINGS
from runner.systems.mechanism.coordinates import FREE, Coordinates
from runner.systems.mechanism.models import can_touch
from runner.systems.mechanism.settings import MECHANISM


def measured_freely(recording: MechanismRecording, coordinates: Coordinates, model: mujoco.MjModel) -> bool:
    """Whether all that moves are free bodies whose whole pose is measured, and which may touch something."""
    if not can_touch(model) or any(j.kind != FREE for j in coordinates.joints):
        return False
    bodies = [model.body(int(model.jnt_bodyid[i])).name for i in range(model.njnt)]
    return bool(bodies) and all(pose_channels(recording, b) is not None for b in bodies)


def pose_channels(recording: MechanismRecording, body: str) -> tuple[list[int], str] | None:
    """Return the channels of a body's x, y, z and the column of its orientation; None: not all are measured."""
    sources = recording.mapping.sources
    place = {s.index: k for k, s in enumerate(sources) if s.target == body and s.quantity == "position"}
    turn = next((s.column for s in sources if s.target == body and s.quantity == "orientation"), None)
    return ([place[i] for i in range(3)], turn) if len(place) == len("xyz") and turn is not None else None


def flights(recording: MechanismRecording, coordinates: Coordinates, model: mujoco.MjModel) -> list[list[Span]]:
    """Return when, by the measured poses and the believed sizes, nothing touches anything, for each episode.

    Args:
        recording: The case; every body's pose is measured (`measured_freely`).
        coordinates: Of the model.
        model: As believed; not written to.
    """
    near = copy.copy(model)
    near.geom_margin[:] = 0.5 * MECHANISM.flight.clearance * size_m(model)
    data = mujoco.MjData(near)
    return [_flights(e, k, recording, coordinates, near, data) for k, e in enumerate(recording.episodes)]


def size_m(model: mujoco.MjModel) -> float:
    """Return how large the smallest moving body is: its bounding radius."""
    moving = [
        r
        for r, b in zip(model.geom_rbound, model.geom_bodyid, strict=True)
        if model.body_weldid[b] != 0 and not parts.is_of_air(model.body(b).name)
    ]
    return float(min((r for r in moving if r > 0), default=0.1))


def _flights(
    episode: MechanismEpisode,
    number: int,
    recording: MechanismRecording,
    coordinates: Coordinates,
    near: mujoco.MjModel,
    data: mujoco.MjData,
) -> list[Span]:
    where: Mapping[int, tuple[slice, list[int], str]] = {
        i: (joint.q, *found)
        for i, joint in enumerate(coordinates.joints)
        if (found := pose_channels(recording, near.body(int(near.jnt_bodyid[i])).name)) is not None
    }
    every = max(1, len(episode) // MECHANISM.flight.max_looked_at)
    looked_at, clear = list[int](), list[float]()
    for k in range(0, len(episode), every):
        for q, places, turn in where.values():
            data.qpos[q] = np.concatenate([episode.values[k, places], episode.orientations[turn][k]])
        if np.isfinite(data.qpos).all():
            mujoco.mj_kinematics(near, data)
            mujoco.mj_collision(near, data)
            looked_at.append(k)
            clear.append(float(data.ncon == 0))
    if not looked_at:
        return []
    # where a reading was lost, and between those that are looked at, what is flight on both sides of it is flight
    free = np.interp(np.arange(len(episode)), looked_at, clear) == 1.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(int)))
    fewest = SETTINGS.fit.min_start_samples
    least = max(fewest, round(MECHANISM.flight.min_length_s / episode.step_s))
    return [Span(number, int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= (least if a else fewest)]


def rests(recording: MechanismRecording, coordinates: Coordinates, model: mujoco.MjModel) -> list[Span]:
    """Return the last part of each episode in which nothing moves any more, where there is one.

    Of a body that lies there, its height tells its size and its pose which way the floor leans.
    """
    out = []
    bodies = [model.body(int(model.jnt_bodyid[i])).name for i in range(len(coordinates.joints))]
    poses = [found for b in bodies if (found := pose_channels(recording, b)) is not None]
    size, limits = size_m(model), MECHANISM.flight
    for e, episode in enumerate(recording.episodes):
        moved = np.zeros(len(episode))
        for places, turn in poses:
            q = episode.orientations[turn]
            moved = np.maximum(moved, np.linalg.norm(episode.values[:, places] - episode.values[-1, places], axis=1))
            # the chord of a turn, at the distance of the size
            moved = np.maximum(moved, size * np.minimum(*(2 * np.linalg.norm(q - s * q[-1], axis=1) for s in (1, -1))))
        still = np.isfinite(moved) & (moved < limits.still * size)
        begin = len(episode) - int(np.argmin(still[::-1])) if not still.all() else 0
        begin = max(begin, len(episode) - round(limits.max_length_s / episode.step_s))
        if len(episode) - begin >= 2 * SETTINGS.fit.min_start_samples:
            out.append(Span(e, begin, len(episode)))
    return [out[i] for i in spread_over(len(out), limits.rests)]


def into_impacts(recording: MechanismRecording, found: Sequence[Sequence[Span]], after_s: float) -> tuple[Span, ...]:
    """Return stretches from flights until so long after they end; where an episode has none, from its beginning.

    Args:
        recording: The case.
        found: Flights of each episode.
        after_s: How much of what follows a flight.
    """
    out = []
    for e, (episode, own) in enumerate(zip(recording.episodes, found, strict=True)):
        after, longest = (max(1, round(s / episode.step_s)) for s in (after_s, MECHANISM.flight.max_length_s))
        begins = [max(s.begin, s.end - longest) for s in own]
        for begin, span, following in zip(begins, own, [*begins, len(episode)][1:], strict=True):
            out.append(Span(e, begin, min(span.end + after, following)))
        if not own:
            out.append(Span(e, 0, min(after, len(episode))))
    return tuple(out)
