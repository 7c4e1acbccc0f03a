"""The missing wrench of one episode, out of the tables of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from runner.diagnose.diagnosis import Diagnosis


@dataclass(frozen=True)
class Wrench:
    """Force and moment that would have to be added for the nominal model to follow the recording.

    Args:
        t_s: From the start of the episode, (n,).
        force_n: World axes, (n, 2).
        moment_nm: About the vertical, (n,).
    """

    t_s: np.ndarray
    force_n: np.ndarray
    moment_nm: np.ndarray


def missing_wrench(diagnosis: Diagnosis, episode: int) -> Wrench | None:
    """Return the missing wrench of an episode; None: it was not worked out."""
    return None
