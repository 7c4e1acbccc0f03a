"""Make cases whose answers are withheld: recordings of the second physics, and what was planted in them elsewhere.

How large an effect is follows from how far it moves the recording, not from its parameter: `error_ratio` is the rms
difference between the recording and a simulation of what the owner believes, started from the true state, over all
samples and channels, in units of the noise. With nothing but noise it is 1. The parameter is found by bracketing and
regula falsi on that ratio.
"""

from __future__ import annotations

from runner.blind.make.case import make_case
from runner.blind.make.case_set import HASH_FILE, MadeCases, make_cases, part_of
from runner.blind.make.plan import BANDS, CasePlan, Mix, plan_cases
from runner.blind.make.reality import Reality
from runner.blind.make.size import find_size, simulate_or_none

__all__ = [
    "BANDS",
    "HASH_FILE",
    "CasePlan",
    "MadeCases",
    "Mix",
    "Reality",
    "find_size",
    "make_case",
    "make_cases",
    "part_of",
    "plan_cases",
    "simulate_or_none",
]
