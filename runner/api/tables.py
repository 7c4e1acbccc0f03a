"""What a results folder holds, as one table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from runner.errors import ResultError
from runner.storage.parquet_file import UNREADABLE, ParquetError, read_whole
from runner.teleop import tables

GAP = "gap.parquet"
VERDICT = ["effects", "probability", "gap_closed", "effect", "parameter", "value", "standard_error"]


def read_table(*folders: str | Path) -> pd.DataFrame:
    """Return one table of what is in results folders, and in the folders within them.

    Of `runner run`, and of sweeps: a row for each run. Where there is no run, of `runner diagnose`: a row for each
    explanation and parameter, with the folder as `case`; see `verdict_table`. Where there is neither, of `runner gap`:
    a row for each case, channel, horizon and kind of start.

    Raises:
        RunnerError: If a folder does not exist, or holds none of these.
    """
    paths = [Path(folder) for folder in folders]
    try:
        return tables.collect(paths)
    except ResultError:
        from runner.diagnosis.verdict import FILE  # which takes its time

        for name, read in ((FILE, _read_verdict), (GAP, _read_gap)):
            files = [sorted(path.rglob(name)) for path in paths]
            if files and all(files):
                return pd.concat([read(file) for some in files for file in some], ignore_index=True)
        raise


def verdict_table(case: str, ranked: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Return a verdict as a table, likeliest explanation first.

    Args:
        case: Its name, for the column `case`.
        ranked: The list of that name in a verdict.

    Returns:
        `case`, `effects` ("friction + wind"; "none" and "unknown" are explanations too), `probability`, `gap_closed`,
        and a row for each `effect` and `parameter` with `value` and `standard_error`, SI units.
    """
    rows = []
    for one in ranked:
        said = (" + ".join(one["effects"]), one["probability"], one.get("gap_closed"))
        values = [(e, p, v) for e, numbers in one["parameters"].items() for p, v in numbers.items()]
        errors = one["standard_errors"]
        rows += [(*said, e, p, v, errors.get(e, {}).get(p)) for e, p, v in values] or [(*said, None, None, None, None)]
    table = pd.DataFrame(rows, columns=VERDICT)
    numbers = ["probability", "gap_closed", "value", "standard_error"]
    table[numbers] = table[numbers].astype(float)
    table.insert(0, "case", case)
    return table


def _read_verdict(file: Path) -> pd.DataFrame:
    from runner.diagnosis.verdict import read_verdict

    ranked = read_verdict(file)["ranked"]
    try:
        return verdict_table(str(file.parent), ranked)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ResultError(f"{file}: is no verdict: {type(error).__name__}: {str(error)[:200]}.") from None


def _read_gap(file: Path) -> pd.DataFrame:
    try:
        return read_whole(file).to_pandas()
    except (ParquetError, *UNREADABLE) as error:
        raise ResultError(f"{file}: can't be read: {str(error)[:300]}") from None
