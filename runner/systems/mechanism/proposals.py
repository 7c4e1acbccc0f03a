"""Experiments that could be done next with a mechanism, within what was commanded so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.recording.model_form_mapping import is_servo
from runner.systems.mechanism.held import even_times

LENGTH_S = 4.0
SETTLE_S = 0.5  # before anything is commanded
SHARES = (0.4, 1.0)  # of the range that was commanded so far
SLOW_HZ, FAST_HZ = 0.5, 2.0


@dataclass(frozen=True)
class Trial:
    """One actuator is driven, from rest; the others stay at what they are at.

    Args:
        actuator: Which.
        pattern: "step": on and held; "ramp": slowly up; "sine": to and fro, once slowly, then fast; "reversal": there,
            and back at once.
        level: The command at most, in the actuator's unit, above `rest`.
        rest: What is commanded before, and of the others.
        unit: Of the command.
    """

    actuator: str
    pattern: str
    level: float
    rest: float
    unit: str

    def command(self, t_s: FloatArray) -> FloatArray:
        """Return the command over time, (T,)."""
        t = t_s - SETTLE_S
        shape = {
            "step": np.where(t >= 0, 1.0, 0.0),
            "ramp": np.clip(t / (LENGTH_S - 2 * SETTLE_S), 0.0, 1.0),
            "sine": np.where(t >= 0, np.sin(2 * np.pi * np.where(t < 2, SLOW_HZ, FAST_HZ) * t), 0.0),
            "reversal": np.where(t < 0, 0.0, np.where(t < 1.0, 1.0, np.where(t < 2.0, -1.0, 0.0))),
        }[self.pattern]
        return self.rest + self.level * shape

    @property
    def sentence(self) -> str:
        """What to do."""
        unit = f" {self.unit}" if self.unit else ""
        low, high = f"{self.rest - self.level:.3g}{unit}", f"{self.rest + self.level:.3g}{unit}"
        what = {
            "step": f"step the command of '{self.actuator}' from {self.rest:.3g} to {high} and hold it",
            "ramp": f"raise the command of '{self.actuator}' slowly, over {LENGTH_S - 2 * SETTLE_S:.2g} s, from "
            f"{self.rest:.3g} to {high}",
            "sine": f"command '{self.actuator}' a sine between {low} and {high}, "
            f"{SLOW_HZ:g} Hz and then {FAST_HZ:g} Hz",
            "reversal": f"command '{self.actuator}' {high} for 1 s, then {low} for 1 s, then let it come to rest",
        }[self.pattern]
        return f"From rest, {what}."


def trials(recording: MechanismRecording, model: mujoco.MjModel) -> list[Trial]:
    """Return experiments for each actuator within the range of the commands that the recording has."""
    commands = np.concatenate([e.commands for e in recording.episodes])
    out = []
    for k, target in enumerate(recording.mapping.commands.values()):
        low, high = float(commands[:, k].min()), float(commands[:, k].max())
        rest = resting_commands(recording, model)[target.actuator]
        # as far as either side of the rest was commanded, the wider one
        most, sign = max((high - rest, 1.0), (rest - low, -1.0))
        both = min(high - rest, rest - low)
        for share in SHARES:
            for pattern in ("step", "ramp", "sine", "reversal"):
                level = share * (both if pattern in ("sine", "reversal") and both > 0.2 * most else sign * most)
                if level != 0.0:
                    out.append(Trial(target.actuator, pattern, level, rest, target.unit))
    return out


def resting_commands(recording: MechanismRecording, model: mujoco.MjModel) -> Mapping[str, float]:
    """Return what actuators are commanded where nothing is to move: a servo its usual first target, others nothing."""
    first = np.median([e.commands[0] for e in recording.episodes], axis=0)
    return {
        c.actuator: float(first[k]) if is_servo(model, model.actuator(c.actuator).id) else 0.0
        for k, c in enumerate(recording.mapping.commands.values())
    }


def unmeasured(recording: MechanismRecording, model: mujoco.MjModel, proposed: list[Trial]) -> MechanismRecording:
    """Return a recording in which each episode is one of these experiments, and nothing has been measured."""
    t = even_times(round(LENGTH_S / recording.step_s) + 1, recording.step_s)
    rest = resting_commands(recording, model)
    names = [c.actuator for c in recording.mapping.commands.values()]
    forces, channels = len(recording.mapping.forces), len(recording.mapping.sources)
    # turns are counted from the orientation that the recording begins with
    first = {n: q[np.isfinite(q[:, 0])][:1] for n, q in recording.episodes[0].orientations.items()}
    episodes = tuple(
        MechanismEpisode(
            i,
            t,
            np.full((len(t), channels), np.nan),
            np.stack([trial.command(t) if n == trial.actuator else np.full(len(t), rest[n]) for n in names], axis=1),
            np.zeros((len(t), forces, 3)),
            np.zeros((len(t), forces, 3)),
            {n: np.repeat(q, len(t), axis=0) for n, q in first.items()},
        )
        for i, trial in enumerate(proposed)
    )
    return replace(recording, mapping=replace(recording.mapping, rests=True), episodes=episodes, notes=())
