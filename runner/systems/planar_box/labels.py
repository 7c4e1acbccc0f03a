"""What a box on a floor was doing in a stretch of time, and where: from commands and measurements alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd

from runner.effects.planar_box import Context
from runner.numerics.arrays import over_gaps
from runner.recording import Recording
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.planar_box.motion import motion, state_columns
from runner.systems.windows import Labels, Windows

PLACES = 5  # cells along each side of the floor map
SECTORS = 8

REGIMES = (
    "at rest",
    "stuck under load",
    "pushed straight",
    "pushed turning",
    "coasting",
    "spinning",
    "just after a change of command",
)
FACTORS = {
    "regime": "{}",
    "push": "under {}",
    "place": "around {}",
    "heading in the world": "when moving towards {} in the world",
    "heading in the body": "when moving towards {} in the body",
    "speed": "at {}",
    "time": "in {} of an episode",
    "episode": "in {}",
}


def label(recording: Recording, context: Context, measured: Signals, windows: Windows) -> Labels:
    """Return what went on in each window, from commands and measurements alone, and where the places are."""
    size, rate = context.size_m, recording.nominal.rate_hz
    states = motion(recording)
    mean = windows.of(states).mean(axis=1)
    velocity, turning = mean[:, 3:5], mean[:, 5]
    speed, surface = np.linalg.norm(velocity, axis=1), np.abs(turning) * size
    slow = 0.01 * np.sqrt(recording.nominal.gravity_m_s2 * size)
    error = _rate_errors(recording, measured.sigma, windows.samples)
    moves, turns = speed > max(slow, 4 * error[0]), surface > max(slow, 4 * error[2] * size)

    force, arm, changed = [], [], []
    for episode, moved in zip(recording.episodes, states, strict=True):
        f, (c, s) = over_gaps(episode.force_n[:, :2], episode.t_s), (np.cos(moved[:, 2]), np.sin(moved[:, 2]))
        point = np.nan_to_num(episode.point_m)
        px, py = c * point[:, 0] - s * point[:, 1], s * point[:, 0] + c * point[:, 1]
        moment = px * f[:, 1] - py * f[:, 0]
        size_n = np.linalg.norm(f, axis=1)
        force.append(size_n)
        arm.append(np.divide(moment, size_n * size, out=np.zeros_like(moment), where=size_n > 0))
        # the moment turns with the body: a change of point is one of the command
        jump = np.linalg.norm(np.diff(f, axis=0, prepend=f[:1]), axis=1)
        shift = np.linalg.norm(np.diff(point * size_n[:, None], axis=0, prepend=(point * size_n[:, None])[:1]), axis=1)
        changed.append(np.maximum(jump, shift / size) > SETTINGS.where.command_change * context.force_n)
    steps = windows.samples - 1
    held, arms = windows.of(force)[:, :-1], windows.of(arm)[:, :-1]
    pushed = (held > 1e-9 * context.force_n).mean(axis=1) > 0.5
    lever = (arms * held).sum(axis=1) / np.maximum(held.sum(axis=1), 1e-300)
    back = round(SETTINGS.where.just_after_s * rate)
    after = np.array(
        [changed[e][max(0, f - back) : f + steps].any() for e, f in zip(windows.episode, windows.first, strict=True)],
        bool,
    )
    still = ~moves & ~turns
    regime = np.select(
        [after, still & pushed, still, pushed & (surface > 0.3 * speed), pushed, surface > speed],
        [REGIMES[i] for i in (6, 1, 0, 3, 2, 5)],
        REGIMES[4],
    )
    push = np.select(
        [~pushed, np.abs(lever) < 0.1, lever > 0],
        ["no push", "a central push", "an off-centre push (counter-clockwise)"],
        "an off-centre push (clockwise)",
    )
    sector = np.arctan2(velocity[:, 1], velocity[:, 0])
    place, places = _places(mean[:, :2])
    middle = windows.first + steps / 2
    part = middle / np.array([len(recording.episodes[e]) for e in windows.episode])
    tags = pd.DataFrame(
        {
            "episode": [f"episode {recording.episodes[e].index}" for e in windows.episode],
            "t_s": [recording.episodes[e].t_s[0] + m / rate for e, m in zip(windows.episode, middle, strict=True)],
            "x_m": mean[:, 0],
            "y_m": mean[:, 1],
            "yaw_rad": mean[:, 2],
            "vx_m_s": velocity[:, 0],
            "vy_m_s": velocity[:, 1],
            "speed_m_s": speed,
            "rate_rad_s": turning,
            "regime": regime,
            "push": push,
            "place": place,
            "heading in the world": _sector(sector, moves),
            "heading in the body": _sector(sector - mean[:, 2], moves),
            "speed": _speeds(speed, moves),
            "time": np.array([f"the {q} quarter" for q in ("first", "second", "third", "last")])[
                np.minimum(4 * part, 3).astype(int)
            ],
        }
    )
    return Labels(tags, places)


def _rate_errors(recording: Recording, sigma: np.ndarray, samples: int) -> np.ndarray:
    """Return the standard error of the mean of vx, vy, wz over a window, (3,); of a slope where it was not measured."""
    columns = state_columns(recording)
    known = dict(zip(columns.tolist(), sigma[: len(columns)], strict=True))
    slope = np.sqrt(2.0) * recording.nominal.rate_hz / max(samples - 1, 1)
    return np.array([known[k] / np.sqrt(samples) if k in known else slope * known[k - 3] for k in (3, 4, 5)])


def _sector(angle: np.ndarray, moves: np.ndarray) -> np.ndarray:
    step = 360 // SECTORS
    degrees = (np.round(np.degrees(angle) / step).astype(int) * step + 179) % 360 - 179
    return np.array([f"{d:d}°" if m else None for d, m in zip(degrees, moves, strict=True)], dtype=object)


def _speeds(speed: np.ndarray, moves: np.ndarray) -> np.ndarray:
    out = np.full(len(speed), None, dtype=object)
    if moves.sum() >= 8:
        edges = np.quantile(speed[moves], [0, 0.25, 0.5, 0.75, 1])
        k = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, 3)
        out[moves] = np.array([f"{a:.2f} to {b:.2f} m/s" for a, b in pairwise(edges)])[k[moves]]
    return out


def _places(xy: np.ndarray) -> tuple[np.ndarray, dict[str, tuple[float, float]]]:
    """Return a label of the floor's cell for each position (W, 2), and the cells' centres; the cells are square."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    side = max(float((high - low).max()) / PLACES, 1e-9)
    cell = np.minimum((xy - low) // side, np.ceil((high - low) / side) - 1).clip(0).astype(int)
    centre = low + (cell + 0.5) * side
    labels = [f"x {x:.2f} m, y {y:.2f} m" for x, y in centre]
    return np.array(labels, dtype=object), {
        label: (float(x), float(y)) for label, (x, y) in zip(labels, centre, strict=True)
    }
