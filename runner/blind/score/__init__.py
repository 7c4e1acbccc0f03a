"""The score of a blind test: every figure with its interval, beside the bar that it is to reach.

Beyond what is right and wrong: how well the stated intervals of parameters hold what was planted, how near the place
of a patch or a tether is, and which share of the closable gap is closed against an oracle that was told the effect.
"""

from __future__ import annotations

from runner.blind.score.bars import Bar, if_calibrated
from runner.blind.score.gap import of_oracle
from runner.blind.score.tables import BlindScore, blind_score, check_hash

__all__ = ["Bar", "BlindScore", "blind_score", "check_hash", "if_calibrated", "of_oracle"]
