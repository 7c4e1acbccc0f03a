"""The force of a pin on the body it pushes, as a channel: what a sensor shows of it, and where that tells anything.

Where a pin stands, or has hardly begun to move, its force may be anything up to that of friction, by what arm and
contact give; when it meets or leaves the body depends on a hair. So a force counts while the pin moves and pushes.

It is predicted as its mean over some time to either side of a sample. A path is a line between its samples, so that the
force that speeds the body up comes as a jerk at each of them, and noise of the path makes more of those; a mean over a
sample or more has all of that, and as it lies around the sample it is neither early nor late.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d

from runner.numerics.arrays import FloatArray, over_gaps
from runner.numerics.differences import white_noise
from runner.physics import dry_friction
from runner.recording import Episode
from runner.recording.model_form_mjcf import quiet

REACH_S = 0.05  # to either side of a sample: over what a force is meant, and pin and body are left to settle
TOUCHES = 0.2  # of the largest force of an episode: with less it hardly touches
MOVES, FAST = 0.1, 0.9  # of this quantile of its speed while it touches: slower it hardly moves
SURE = 4.0  # errors of a speed that noise of the path makes: below that it may stand


def means(force_n: FloatArray, steps_per_sample: int, step_s: float) -> FloatArray:
    """Return what is shown at samples of a force, mean over `REACH_S` to either side or half a sample, (..., T, 2).

    Args:
        force_n: During each physics step from the first sample to the last, (..., n, 2).
        steps_per_sample: How many there are from one sample to the next.
        step_s: How long they are.
    """
    count = force_n.shape[-2]
    reach = max(math.ceil(steps_per_sample / 2), round(REACH_S / step_s))
    at = np.arange(0, count + 1, steps_per_sample)
    first, last = np.maximum(at - reach, 0), np.minimum(at + reach, count)
    until = np.concatenate([np.zeros((*force_n.shape[:-2], 1, 2)), np.cumsum(force_n, axis=-2)], axis=-2)
    return (until[..., last, :] - until[..., first, :]) / np.maximum(last - first, 1)[:, None]


def measured_force(episode: Episode) -> FloatArray:
    """Return the force of the pin as measured, (T, 2), N, world; NaN where it was not, or tells nothing."""
    force_n = np.array(episode.force_n[:, :2])
    force_n[~_pushes(episode)] = np.nan
    return force_n


def _pushes(episode: Episode) -> np.ndarray:
    """Return where the pin moves and pushes, and does so over twice as long as a mean goes over, (T,).

    A force that a sensor shows comes and goes between two samples; when, hangs on less than the noise of a pose.
    """
    t_s, force_n = episode.t_s, over_gaps(episode.force_n[:, :2], episode.t_s)
    if episode.pin_m is None or not force_n.any():
        return np.zeros(len(episode), bool)
    reach = max(1, math.ceil(REACH_S / episode.step_s - 1e-9))
    i = np.arange(len(episode))
    before, after = np.maximum(i - reach, 0), np.minimum(i + reach, len(episode) - 1)
    lasts_s = t_s[after] - t_s[before]
    speed = np.linalg.norm(episode.pin_m[after] - episode.pin_m[before], axis=1) / lasts_s
    noise_m = max(np.nan_to_num([white_noise([(t_s, p)]) for p in episode.pin_m.T]))
    # the median leaves edges where they are
    size = np.linalg.norm(median_filter(force_n, (2 * reach + 1, 1), mode="nearest"), axis=1)
    touches = size >= TOUCHES * size.max()
    hardly = MOVES * float(np.quantile(speed[touches], FAST))
    moves = speed > np.maximum(hardly, SURE * math.sqrt(2.0) * noise_m / lasts_s)
    return np.asarray(minimum_filter1d(moves & touches, 4 * reach + 1, mode="nearest"))


def steps_of_engine(
    models: list[mujoco.MjModel], data: mujoco.MjData, start: FloatArray, controls: FloatArray
) -> FloatArray:
    """Return what `dry_friction.rollout` does with a pin's force, (R, n, 8), by MuJoCo's own steps.

    `mujoco.rollout` does not tell of a pin.

    Args:
        models: Of each motion, R, with the sizes of `data`.
        data: To step with.
        start: Time, position, velocity and what else there is of a full state, (R, S).
        controls: What `userdata` is at each step, (R, n, USERDATA_SIZE).
    """
    out = np.empty((*controls.shape[:2], dry_friction.STATE_AND_PIN))
    pin = slice(dry_friction.PUSH_SIZE + dry_friction.OUT_PIN, dry_friction.PUSH_SIZE + dry_friction.OUT_PIN + 2)
    with quiet():  # what runs away is told by its residuals
        for r, model in enumerate(models):
            mujoco.mj_resetData(model, data)
            mujoco.mj_setState(model, data, start[r], mujoco.mjtState.mjSTATE_FULLPHYSICS.value)
            for k, row in enumerate(controls[r]):
                data.userdata[:] = row
                mujoco.mj_step(model, data)
                out[r, k] = *data.qpos, *data.qvel, *data.userdata[pin]
    return out
