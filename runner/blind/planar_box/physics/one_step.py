"""Single steps from sample to sample, where the command changes at every sample."""

from __future__ import annotations

import math

from numba import njit

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.motion import rate


@njit(error_model="numpy")
def dormand_prince(y, t, h, p, rtol, atol):
    """Return the state after one step, and its estimated error over the tolerance."""
    k1 = rate(y, t, p)
    k2 = rate(y + h * 0.2 * k1, t + 0.2 * h, p)
    k3 = rate(y + h * (0.075 * k1 + 0.225 * k2), t + 0.3 * h, p)
    k4 = rate(y + h * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3), t + 0.8 * h, p)
    k5 = rate(
        y + h * (19372.0 / 6561.0 * k1 - 25360.0 / 2187.0 * k2 + 64448.0 / 6561.0 * k3 - 212.0 / 729.0 * k4),
        t + 8.0 / 9.0 * h,
        p,
    )
    k6 = rate(
        y
        + h * (9017.0 / 3168.0 * k1 - 355.0 / 33.0 * k2 + 46732.0 / 5247.0 * k3 + 49.0 / 176.0 * k4)
        - h * 5103.0 / 18656.0 * k5,
        t + h,
        p,
    )
    new = y + h * (
        35.0 / 384.0 * k1 + 500.0 / 1113.0 * k3 + 125.0 / 192.0 * k4 - 2187.0 / 6784.0 * k5 + 11.0 / 84.0 * k6
    )
    k7 = rate(new, t + h, p)
    error = 0.0
    for i in range(6):
        e = 71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] + 71.0 / 1920.0 * k4[i]
        e += -17253.0 / 339200.0 * k5[i] + 22.0 / 525.0 * k6[i] - 0.025 * k7[i]
        error = max(error, abs(h * e) / (atol + rtol * abs(new[i])))
    return new, error


@njit(error_model="numpy")
def march(p, y, starts, targets, held, lag, first, last, end, sample, filled, result, rtol, atol):
    """Go through the intervals first <= k < last by single steps as long as their error allows; fill `result`.

    Returns:
        The interval that was not finished (`last` where all were) and the number of samples filled. `y` and `held`
        are those at the start of that interval.
    """
    n = sample.size
    for k in range(first, last):
        p[at.T0] = starts[k]
        for i in range(8):
            p[at.A0 + i] = targets[k, i]
            p[at.B0 + i] = held[i] - targets[k, i] if lag > 0.0 else 0.0
        stop = min(starts[k + 1], end) if k + 1 < starts.size else end
        now = y.copy()
        t = starts[k]
        reached = filled
        while True:
            while reached < n and sample[reached] <= t + 1e-9:
                result[reached] = now
                reached += 1
            if t >= stop - 1e-12 or reached >= n:
                break
            goal = min(stop, sample[reached])
            step = goal - t
            tries = 0
            while t < goal - 1e-12 and tries < 6:
                new, error = dormand_prince(now, t, step, p, rtol, atol)
                tries += 1
                if error <= 1.0:
                    now = new
                    t += step
                    step = min(step, goal - t)
                elif error < 1e3:
                    step *= 0.5
                else:
                    break  # stiff: the body sticks or is about to
            if t < goal - 1e-12:
                return k, filled
            t = goal
        y[:] = now
        filled = reached
        if lag > 0.0 and k + 1 < starts.size:
            decay = math.exp(-(starts[k + 1] - starts[k]) / lag)
            for i in range(8):
                held[i] = targets[k, i] + (held[i] - targets[k, i]) * decay
    return last, filled
