"""The missing wrench: the force and moment that would have to be added for a model to follow the recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from runner.localise.where import REGIMES, WINDOWS_S

if TYPE_CHECKING:
    from runner.diagnosis.pipeline import Diagnosis
    from runner.localise.where import Where

# what of it is looked at: the column, and what it is called
COMPONENTS = {
    "along": "along the motion [N]",
    "left": "left of the motion [N]",
    "fx_n": "towards world x [N]",
    "fy_n": "towards world y [N]",
    "mz_n_m": "moment about z [N m]",
}


LEAST = 3  # windows that make a mean
BADLY = 3.0  # times the usual error: what is known worse than that is not drawn


@dataclass(frozen=True)
class Wrench:
    """The missing wrench of one episode, window by window.

    Args:
        t_s: Middle of each window from the start of the episode, (n,).
        force_n: World axes, (n, 2), NaN where it can't be seen (friction holds the body).
        moment_nm: About the vertical through the geometric centre, (n,).
        error: Standard errors of both forces and the moment, (n, 3).
    """

    t_s: np.ndarray
    force_n: np.ndarray
    moment_nm: np.ndarray
    error: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Where it is known about as well as it usually is, (n,)."""
        known = np.asarray(np.isfinite(self.error).all(axis=1))
        if not known.any():
            return known
        usual = np.median(self.error[known], axis=0)
        return np.asarray(known & (np.nan_to_num(self.error, nan=np.inf) <= BADLY * usual).all(axis=1))


def missing_wrench(diagnosis: Diagnosis, where: Where | None, episode: int) -> Wrench | None:
    """Return the missing wrench of an episode (its place in the recording); None: it was not worked out."""
    if where is None:
        return None
    recorded = diagnosis.recording.episodes[episode]
    table = where.wrench.loc[where.wrench["episode"] == f"episode {recorded.index}"]
    if not len(table):
        return None
    names = ["fx_n", "fy_n", "mz_n_m"]
    return Wrench(
        table["t_s"].to_numpy(float) - float(recorded.t_s[0]),
        table[names[:2]].to_numpy(float),
        table[names[2]].to_numpy(float),
        table[[f"{n}_se" for n in names]].to_numpy(float),
    )


@dataclass(frozen=True)
class Mean:
    """The mean of one component of the missing wrench in one regime, and its standard error; `count` windows."""

    regime: str
    component: str
    value: float
    error: float
    count: int


def by_regime(diagnosis: Diagnosis, where: Where) -> list[Mean]:
    """Return the mean missing wrench of every regime in which it can be seen, each window by its certainty."""
    table = along_motion(diagnosis, where)
    out = []
    for regime in REGIMES:
        part = table.loc[table["regime"] == regime]
        for component in COMPONENTS:
            value, error = part[component].to_numpy(float), part[f"{component}_se"].to_numpy(float)
            known = np.isfinite(value) & np.isfinite(error) & (error > 0)
            if known.sum() >= LEAST:
                out.append(Mean(regime, component, *_mean(value[known], error[known]), int(known.sum())))
    return out


def along_motion(diagnosis: Diagnosis, where: Where) -> pd.DataFrame:
    """Return the missing wrench with its parts `along` and `left` of the motion, NaN where the body hardly moves."""
    table = where.wrench
    velocity = np.full((len(table), 2), np.nan)
    for e, episode in enumerate(diagnosis.recording.episodes):
        rows = np.flatnonzero((table["episode"] == f"episode {episode.index}").to_numpy())
        at = table["t_s"].to_numpy(float)[rows]
        near = np.abs(np.asarray(episode.t_s) - at[:, None]) <= 0.5 * WINDOWS_S[0]
        values = np.where(diagnosis.measured.valid[e], diagnosis.measured.values[e], np.nan)[:, 3:5]
        velocity[rows] = [
            np.nanmean(values[n], axis=0) if np.isfinite(values[n]).any() else (np.nan,) * 2 for n in near
        ]
    speed = np.linalg.norm(velocity, axis=1)
    moves = table["heading in the world"].map(lambda h: isinstance(h, str)).to_numpy(bool)
    c, s = np.where(moves, velocity.T / np.where(speed > 0, speed, np.nan), np.nan)
    force, error = (table[[f"fx_n{k}", f"fy_n{k}"]].to_numpy(float) for k in ("", "_se"))
    return table.assign(
        along=c * force[:, 0] + s * force[:, 1],
        left=c * force[:, 1] - s * force[:, 0],
        along_se=np.hypot(c * error[:, 0], s * error[:, 1]),
        left_se=np.hypot(s * error[:, 0], c * error[:, 1]),
    )


def _mean(value: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Return the weighted mean and its standard error, from the scatter where that is larger than the errors say."""
    weight = 1 / (error**2 + max(float(np.var(value)) - float(np.mean(error**2)), 0.0))
    mean = float(np.sum(weight * value) / weight.sum())
    scatter = float(np.sum(weight * (value - mean) ** 2) / max(len(value) - 1, 1))
    return mean, float(np.sqrt(max(scatter, 1.0) / weight.sum()))
