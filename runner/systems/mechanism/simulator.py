"""Open-loop simulation of a mechanism: recorded commands through the believed model, with or without effects.

Everything runs in `mujoco.rollout` on all cores; trees of joints that touch nothing in `physics.joint_tree`, which
gives the same in less time. A *stretch* is what one rollout simulates: samples of an episode, from a start. Effects
outside the engine change commands before and channels after it.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from mujoco import rollout

from runner.effects.base import Effects
from runner.effects.mechanism.base import MechanismEffect
from runner.numerics.arrays import FloatArray
from runner.physics import joint_tree
from runner.physics.joint_tree import Tree
from runner.recording import Span
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import is_servo
from runner.recording.model_form_mjcf import quiet
from runner.systems.mechanism.commands import Commands
from runner.systems.mechanism.held import even_times
from runner.systems.mechanism.models import Compiled, Models, mechanical
from runner.systems.mechanism.observer import Observer, States
from runner.systems.mechanism.readings import Readings, on_readings
from runner.systems.simulator import AbstractSimulator, Run, alike, of_each
from runner.systems.windows import Windows

FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
BYTES_AT_ONCE = 60e6  # of states and commands
HUGE = 1e8  # a coordinate or velocity beyond has diverged
SHORTEST_STEP_S = 0.0002  # harder contacts than that resolves are as hard as it resolves
# By which a spring that effects have added may swing in a step, as an angle of its phase; and in surveys.
PER_STEP_RAD, PER_SURVEY_STEP_RAD = 0.05, 0.25
ADDED_JOINTS_S = 0.001  # the longest step of a model with joints that effects have added: light, and often in contact


@dataclass(frozen=True)
class Stretch:
    """What one rollout simulates.

    Args:
        episode: Of the recording.
        begin: First sample.
        end: After the last.
        effects: In the model.
        start: The true start, (S,).
        disturbance: A constant generalised force, (nv,) of the believed model; None: none.
    """

    episode: int
    begin: int
    end: int
    effects: Effects
    start: FloatArray
    disturbance: FloatArray | None = None


@dataclass(frozen=True)
class _Batch:
    """What one rollout simulates: stretches, their models, which are of one shape, and steps of one length.

    The first may be shorter: it lasts `first_s`. All go on for as many steps as the longest has.
    """

    compiled: Compiled
    models: Sequence[mujoco.MjModel]
    trees: Sequence[Tree | None]
    stretches: Sequence[Stretch]
    lengths: Sequence[int]
    step_s: float
    first_s: float

    @cached_property
    def steps(self) -> int:
        """Of the longest."""
        return max(self.lengths)


class MechanismSimulator(AbstractSimulator):
    """Simulates a recording in model form.

    Args:
        recording: The case.
        models: Its compiled models.
        step_s: Physics step.
        threads: For the rollouts; None: one per core.
        rough: Whether springs that effects add are told apart as in a survey: how they ring may be off.

    Attributes:
        survey_step_s: Physics step of surveys of all effects, see `surveying`; to begin with the same.
    """

    def __init__(
        self,
        recording: MechanismRecording,
        models: Models,
        step_s: float,
        threads: int | None = None,
        *,
        rough: bool = False,
    ) -> None:
        self.recording, self.models, self.step_s = recording, models, step_s
        self.survey_step_s = step_s
        self.simulated_s = 0.0
        self._per_step_rad = PER_SURVEY_STEP_RAD if rough else PER_STEP_RAD
        self.threads = min(threads or models.threads, models.threads)
        self._pool = rollout.Rollout(nthread=self.threads if self.threads > 1 else 0)
        self._spans = tuple(Span(i, 0, len(e)) for i, e in enumerate(recording.episodes))
        self._commands = Commands(recording, models.compiled(()).model, models.believed_delays)
        self._readings = Readings(recording, models)

    def surveying(self) -> MechanismSimulator:
        """See the base class."""
        other = self.stepping(self.survey_step_s)
        other._per_step_rad = PER_SURVEY_STEP_RAD
        return other

    def stepping(self, step_s: float) -> MechanismSimulator:
        """Return a simulator of the same with another physics step."""
        other = copy.copy(self)  # threads and commands are shared
        other.step_s, other.simulated_s = step_s, 0.0
        return other

    def parts(self, spans: Sequence[Span]) -> MechanismSimulator:
        """Return a simulator of parts of what this one simulates; `episode` counts what that is."""
        whole = [self._spans[s.episode] for s in spans]
        inside = tuple(Span(w.episode, w.begin + s.begin, w.begin + s.end) for w, s in zip(whole, spans, strict=True))
        part = copy.copy(self)  # threads and commands are shared
        part._spans, part.simulated_s = inside, 0.0
        return part

    def predict_each(self, asked: Sequence[tuple[int, Sequence[Run]]]) -> list[FloatArray]:
        """See the base class."""
        spans = [self._spans[episode] for episode, _ in asked]
        stretches = [
            Stretch(s.episode, s.begin, s.end, r.effects, r.start)
            for s, (_, runs) in zip(spans, asked, strict=True)
            for r in runs
        ]
        return of_each(self.simulate(stretches), asked, spans, len(self.recording.mapping.sources))

    def predict_windows(
        self, effects: Effects, windows: Windows, starts: FloatArray, disturbance: FloatArray | None = None
    ) -> FloatArray:
        """Return the predicted channels in windows, each begun anew, (W, K, samples, C); see the base class."""
        count, columns = starts.shape[:2]
        force = None
        if disturbance is not None:
            force = np.broadcast_to(disturbance, (count, columns, disturbance.shape[-1]))
        stretches = []
        for w in range(count):
            span = self._spans[int(windows.episode[w])]
            first = span.begin + int(windows.first[w])
            true = self._readings.behind(effects, starts[w], self.step_s, at_rest=self._readings.at_rest(first))
            for k in range(columns):
                push = None if force is None else force[w, k]
                stretches.append(Stretch(span.episode, first, first + windows.samples, effects, true[k], push))
        return np.reshape(self.simulate(stretches), (count, columns, windows.samples, -1))

    def simulate(self, stretches: Sequence[Stretch]) -> list[FloatArray]:
        """Return the predicted channels of each stretch at its samples, (T, C); NaN once it has diverged."""
        out: dict[int, FloatArray] = {}
        groups: dict[tuple[object, float, float], list[int]] = {}
        kinds: dict[int, tuple[object, float, float]] = {}  # of effects that many stretches share, by which they are
        for i, stretch in enumerate(stretches):
            if id(stretch.effects) not in kinds:
                compiled = self.models.compiled(stretch.effects)
                step_s = self._step(compiled, stretch.effects)
                first_s = self._commands.first_s(stretch.effects, step_s)
                kinds[id(stretch.effects)] = compiled.signature, step_s, first_s
            groups.setdefault(kinds[id(stretch.effects)], []).append(i)
        for (_, step_s, first_s), every in groups.items():
            compiled = self.models.compiled(stretches[every[0]].effects)
            width = mujoco.mj_stateSize(compiled.model, FULL) + mujoco.mj_stateSize(compiled.model, CONTROL)
            lengths = [self._steps(stretches[i], step_s) for i in every]
            for members in alike(lengths):
                at_once = max(1, int(BYTES_AT_ONCE / (8.0 * lengths[members[0]] * width)))
                for k in range(0, len(members), at_once):
                    some = members[k : k + at_once]
                    chosen = [stretches[every[m]] for m in some]
                    models, trees = zip(*(self.models.with_tree(s.effects, step_s) for s in chosen), strict=True)
                    batch = _Batch(compiled, models, trees, chosen, [lengths[m] for m in some], step_s, first_s)
                    out |= zip((every[m] for m in some), self._simulate(batch), strict=True)
        return [out[i] for i in range(len(stretches))]

    def step_with(self, effects: Effects) -> float:
        """Return the physics step of a model with these effects, s."""
        return self._step(self.models.compiled(effects), effects)

    def _step(self, compiled: Compiled, effects: Effects) -> float:
        """Return the step of a model: a whole part of the usual one where effects have added what asks for less.

        MuJoCo softens contacts whose time constant is below two steps, and takes the damping of a spring at the end of
        a step, so that the spring rings longer and slower, by a share of the order of what it swings in a step.
        """
        added = compiled.model.nv > self.models.believed_coordinates.nv
        longest_s = ADDED_JOINTS_S if added else np.inf
        fastest_rad_s = max((e.swings_rad_s(compiled.model) for e in mechanical(effects)), default=0.0)
        if fastest_rad_s > 0.0:
            longest_s = min(longest_s, max(self._per_step_rad / fastest_rad_s, SHORTEST_STEP_S))
        contact_s = self.models.contact_time_s(effects)
        if contact_s < self.models.contact_time_s(()):
            longest_s = min(longest_s, max(0.5 * contact_s, SHORTEST_STEP_S))
        return self.step_s / max(1, int(np.ceil(self.step_s / longest_s - 1e-9)))

    def _steps(self, stretch: Stretch, step_s: float) -> int:
        """Return how many physics steps reach the last sample."""
        t = self.recording.episodes[stretch.episode].t_s
        return max(1, int(np.ceil((t[stretch.end - 1] - t[stretch.begin]) / step_s - 1e-6)))

    def _simulate(self, batch: _Batch) -> list[FloatArray]:
        model, runs = batch.compiled.model, len(batch.stretches)
        # the command of a further step: a force is read under the one that follows the last sample
        control = np.zeros((runs, batch.steps + 1, mujoco.mj_stateSize(model, CONTROL)))
        start = np.zeros((runs, mujoco.mj_stateSize(model, FULL)))
        with quiet():
            for r, s in enumerate(batch.stretches):
                control[r, :, : model.nu] = self._commands.control(
                    s.effects, s.episode, self._time(s), batch.steps + 1, batch.step_s, model
                )
                if s.disturbance is not None:
                    control[r, :, model.nu :] = self._generalised(s.disturbance, batch.compiled)
                start[r] = self._initial(s, batch.compiled, batch.models[r], control[r, 0, : model.nu])
            states = self._states(batch, start, control)
        self.simulated_s += batch.steps * batch.step_s * runs
        return self._sampled(batch, states, control)

    def _initial(self, stretch: Stretch, compiled: Compiled, model: mujoco.MjModel, command: FloatArray) -> FloatArray:
        """Return the state at the first sample."""
        q, v = _places(model)
        out = np.zeros(mujoco.mj_stateSize(model, FULL))
        out[0] = self._time(stretch)
        out[q], out[v] = self._start(stretch, compiled, model, command)
        out[v.stop : v.stop + model.na] = _activation(model, out[q], command)
        return out

    def _states(self, batch: _Batch, start: FloatArray, control: FloatArray) -> FloatArray:
        """Return states in even steps (R, n + 1, ...) from starts (R, ...) on, under commands (R, n + 1, ...)."""
        if batch.first_s == batch.step_s:
            return self._stepped(batch, start, control[:, :-1])
        # the first is a part of a whole step; samples lie at one and the same part of those that follow
        share = batch.first_s / batch.step_s
        second = _within(batch.compiled, self._stepped(batch, start, control[:, :1]), share)[:, 0]
        after = self._stepped(batch, second, control[:, 1:])
        return np.concatenate([start[:, None], _within(batch.compiled, after, 1.0 - share)], axis=1)

    def _stepped(self, batch: _Batch, start: FloatArray, control: FloatArray) -> FloatArray:
        """Return states (R, n + 1, ...) after whole steps under commands (R, n, ...); NaN once it has diverged."""
        runs, moved, (q, v) = len(start), batch.compiled.coordinates.moved, _places(batch.compiled.model)
        step_s = np.array([[model.opt.timestep] for model in batch.models])  # another one where a clock is off
        # MuJoCo's positions are half a step ahead of its velocities
        lead_s = 0.5 * step_s if self.models.leapfrog else np.zeros_like(step_s)
        initial = start.copy()
        initial[:, q] = moved(start[:, q], lead_s * start[:, v])
        trees = [tree for tree in batch.trees if tree is not None]
        if len(trees) == runs:
            after = joint_tree.rollout(trees, initial, control, self.threads)
        else:
            after, _ = self._pool.rollout(
                list(batch.models),
                list(batch.compiled.data[: self.threads]),
                initial,
                control,
                control_spec=CONTROL,
                chunk_size=max(1, min(16, runs // (4 * self.threads))),
            )
        # a run that has diverged stands still in time from there on
        stopped = np.diff(after[:, :, 0], axis=1, prepend=initial[:, None, 0]) < 0.5 * step_s
        after[stopped | ~(np.abs(after).max(axis=2) < HUGE)] = np.nan
        after[..., q] = moved(after[..., q], -lead_s[..., None] * after[..., v])
        return np.concatenate([start[:, None], after], axis=1)

    def _time(self, stretch: Stretch) -> float:
        """Return the time since its episode began at which a stretch begins."""
        t = self.recording.episodes[stretch.episode].t_s
        return float(t[stretch.begin] - t[0])

    def _start(
        self, stretch: Stretch, compiled: Compiled, model: mujoco.MjModel, command: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of all joints of a model at the start of a stretch, (nq,) and (nv,)."""
        believed = self.models.believed_coordinates
        at = believed.moved(self.models.qpos0, stretch.start[: believed.nv])
        rate = np.zeros(believed.nv) if self._readings.at_rest(stretch.begin) else stretch.start[believed.nv :]
        position, velocity = np.array(model.qpos0), np.zeros(model.nv)
        structural = [e for e in stretch.effects if e.structural and isinstance(e, MechanismEffect)]
        follows = {added: led for e in structural for added, led in e.follows.items()}
        for joint in compiled.coordinates.joints:
            own = believed.by_name.get(follows.get(joint.name, joint.name))
            if own is not None:
                position[joint.q], velocity[joint.v] = at[own.q], rate[own.v]
        if structural:
            data = compiled.data[0]
            mujoco.mj_resetData(model, data)
            data.time, data.ctrl[:], data.qpos[:], data.qvel[:] = self._time(stretch), command, position, velocity
            for effect in structural:
                effect.edit_start(model, data)
            position, velocity = np.array(data.qpos), np.array(data.qvel)
        return position, velocity

    def _generalised(self, force: FloatArray, compiled: Compiled) -> FloatArray:
        """Return a force on the believed joints as one on those of a model, (nv,)."""
        out = np.zeros(compiled.model.nv)
        for joint in self.models.believed_coordinates.joints:
            out[compiled.coordinates.by_name[joint.name].v] = force[joint.v]
        return out

    def _sampled(self, batch: _Batch, full: FloatArray, control: FloatArray) -> list[FloatArray]:
        """Return the channels of each stretch at its samples, (T, C), from states in even steps, (R, n + 1, ...)."""
        compiled, stretches = batch.compiled, batch.stretches
        q, v = _places(compiled.model)
        observer = Observer(self.recording, compiled)
        states = States(full[..., q], full[..., v], control[..., : compiled.model.nu])
        sensordata = self._sensordata(batch, full, control) if observer.needs_sensors else None
        shown = observer.channels(batch.models, states, sensordata)
        out: dict[int, FloatArray] = {}
        # effects on readings work on many runs at once, and so do samples at the same times
        together: dict[object, list[int]] = {}
        for r, s in enumerate(stretches):
            together.setdefault((on_readings(s.effects), s.episode, s.begin, s.end), []).append(r)
        for rows in together.values():
            s, count = stretches[rows[0]], batch.lengths[rows[0]] + 1
            some = {name: values[rows, :count] for name, values in shown.items()}
            grid = even_times(count, batch.step_s)
            sampled = self._readings.sampled(s.effects, s.episode, slice(s.begin, s.end), some, grid)
            out |= zip(rows, sampled, strict=True)
        return [out[r] for r in range(len(stretches))]

    def _sensordata(self, batch: _Batch, full: FloatArray, control: FloatArray) -> FloatArray:
        """Return MuJoCo's sensors in every state, (R, n + 1, nsensordata)."""
        runs, n = full.shape[:2]
        states = full.copy()
        lost = np.isnan(states).any(axis=-1)
        states[lost] = states[:, :1].repeat(n, axis=1)[lost]
        with quiet():
            _, sensordata = self._pool.rollout(
                [m for m in batch.models for _ in range(n)],
                list(batch.compiled.data[: self.threads]),
                states.reshape(runs * n, -1),
                control.reshape(runs * n, 1, -1),
                control_spec=CONTROL,
            )
        sensordata = sensordata.reshape(runs, n, -1)
        sensordata[lost] = np.nan
        return sensordata

    def seen_start(self, effects: Effects, start: FloatArray) -> FloatArray:
        """Return the true start (S,) that sensors with these effects show as the given one."""
        return self._readings.behind(effects, start[None], self.step_s, at_rest=self.recording.mapping.rests)[0]


def _places(model: mujoco.MjModel) -> tuple[slice, slice]:
    """Return where positions and velocities stand in a state; activations come next."""
    return slice(1, 1 + model.nq), slice(1 + model.nq, 1 + model.nq + model.nv)


def _within(compiled: Compiled, states: FloatArray, share: float) -> FloatArray:
    """Return the states (R, n, ...) when a share of each of the steps between n + 1 states has passed.

    A step's forces act evenly over all of it, so that the acceleration within it is uniform.
    """
    (q, v), coordinates = _places(compiled.model), compiled.coordinates
    before, after = states[:, :-1], states[:, 1:]
    out = before.copy()
    for part in slice(0, 1), slice(v.start, v.stop + compiled.model.na):
        out[..., part] += share * (after[..., part] - before[..., part])
    change = coordinates.difference(after[..., q], before[..., q])
    gained = (after[..., :1] - before[..., :1]) * (after[..., v] - before[..., v])
    out[..., q] = coordinates.moved(before[..., q], share * (change - 0.5 * (1.0 - share) * gained))
    return out


def _activation(model: mujoco.MjModel, position: FloatArray, command: FloatArray) -> FloatArray:
    """Return the actuators' states at a start, (na,): settled at the first command; an integrator at its position."""
    out = np.zeros(model.na)
    for a in range(model.nu if model.na else 0):
        first, count = int(model.actuator_actadr[a]), int(model.actuator_actnum[a])
        kind = mujoco.mjtDyn(int(model.actuator_dyntype[a]))
        if count == 1 and kind in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT):
            out[first] = command[a]
        elif count == 1 and kind == mujoco.mjtDyn.mjDYN_INTEGRATOR and is_servo(model, a):
            joint = int(model.actuator_trnid[a, 0])
            out[first] = model.actuator_gear[a, 0] * position[int(model.jnt_qposadr[joint])]
    return out


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))
