"""Open-loop simulation of a mechanism: recorded commands through the believed model, with or without effects.

Everything runs in `mujoco.rollout` on all cores. A *stretch* is what one rollout simulates: samples of an episode, from
a start. Effects outside the engine change commands before and channels after it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout

from runner.effects.mechanism.base import Command, MechanismEffect, Reading
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import is_servo
from runner.recording.model_form_mjcf import quiet
from runner.systems.base import AbstractSimulator, Effects, FloatArray, Run, Span, Windows
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.held import even_times, step_means
from runner.systems.mechanism.models import (
    Compiled,
    Models,
    force_actuators,
    force_weights,
)
from runner.systems.mechanism.observer import (
    Observer,
    Sampling,
    States,
    first_orientation,
    held_channels,
    turns_from,
)

FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
CONTROL = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
BYTES_AT_ONCE = 60e6  # of states and commands
KEPT_COMMANDS = 512
HUGE = 1e8  # a coordinate or velocity beyond has diverged
CORRECTIONS, EXACT = 30, 1e-12  # of a start that sensors show, until it is exact


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


class MechanismSimulator(AbstractSimulator):
    """Simulates a recording in model form.

    Args:
        recording: The case.
        models: Its compiled models.
        step_s: Physics step.
        threads: For the rollouts.
        spans: What is simulated, each on its own, with all that was commanded before; None: every episode.
    """

    def __init__(
        self,
        recording: MechanismRecording,
        models: Models,
        step_s: float,
        threads: int | None = None,
        spans: tuple[Span, ...] | None = None,
    ) -> None:
        self.recording, self.models, self.step_s = recording, models, step_s
        self.simulated_s = 0.0
        self.threads = min(threads or models.threads, models.threads)
        self._pool = rollout.Rollout(nthread=self.threads if self.threads > 1 else 0)
        self._spans = spans or tuple(Span(i, 0, len(e)) for i, e in enumerate(recording.episodes))
        self._sources = recording.mapping.sources
        self._held = held_channels(recording, models.compiled(()).model)
        self._commands: dict[tuple[Effects, int], dict[str, FloatArray]] = {}
        self._observers: dict[int, Observer] = {}

    def parts(self, spans: Sequence[Span]) -> MechanismSimulator:
        """Return a simulator of parts of what this one simulates; `episode` counts what that is."""
        whole = [self._spans[s.episode] for s in spans]
        inside = tuple(Span(w.episode, w.begin + s.begin, w.begin + s.end) for w, s in zip(whole, spans, strict=True))
        return MechanismSimulator(self.recording, self.models, self.step_s, self.threads, inside)

    def predict(self, episode: int, runs: Sequence[Run]) -> FloatArray:
        """Return the predicted channels at the samples of an episode, or span, (len(runs), T, C)."""
        span = self._spans[episode]
        return self.simulate([Stretch(span.episode, span.begin, span.end, r.effects, r.start) for r in runs])

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
            true = self._seen(effects, starts[w], at_rest=self._at_rest(first))
            for k in range(columns):
                push = None if force is None else force[w, k]
                stretches.append(Stretch(span.episode, first, first + windows.samples, effects, true[k], push))
        return self.simulate(stretches).reshape(count, columns, windows.samples, len(self._sources))

    def simulate(self, stretches: Sequence[Stretch]) -> FloatArray:
        """Return the predicted channels of stretches of equally many samples, (R, T, C); NaN once it has diverged."""
        samples = stretches[0].end - stretches[0].begin
        out = np.empty((len(stretches), samples, len(self._sources)))
        groups: dict[object, list[int]] = {}
        for i, stretch in enumerate(stretches):
            groups.setdefault(self.models.compiled(stretch.effects).signature, []).append(i)
        for members in groups.values():
            compiled = self.models.compiled(stretches[members[0]].effects)
            steps = max(self._steps(stretches[i]) for i in members)
            width = mujoco.mj_stateSize(compiled.model, FULL) + mujoco.mj_stateSize(compiled.model, CONTROL)
            at_once = max(1, int(BYTES_AT_ONCE / (8.0 * steps * width)))
            for k in range(0, len(members), at_once):
                some = members[k : k + at_once]
                out[some] = self._simulate(compiled, [stretches[i] for i in some], steps)
        return out

    def _at_rest(self, begin: int) -> bool:
        """Whether what begins at that sample of an episode begins at rest."""
        return begin == 0 and self.recording.mapping.rests

    def _steps(self, stretch: Stretch) -> int:
        """Return how many physics steps reach the last sample."""
        t = self.recording.episodes[stretch.episode].t_s
        return max(1, int(np.ceil((t[stretch.end - 1] - t[stretch.begin]) / self.step_s - 1e-6)))

    def _simulate(self, compiled: Compiled, stretches: Sequence[Stretch], steps: int) -> FloatArray:
        model = compiled.model
        models = [self.models.model(s.effects, self.step_s) for s in stretches]
        # one step more than is made: a force is read under the command that follows the last sample
        control = np.zeros((len(stretches), steps + 1, mujoco.mj_stateSize(model, CONTROL)))
        initial = np.zeros((len(stretches), mujoco.mj_stateSize(model, FULL)))
        for r, s in enumerate(stretches):
            control[r, :, : model.nu] = self._control(s, model, steps + 1)
            if s.disturbance is not None:
                control[r, :, model.nu :] = self._generalised(s.disturbance, compiled)
            initial[r] = self._initial(s, compiled, models[r], control[r, 0, : model.nu])
        with quiet():
            state, _ = self._pool.rollout(
                models,
                list(compiled.data[: self.threads]),
                initial,
                control[:, :-1],
                control_spec=CONTROL,
                chunk_size=max(1, min(16, len(models) // (4 * self.threads))),
            )
        self.simulated_s += steps * self.step_s * len(stretches)
        # a run that has diverged stands still in time from there on
        stopped = np.diff(state[:, :, 0], axis=1, prepend=initial[:, None, 0]) < 0.5 * self.step_s
        state[stopped | ~(np.abs(state).max(axis=2) < HUGE)] = np.nan
        full = np.concatenate([initial[:, None], state], axis=1)
        return self._sampled(compiled, models, stretches, full, control)

    def _initial(self, stretch: Stretch, compiled: Compiled, model: mujoco.MjModel, command: FloatArray) -> FloatArray:
        """Return the state that a rollout begins with: positions half a step ahead of velocities."""
        nq, nv = model.nq, model.nv
        position, velocity = self._start(stretch, compiled, model, command)
        out = np.zeros(mujoco.mj_stateSize(model, FULL))
        out[0] = self._time(stretch)
        out[1 + nq + nv : 1 + nq + nv + model.na] = _activation(model, position, command)
        if self.models.leapfrog:
            position = compiled.coordinates.moved(position, 0.5 * self.step_s * velocity)
        out[1 : 1 + nq], out[1 + nq : 1 + nq + nv] = position, velocity
        return out

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
        rate = np.zeros(believed.nv) if self._at_rest(stretch.begin) else stretch.start[believed.nv :]
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

    def _control(self, stretch: Stretch, model: mujoco.MjModel, steps: int) -> FloatArray:
        """Return the mean command of every actuator over each step, (steps, nu)."""
        columns = self._sent(stretch.effects, stretch.episode)
        out = np.zeros((steps, model.nu))
        place = self._time(stretch) / self.step_s
        first = round(place)
        aligned = abs(place - first) < 1e-6
        for name, column in columns.items():
            if aligned:
                part = column[first : first + steps]
                part = np.concatenate([part, np.repeat(column[-1:], steps - len(part))])
            else:
                edges = self._time(stretch) + even_times(steps + 1, self.step_s)
                grid = even_times(len(column), self.step_s)
                part = step_means(grid, column[:, None], edges, column[:1])[:, 0]
            out[:, model.actuator(name).id] = part
        return out

    def _sent(self, effects: Effects, episode: int) -> dict[str, FloatArray]:
        """Return what the actuators really get over a whole episode, by actuator, (n,) each."""
        editing = _on_commands(effects)
        key = editing, episode
        if key not in self._commands:
            if len(self._commands) > KEPT_COMMANDS:
                self._commands.clear()
            recorded, mapping = self.recording.episodes[episode], self.recording.mapping
            t = recorded.t_s - recorded.t_s[0]
            edges = even_times(int(np.ceil(t[-1] / self.step_s - 1e-6)) + 2, self.step_s)
            model = self.models.compiled(()).model
            names = [c.actuator for c in mapping.commands.values()]
            before = np.array(
                [recorded.commands[0, k] if is_servo(model, model.actuator(n).id) else 0.0 for k, n in enumerate(names)]
            )
            means = step_means(t, recorded.commands, edges, before)
            command = Command(
                self.step_s, dict(zip(names, means.T, strict=True)), dict(zip(names, before, strict=True))
            )
            for effect in editing:
                command = effect.edit_command(command)
            columns = dict(command.columns)
            for i in range(len(mapping.forces)):
                weights = force_weights(recorded.points_m[:, i], recorded.forces_n[:, i])
                columns |= dict(zip(force_actuators(i), step_means(t, weights, edges, np.zeros(12)).T, strict=True))
            self._commands[key] = columns
        return self._commands[key]

    def _observer(self, compiled: Compiled) -> Observer:
        if id(compiled) not in self._observers:
            self._observers[id(compiled)] = Observer(self.recording, compiled)
        return self._observers[id(compiled)]

    def _sampled(
        self,
        compiled: Compiled,
        models: Sequence[mujoco.MjModel],
        stretches: Sequence[Stretch],
        full: FloatArray,
        control: FloatArray,
    ) -> FloatArray:
        """Return the channels at the samples, (R, T, C), from states (R, n + 1, ...) with leading positions."""
        model, nq = compiled.model, compiled.model.nq
        position, velocity = full[..., 1 : 1 + nq], full[..., 1 + nq : 1 + nq + model.nv]
        if self.models.leapfrog:
            position = compiled.coordinates.moved(position, -0.5 * self.step_s * velocity)
        observer = self._observer(compiled)
        states = States(position, velocity, control[..., : model.nu])
        sensordata = self._sensordata(compiled, models, full, position, control) if observer.needs_sensors else None
        shown = observer.channels(models, states, sensordata)
        out = np.empty((len(stretches), stretches[0].end - stretches[0].begin, len(self._sources)))
        # effects on readings work on many runs at once, and so do samples at the same times
        together: dict[object, list[int]] = {}
        for r, s in enumerate(stretches):
            together.setdefault((_on_readings(s.effects), s.episode, s.begin), []).append(r)
        for rows in together.values():
            some = {name: values[rows] for name, values in shown.items()}
            out[rows] = self._read(stretches[rows[0]], some, full.shape[1])
        return out

    def _sensordata(
        self,
        compiled: Compiled,
        models: Sequence[mujoco.MjModel],
        full: FloatArray,
        position: FloatArray,
        control: FloatArray,
    ) -> FloatArray:
        """Return MuJoCo's sensors in every state, (R, n + 1, nsensordata), positions and velocities of one instant."""
        runs, n = full.shape[:2]
        states = full.copy()
        states[..., 1 : 1 + compiled.model.nq] = position
        lost = np.isnan(states).any(axis=-1)
        states[lost] = states[:, :1].repeat(n, axis=1)[lost]
        with quiet():
            _, sensordata = self._pool.rollout(
                [m for m in models for _ in range(n)],
                list(compiled.data[: self.threads]),
                states.reshape(runs * n, -1),
                control.reshape(runs * n, 1, -1),
                control_spec=CONTROL,
            )
        sensordata = sensordata.reshape(runs, n, -1)
        sensordata[lost] = np.nan
        return sensordata

    def _read(self, stretch: Stretch, shown: dict[str, FloatArray], n: int) -> FloatArray:
        """Return what the sensors report at the samples, (R, T, C), of runs with the same effects and samples."""
        episode = self.recording.episodes[stretch.episode]
        span = slice(stretch.begin, stretch.end)
        grid = even_times(n, self.step_s)
        sampling = Sampling(grid, episode.t_s[span] - episode.t_s[stretch.begin])
        numbers: dict[str, FloatArray] = {}
        for source in self._sources:
            if source.quantity != "orientation":
                numbers[source.name] = shown[source.name]
            elif source.index == 0:
                turn = turns_from(first_orientation(episode, source.column), shown[source.column])
                numbers |= {f"{source.column}.{a}": turn[..., i] for i, a in enumerate("xyz")}
        numbers = self._reported(stretch.effects, grid, numbers, at_rest=self._at_rest(stretch.begin))
        columns = []
        for source in self._sources:
            read = sampling.held if source.name in self._held else sampling.smooth
            columns.append(read(numbers[source.name]))
        out = np.stack(columns, axis=-1)
        for k, source in enumerate(self._sources):
            if source.quantity == "orientation" and source.index == 0:
                turn = quaternions.exponential(out[..., k : k + 3])
                whole = quaternions.multiply(first_orientation(episode, source.column), turn)
                measured = quaternions.inverse(episode.orientations[source.column][span])
                out[..., k : k + 3] = quaternions.logarithm(quaternions.multiply(measured, whole))
        return out

    def _reported(
        self, effects: Effects, grid: FloatArray, channels: dict[str, FloatArray], *, at_rest: bool
    ) -> dict[str, FloatArray]:
        """Return channels (R, n) on a grid as sensors with these effects report them."""
        reading = Reading(grid, channels, held_before=at_rest)
        for effect in _on_readings(effects):
            reading = effect.edit_reading(reading)
        return dict(reading.channels)

    def seen_start(self, effects: Effects, start: FloatArray) -> FloatArray:
        """Return the true start (S,) that sensors with these effects show as the given one."""
        return self._seen(effects, start[None], at_rest=self.recording.mapping.rests)[0]

    def _seen(self, effects: Effects, shown: FloatArray, *, at_rest: bool) -> FloatArray:
        """Return the true starts (R, S) that sensors with these effects show as the given ones.

        Of joints that are measured by themselves, each by its own channel; other coordinates are taken as shown. A
        velocity that no channel measures is the slope of the position's. Solved by repeated correction; the motion
        before is taken to be uniform.
        """
        true = shown.copy()
        if not _on_readings(effects):
            return true
        believed = self.models.believed_coordinates
        grid = even_times(2, self.step_s)
        wanted = self._own_channels(shown, grid)
        for _ in range(CORRECTIONS):
            reported = self._reported(effects, grid, self._own_channels(true, grid), at_rest=at_rest)
            error = np.zeros_like(true)
            for source in self._sources:
                if source.kind != "joint":
                    continue
                v = believed.by_name[source.target].v.start
                ahead = wanted[source.name] - reported[source.name]
                if source.quantity == "velocity":
                    error[:, believed.nv + v] = ahead[:, 0]
                else:
                    error[:, v] = ahead[:, 0]
                    if not self._measures_velocity(source.target):
                        error[:, believed.nv + v] = (ahead[:, 1] - ahead[:, 0]) / self.step_s
            true += error
            if np.abs(error).max(initial=0.0) < EXACT:
                break
        return true

    def _measures_velocity(self, joint: str) -> bool:
        return any(s.kind == "joint" and s.target == joint and s.quantity == "velocity" for s in self._sources)

    def _own_channels(self, starts: FloatArray, grid: FloatArray) -> dict[str, FloatArray]:
        """Return what each channel shows of uniform motion from starts (R, S), (R, n); 0 for all but joints' own."""
        believed = self.models.believed_coordinates
        out = {}
        for source in self._sources:
            out[source.name] = np.zeros((len(starts), len(grid)))
            if source.kind == "joint":
                joint = believed.by_name[source.target]
                rate = starts[:, believed.nv + joint.v.start, None]
                level = self.models.qpos0[joint.q.start] + starts[:, joint.v.start, None] + rate * grid
                out[source.name] += rate if source.quantity == "velocity" else level
        return out


def _on_commands(effects: Effects) -> tuple[MechanismEffect, ...]:
    """Return the effects that change commands."""
    return tuple(
        e
        for e in effects
        if isinstance(e, MechanismEffect) and type(e).edit_command is not MechanismEffect.edit_command
    )


def _on_readings(effects: Effects) -> tuple[MechanismEffect, ...]:
    """Return the effects that change readings."""
    return tuple(
        e
        for e in effects
        if isinstance(e, MechanismEffect) and type(e).edit_reading is not MechanismEffect.edit_reading
    )


def _activation(model: mujoco.MjModel, position: FloatArray, command: FloatArray) -> FloatArray:
    """Return the actuators' states at a start, (na,): settled at the first command; an integrator at its position."""
    out = np.zeros(model.na)
    for a in range(model.nu):
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
