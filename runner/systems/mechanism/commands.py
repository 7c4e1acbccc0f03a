"""What the actuators get: recorded commands with effects on them, as means over physics steps."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from runner.effects.base import Effects, in_stages
from runner.effects.mechanism import ActuatorDelay, ObservationDelay
from runner.effects.mechanism.base import Command, MechanismEffect
from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import is_servo
from runner.systems.mechanism.held import even_times, step_means
from runner.systems.mechanism.models import force_actuators, force_weights

DELAYS = ActuatorDelay | ObservationDelay
KEPT = 512  # commands of whole episodes
DIGITS = 6  # of a step
ALIGNED = 10.0**-DIGITS  # what begins so near to the border of one begins there


class Commands:
    """Commands of a recording.

    Args:
        recording: The case.
        believed: Its compiled model: which actuators are servos.
        delays: Those that its MJCF has.
    """

    def __init__(
        self, recording: MechanismRecording, believed: mujoco.MjModel, delays: Sequence[ActuatorDelay] = ()
    ) -> None:
        self._recording = recording
        self._names = [c.actuator for c in recording.mapping.commands.values()]
        self._delays = tuple(d for d in delays if d.target in self._names)
        self._servos = np.array([is_servo(believed, believed.actuator(n).id) for n in self._names], bool)
        self._sent: dict[tuple[Effects, int, float, float], dict[str, FloatArray]] = {}
        # many runs one after the other are of one window
        self._last: tuple[tuple[Effects, int, float, float, int], FloatArray] | None = None

    def first_s(self, effects: Effects, step_s: float) -> float:
        """Return how long a first step is after which delayed commands change between two steps; `step_s` at most.

        A step that gets one command for a part and another for the rest gets their mean, which moves a joint as the two
        do, but not one that sticks until the second comes. Commands that are not all late by the same, or that were
        sent at uneven times, change within steps all the same.
        """
        late = (self._common_s(effects) or 0.0) / step_s
        return step_s * (1.0 + late - _whole_steps(late))

    def _common_s(self, effects: Effects) -> float | None:
        """Return by how much all commands are late; None: not all by the same, recorded forces among them."""
        if self._recording.mapping.forces:
            return None
        delays = [e for e in (*self._delays, *effects) if isinstance(e, DELAYS)]
        late = {
            sum(e.delay_s for e in delays if isinstance(e, ObservationDelay) or e.target == name)
            for name in self._names
        }
        return late.pop() if len(late) == 1 else None

    def _edits(self, effects: Effects, step_s: float) -> tuple[MechanismEffect, ...]:
        """Return what changes commands, the believed delays first; one of whole steps for all if all are late alike."""
        edits = (*self._delays, *_on_commands(effects))
        late_s = self._common_s(effects)
        if late_s is None:
            return edits
        whole = ObservationDelay(_whole_steps(late_s / step_s) * step_s)
        return whole, *(e for e in edits if not isinstance(e, DELAYS))

    def control(
        self, effects: Effects, episode: int, begin_s: float, steps: int, step_s: float, model: mujoco.MjModel
    ) -> FloatArray:
        """Return the mean command of every actuator of a model over each step, (steps, nu).

        Args:
            effects: What is in the model.
            episode: Of the recording.
            begin_s: When the first step begins, since the episode did; it lasts `first_s`.
            steps: How many; after the end the last command is held.
            step_s: Length of each of the others.
            model: Whose actuators are meant.
        """
        place = round(begin_s / step_s, DIGITS)
        first, phase = int(place), round(place % 1.0, DIGITS)
        editing = self._edits(effects, step_s)
        columns = self._whole(editing, episode, step_s, phase * step_s)
        key = editing, episode, step_s, place, steps
        if self._last is None or self._last[0] != key:
            whole = np.column_stack(list(columns.values())) if columns else np.zeros((1, 0))
            part = whole[first : first + steps]
            self._last = key, np.concatenate([part, np.repeat(whole[-1:], steps - len(part), axis=0)])
        out = np.zeros((steps, model.nu))
        out[:, [model.actuator(name).id for name in columns]] = self._last[1]
        return out

    def _whole(
        self, editing: tuple[MechanismEffect, ...], episode: int, step_s: float, from_s: float
    ) -> dict[str, FloatArray]:
        """Return what the actuators really get over an episode in steps from a time on, by actuator, (n,) each."""
        key = editing, episode, step_s, from_s
        if key not in self._sent:
            if len(self._sent) > KEPT:
                self._sent.clear()
            recorded = self._recording.episodes[episode]
            t, commanded = recorded.t_s - recorded.t_s[0], recorded.commands
            # one more than reaches the end: forces are read under the command of the last sample
            edges = from_s + even_times(int(np.ceil(t[-1] / step_s - ALIGNED)) + 2, step_s)
            sent_s = t
            if recorded.after is not None:
                sent_s = np.concatenate([recorded.after.t_s - recorded.t_s[0], t])
                commanded = np.concatenate([recorded.after.commands, commanded])
            earlier = int(np.ceil((from_s - sent_s[0]) / step_s - ALIGNED))
            before = np.where(self._servos, commanded[0], 0.0)
            since = np.concatenate([from_s - even_times(earlier + 1, step_s)[:0:-1], edges])
            means = step_means(sent_s, commanded, since, before)
            columns = dict(zip(self._names, means.T, strict=True))
            command = Command(step_s, columns, dict(zip(self._names, before, strict=True)))
            for effect in editing:
                command = effect.edit_command(command)
            columns = {name: column[earlier:] for name, column in command.columns.items()}
            for i in range(len(self._recording.mapping.forces)):
                weights = force_weights(recorded.points_m[:, i], recorded.forces_n[:, i])
                columns |= dict(zip(force_actuators(i), step_means(t, weights, edges, np.zeros(12)).T, strict=True))
            self._sent[key] = columns
        return self._sent[key]


def _whole_steps(late: float) -> float:
    """Return a delay, in steps, as whole steps that are as long or longer; what is nearly whole stays as it is."""
    return late if abs(late - round(late)) < ALIGNED else float(np.ceil(late))


def _on_commands(effects: Effects) -> tuple[MechanismEffect, ...]:
    """Return the effects that change commands."""
    return in_stages(
        e
        for e in effects
        if isinstance(e, MechanismEffect) and type(e).edit_command is not MechanismEffect.edit_command
    )
