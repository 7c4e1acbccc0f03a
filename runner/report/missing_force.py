"""The missing force: the generalised force that would have to be added for a model to follow the recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis
    from runner.localise.where import Where
    from runner.systems.base import AbstractSystem

LEAST = 3  # windows that make a mean
BADLY = 3.0  # times the usual error: what is known worse than that is not drawn


def components(system: AbstractSystem) -> dict[str, str]:
    """Return what of the missing force is looked at: the column, and what it is called."""
    return {**system.force_views, **dict(zip(system.disturbance.names, system.disturbance.labels, strict=True))}


@dataclass(frozen=True)
class MissingForce:
    """The missing force of one episode, window by window.

    Args:
        t_s: Middle of each window from the start of the episode, (n,).
        value: As `Disturbance` names it, (n, D), NaN where it can't be seen (friction holds the object).
        error: Standard errors, (n, D).
    """

    t_s: np.ndarray
    value: np.ndarray
    error: np.ndarray

    @property
    def seen(self) -> np.ndarray:
        """Where each component is known about as well as it usually is, (n, D)."""
        known = np.isfinite(self.error)
        usual = np.array([np.median(e[k]) if k.any() else 0.0 for e, k in zip(self.error.T, known.T, strict=True)])
        return np.asarray(known & (np.nan_to_num(self.error, nan=np.inf) <= BADLY * usual))


def missing_force(diagnosis: Diagnosis, where: Where | None, episode: int) -> MissingForce | None:
    """Return the missing force of an episode (its place in the recording); None: it was not worked out."""
    if where is None:
        return None
    recorded = diagnosis.recording.episodes[episode]
    table = where.missing_force.loc[where.missing_force["episode"] == f"episode {recorded.index}"]
    if not len(table):
        return None
    names = list(diagnosis.system.disturbance.names)
    return MissingForce(
        table["t_s"].to_numpy(float) - float(recorded.t_s[0]),
        table[names].to_numpy(float),
        table[[f"{n}_se" for n in names]].to_numpy(float),
    )


@dataclass(frozen=True)
class Mean:
    """The mean of one component of the missing force in one regime, and its standard error; `count` windows."""

    regime: str
    component: str
    value: float
    error: float
    count: int


def by_regime(diagnosis: Diagnosis, where: Where) -> list[Mean]:
    """Return the mean missing force of every regime in which it can be seen, each window by its certainty."""
    table = where.missing_force
    out = []
    for regime in diagnosis.system.regimes:
        part = table.loc[table["regime"] == regime]
        for component in components(diagnosis.system):
            value, error = part[component].to_numpy(float), part[f"{component}_se"].to_numpy(float)
            known = np.isfinite(value) & np.isfinite(error) & (error > 0)
            if known.sum() >= LEAST:
                out.append(Mean(regime, component, *_mean(value[known], error[known]), int(known.sum())))
    return out


def _mean(value: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    """Return the weighted mean and its standard error, from the scatter where that is larger than the errors say."""
    weight = 1 / (error**2 + max(float(np.var(value)) - float(np.mean(error**2)), 0.0))
    mean = float(np.sum(weight * value) / weight.sum())
    scatter = float(np.sum(weight * (value - mean) ** 2) / max(len(value) - 1, 1))
    return mean, float(np.sqrt(max(scatter, 1.0) / weight.sum()))
