"""What was read as something else than it is, told by the model: units, signals, axes, the order of quaternions.

Units as `runner.systems.misread` has it. In the same way the model as believed is asked what it would miss if two
signals were exchanged. Likewise a body that lies on something lies flat on it, and with its quaternions in another
order it does not.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import mujoco
import numpy as np

from runner.importing.guess.fall import falls_otherwise
from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.coordinates import FREE, Coordinates
from runner.systems.mechanism.flights import measured_freely, pose_channels, rests, size_m
from runner.systems.mechanism.initial import MechanismStart
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.scope import raw_signals
from runner.systems.mechanism.simulator import MechanismSimulator
from runner.systems.misread import (
    FEWER,
    FEWEST_SAMPLES,
    FOLLOWED,
    FOLLOWS,
    UNITS,
    WINDOW_S,
    WINDOWS,
    in_another_unit,
    percent,
    share_missed,
)
from runner.systems.windows import Windows, windows_of

WHAT = {"rad": "Angles", "m": "Ways"}
LIES_OFF = 0.15  # of a body's size: nobody measures poses that badly, nor is off by that in how large it is
SCALAR = "read with the scalar in the wrong place (`order` of the map: wxyz or xyzw)"
FLIES_S, Y_UP = 0.3, np.array([0.5**0.5, 0.5**0.5, 0.0, 0.0])  # of a flight; the turn that puts y where z is
POSES = 400  # that are looked at: each costs a search for the nearest points
Turned = Callable[[FloatArray], FloatArray]
Clearance = Callable[[FloatArray], float]
# by what a quaternion may have been read as
READ_AS: tuple[tuple[str, Turned], ...] = (
    (SCALAR, lambda q: np.roll(q, 1, axis=-1)),
    (SCALAR, lambda q: np.roll(q, -1, axis=-1)),
    (SCALAR, lambda q: _with_y_up(q, 1)),
    (SCALAR, lambda q: _with_y_up(q, -1)),
    ("measured as the turn of the world against the body, not of the body against the world", quaternions.inverse),
)


def _with_y_up(q: FloatArray, shift: int) -> FloatArray:
    """Return quaternions (..., 4) whose numbers are that many places further in a log in whose world y points up."""
    back = quaternions.inverse(Y_UP)
    of_log = quaternions.multiply(quaternions.multiply(back, q), Y_UP)
    return quaternions.multiply(quaternions.multiply(Y_UP, np.roll(of_log, shift, axis=-1)), back)


def in_other_units(recording: MechanismRecording, models: Models) -> list[str]:
    """Say of which joints the model as believed follows the motion far better if it was read in a wrong unit.

    All of a kind may have been, with the targets of their servos, or else the measurements, or targets, of one alone.

    Args:
        recording: The case.
        models: Its compiled models.
    """
    mapping, out = recording.mapping, []
    for unit in UNITS:
        channels = [k for k, s in enumerate(mapping.sources) if (s.kind, s.unit) == ("joint", unit)]
        measured = [k for k, s in enumerate(mapping.sources) if s.kind == "joint" and s.unit.split("/")[0] == unit]
        targets = [k for k, c in enumerate(mapping.commands.values()) if c.unit == unit]
        out += _in_another_unit(recording, models, WHAT[unit], unit, channels, measured, targets)
    return out or _of_one_in_another_unit(recording, models)


def _of_one_in_another_unit(recording: MechanismRecording, models: Models) -> list[str]:
    """Say of which one joint, or servo, that is so: of those that miss much of their own motion."""
    mapping, model, out = recording.mapping, models.compiled(()).model, []
    joints = dict.fromkeys(s.target for s in mapping.sources if s.kind == "joint")
    for joint in joints:
        measured = [k for k, s in enumerate(mapping.sources) if (s.kind, s.target) == ("joint", joint)]
        places = [k for k in measured if mapping.sources[k].unit in UNITS]
        if not places or not _missed(recording, models, places) > FOLLOWS:
            continue
        unit = mapping.sources[places[0]].unit
        out += _in_another_unit(recording, models, f"Measurements of joint '{joint}'", unit, places, measured, [])
        for k, (name, command) in enumerate(mapping.commands.items()):
            driven = model.joint(int(model.actuator(command.actuator).trnid[0])).name
            if command.unit == unit and driven == joint:
                out += _in_another_unit(recording, models, f"Commands '{name}'", unit, places, [], [k])
    return out


def _in_another_unit(
    recording: MechanismRecording,
    models: Models,
    what: str,
    unit: str,
    channels: Sequence[int],
    measured: Sequence[int],
    commands: Sequence[int],
) -> list[str]:
    """Say whether the motion of some channels is followed far better if what was measured and commanded is larger."""

    def missed(factor: float) -> float:
        other = recording if factor == 1.0 else _scaled(recording, measured, commands, factor)
        return _missed(other, models, channels)

    return in_another_unit(what, unit, missed)


def exchanged(recording: MechanismRecording, models: Models) -> list[str]:
    """Say which two commands, or joints, the model as believed follows far better the one in the other's place.

    Args:
        recording: The case.
        models: Its compiled models.
    """
    sources, commands = recording.mapping.sources, recording.mapping.commands
    channels = [k for k, s in enumerate(sources) if s.kind == "joint"]
    as_read = _missed(recording, models, channels)
    if not as_read > FOLLOWED:
        return []
    units = [(name, c.unit) for name, c in commands.items()]
    joints: dict[str, dict[str, int]] = {}
    for k in channels:
        joints.setdefault(sources[k].target, {})[f"{sources[k].quantity} {sources[k].unit}"] = k
    other: list[tuple[str, MechanismRecording]] = [
        (f"commands '{a}' and '{b}'", _swapped(recording, commands={i: j, j: i}))
        for (i, (a, unit)), (j, (b, its)) in itertools.combinations(enumerate(units), 2)
        if unit == its
    ]
    for (a, own), (b, its) in itertools.combinations(joints.items(), 2):
        if own.keys() == its.keys():
            both = {own[k]: its[k] for k in own}
            swapped = _swapped(recording, channels=both | {j: i for i, j in both.items()})
            other.append((f"measurements of joints '{a}' and '{b}'", swapped))
    enough = min(FOLLOWS, FEWER * as_read)
    found = sorted((missed, what) for what, of in other if (missed := _missed(of, models, channels)) < enough)
    if not found:
        return []
    said = " or ".join(f"{percent(missed)} with {what} in each other's place" for missed, what in found)
    return [
        f"Signals may have been exchanged: within {WINDOW_S:g} s the model as believed misses {percent(as_read)} of "
        f"the motion, and {said}"
    ]


def _swapped(
    recording: MechanismRecording,
    *,
    commands: Mapping[int, int] = MappingProxyType({}),
    channels: Mapping[int, int] = MappingProxyType({}),
) -> MechanismRecording:
    """Return a recording with columns of its commands, or its channels, taken from others."""
    mapping = recording.mapping
    by = [commands.get(k, k) for k in range(len(mapping.commands))]
    values = [channels.get(k, k) for k in range(len(mapping.sources))]

    def of(episode: MechanismEpisode) -> MechanismEpisode:
        after = None if episode.after is None else of(episode.after)
        return replace(episode, values=episode.values[:, values], commands=episode.commands[:, by], after=after)

    return replace(recording, episodes=tuple(map(of, recording.episodes)))


def _scaled(
    recording: MechanismRecording, channels: Sequence[int], commands: Sequence[int], factor: float
) -> MechanismRecording:
    """Return a recording in which some channels and commands are so many times as large."""
    measured, commanded = np.ones(len(recording.mapping.sources)), np.ones(len(recording.mapping.commands))
    measured[list(channels)], commanded[list(commands)] = factor, factor

    def of(episode: MechanismEpisode) -> MechanismEpisode:
        after = None if episode.after is None else of(episode.after)
        return replace(episode, values=episode.values * measured, commands=episode.commands * commanded, after=after)

    return replace(recording, episodes=tuple(map(of, recording.episodes)))


def _missed(recording: MechanismRecording, models: Models, channels: Sequence[int]) -> float:
    """Return what the model as believed misses of the motion in short windows, as a share of it: root mean square.

    Over channels, each by its own motion; NaN where there is none.
    """
    if not channels or (replayed := _replayed(recording, models, WINDOW_S)) is None:
        return np.nan
    windows, shown = replayed
    measured = windows.of([e.values for e in recording.episodes])
    return share_missed(shown[..., channels], measured[..., channels])


def _replayed(recording: MechanismRecording, models: Models, length_s: float) -> tuple[Windows, FloatArray] | None:
    """Return some windows that are about as long, and what the model as believed shows in each, (W, n, C).

    None where no episode is so long.
    """
    signals, samples = raw_signals(recording), max(FEWEST_SAMPLES, round(length_s / recording.step_s))
    windows = windows_of([len(t) for t in recording.episodes], samples).some(WINDOWS)
    if not len(windows):
        return None
    starts = MechanismStart(recording, models, signals.sigma).guess_windows(signals, windows, smooth=True)
    simulator = MechanismSimulator(recording, models, models.file_step_s)
    with np.errstate(invalid="ignore", over="ignore"):
        return windows, simulator.predict_windows((), windows, starts[:, None])[:, 0]


def falling_otherwise(recording: MechanismRecording, models: Models) -> list[str]:
    """Say which free bodies fall as they would in another unit, or along another axis, than the model's gravity has it.

    Args:
        recording: The case.
        models: Its compiled models.
    """
    model, out = models.compiled(()).model, []
    for joint in np.flatnonzero(model.jnt_type == FREE):
        body = model.body(int(model.jnt_bodyid[joint])).name
        found = pose_channels(recording, body)
        if found is None:
            continue
        places = np.concatenate([e.values[:, found[0]] for e in recording.episodes])
        times = np.concatenate([e.t_s for e in recording.episodes])
        if said := falls_otherwise(times, places, np.array(model.opt.gravity)):
            out.append(
                f"'{body}' {said}: is the unit of its positions m, do the axes stand right, and is the clock in s?"
            )
    return out


def in_another_order(recording: MechanismRecording, models: Models, coordinates: Coordinates) -> list[str]:
    """Say which bodies that were measured as a whole would lie flat, or tumble as they do, if read otherwise.

    Args:
        recording: The case.
        models: Its compiled models.
        coordinates: Of the believed model.
    """
    model = models.compiled(()).model
    if not measured_freely(recording, coordinates, model):
        return []
    size, lying = size_m(model), {(s.episode, s.end - 1) for s in rests(recording, coordinates, model)}
    every = max(1, sum(map(len, recording.episodes)) // POSES)
    poses = [(e, k) for e, of in enumerate(recording.episodes) for k in range(e % every, len(of), every)]
    out = []
    for joint in range(model.njnt):
        body, above = model.body(int(model.jnt_bodyid[joint])).name, _clearance(model, joint)
        places, turn = pose_channels(recording, body) or ([], "")

        def off(turned: Turned, above: Clearance = above, places: Sequence[int] = places, turn: str = turn) -> float:
            largest = -np.inf
            for e, k in {*poses, *lying}:
                of = recording.episodes[e]
                clear = above(np.concatenate([of.values[k, places], turned(of.orientations[turn][k])]))
                largest = max(largest, abs(clear) if (e, k) in lying else -clear)
            return largest

        said = f"Orientations of '{body}' may have been "
        deep = off(lambda q: q)
        if deep > LIES_OFF * size:
            otherwise, how = min(((off(turned), how) for how, turned in READ_AS), key=lambda of: of[0])
            if otherwise < FEWER * deep:
                out.append(
                    f"{said}{how}: as they are it is up to {1e3 * deep:.2g} mm deep in what it hits, or off what it "
                    f"rests on; otherwise {1e3 * otherwise:.2g} mm"
                )
                continue
        tumbles = _tumbles_otherwise(recording, models, body, lambda q: q)
        if tumbles > FOLLOWED:
            each = ((_tumbles_otherwise(recording, models, body, turned), how) for how, turned in READ_AS)
            otherwise, how = min(each, key=lambda of: of[0])
            if otherwise < min(FOLLOWS, FEWER * tumbles):
                out.append(
                    f"{said}{how}: within {FLIES_S:g} s the model as believed misses {percent(tumbles)} of its "
                    f"turning, otherwise {percent(otherwise)}"
                )
    return out


def _tumbles_otherwise(recording: MechanismRecording, models: Models, body: str, turned: Turned) -> float:
    """Return what the model as believed misses of how a body turns, as a share of that: the median of short windows."""
    _, turn = pose_channels(recording, body) or ([], "")
    other = replace(
        recording,
        episodes=tuple(
            replace(e, orientations={**e.orientations, turn: turned(e.orientations[turn])}) for e in recording.episodes
        ),
    )
    columns = [k for k, s in enumerate(recording.mapping.sources) if s.quantity == "orientation" and s.column == turn]
    if (replayed := _replayed(other, models, FLIES_S)) is None:
        return 0.0
    windows, shown = replayed
    missed = shown[..., columns]  # turns from what was measured
    q = windows.of([e.orientations[turn] for e in other.episodes])
    moved = quaternions.logarithm(quaternions.multiply(quaternions.inverse(q[:, :1]), q))
    share = np.sqrt(np.nansum(missed**2, axis=(1, 2)) / np.maximum(np.nansum(moved**2, axis=(1, 2)), 1e-12))
    return float(np.median(share))


def _clearance(model: mujoco.MjModel, joint: int) -> Clearance:
    """Return what tells how far the body of a free joint is above what never moves, m, from its pose, (7,).

    Below 0: in it; infinite where the pose was not measured.
    """
    data, q, far = mujoco.MjData(model), int(model.jnt_qposadr[joint]), 10 * size_m(model)
    root = model.body_rootid[model.geom_bodyid]
    still = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    hits = (model.geom_contype | model.geom_conaffinity) > 0
    pairs = [(a, b) for a in np.flatnonzero((root == int(model.jnt_bodyid[joint])) & hits) for b in still]

    def above(pose: FloatArray) -> float:
        if not np.isfinite(pose).all():
            return np.inf
        data.qpos[q : q + 7] = pose
        mujoco.mj_kinematics(model, data)
        return min((mujoco.mj_geomDistance(model, data, a, b, far, None) for a, b in pairs), default=np.inf)

    return above
