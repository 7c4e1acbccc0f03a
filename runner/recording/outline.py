"""The outline of a body that is no box, as `nominal.yaml` says it: seen from above, about the geometric centre.

outline: {disc: 0.0525}                # m, radius
outline: {ellipse: [0.0525, 0.0785]}   # m, half axes along x and y
outline: [[0.06, 0.0], [0.0, 0.05], [-0.06, 0.0]]    # m, corners in order, at least three; may be bent inwards
outline: outlines.csv#hex              # corners in a table beside it: columns x, y and, where there are several, shape
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from runner.errors import LimitError, RecordingError, nearest
from runner.numerics.arrays import FloatArray
from runner.numerics.polygon import Polygon
from runner.recording.data import check_number
from runner.storage.csv_text import CsvError, CsvText, number, read_csv

MOST_CORNERS = 2000  # sides are compared in pairs; a photograph's edge has fewer
SHAPE, AXES = "shape", ("x", "y")
FORMS = "corners [[x, y], ...] in m, {disc: radius}, {ellipse: [half_x, half_y]} or 'FILE.csv#NAME'"
LEAST_M, MOST_M = 1e-4, 100.0  # extents; those of bodies that slide on floors
FITS = 0.01  # of the extent: so far may `half_size` be from that of the outline
WITHIN = 1e-6  # of the extent: what rounding may do


def outline_of(value: object, folder: Path) -> Polygon:
    """Return the outline that a value of `nominal.yaml` stands for.

    Args:
        value: Of the key `outline`.
        folder: Of the case; a table of corners must be in it.

    Raises:
        RecordingError: If it is no outline: corners too few or too many, an edge that crosses another, another unit.
    """
    if isinstance(value, str):
        return _checked(_from_table(value, folder))
    if isinstance(value, Mapping):
        return _round(value)
    if isinstance(value, list) and value and all(isinstance(p, list) and len(p) == len(AXES) for p in value):
        for k, point in enumerate(value):
            for axis, coordinate in zip(AXES, point, strict=True):
                check_number(f"outline[{k}] {axis}", coordinate, "m")
        return _checked(np.array(value, float))
    raise RecordingError(f"outline: must be {FORMS}, got {str(value)[:60]!r}.")


def check_outline(outline: Polygon, half_size_m: tuple[float, float, float]) -> None:
    """Refuse an outline that is not of the stated size, or about another point than the geometric centre.

    Raises:
        RecordingError: Saying what belongs together.
    """
    low, high = outline.bounds_m
    half = (high - low) / 2
    stated = np.array(half_size_m[:2])
    if np.abs(half - stated).max() > FITS * half.max():
        raise RecordingError(
            f"half_size: {list(half_size_m)!r} m is not that of the outline, which spans {2 * half[0]:.6g} x "
            f"{2 * half[1]:.6g} m along x and y; needed: [{half[0]:.6g}, {half[1]:.6g}, half the height]."
        )
    if (np.abs(outline.centroid_m) > half).any():
        x, y = outline.centroid_m
        raise RecordingError(
            f"outline: its middle is at ({x:.4g}, {y:.4g}) m; its corners must be relative to the geometric centre."
        )


def _round(value: Mapping) -> Polygon:
    if set(value) == {"disc"}:
        check_number("outline.disc", value["disc"], "m (its radius)", least=LEAST_M, most=MOST_M)
        return Polygon.ellipse(float(value["disc"]), float(value["disc"]))
    if set(value) == {"ellipse"} and isinstance(value["ellipse"], list) and len(value["ellipse"]) == len(AXES):
        for k, half in enumerate(value["ellipse"]):
            check_number(f"outline.ellipse[{k}]", half, "m (half an axis)", least=LEAST_M, most=MOST_M)
        return Polygon.ellipse(*map(float, value["ellipse"]))
    raise RecordingError(f"outline: must be {FORMS}, got {str(dict(value))[:60]!r}.")


def _from_table(value: str, folder: Path) -> FloatArray:
    """Return the corners that a table in a case's folder has, (n, 2)."""
    name, _, shape = value.partition("#")
    file = folder / name
    inside = Path(name).name == name and file.resolve().is_relative_to(folder.resolve())
    if not inside or file.suffix != ".csv":
        raise RecordingError(f"outline: must be a .csv file in the folder of the case, got {name!r}.")
    if not file.is_file():
        raise RecordingError(f"outline: {file}: no such file.")
    try:
        table = read_csv(file)
    except (CsvError, LimitError) as error:
        raise RecordingError(f"outline: {file}: {error}") from None
    if missing := [axis for axis in AXES if table.header.count(axis) != 1]:
        raise RecordingError(f"outline: {file}: needs one column {missing[0]!r}, got: {', '.join(table.header[:8])}.")
    rows = _rows(table, shape, file)
    columns = [table.columns[table.header.index(axis)] if table.columns else () for axis in AXES]
    out = np.empty((len(rows), len(AXES)))
    for k, row in enumerate(rows):
        for a, axis in enumerate(AXES):
            try:
                out[k, a] = number(columns[a][row])
            except ValueError:
                out[k, a] = np.nan
            if not np.isfinite(out[k, a]):
                text = columns[a][row][:20]
                raise RecordingError(
                    f"outline: {file}: line {table.lines[row]}: {axis} must be a finite number in m, got {text!r}."
                )
    return out


def _rows(table: CsvText, shape: str, file: Path) -> list[int]:
    """Return which rows of a table are of a shape; without a name there must be one shape."""
    if SHAPE not in table.header:
        if shape:
            raise RecordingError(f"outline: {file}: has no column '{SHAPE}' in which {shape!r} could be.")
        return list(range(len(table.lines)))
    names = table.columns[table.header.index(SHAPE)] if table.columns else ()
    known = list(dict.fromkeys(names))
    if not shape and len(known) > 1:
        raise RecordingError(f"outline: {file}: has several shapes; needed: '{file.name}#NAME'. {nearest('', known)}")
    if shape and shape not in known:
        raise RecordingError(f"outline: {file}: no shape {shape!r}. {nearest(shape, known)}")
    return [k for k, name in enumerate(names) if not shape or name == shape]


def _checked(corners: FloatArray) -> Polygon:
    """Return corners as an outline."""
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise RecordingError(f"outline: must have 3 to {MOST_CORNERS} corners, got {len(corners)}.")
    extent = np.ptp(corners, axis=0)
    if not (extent.min() >= LEAST_M and extent.max() <= MOST_M):
        raise RecordingError(
            f"outline: spans {extent[0]:.4g} x {extent[1]:.4g} m, allowed: {LEAST_M:g} to {MOST_M:g} m; in metres?"
        )
    outline = Polygon.of(corners)
    crossing = outline.crossing()
    if crossing is not None:
        (ax, ay), (bx, by) = (outline.points[k] for k in crossing)
        raise RecordingError(
            f"outline: the edges that begin at ({ax:.4g}, {ay:.4g}) and ({bx:.4g}, {by:.4g}) m meet; an outline must "
            "be one closed line that does not cross itself."
        )
    if outline.area_m2 <= WITHIN * float(extent.prod()):
        raise RecordingError("outline: encloses no area.")
    return outline
