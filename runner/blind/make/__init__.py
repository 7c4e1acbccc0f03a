"""Make cases whose answers are withheld: recordings of a second physics, and what was planted in them elsewhere.

Which physics is a maker's: `maker` says what one is, `runner.blind.worlds` which there are.

How large an effect is follows from how far it moves the recording, not from its parameter: `error_ratio` is the rms
difference between the recording and a simulation of what the owner believes, started from the true state, over all
samples and channels, in units of the noise. With nothing but noise it is 1. The parameter is found by bracketing and
regula falsi on that ratio.
"""

from __future__ import annotations

from runner.blind.make.case_set import HASH_FILE, MadeCases, make_cases, part_of
from runner.blind.make.maker import BANDS, PAIR_BANDS, AbstractMaker, CasePlan, Purpose
from runner.blind.make.plan import Mix, plan_cases
from runner.blind.make.size import RATIOS, draw_size, error_ratio, find_size, nearest_band, size_for

__all__ = [
    "BANDS",
    "HASH_FILE",
    "PAIR_BANDS",
    "RATIOS",
    "AbstractMaker",
    "CasePlan",
    "MadeCases",
    "Mix",
    "Purpose",
    "draw_size",
    "error_ratio",
    "find_size",
    "make_cases",
    "nearest_band",
    "part_of",
    "plan_cases",
    "size_for",
]
