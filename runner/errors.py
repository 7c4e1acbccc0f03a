"""Errors that a user can cause: one line each, saying what was wrong, where, and what is allowed."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable


class RunnerError(Exception):
    """Base of every error that the command line reports as one line with exit code 2."""


class ConfigError(RunnerError):
    """A setting is wrong: its key, its value, what is allowed."""


class RecordingError(RunnerError):
    """A recording can't be used as it is: the file, the row, the column."""


class ResultError(RunnerError):
    """A results folder lacks something that was asked of it."""


class LimitError(RunnerError):
    """A file is larger than what is read: how large, and the limit."""


class WriteError(RunnerError):
    """A file can't be written: which one, and why."""


class LauncherError(RunnerError):
    """What does tasks in other processes has lost some of them, or could not begin: in the words of its cause."""


def nearest(name: str, valid: Iterable[str], *, listed_by: str = "") -> str:
    """Return `Valid: 'a', 'b'. Did you mean 'a'?` for a name that is not among the valid ones.

    Where a command lists them, because they are many, `listed_by` names it in their place.
    """
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    text = f"`{listed_by}` has all names." if listed_by else "Valid: " + ", ".join(f"'{n}'" for n in names) + "."
    return text + (f" Did you mean '{close[0]}'?" if close else "")


def check_range(
    key: str,
    value: float,
    lower: float = -math.inf,
    upper: float = math.inf,
    *,
    unit: str = "",
    lower_open: bool = False,
) -> None:
    """Refuse a number outside [lower, upper] (or ]lower, upper] with `lower_open`), NaN and non-numbers.

    Raises:
        ConfigError: Naming the key, the value and the allowed range.
    """
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    inside = number and (lower < value if lower_open else lower <= value) and value <= upper
    if inside and math.isfinite(value):
        return
    left = f"]{lower:g}" if lower_open or lower == -math.inf else f"[{lower:g}"
    right = f"{upper:g}[" if upper == math.inf else f"{upper:g}]"
    raise ConfigError(f"{key}: must be a finite number in {left}, {right}{' ' + unit if unit else ''}, got {value!r}.")


def check_workers(workers: int | None) -> None:
    """Refuse a number of processes that is none; None is one per core.

    Raises:
        ConfigError: Naming what is allowed.
    """
    if workers is not None:
        check_range("workers", workers, 1, 1024)


def check_vector(key: str, value: Iterable[float], length: int, *, unit: str = "", limit: float = math.inf) -> None:
    """Refuse anything but `length` finite numbers of absolute value at most `limit`.

    Raises:
        ConfigError: Naming the key, the value and what is allowed.
    """
    items = list(value)
    if len(items) != length:
        raise ConfigError(f"{key}: must be {length} numbers{' in ' + unit if unit else ''}, got {items!r}.")
    for i, item in enumerate(items):
        check_range(f"{key}[{i}]", item, -limit, limit, unit=unit)
