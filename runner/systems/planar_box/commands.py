"""What drives a box at every physics step: the forces that were commanded, or the path of a pin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from runner.effects.base import in_stages
from runner.effects.planar_box import PlanarEffect
from runner.numerics.arrays import FloatArray
from runner.physics import dry_friction
from runner.physics.scene import push_columns
from runner.recording import Episode, Recording

KEPT_BYTES = 100e6  # what was made last, as models and windows that ask for the same follow one another


@dataclass(frozen=True)
class Commands:
    """The commands of a recording, at so many physics steps of `step_s` per sample."""

    recording: Recording
    steps_per_sample: int
    step_s: float
    _kept: dict[tuple[tuple[PlanarEffect, ...], int], FloatArray] = field(
        init=False, default_factory=dict, repr=False, compare=False
    )

    def control(self, effects: Sequence[PlanarEffect], episode: int) -> FloatArray:
        """Return what the engine is given over a whole episode with these effects, (n, USERDATA_SIZE); not to write to.

        Of a long recording all of that is gigabytes: only some is kept.
        """
        effects = in_stages(effects)
        key = effects, episode
        if key not in self._kept:
            made = self._control(effects, episode)
            made.setflags(write=False)
            if sum(k.nbytes for k in self._kept.values()) + made.nbytes > KEPT_BYTES:
                self._kept.clear()
            self._kept[key] = made
        return self._kept[key]

    def _control(self, effects: Sequence[PlanarEffect], episode: int) -> FloatArray:
        recorded = self.recording.episodes[episode]
        steps = (len(recorded) - 1) * self.steps_per_sample
        out = np.zeros((steps, dry_friction.USERDATA_SIZE))
        if recorded.pin_m is None:
            columns = self._push(recorded)
            for effect in effects:
                columns = effect.edit_command(columns, self.step_s)
            out[:, : dry_friction.PUSH_SIZE] = columns
        else:
            path = self._path(recorded.pin_m)
            for effect in effects:
                path = effect.edit_pin(path, self.step_s)
            out[:, dry_friction.PIN_ADR : dry_friction.PIN_ADR + dry_friction.PIN_SIZE] = self._pin(path)
        return out

    def _push(self, episode: Episode) -> FloatArray:
        """Return pushes over physics steps, (n, 12); the last sample's command has no time to act."""
        columns = np.nan_to_num(push_columns(episode.force_n, episode.point_m)[:-1])
        return np.repeat(columns, self.steps_per_sample, axis=0)

    def _path(self, pin_m: FloatArray) -> FloatArray:
        """Return a path of samples (T, 2) at the ends of physics steps, (n + 1, 2): straight in between."""
        n = self.steps_per_sample
        at = np.arange((len(pin_m) - 1) * n + 1) / n
        return np.stack([np.interp(at, np.arange(len(pin_m)), pin_m[:, a]) for a in (0, 1)], axis=1)

    def _pin(self, path: FloatArray) -> FloatArray:
        """Return place and velocity of the pin for each step, (n, 4).

        The engine's poses are those of half a step later (see `Simulator`), so the pin's are too; its velocity is that
        of the step, as a body's at its end is.
        """
        return np.hstack([0.5 * (path[1:] + path[:-1]), np.diff(path, axis=0) / self.step_s])
