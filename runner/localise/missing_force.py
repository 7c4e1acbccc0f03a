"""The missing force: what, added to the command of a window, makes the model follow the measurement best.

It is a constant generalised force per window. Where friction holds the object, no such force can be seen, and it is
NaN.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from runner.localise.excess import WindowExcess
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


def missing_force(system: AbstractSystem, windows: WindowExcess) -> tuple[np.ndarray, np.ndarray]:
    """Return the force that is missing in each window, (W, D), and its covariance, (W, D, D)."""
    step = system.disturbance.steps
    covariance = windows.force_covariance * float(windows.noise.max())
    return windows.force * step, covariance * step[:, None] * step


def missing_force_table(system: AbstractSystem, windows: WindowExcess) -> pd.DataFrame:
    """Return the missing force of each window, with its errors and the system's further views of it, one row each."""
    prior = system.disturbance.prior
    value, spread = missing_force(system, windows)
    error = np.sqrt(np.einsum("wdd->wd", spread))
    known = error < SETTINGS.where.force_error_share * prior
    out = {}
    for i, name in enumerate(system.disturbance.names):
        out[name] = np.where(known[:, i], value[:, i], np.nan)
        out[f"{name}_se"] = np.where(known[:, i], error[:, i], np.nan)
    views = system.missing_force_views(
        np.where(known, value, np.nan),
        np.where((known[:, :, None] & known[:, None, :]), spread, np.nan),
        windows.labels,
    )
    return pd.DataFrame(out | views)
