"""What positions and velocities of one quantity say of each other: one is the integral of the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from runner.numerics.arrays import FloatArray, over_gaps
from runner.numerics.differences import NORMAL_MEDIAN
from runner.settings import SETTINGS

MOTION = SETTINGS.motion


@dataclass(frozen=True)
class Follows:
    """How positions follow the integral of velocities, over all stretches together.

    Args:
        correlation: Of displacement and integral.
        gain: Displacement over integral, least squares.
        unexplained: Share of the displacement's square that the integral leaves.
        moved: rms displacement about its mean, in the unit of the position.
        due: rms of the integral about its mean.
        drift: Rate at which displacement and integral part, one for all stretches, in the unit of the velocity.
        drifted: Share of the displacement's square that this drift explains.
    """

    correlation: float
    gain: float
    unexplained: float
    moved: float
    due: float
    drift: float = 0.0
    drifted: float = 0.0

    @property
    def drifts(self) -> bool:
        """Whether a drift, and no other scale of the velocity, is what parts the two."""
        others = 1 - self.correlation**2, self.drifted
        return min(others) > MOTION.together_share and self.unexplained - self.drifted < MOTION.together_share

    @property
    def scaled(self) -> bool:
        """Whether another scale is what parts the two."""
        return self.correlation > 1 - MOTION.together_share and not 1 / MOTION.max_scale < self.gain < MOTION.max_scale


def follows(t_s: Sequence[FloatArray], positions: Sequence[FloatArray], velocities: Sequence[FloatArray]) -> Follows:
    """Compare positions with integrals of velocities (trapezoid rule), each less its mean over its stretch.

    Args:
        t_s: Times of each stretch, each (T,), s.
        positions: At these times, each (T,).
        velocities: At these times, each (T,), per second.
    """
    ways, dues, times = [np.zeros(1)], [np.zeros(1)], [np.zeros(1)]
    for t, position, velocity in zip(t_s, positions, velocities, strict=True):
        due = np.concatenate([[0.0], np.cumsum(np.diff(t) * (velocity[1:] + velocity[:-1]) / 2)])
        ways.append(position - position.mean())
        dues.append(due - due.mean())
        times.append(t - t.mean())
    way, due, time = np.concatenate(ways), np.concatenate(dues), np.concatenate(times)
    ww, dd, wd, tt = float(way @ way), float(due @ due), float(way @ due), float(time @ time)
    drift = float(time @ (way - due)) / tt if tt > 0 else 0.0
    size = float(np.sqrt(ww) * np.sqrt(dd))
    return Follows(
        correlation=wd / size if size > 0 else 0.0,
        gain=wd / dd if dd > 0 else 0.0,
        unexplained=float(np.sum((way - due) ** 2)) / ww if ww > 0 else float(dd > 0),
        moved=float(np.sqrt(ww / len(way))),
        due=float(np.sqrt(dd / len(due))),
        drift=drift,
        drifted=drift**2 * tt / ww if ww > 0 else 0.0,
    )


def without_gaps(t_s: FloatArray, positions: FloatArray, velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities without NaN: lines between measured positions, slopes for missing velocities.

    A rough account of a motion, for labels and checks; nothing is fitted to it.

    Args:
        t_s: Times, (T,), s.
        positions: NaN where not measured, (T, K), each somewhere measured.
        velocities: The same per second, (T, K).
    """
    positions, velocities = over_gaps(positions, t_s), velocities.copy()
    for k in range(positions.shape[1]):
        lacking = ~np.isfinite(velocities[:, k])
        if lacking.any():
            velocities[lacking, k] = np.gradient(positions[:, k], t_s)[lacking]
    return positions, velocities


def lone_samples(values: FloatArray) -> list[int]:
    """Return the samples that stand alone: far off both neighbours, to the same side, between which nothing happens.

    A step is none: there one neighbour lies on each side. Of what is rounded, a step of rounding is usual.
    """
    if len(values) < 5:
        return []
    off = np.zeros(len(values))
    off[1:-1] = values[1:-1] - (values[:-2] + values[2:]) / 2
    sizes = np.abs(off[1:-1])
    if not (sizes > 0).any():
        return []
    usual = max(float(np.median(sizes)) / NORMAL_MEDIAN, float(sizes[sizes > 0].min()))
    # beside a lone sample there is minus half of it
    beside = np.abs(np.stack([off[:-2], off[2:]]) + off[1:-1] / 2)
    alone = (sizes > MOTION.lone_factor * usual) & (beside < MOTION.lone_tolerance * sizes).all(axis=0)
    return (np.flatnonzero(alone) + 1).tolist()


def jumps(t_s: FloatArray, positions: FloatArray, velocities: FloatArray) -> list[tuple[int, float]]:
    """Return steps of a position that its velocity has no part in: the samples after them, and by how much each.

    Between two samples a velocity may be what it is not at either, so as much as it changes nearby is allowed twice.

    Args:
        t_s: Times of a stretch, (T,), s.
        positions: (T,), without NaN.
        velocities: (T,), without NaN, per second.
    """
    if len(t_s) < 5:
        return []
    dt, steps = np.diff(t_s), np.diff(positions)
    off = steps - dt * (velocities[1:] + velocities[:-1]) / 2
    near = 2 * round(MOTION.answer_s / float(np.median(dt))) + 3
    changes = maximum_filter1d(velocities, near) - minimum_filter1d(velocities, near)
    hidden = 2 * dt * np.maximum(changes[1:], changes[:-1])
    usual = max(float(np.median(np.abs(off))) / NORMAL_MEDIAN, _resolution(positions))
    apart = np.abs(off) > np.maximum(MOTION.lone_factor * usual, hidden)
    return [(int(k) + 1, float(off[k])) for k in np.flatnonzero(apart)]


def steps_alone(t_s: FloatArray, positions: FloatArray) -> list[tuple[int, float]]:
    """Return steps of a position that no motion before or after belongs to: the samples after them, and by how much.

    For positions whose velocity is not measured, else see `jumps`. A sensor that is slower than the samples steps, too,
    and again and again.

    Args:
        t_s: Times of a stretch, (T,), s.
        positions: (T,), without NaN.
    """
    if len(t_s) < 6:
        return []
    steps = np.diff(positions)
    least = MOTION.step_factor * float(np.percentile(np.abs(steps), MOTION.usual_percent))
    return [(k + 1, float(steps[k])) for k in lone_samples(steps / np.diff(t_s)) if abs(steps[k]) > least]


def is_noise(positions: FloatArray) -> bool:
    """Whether a position is another one at each sample, as no motion is that the samples can tell."""
    if len(positions) < 3:
        return False
    return float(np.var(np.diff(positions))) > MOTION.noise_variance_ratio * float(np.var(positions))


def stuck(
    t_s: FloatArray, held: FloatArray, positions: FloatArray, velocities: FloatArray, least: float
) -> list[tuple[int, int, float]]:
    """Return where a position or a velocity keeps one value while the other tells of motion: first, last, how much.

    Args:
        t_s: Times of a stretch, (T,), s.
        held: Which of the two is looked at: `positions` or `velocities`.
        positions: (T,), without NaN.
        velocities: (T,), without NaN, per second.
        least: What has to be missed meanwhile, in the unit of the positions.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(held)) + 1, [len(held)]])
    lengths = np.diff(edges)
    enough = max(MOTION.stuck_samples, MOTION.stuck_runs * float(np.median(lengths)))
    speed = MOTION.stuck_speed_share * float(np.sqrt(np.mean(velocities**2)))
    found = []
    for k in np.flatnonzero(lengths > enough):
        first, last = int(edges[k]), int(edges[k + 1]) - 1
        run = slice(first, last + 1)
        missed = float(positions[last] - positions[first] - np.trapezoid(velocities[run], t_s[run]))
        lasts_s = float(t_s[last] - t_s[first])
        allowed = max(least, 2 * _resolution(positions)) + _resolution(velocities) * lasts_s
        if abs(missed) > max(allowed, speed * lasts_s):
            found.append((first, last, missed))
    return found


def _resolution(values: FloatArray) -> float:
    """Return the smallest step that values make, 0 if they never change."""
    steps = np.abs(np.diff(values))
    return float(steps[steps > 0].min()) if steps.any() else 0.0
