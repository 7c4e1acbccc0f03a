"""As much of a contender as its odds need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Contended:
    """As much of a contender as its odds need."""

    fit: Any
    log_posterior: float
    evidence: Any = None
    against: float = 0.0
