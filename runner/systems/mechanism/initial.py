"""The unknown start of a mechanism: where every joint is, and how fast.

S = 2 nv numbers: the change of position from the model's reference position in tangent coordinates (rad, m; of a free
joint in metres and as a turn), then the velocities as MuJoCo has them. A recording whose episodes begin at rest has
the same numbers, as windows of it don't; at the start of its episodes the velocities don't count.

A guess solves the measured channels for the numbers: positions from what tells of positions, velocities from what
tells of velocities and from the slopes of the others. What no channel tells of stays at the reference.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import ChannelSource
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.initial import AbstractInitialState, told_around
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.coordinates import HINGE, Coordinates
from runner.systems.mechanism.kinematics import Kinematics
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.windows import Windows

ITERATIONS, CLOSE = 12, 1e-7  # of positions that show what was measured; rad or m
NEAR = 0.02  # within a step so small, rad or m, the derivatives stay


class MechanismStart(AbstractInitialState):
    """See the module's docstring.

    Args:
        recording: The case.
        models: Its compiled models.
        sigma: Rough noise of each channel, (C,), for the steps of differences.
    """

    def __init__(self, recording: MechanismRecording, models: Models, sigma: FloatArray) -> None:
        compiled = models.compiled(())
        self._recording, self._model, self._coordinates = recording, compiled.model, compiled.coordinates
        self._sources = recording.mapping.sources
        self._kinematics = Kinematics(self._sources, compiled)
        self._broad = _broad_of(self._coordinates)
        self.steps = np.ones(2 * self._coordinates.nv)
        self.steps = np.clip(self.scale(sigma), 1e-6, 0.02)

    @property
    def coordinates(self) -> Coordinates:
        """Of the believed model."""
        return self._coordinates

    def broad(self) -> FloatArray:
        """Return how far a joint that nobody measured may be from its reference, and how fast, (S,)."""
        return self._broad

    def scale(self, sigma: FloatArray) -> FloatArray:
        """Return how well the channels of one sample, and slopes of a few, tell each number."""
        broad = self.broad()
        return np.concatenate(
            [
                self._known(sigma, broad[: self._coordinates.nv], position=1.0, velocity=0.0),
                self._known(sigma, broad[self._coordinates.nv :], position=MECHANISM.start.slope_s, velocity=1.0),
            ]
        )

    def errors(self, signals: Signals, windows: Windows) -> FloatArray:
        """See the base class: a speed that is told by samples to one side alone is off by more than elsewhere."""
        broad, nv = self.broad(), self._coordinates.nv
        positions = self._known(signals.sigma, broad[:nv], position=1.0, velocity=0.0)
        speeds: dict[float, FloatArray] = {}
        out = np.empty((len(windows), 2 * nv))
        for w, (episode, first) in enumerate(zip(windows.episode, windows.first, strict=True)):
            span, time = self._around(signals, int(episode), int(first))
            time = time[signals.valid[episode][span].any(axis=1)]
            powers = np.stack([time**0, time, time**2], axis=1)[:, : len(time)]
            off = float(np.linalg.norm(np.linalg.pinv(powers)[1])) if len(time) > 1 else 1.0 / MECHANISM.start.slope_s
            off = round(off, 1)  # 1/s: of an even clock few differ
            if off not in speeds:
                speeds[off] = self._known(signals.sigma, broad[nv:], position=1.0 / max(off, 0.1), velocity=1.0)
            out[w] = np.concatenate([positions, speeds[off]])
        return out

    def speed_error(self, sigma: FloatArray) -> FloatArray:
        """Return the standard error of velocities of a smooth guess in the middle of an episode, (nv,)."""
        step_s = self._recording.step_s
        n = 2 * max(SETTINGS.fit.min_start_samples, round(MECHANISM.start.smooth_s / step_s)) + 1
        broad = self.broad()[self._coordinates.nv :]
        # of a straight line through n samples: slope and level
        return self._known(sigma, broad, position=step_s * np.sqrt(n**3 / 12.0), velocity=np.sqrt(n))

    def _known(self, sigma: FloatArray, broad: FloatArray, *, position: float, velocity: float) -> FloatArray:
        """Return standard errors (nv,) from channels with these weights, and a prior as broad as that."""
        reference, weight = np.array(self._model.qpos0), np.zeros(len(sigma))
        matrix = self._kinematics.jacobian(reference) + self._kinematics.rate_jacobian(reference)
        weight[self._kinematics.positions] = position
        weight[self._kinematics.velocities] = velocity
        rows = matrix * (weight / sigma)[:, None]
        return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows + np.diag(broad**-2.0))))

    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return the start from local polynomials through the first samples; at rest: level at the first."""
        return self._solve(signals, episode, 0, smooth=True, rests=self._rests(signals, episode, 0))

    def _rests(self, signals: Signals, episode: int, first: int) -> bool:
        """Whether a sample is the first of an episode that begins at rest."""
        return self._recording.mapping.rests and signals.spans[episode].begin + first == 0

    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return a start of each window, (W, S); what is not measured comes from slopes of the others either way."""
        at = [(int(e), int(f)) for e, f in zip(windows.episode, windows.first, strict=True)]
        rests = [self._rests(signals, e, f) for e, f in at]
        each = zip(at, rests, strict=True)
        if not at or not self._in_proportion:
            return np.array([self._solve(signals, e, f, smooth=smooth, rests=r) for (e, f), r in each])
        told = [self._local(signals, e, f, smooth=smooth, rests=r) for (e, f), r in each]
        level, slope = (np.array(each) for each in zip(*told, strict=True))
        out = np.empty((len(at), 2 * self._coordinates.nv))
        for same in _alike(np.hstack([np.isfinite(level), np.isfinite(slope)])):
            out[same] = self._solve_at_once(level[same], slope[same], signals.sigma)
        out[rests, self._coordinates.nv :] = 0.0
        return out

    @property
    def _in_proportion(self) -> bool:
        """Whether what channels show changes in proportion to the numbers, as where joints alone are measured."""
        return self._kinematics.is_constant and not self._coordinates.turning

    def positions(self, episode: int, channels: FloatArray) -> FloatArray:
        """Return positions of all joints that show the channels (T, C) at the samples of an episode, (T, nq)."""
        start, sigma = np.array(self._model.qpos0), np.ones(channels.shape[1])
        out = np.empty((len(channels), self._coordinates.nq))
        levels = np.where(self._kinematics.positions, channels, np.nan)
        if self._in_proportion:
            for same in _alike(np.isfinite(levels)):
                out[same] = start + self._away_at_once(levels[same], sigma).T
            # where nothing is measured, all stays where it was
            last = np.maximum.accumulate(np.where(np.isfinite(levels).any(axis=1), np.arange(len(out)), -1))
            return np.where(last[:, None] < 0, start, out[last])
        turns = self._kinematics.turns.items()
        references = {c: np.array([self._reference(episode, k, s) for k in range(len(out))]) for c, s in turns}
        if (whole := self._kinematics.posed(levels, references)) is not None:
            return whole
        for k, level in enumerate(levels):
            start = out[k] = self._posed(level, episode, k, sigma, start)
        return out

    def _solve(self, signals: Signals, episode: int, first: int, *, smooth: bool, rests: bool) -> FloatArray:
        """Return the numbers that the channels around a sample tell, (S,)."""
        level, slope = self._local(signals, episode, first, smooth=smooth, rests=rests)
        # from here on the episode is that of the recording
        episode, first = signals.spans[episode].episode, signals.spans[episode].begin + first
        told = self._kinematics.positions & np.isfinite(level)
        reference = np.array(self._model.qpos0)
        qpos = self._posed(np.where(told, level, np.nan), episode, first, signals.sigma, reference)
        x = self._coordinates.difference(qpos, reference)
        rate = self._moving(qpos, level[:, None], slope[:, None], signals.sigma)[:, 0]
        return np.concatenate([x, np.zeros_like(rate) if rests else rate])

    def _solve_at_once(self, level: FloatArray, slope: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the numbers that the channels around many samples tell, (W, S), where they are `_in_proportion`.

        Args:
            level: Of each channel, (W, C); NaN of the same channels at each sample.
            slope: Likewise.
            sigma: Noise of each channel, (C,).
        """
        moving = self._moving(np.array(self._model.qpos0), level.T, slope.T, sigma)
        return np.vstack([self._away_at_once(level, sigma), moving]).T

    def _away_at_once(self, level: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return how far from the reference the joints are that show levels (W, C), (nv, W), see `_solve_at_once`.

        What `_posed` finds by iteration, and sample by sample, is one division by the same matrix for all of them.
        """
        nv, reference = self._coordinates.nv, np.array(self._model.qpos0)
        told = self._kinematics.positions & np.isfinite(level[0])
        weight, weak = 1.0 / sigma[told], MECHANISM.start.unmeasured_weight / self.broad()[:nv]
        rows = np.vstack([self._kinematics.jacobian(reference)[told] * weight[:, None], np.diag(weak)])
        ahead = (level - self._kinematics.from_reference(reference, {}))[:, told]
        return _least_squares(rows, np.vstack([(ahead * weight).T, np.zeros((nv, len(level)))]))

    def _moving(self, qpos: FloatArray, level: FloatArray, slope: FloatArray, sigma: FloatArray) -> FloatArray:
        """Return the velocities at a position (nq,), (nv, W), from levels and slopes (C, W) of the same channels."""
        nv, broad = self._coordinates.nv, self.broad()
        matrix = self._kinematics.jacobian(qpos) + self._kinematics.rate_jacobian(qpos)
        rates = self._kinematics.velocities & np.isfinite(level[:, 0])
        slopes = self._kinematics.positions & np.isfinite(level[:, 0]) & np.isfinite(slope[:, 0])
        rows = np.vstack(
            [
                matrix[rates] / sigma[rates, None],
                matrix[slopes] / sigma[slopes, None] * MECHANISM.start.slope_s,
                np.diag(MECHANISM.start.unmeasured_weight / broad[nv:]),
            ]
        )
        right = np.vstack(
            [
                level[rates] / sigma[rates, None],
                slope[slopes] / sigma[slopes, None] * MECHANISM.start.slope_s,
                np.zeros((nv, level.shape[1])),
            ]
        )
        return _least_squares(rows, right)

    def _posed(self, level: FloatArray, episode: int, sample: int, sigma: FloatArray, begin: FloatArray) -> FloatArray:
        """Return positions (nq,) that show these levels, (C,), as nearly as the noise says; NaN counts for nothing.

        Args:
            level: Of each channel.
            episode: Whose measured orientations turns are relative to.
            sample: At which.
            sigma: Noise of each channel, (C,).
            begin: Where to begin, (nq,); what no channel tells of stays near the reference.
        """
        told = np.isfinite(level)
        nv, reference = self._coordinates.nv, np.array(self._model.qpos0)
        weight, weak = 1.0 / sigma[told], MECHANISM.start.unmeasured_weight / self.broad()[:nv]
        turns = {k: self._reference(episode, sample, s) for k, s in self._kinematics.turns.items()}
        whole = self._kinematics.posed(level[None], {k: q[None] for k, q in turns.items()})
        if whole is not None:
            return whole[0]
        qpos = begin
        matrix = self._kinematics.jacobian(qpos)
        for _ in range(ITERATIONS if told.any() else 0):
            ahead = (level - self._kinematics.from_reference(qpos, turns))[told]
            away = self._coordinates.difference(qpos, reference)
            rows = np.vstack([matrix[told] * weight[:, None], np.diag(weak)])
            step = _least_squares(rows, np.concatenate([ahead * weight, -away * weak]))
            qpos = self._coordinates.moved(qpos, step)
            size = float(np.abs(step).max())
            if size < CLOSE:
                break
            if size > NEAR:
                matrix = self._kinematics.jacobian(qpos)
        return qpos

    def _local(
        self, signals: Signals, episode: int, first: int, *, smooth: bool, rests: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return level and slope of each channel at a sample, (C,): of a quadratic around it, NaN where nothing is."""
        span, time = self._around(signals, episode, first)
        values = self._turned(signals.values[episode], signals.spans[episode], first, span)
        valid = signals.valid[episode][span] & np.isfinite(values)
        here = first - (span.start or 0)
        powers = np.stack([time**0, time**2] if rests else [time**0, time, time**2], axis=1)
        level, slope = np.full(values.shape[1], np.nan), np.full(values.shape[1], np.nan)
        # channels that are measured at the same samples are fitted together
        for pattern in {tuple(column) for column in valid.T.tolist()}:
            fine = np.array(pattern)
            if not fine.any():
                continue
            these = np.flatnonzero((valid == fine[:, None]).all(axis=0))
            order = min(powers.shape[1], int(fine.sum()))
            fitted = np.linalg.lstsq(powers[fine, :order], values[fine][:, these], rcond=None)[0]
            level[these] = fitted[0] if smooth or not fine[here] else values[here, these]
            if not rests and order > 1:
                slope[these] = fitted[1]
        return level, slope

    def _around(self, signals: Signals, episode: int, first: int) -> tuple[slice, FloatArray]:
        """Return the samples around one that tell of it, and their times from it, s."""
        whole = signals.spans[episode]
        t = self._recording.episodes[whole.episode].t_s[whole.begin : whole.end]
        reach = max(SETTINGS.fit.min_start_samples, round(MECHANISM.start.smooth_s / self._recording.step_s))
        span = told_around(signals.valid[episode], first, reach)
        return span, t[span] - t[first]

    def _turned(self, values: FloatArray, whole: Span, first: int, span: slice) -> FloatArray:
        """Return the values of some samples with orientations as turns from the measured one at one, body axes."""
        out = np.array(values[span])
        for k, source in self._kinematics.turns.items():
            every = self._recording.episodes[whole.episode].orientations[source.column]
            measured = every[whole.begin : whole.end][span]
            reference = quaternions.inverse(self._reference(whole.episode, whole.begin + first, source))
            out[:, k : k + 3] = quaternions.logarithm(quaternions.multiply(reference, measured))
        return out

    def _reference(self, episode: int, first: int, source: ChannelSource) -> FloatArray:
        """Return the measured orientation nearest to a sample, (4,)."""
        measured = self._recording.episodes[episode].orientations[source.column]
        known = np.flatnonzero(np.isfinite(measured[:, 0]))
        return measured[known[np.argmin(np.abs(known - first))]] if len(known) else np.array([1.0, 0.0, 0.0, 0.0])


def _broad_of(coordinates: Coordinates) -> FloatArray:
    unit = np.full(coordinates.nv, MECHANISM.start.broad_m)
    for joint in coordinates.joints:
        if joint.kind == HINGE:
            unit[joint.v] = MECHANISM.start.broad_rad
        elif joint.v.stop - joint.v.start >= 3:
            unit[joint.v.stop - 3 : joint.v.stop] = MECHANISM.start.broad_rad
    return np.concatenate([unit, np.full(coordinates.nv, MECHANISM.start.broad_rate)])


def _alike(known: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the positions of rows that are the same, (W, n), each with the others like it."""
    return [np.flatnonzero((known == pattern).all(axis=1)) for pattern in np.unique(known, axis=0)]


def _least_squares(rows: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0], dtype=np.float64)
