"""Nested Arrow columns taken apart into series of numbers: structs by field, lists by index or by names beside them.

`position: [0.1, 0.2]` beside `name: [elbow, wrist]` becomes `position[elbow]` and `position[wrist]`, whatever the order
of the names is in each message; without names it becomes `position[0]` and `position[1]`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute

from runner.importing.signals import Clock, Integers, Signal
from runner.numerics.arrays import FloatArray

compute: Any = pyarrow.compute  # its functions are made when it is imported, unseen by type checkers
WIDEST = 128  # of a list that is taken apart; images and point clouds are wider
NAMES = ("name", "names", "joint_names")
STAMPS = (("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"), ("seconds", "nanos"))
HEADER_STAMP = "header_stamp"

Rows = Integers | None  # which rows of the stream a series has a value in; None: in all, one each


def signals_of(
    stream: str, column: pa.Array, clocks: Mapping[str, Clock], *, root: str | None = None, names: object = None
) -> list[Signal]:
    """Return all series of numbers in a column.

    Args:
        stream: Its name, and how the names of the series begin unless `root` says so.
        column: (T,), nested as may be.
        clocks: Of the rows.
        root: Beginning of the names.
        names: Of the elements, if the column is a list.
    """
    root = stream if root is None else root
    stamp = header_stamp(column)
    if stamp is not None:
        clocks = {**clocks, HEADER_STAMP: Clock(stamp, in_ns=True)}
    found = []
    for name, rows, values in _series(root, column, None, names if isinstance(names, list) else None):
        own = clocks if rows is None else {k: Clock(c.stamps[rows], c.in_ns) for k, c in clocks.items()}
        found.append(Signal(name, stream, values, own))
    return found


def header_stamp(column: pa.Array) -> Integers | None:
    """Return `header.stamp`, or a bare `stamp`, of messages in ns, (T,); None if they have none or it was never set."""
    if not pa.types.is_struct(column.type):
        return None
    fields = {f.name for f in column.type}
    if "header" in fields and pa.types.is_struct(column.type.field("header").type):
        return header_stamp(compute.struct_field(column, "header"))
    if "stamp" not in fields or not pa.types.is_struct(column.type.field("stamp").type):
        return None
    stamp = compute.struct_field(column, "stamp")
    inside = {f.name for f in stamp.type}
    for seconds, nanoseconds in STAMPS:
        if seconds in inside and nanoseconds in inside:
            whole, rest = (_whole(compute.struct_field(stamp, name)) for name in (seconds, nanoseconds))
            if whole is None or rest is None:
                return None
            total = whole * 1_000_000_000 + rest
            return total if total.any() else None
    return None


def _whole(column: pa.Array) -> Integers | None:
    if not pa.types.is_integer(column.type) or column.null_count:
        return None
    return column.cast(pa.int64()).to_numpy(zero_copy_only=False)


def is_number(kind: pa.DataType) -> bool:
    """Whether values of a type are taken for numbers."""
    return pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)


def as_numbers(column: pa.Array) -> FloatArray:
    """Return a column of numbers, null as NaN, (T,)."""
    if pa.types.is_boolean(column.type):
        column = column.cast(pa.int8())
    return np.array(column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=np.float64)


def _series(name: str, column: pa.Array, rows: Rows, names: list[str] | None) -> Iterator[tuple[str, Rows, FloatArray]]:
    kind = column.type
    if is_number(kind):
        yield name, rows, as_numbers(column)
    elif pa.types.is_struct(kind):
        yield from _fields(name, column, rows)
    elif pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind):
        yield from _elements(name, column, rows, names)


def _fields(name: str, column: pa.Array, rows: Rows) -> Iterator[tuple[str, Rows, FloatArray]]:
    labels = next((n for n in NAMES if n in {f.name for f in column.type} and _is_text_list(column, n)), None)
    for field in column.type:
        if field.name in ("header", labels):
            continue
        inner = compute.struct_field(column, field.name)
        own = f"{name}/{field.name}"
        if labels is not None and _is_list(inner.type) and is_number(inner.type.value_type):
            yield from _labelled(own, compute.struct_field(column, labels), inner, rows)
        else:
            yield from _series(own, inner, rows, None)


def _is_list(kind: pa.DataType) -> bool:
    return pa.types.is_list(kind) or pa.types.is_large_list(kind)


def _is_text_list(column: pa.Array, name: str) -> bool:
    kind = column.type.field(name).type
    return _is_list(kind) and pa.types.is_string(kind.value_type)


def _labelled(name: str, labels: pa.Array, column: pa.Array, rows: Rows) -> Iterator[tuple[str, Rows, FloatArray]]:
    """Yield the elements of a list by the names beside it; where the lengths differ a message is left out."""
    counts = compute.fill_null(compute.list_value_length(column), 0).to_numpy(zero_copy_only=False)
    named = compute.fill_null(compute.list_value_length(labels), 0).to_numpy(zero_copy_only=False)
    good = np.flatnonzero((counts == named) & (counts > 0))
    if not len(good):
        if counts.any():
            yield from _elements(name, column, rows, None)
        return
    take = pa.array(good)
    flat, text = column.take(take).flatten(), labels.take(take).flatten()
    values, owner = as_numbers(flat), np.repeat(good, counts[good])
    coded = text.dictionary_encode()
    codes = coded.indices.to_numpy(zero_copy_only=False)
    if len(coded.dictionary) > WIDEST:
        return
    for code, label in enumerate(coded.dictionary.to_pylist()):
        mine = np.flatnonzero(codes == code)
        at = owner[mine]
        whole = len(at) == len(column) and bool(np.all(np.diff(at) == 1))
        yield f"{name}[{label}]", (rows if whole else at if rows is None else rows[at]), values[mine]


def _elements(
    name: str, column: pa.Array, rows: Rows, names: list[str] | None
) -> Iterator[tuple[str, Rows, FloatArray]]:
    """Yield the elements of a list by their index; an element that some lists lack is left out there."""
    lengths = compute.list_value_length(column)
    counts = compute.fill_null(lengths, 0).to_numpy(zero_copy_only=False)
    widest = int(counts.max(initial=0))
    if not 0 < widest <= WIDEST:
        return
    labels = names if names is not None and len(names) == widest else [str(i) for i in range(widest)]
    for i in range(widest):
        has = np.flatnonzero(counts > i)
        own = column if len(has) == len(column) else column.take(pa.array(has))
        at = rows if len(has) == len(column) else has if rows is None else rows[has]
        yield from _series(f"{name}[{labels[i]}]", compute.list_element(own, i), at, None)
