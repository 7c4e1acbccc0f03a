"""What a diagnosis says: explanations with probabilities, where the gap lies, how far it shrinks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from runner.effects.base import Effects
from runner.inference.confounding import Rival
from runner.localise.dated import DatedDisturbance
from runner.localise.likeness import Likeness
from runner.localise.where import Where
from runner.noise.measured import Measured
from runner.recording import Span
from runner.systems.base import AbstractSystem

ByEffect = dict[str, dict[str, float]]


@dataclass(frozen=True)
class Ranked:
    """One explanation, with what these data can't tell from it.

    Args:
        effects: The vocabulary's names; ("none",) and ("unknown",) are explanations too.
        equivalent: Other sets of names that explain the recording as well; the probability is that of all together.
        probability: Of this explanation, or one of its equivalents; all sum to 1.
        values: The effects with their fitted values.
        parameters: Values by effect and parameter, SI units.
        errors: Their standard errors, the simulator's own inexactness included.
        gap_closed: 1 - error after / error before, on the held-out episodes; None: not computed.
        log_evidence: Natural log, relative to the best explanation. None: `unknown` has no model to weigh, and what is
            far behind on the fitted episodes is not held against the others.
        equal_numbers: Of `equivalent`, `parameters` and `errors` of each; no errors of what a trial alone has told.
    """

    effects: tuple[str, ...]
    equivalent: tuple[tuple[str, ...], ...]
    probability: float
    values: Effects
    parameters: ByEffect
    errors: ByEffect
    gap_closed: float | None
    log_evidence: float | None
    equal_numbers: Mapping[tuple[str, ...], tuple[ByEffect, ByEffect]] = field(default_factory=dict)


@dataclass(frozen=True)
class Closure:
    """How far the gap shrinks on the held-out episodes, start states fitted to them with either model.

    `table`: one row per episode and channel: root mean square before and after, in the channel's unit and in noises.
    `regimes`: the same by what went on, see `closure_by_regime`. The interval is over episodes and blocks of a second
    (percentile bootstrap).
    """

    table: pd.DataFrame
    regimes: pd.DataFrame
    gap_closed: float
    gap_closed_low: float
    gap_closed_high: float
    closable_closed: float


@dataclass(frozen=True)
class Nearest:
    """An explanation that comes near where none holds, and what speaks against it.

    Args:
        ranked: It.
        gap_closed: 1 - error after / error before, on the held-out episodes.
        fitted_closed: The same of what was fitted.
        left_fitted: What it leaves of what was fitted, as a share of what the nominal model leaves (mean squares, both
            less the noise's).
        left_unseen: The same of the held-out episodes.
        behind: By how much it is less likely than the first of those named, in natural log odds.
        unsure: Which of its effects do not stand out of their own errors.
    """

    ranked: Ranked
    gap_closed: float
    fitted_closed: float
    left_fitted: float
    left_unseen: float
    behind: float
    unsure: tuple[str, ...]


@dataclass(frozen=True)
class Abstention:
    """What is told where no explanation holds: the nearest, where the first of them still misses, and how.

    `looks` are what the forces look like that are missing beside it.
    """

    nearest: tuple[Nearest, ...]
    after: Where
    looks: tuple[Likeness, ...]


@dataclass(frozen=True)
class Flights:
    """What flights until the first hit say by themselves, where the answer for all of it is none, or another one.

    Args:
        effects: Their likeliest explanation: the vocabulary's names, or ("none",).
        probability: Its own among what explains flights, by a search whose fits only begin.
        parameters: Values by effect and parameter, SI units.
        errors: Their standard errors.
        noises: The root mean square that it leaves, in noises.
        sentence: All of it in words.
        advice: What to do.
    """

    effects: tuple[str, ...]
    probability: float
    parameters: dict[str, dict[str, float]]
    errors: dict[str, dict[str, float]]
    noises: float
    sentence: str
    advice: str

    @property
    def note(self) -> str:
        """What is said where no list of next steps has the advice."""
        return f"{self.sentence} {self.advice}"


@dataclass(frozen=True)
class Diagnosis:
    """All that `runner diagnose` says of a case; arrays and tables are not to be written to.

    `fitted` and `held_out` are episodes of the recording by their position. Models were replayed in `stretches`, each
    with a start state of its own, (S,): `nominal_starts` and `corrected_starts` by the position of a stretch.
    `measured` is of whole episodes. `left_by_episode` is what the corrected model leaves beyond the noise, in squared
    noises summed over values, by the number of the episode. Of such squares noise of a measured force hardly makes more
    than `drive_excess`. `doubts` are of the numbers of the best explanation, `notes` of all else. It took `wall_s` by
    the clock and `cpu_s` of the processor, all threads of this process together, and `simulated_s` of motion were
    simulated in it.
    """

    case: str
    system: AbstractSystem
    ranked: tuple[Ranked, ...]
    abstain: bool
    gap_closed: float
    effects: Effects
    fitted: tuple[int, ...]
    held_out: tuple[int, ...]
    stretches: tuple[Span, ...]
    measured: Measured
    nominal_starts: dict[int, np.ndarray]
    corrected_starts: dict[int, np.ndarray]
    where: Where
    closure: Closure
    excess: float
    nominal_excess: float
    drive_excess: float
    left_by_episode: Mapping[int, float]
    wall_s: float
    cpu_s: float
    simulated_s: float
    next_push: str | None
    disturbances: tuple[DatedDisturbance, ...]
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    rivals: tuple[Rival, ...] = ()
    abstention: Abstention | None = None
    flights: Flights | None = None

    @property
    def recording(self) -> Any:
        """What was diagnosed."""
        return self.system.recording
