"""Recordings: what was commanded and what was measured, checked before anything is computed from it.

A case is a folder with `recording.parquet` (or `recording.csv`) and `nominal.yaml`. SI units, radians, z up. The
columns are listed in `runner.recording.table`, the keys of `nominal.yaml` in `runner.recording.nominal`.
"""

from runner.recording.case import find_cases, read_case, write_case
from runner.recording.data import BelievedPin, Episode, Form, Noise, Nominal, Recording, Span, Support
from runner.recording.nominal import read_nominal, write_nominal

__all__ = [
    "BelievedPin",
    "Episode",
    "Form",
    "Noise",
    "Nominal",
    "Recording",
    "Span",
    "Support",
    "find_cases",
    "read_case",
    "read_nominal",
    "write_case",
    "write_nominal",
]
