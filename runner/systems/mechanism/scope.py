"""What effects may know of a mechanism: how fast, how far, how hard it was moved; and which may be at work."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from runner.effects.mechanism import EFFECTS, MechanismEffect, Scope, SensorLag, SensorOffset, SensorScale, contacts
from runner.effects.vocabulary import Candidate, Vocabulary
from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.coordinates import HINGE, SLIDE, Coordinates
from runner.systems.mechanism.initial import MechanismStart
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.observer import turns_from
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.raw_signals import RawSignals, raw, spreads
from runner.systems.windows import Windows


def raw_signals(recording: MechanismRecording) -> RawSignals:
    """Return the channels of a recording with the stated noise, or where there is none a rough one."""
    shown = [_with_turns(recording, e) for e in recording.episodes]
    stated = np.array([recording.mapping.noise.get(s.name, np.nan) for s in recording.mapping.sources])
    return raw([e.values for e in recording.episodes], [e.t_s for e in recording.episodes], stated, shown)


def _with_turns(recording: MechanismRecording, episode: MechanismEpisode) -> FloatArray:
    """Return the channels of an episode with orientations as the way that the body has turned, its axes, (T, C).

    The sum of the turns from each sample to the next, which is smooth where the body tumbles, as a rotation vector from
    the first sample on is not, and whose noise is that of the samples.
    """

    def turns(q: FloatArray) -> FloatArray:
        steps = quaternions.logarithm(quaternions.multiply(quaternions.inverse(q[:-1]), q[1:]))
        return np.concatenate([np.zeros((min(len(q), 1), 3)), np.cumsum(steps, axis=0)])

    return _with_orientations(recording, episode, turns)


def with_rotation_vectors(recording: MechanismRecording, episode: MechanismEpisode) -> FloatArray:
    """Return the channels of an episode with orientations as rotation vectors, (T, C); NaN where not measured."""
    level = np.array([1.0, 0.0, 0.0, 0.0])
    return _with_orientations(recording, episode, lambda q: turns_from(level, q))


def _with_orientations(
    recording: MechanismRecording, episode: MechanismEpisode, turns: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """Return the channels with what `turns` makes of the orientations that were measured, (n, 4) to (n, 3)."""
    out = np.array(episode.values)
    for k, source in enumerate(recording.mapping.sources):
        if source.quantity == "orientation" and source.index == 0:
            measured = episode.orientations[source.column]
            there = np.isfinite(measured).all(axis=1)
            out[:, k : k + 3] = np.nan
            out[there, k : k + 3] = turns(measured[there])
    return out


def scope_of(recording: MechanismRecording, models: Models, initial: MechanismStart, signals: RawSignals) -> Scope:
    """Return what effects may know of a recording."""
    model, coordinates = models.compiled(()).model, initial.coordinates
    speed, reach, force = _motion(recording, models, initial, signals)
    commands = np.concatenate([e.commands for e in recording.episodes])
    targets = [c.actuator for c in recording.mapping.commands.values()]
    spread = spreads(signals.values)
    names = [j.name for j in coordinates.joints if j.kind in (HINGE, SLIDE)]
    dofs = [j.v.start for j in coordinates.joints if j.kind in (HINGE, SLIDE)]
    return Scope(
        model=model,
        target=None,
        speed={n: float(speed[d]) for n, d in zip(names, dofs, strict=True)},
        reach={n: float(reach[d]) for n, d in zip(names, dofs, strict=True)},
        force={n: float(force[d]) for n, d in zip(names, dofs, strict=True)},
        command={n: float(np.abs(commands[:, k]).max()) for k, n in enumerate(targets)},
        demand=_demand(recording, models, initial, signals),
        signal={s.name: float(spread[k]) for k, s in enumerate(recording.mapping.sources)},
        length_s=max(float(e.t_s[-1] - e.t_s[0]) for e in recording.episodes),
        step_s=recording.step_s,
        pushed=frozenset(f.body for f in recording.mapping.forces),
    )


def _motion(
    recording: MechanismRecording, models: Models, initial: MechanismStart, signals: RawSignals
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return root mean square speed, half the range and root mean square force of each degree of freedom, (nv,)."""
    coordinates, total = initial.coordinates, sum(len(e) for e in recording.episodes)
    every = max(1, total // MECHANISM.signal.looked_at, round(MECHANISM.signal.apart_s / recording.step_s))
    model = models.edited(())
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    speeds, places, forces = [], [], []
    for episode, first, place, rates in _states(recording, initial, signals, every):
        places.append(place)
        speeds.append(rates)
        if len(first) < 2:
            continue
        accelerations = np.gradient(rates, episode.t_s[first], axis=0)
        for position, rate, acceleration in zip(place, rates, accelerations, strict=True):
            data.qpos[:] = coordinates.moved(models.qpos0, position)
            data.qvel[:], data.qacc[:] = rate, acceleration
            mujoco.mj_inverse(model, data)
            forces.append(np.array(data.qfrc_inverse))
    visited = np.concatenate(places)
    reach = 0.5 * (np.quantile(visited, 0.99, axis=0) - np.quantile(visited, 0.01, axis=0))
    force = np.array(forces) if forces else np.zeros((1, coordinates.nv))
    return _rms(np.concatenate(speeds)), reach, _rms(force)


def _states(
    recording: MechanismRecording, initial: MechanismStart, signals: RawSignals, every: int
) -> Iterator[tuple[MechanismEpisode, NDArray[np.int64], FloatArray, FloatArray]]:
    """Yield each episode with every so many of its samples, (n,), and positions and rates there, (n, nv) each."""
    for e, episode in enumerate(recording.episodes):
        first = np.arange(0, len(episode), every)
        x = initial.guess_windows(signals, Windows(np.full(len(first), e), first, 1), smooth=True)
        yield episode, first, x[:, : initial.coordinates.nv], x[:, initial.coordinates.nv :]


def _demand(
    recording: MechanismRecording, models: Models, initial: MechanismStart, signals: RawSignals
) -> dict[str, float]:
    """Return the largest force that each commanded actuator is asked for where the recording was, without any limit."""
    targets = [c.actuator for c in recording.mapping.commands.values()]
    if not targets:
        return {}
    every = max(1, sum(len(e) for e in recording.episodes) // MECHANISM.signal.asked)
    model = models.edited(())
    model.actuator_forcelimited[:] = 0
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, numbers = mujoco.MjData(model), [model.actuator(name).id for name in targets]
    largest = np.zeros(len(targets))
    for episode, first, position, rate in _states(recording, initial, signals, every):
        for q, v, command in zip(position, rate, episode.commands[first], strict=True):
            data.qpos[:], data.qvel[:] = initial.coordinates.moved(models.qpos0, q), v
            data.ctrl[numbers] = command
            mujoco.mj_forward(model, data)
            largest = np.fmax(largest, np.abs(data.actuator_force[numbers]))
    return dict(zip(targets, largest.tolist(), strict=True))


def _rms(values: FloatArray) -> FloatArray:
    return np.sqrt(np.mean(values**2, axis=0))


def vocabulary_of(recording: MechanismRecording, scope: Scope, coordinates: Coordinates) -> Vocabulary:
    """Return every effect that may be at work in a mechanism, bound to every target that it applies to."""
    targets: dict[str, list[str | None]] = {
        "joint": [j.name for j in coordinates.joints if j.kind in (HINGE, SLIDE)],
        "body": [*contacts.moving_bodies(scope.model)],
        "actuator": [c.actuator for c in recording.mapping.commands.values()],
        "channel": [s.name for s in recording.mapping.sources],
        "": [None],
    }
    candidates = []
    for cls in EFFECTS:
        single = [
            Candidate(cls, target, sole=len(targets[cls.target_kind]) == 1)
            for target in targets[cls.target_kind]
            if cls.applies(scope.at(target))
            and (cls.target_kind != "channel" or _of_its_own(cls, target, recording, scope.model))
        ]
        candidates += [*single, *_shared(single, scope)]
        if cls is SensorScale and (lengths := _tracked_lengths(recording)):
            candidates.append(Candidate(cls, lengths[0], lengths))
    return Vocabulary(tuple(candidates))


def _tracked_lengths(recording: MechanismRecording) -> tuple[str, ...]:
    """Return the channels that a wrong scale of what tracks bodies multiplies: all of their places and velocities."""
    sources = recording.mapping.sources
    return tuple(s.name for s in sources if s.kind == "body" and s.quantity in ("position", "velocity"))


def _shared(single: Sequence[Candidate], scope: Scope) -> list[Candidate]:
    """Return the effect on all targets at once, where the same vector means the same numbers on each of them.

    What has one cause, such as the supply of all servos, or parts that are all alike, then takes one number, not one
    for each.
    """
    if len(single) < 2 or not single[0].effect.shared:
        return []
    first = single[0].parameters(scope)
    vectors = [np.zeros(len(first)), np.array([0.1 * p.scale for p in first])]
    for c in single[1:]:
        same = [c.make(x, scope)[0].report() == single[0].make(x, scope)[0].report() for x in vectors]
        if not all(same):
            return []
    return [Candidate(single[0].effect, single[0].target, tuple(str(c.target) for c in single))]


def _of_its_own(
    cls: type[MechanismEffect], channel: str | None, recording: MechanismRecording, model: mujoco.MjModel
) -> bool:
    """Whether a channel can be filtered, scaled or shifted by itself, and that shows.

    What tracks a body filters and scales all axes of a pose alike; a shift along an even floor changes nothing.
    """
    source = next(s for s in recording.mapping.sources if s.name == channel)
    if source.kind != "body" or source.quantity != "position":
        return True
    if issubclass(cls, SensorOffset) and contacts.is_free(model, source.target):
        return not contacts.is_even(model, source.index)
    return not issubclass(cls, SensorLag | SensorScale)
