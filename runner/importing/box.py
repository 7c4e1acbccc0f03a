"""The case of a box that is pushed over a floor: columns of the planar form, each from a signal of the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.errors import RecordingError, nearest
from runner.importing.entries import Entry, Plan, Role, beside_of, entry_of
from runner.importing.map_file import EVEN, NEAREST, BoxMap
from runner.recording import Form, Nominal
from runner.recording.nominal import load_mapping, nominal_of
from runner.recording.table import FORCE, PIN, POINT, POSE, TWIST, UNITS

MEASURED = (*POSE[Form.PLANAR], *TWIST[Form.PLANAR])
COMMANDED = (*FORCE[:2], *POINT, *PIN)
OF_PIN = (*FORCE[:2], *POINT)  # where a pin's path is what drives: measured, if at all
NOISE = {"x": "position", "y": "position", "yaw": "yaw", "vx": "velocity", "vy": "velocity", "wz": "rate"}
SUFFIXES = (".yaml", ".yml")


def believed(path: Path, rate_hz: float) -> tuple[Nominal, Mapping[str, Any]]:
    """Return what is believed of a box, checked and as it stands in the file, with the rate of the recording.

    Args:
        path: YAML as `nominal.yaml` of a case; its `rate_hz` may be missing.
        rate_hz: Of the recording.

    Raises:
        RecordingError: As `read_nominal` does.
    """
    content = {**load_mapping(path, ()), "rate_hz": rate_hz}
    try:
        return nominal_of(content, path), content
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def plan_box(path: Path, wanted: BoxMap, model: Path) -> Plan:
    """Return what a map asks for.

    Args:
        path: The map, for messages.
        wanted: What it says.
        model: YAML with what is believed of the box.

    Raises:
        RecordingError: If a column is none of a case of a box, a unit measures something else, or rows are uneven.
    """
    rate_hz = wanted.rows.rate_hz
    if wanted.rows.at not in (EVEN, NEAREST) or rate_hz is None:
        raise RecordingError(
            f"{path}: rows: a box needs even ones, as in {{at: {NEAREST}, rate_hz: 30}}; got at: {wanted.rows.at}."
        )
    nominal, content = believed(model, rate_hz)
    measured = MEASURED if nominal.pin is None else (*MEASURED, *OF_PIN)
    entries, beside = list[Entry](), beside_of(wanted.commands)
    for group, role, allowed in (("commands", Role.COMMAND, COMMANDED), ("channels", Role.CHANNEL, measured)):
        for column, keys in getattr(wanted, group).items():
            if column not in allowed:
                raise RecordingError(f"{path}: {group}.{column}: unknown column. {nearest(column, allowed)}")
            try:
                entry = entry_of(f"{group}.{column}", column, keys, UNITS[column], role, beside=beside)
                acts = FORCE[:2] if role is Role.COMMAND and column in POINT else ()
                entries.append(replace(entry, acts=acts))
            except RecordingError as error:
                raise RecordingError(f"{path}: {error}") from None
    noise = {k: v for k, v in wanted.noise.items() if v is not None}
    return Plan(tuple(entries), {**content, **({"noise": noise} if noise else {})}, None, None)


def with_whole_turns(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose yaw does not jump by full turns within an episode."""
    for _, rows in table.groupby("episode", sort=False):
        seen = rows["yaw"].dropna() if "yaw" in rows else rows.iloc[:0]
        if len(seen):
            table.loc[seen.index, "yaw"] = np.unwrap(seen.to_numpy())
    return table
