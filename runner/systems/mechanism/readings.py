"""What the sensors report: channels with effects on them, at the times of the samples."""

from __future__ import annotations

import numpy as np

from runner.effects.base import Effects, in_stages
from runner.effects.mechanism.base import MechanismEffect, Reading
from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismRecording
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.held import even_times
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.observer import Sampling, first_orientation, held_channels, turns_from

CORRECTIONS, EXACT = 30, 1e-12  # of a start that sensors show, until it is exact


class Readings:
    """Readings of a recording.

    Args:
        recording: The case.
        models: Its compiled models.
    """

    def __init__(self, recording: MechanismRecording, models: Models) -> None:
        self._recording, self._models = recording, models
        self._sources = recording.mapping.sources
        self._held = held_channels(recording, models.compiled(()).model)

    def at_rest(self, begin: int) -> bool:
        """Whether what begins at that sample of an episode begins at rest."""
        return begin == 0 and self._recording.mapping.rests

    def sampled(
        self, effects: Effects, number: int, span: slice, shown: dict[str, FloatArray], grid: FloatArray
    ) -> FloatArray:
        """Return what the sensors report at the samples, (R, T, C).

        Args:
            effects: At work, the same in all runs.
            number: Of the episode in the recording.
            span: Its samples.
            shown: What is to be measured, by channel, on a grid, (R, n); orientations as quaternions by column,
                (R, n, 4).
            grid: Even times since the first of the samples, (n,), s.
        """
        episode = self._recording.episodes[number]
        sampling = Sampling(grid, episode.t_s[span] - episode.t_s[span.start])
        numbers: dict[str, FloatArray] = {}
        for source in self._sources:
            if source.quantity != "orientation":
                numbers[source.name] = shown[source.name]
            elif source.index == 0:
                turn = turns_from(first_orientation(episode, source.column), shown[source.column])
                numbers |= {f"{source.column}.{a}": turn[..., i] for i, a in enumerate("xyz")}
        numbers = self._reported(effects, grid, numbers, at_rest=self.at_rest(span.start))
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
        for effect in on_readings(effects):
            reading = effect.edit_reading(reading)
        return dict(reading.channels)

    def behind(self, effects: Effects, shown: FloatArray, step_s: float, *, at_rest: bool) -> FloatArray:
        """Return the true starts (R, S) that sensors with these effects show as the given ones.

        Of joints that are measured by themselves, each by its own channel; other coordinates are taken as shown. A
        velocity that no channel measures is the slope of the position's. Solved by repeated correction; the motion
        before is taken to be uniform.
        """
        true = shown.copy()
        if not on_readings(effects):
            return true
        believed = self._models.believed_coordinates
        grid = even_times(2, step_s)
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
                        error[:, believed.nv + v] = (ahead[:, 1] - ahead[:, 0]) / step_s
            true += error
            if np.abs(error).max(initial=0.0) < EXACT:
                break
        return true

    def _measures_velocity(self, joint: str) -> bool:
        return any(s.kind == "joint" and s.target == joint and s.quantity == "velocity" for s in self._sources)

    def _own_channels(self, starts: FloatArray, grid: FloatArray) -> dict[str, FloatArray]:
        """Return what each channel shows of uniform motion from starts (R, S), (R, n); 0 for all but joints' own."""
        believed = self._models.believed_coordinates
        out = {}
        for source in self._sources:
            out[source.name] = np.zeros((len(starts), len(grid)))
            if source.kind == "joint":
                joint = believed.by_name[source.target]
                rate = starts[:, believed.nv + joint.v.start, None]
                level = self._models.qpos0[joint.q.start] + starts[:, joint.v.start, None] + rate * grid
                out[source.name] += rate if source.quantity == "velocity" else level
        return out


def on_readings(effects: Effects) -> tuple[MechanismEffect, ...]:
    """Return the effects that change readings."""
    return in_stages(
        e
        for e in effects
        if isinstance(e, MechanismEffect) and type(e).edit_reading is not MechanismEffect.edit_reading
    )
