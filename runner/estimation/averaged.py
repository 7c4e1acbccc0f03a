"""The median or the mean of a published rule's last estimates, as variants of it.

The paper wishes for an estimate that can be trusted, and proposes the median or the mean of the estimates. The rule
corrects the mass that its local cube has, and that is the average: so an average follows as fast as half (median) or
all (mean) of its window has been renewed, and lets single wild estimates pass without a trace (median) or damped.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from enum import Enum

from runner.config import registered
from runner.errors import check_range
from runner.teleop.estimators import AbstractEstimator, Compared, MassRule, Outcome, Seen, Setup


class Average(Enum):
    """Which average."""

    median = "median"
    mean = "mean"


@dataclass(frozen=True)
class AveragedMemory:
    """The mass that is given out, and the last estimates that the rule made, oldest first."""

    mass_kg: float
    last_kg: tuple[float, ...] = ()


@registered("estimator")
@dataclass(frozen=True)
class Averaged(AbstractEstimator):
    """An average of the last `updates` estimates that a rule has made; updates at which it held do not count."""

    rule: MassRule
    average: Average = Average.median
    updates: int = 15

    def __post_init__(self) -> None:
        check_range("updates", self.updates, 1, 10_000)

    @property
    def compared(self) -> Compared:
        return self.rule.compared

    def start(self, setup: Setup) -> AveragedMemory:
        return AveragedMemory(self.rule.start(setup))

    def update(self, memory: AveragedMemory, seen: Seen) -> tuple[AveragedMemory, Outcome]:
        estimate, outcome = self.rule.update(memory.mass_kg, seen)
        if outcome is not Outcome.updated:
            return memory, outcome
        last = (*memory.last_kg, estimate)[-self.updates :]
        average = statistics.median if self.average is Average.median else statistics.fmean
        return AveragedMemory(average(last), last), outcome

    def values(self, memory: AveragedMemory) -> tuple[float, ...]:
        return (memory.mass_kg,)
