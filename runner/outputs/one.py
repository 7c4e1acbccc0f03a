"""What a diagnosis leaves in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from runner.diagnosis.corrected import write_corrected, write_equals
from runner.diagnosis.result import Diagnosis
from runner.diagnosis.verdict import FILE, verdict
from runner.errors import ResultError, WriteError
from runner.report import words
from runner.storage.writing import write_json, write_parquet

# what a diagnosis may leave beside its verdict; corrected model and closure are always written anew
LEFT = ("where_*.parquet", "report.html", "diagnosis.rrd", "or_*/corrected.yaml")


def write_all(diagnosis: Diagnosis, folder: Path, *, report: bool, provenance: Mapping[str, Any]) -> None:
    """Write what a diagnosis leaves; `verdict.json` last, as the sign that all is there.

    Args:
        diagnosis: What was found.
        folder: Where to; made if it is not there. What another diagnosis left in it is taken away first.
        report: Whether to write more than the verdict and the corrected model.
        provenance: What made it and what it belongs to, see `runner.outputs.many.made_from`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)
    write_parquet(folder / "closure.parquet", diagnosis.closure.table)
    write_parquet(folder / "closure_regimes.parquet", diagnosis.closure.regimes)
    diagnosis = with_corrected(diagnosis, folder)
    if report:
        from runner.report.html import write_html  # matplotlib, which takes a second
        from runner.report.record import write_rrd  # Rerun, likewise

        where = diagnosis.where
        tables = {
            "gap": where.gap,
            "windows": where.windows,
            "missing_force": where.missing_force,
            "cells": where.cells,
        }
        for name, table in tables.items():
            write_parquet(folder / f"where_{name}.parquet", table)
        write_html(diagnosis, folder / "report.html")
        write_rrd(diagnosis, folder / "diagnosis.rrd")
    content = {"sentence": words.verdict(diagnosis), **verdict(diagnosis), "provenance": dict(provenance)}
    write_json(folder / FILE, content)


def with_corrected(diagnosis: Diagnosis, folder: Path) -> Diagnosis:
    """Write the corrected model; where it can't be, return the diagnosis with a note that says why.

    What took minutes to find is not thrown away for the file that it would be used with.
    """
    try:
        write_corrected(folder, diagnosis.effects, diagnosis.system)
    except ResultError as error:
        return replace(diagnosis, notes=(*diagnosis.notes, f"No corrected model was written. {error}"))
    failed = write_equals(folder, diagnosis.ranked[0], diagnosis.system) if diagnosis.effects else []
    return replace(diagnosis, notes=(*diagnosis.notes, *failed)) if failed else diagnosis


def _clear(folder: Path) -> None:
    """Take away what a diagnosis left, the verdict first; what was not made by one stays."""
    named = [folder / FILE, *(f for pattern in LEFT for f in folder.glob(pattern))]
    try:
        for file in named:
            file.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: can't be written: {error.strerror}.") from error
