"""Quaternions w, x, y, z in arrays (..., 4), and turns as rotation vectors (..., 3), rad."""

from __future__ import annotations

import numpy as np

from runner.numerics.arrays import FloatArray


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product: first b, then a."""
    (aw, ax, ay, az), (bw, bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def inverse(q: FloatArray) -> FloatArray:
    """Return the opposite turn of unit quaternions."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def exponential(turn: FloatArray) -> FloatArray:
    """Return the quaternion of a rotation vector."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    # sin(x) / x, exact at zero
    return np.concatenate([np.cos(half), 0.5 * turn * np.sinc(half / np.pi)], axis=-1)


def logarithm(q: FloatArray) -> FloatArray:
    """Return the rotation vector of a unit quaternion, of length at most pi."""
    q = np.where(q[..., :1] < 0, -q, q)
    size = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    half = np.arctan2(size, q[..., :1])
    return 2.0 * q[..., 1:] / np.sinc(half / np.pi)


def continuous(turn: FloatArray) -> FloatArray:
    """Return rotation vectors (..., n, 3) with whole turns added about their axes so that they don't jump."""
    out = turn.copy()
    jumps = np.linalg.norm(np.diff(turn, axis=-2), axis=-1) > np.pi
    if not jumps.any():
        return out
    for k in range(int(np.argmax(jumps.reshape(-1, jumps.shape[-1]).any(axis=0))) + 1, turn.shape[-2]):
        now, before = out[..., k, :], out[..., k - 1, :]
        size = np.linalg.norm(now, axis=-1, keepdims=True)
        axis = np.divide(now, size, out=np.zeros_like(now), where=size > 1e-12)
        turns = np.round(np.sum((before - now) * axis, axis=-1, keepdims=True) / (2 * np.pi))
        out[..., k, :] = now + 2 * np.pi * turns * axis
    return out


def interpolated(t_s: FloatArray, q: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return orientations (n, 4) known at times (n,) at other times (m,): constant rate in between, held outside."""
    k = np.clip(np.searchsorted(t_s, at_s, side="right") - 1, 0, max(len(t_s) - 2, 0))
    if len(t_s) < 2:
        return q[k]
    share = np.clip((at_s - t_s[k]) / (t_s[k + 1] - t_s[k]), 0.0, 1.0)
    return multiply(q[k], exponential(logarithm(multiply(inverse(q[k]), q[k + 1])) * share[:, None]))
