"""Ways to spoil a file: as bytes, as text, as a table. Each takes what a random generator says and nothing else."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

Rng = np.random.Generator

WORDS = (
    "nan", ".nan", "inf", "-inf", ".inf", "1e308", "-1e308", "1e-320", "1e400", "0", "-0.0", "-1", "1", "4:00", "010",
    "0x10", "1_000", "", " ", "null", "~", "true", "no", "[]", "{}", "[1, 2]", "{a: 1}", "''", '"', "'", "*a", "&a",
    "!!int ''",
    "!!python/object/apply:os.system [ls]", "2026-13-45", "9" * 400, "a" * 300, "é", "\u202e", "\x00", "\ufeff", "%s",
    "../../etc/passwd", "/dev/zero", "-", ",", ";", ":", "#", "<<", "1e5", "3.5", "-3.5e-7", "1000000000000", "[" * 60,
    "{" * 60, "${oc.env:HOME}", "_target_", "inf inf inf",
    "<include file='x'/>", "\\", "\n", "\t", "\r\n",
)  # fmt: skip
VALUES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 0.0, -1.0, 1e9, -1e9)


def spoilt(name: str, content: bytes, rng: Rng) -> bytes:
    """Return a file's content, spoilt once or a few times."""
    for _ in range(1 + int(rng.geometric(0.6))):
        content = _once(name, content, rng)
    return content


def _once(name: str, content: bytes, rng: Rng) -> bytes:
    ways: list[Callable[[bytes, Rng], bytes]] = list(BYTES)
    if name.endswith(".parquet") and rng.random() < 0.5:
        return _table(content, rng)
    if not name.endswith(BINARY) and rng.random() < 0.85:
        ways = list(TEXT)
    return ways[int(rng.integers(len(ways)))](content, rng)


BINARY = (".parquet", ".mcap", ".bag", ".db3", ".h5", ".npz", ".rrd")


def _place(content: bytes, rng: Rng) -> tuple[int, int]:
    """Return where a short piece of a file begins and ends."""
    begin = int(rng.integers(len(content) + 1))
    return begin, min(len(content), begin + int(rng.geometric(0.05)))


def _flip(content: bytes, rng: Rng) -> bytes:
    out = bytearray(content)
    for _ in range(int(rng.integers(1, 9)) if out else 0):
        out[int(rng.integers(len(out)))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _random(content: bytes, rng: Rng) -> bytes:
    begin, end = _place(content, rng)
    return content[:begin] + rng.bytes(end - begin) + content[end:]


def _cut(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(len(content) + 1))]


def _taken(content: bytes, rng: Rng) -> bytes:
    begin, end = _place(content, rng)
    return content[:begin] + content[end:]


def _twice(content: bytes, rng: Rng) -> bytes:
    begin, end = _place(content, rng)
    return content[:end] + content[begin:end] * int(rng.integers(1, 9)) + content[end:]


def _number(content: bytes, rng: Rng) -> bytes:
    """Write a whole number of 1 to 8 bytes somewhere: sizes and offsets of binary formats."""
    size = int(rng.choice([1, 2, 4, 8]))
    value = int(rng.choice([0, 1, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1])) % 2 ** (8 * size)
    begin, _ = _place(content, rng)
    return content[:begin] + value.to_bytes(size, "little") + content[begin + size :]


def _word(content: bytes, rng: Rng) -> bytes:
    """Put a word in the place of another one."""
    found = list(re.finditer(rb"[^\s,;:<>='\"\[\]{}]+", content))
    if not found:
        return WORDS[int(rng.integers(len(WORDS)))].encode()
    old = found[int(rng.integers(len(found)))]
    other = found[int(rng.integers(len(found)))].group()
    new = WORDS[int(rng.integers(len(WORDS)))].encode() if rng.random() < 0.8 else other
    return content[: old.start()] + new + content[old.end() :]


def _insert(content: bytes, rng: Rng) -> bytes:
    begin, _ = _place(content, rng)
    return content[:begin] + WORDS[int(rng.integers(len(WORDS)))].encode() + content[begin:]


def _lines(content: bytes, rng: Rng) -> bytes:
    """Take a line away, say it twice, exchange it with another, or indent it."""
    lines = content.split(b"\n")
    i, j, way = int(rng.integers(len(lines))), int(rng.integers(len(lines))), int(rng.integers(4))
    if way == 0:
        del lines[i]
    elif way == 1:
        lines.insert(j, lines[i])
    elif way == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i] = b" " * int(rng.integers(1, 5)) + lines[i]
    return b"\n".join(lines)


def _table(content: bytes, rng: Rng) -> bytes:
    """Change a Parquet file as a table: its columns, their types, their values, their rows."""
    try:
        table = pd.read_parquet(io.BytesIO(content))
    except Exception:  # spoilt before
        return _flip(content, rng)
    if not len(table.columns):
        return content
    name = table.columns[int(rng.integers(len(table.columns)))]
    way = int(rng.integers(len(TABLE)))
    try:
        changed = TABLE[way](table, name, rng)
        out = io.BytesIO()
        changed.to_parquet(out, index=bool(rng.random() < 0.1))
    except (pa.ArrowException, ValueError, TypeError, OverflowError):  # no such table can be written
        return _flip(content, rng)
    return out.getvalue()


def _values(table: pd.DataFrame, name: str, rng: Rng) -> pd.DataFrame:
    rows = rng.random(len(table)) < rng.choice([0.01, 0.1, 1.0])
    value = VALUES[int(rng.integers(len(VALUES)))]
    numbers = np.asarray(pd.to_numeric(table[name], errors="coerce"), dtype=float)
    return table.assign(**{name: np.where(rows, value, numbers)})


def _typed(table: pd.DataFrame, name: str, rng: Rng) -> pd.DataFrame:
    kinds: tuple[Callable[[Any], object], ...] = (
        lambda c: c.astype(str),
        lambda c: [[v] for v in c],
        lambda c: [{"a": v} for v in c],
        lambda c: pd.to_datetime(np.arange(len(c)), unit="s"),
        lambda c: c.astype(bool),
        lambda c: [None] * len(c),
        lambda c: pd.Categorical(c.astype(str)),
        lambda c: np.arange(len(c), dtype=np.uint8),
        lambda c: c.astype(np.float32),
        lambda c: [bytes([k % 256]) for k in range(len(c))],
        lambda c: pd.to_timedelta(np.arange(len(c)), unit="s"),
    )
    return table.assign(**{name: kinds[int(rng.integers(len(kinds)))](table[name])})


def _renamed(table: pd.DataFrame, name: str, rng: Rng) -> pd.DataFrame:
    other = [*table.columns, "", "x", "t", "index", "é" * 9][int(rng.integers(len(table.columns) + 5))]
    return table.rename(columns={name: other})


TABLE: tuple[Callable[[pd.DataFrame, str, Rng], pd.DataFrame], ...] = (
    _values,
    _typed,
    _renamed,
    lambda table, name, rng: table.drop(columns=name),
    lambda table, name, rng: table.sample(frac=1.0, random_state=int(rng.integers(2**31))),
    lambda table, name, rng: table.iloc[: int(rng.integers(4))],
    lambda table, name, rng: pd.concat([table, table]),
    lambda table, name, rng: table.assign(**{name: table[table.columns[int(rng.integers(len(table.columns)))]]}),
)
BYTES = (_flip, _random, _cut, _taken, _twice, _number)
TEXT = (_word, _word, _word, _word, _insert, _lines, _lines, _taken, _twice, _cut)
