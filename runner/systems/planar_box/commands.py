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


class _Kept(dict[tuple[tuple[PlanarEffect, ...], int], FloatArray]):
    """Commands that were made, which take no more than `KEPT_BYTES`: before they would, all go."""

    nbytes = 0

    def keep(self, key: tuple[tuple[PlanarEffect, ...], int], made: FloatArray) -> None:
        """Add some."""
        if self.nbytes + made.nbytes > KEPT_BYTES:
            self.clear()
            self.nbytes = 0
        self[key] = made
        self.nbytes += made.nbytes


@dataclass(frozen=True)
class Commands:
    """The commands of a recording, at so many physics steps of `step_s` per sample."""

    recording: Recording
    steps_per_sample: int
    step_s: float
    _kept: _Kept = field(init=False, default_factory=_Kept, repr=False, compare=False)

    def acting(self, effects: Sequence[PlanarEffect]) -> tuple[PlanarEffect, ...]:
        """Return those of some effects that act on commands: with all others a box is driven as it was."""
        ways = PlanarEffect.edit_command, PlanarEffect.edit_pin
        return in_stages([e for e in effects if (type(e).edit_command, type(e).edit_pin) != ways])

    def control(self, effects: Sequence[PlanarEffect], episode: int) -> FloatArray:
        """Return what the engine is given over a whole episode with these effects, (n, USERDATA_SIZE); not to write to.

        Of a long recording all of that is gigabytes: only some is kept.
        """
        effects = self.acting(effects)
        key = effects, episode
        if key not in self._kept:
            made = self._control(effects, episode)
            made.setflags(write=False)
            self._kept.keep(key, made)
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
