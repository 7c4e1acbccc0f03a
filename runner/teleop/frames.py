"""Frames: immutable columns of what happened, with a view of each row.

A run has two kinds. `steps` has a frame for every physics step: the state at its start, and the command and the
contact over it. `updates` has a frame for every update: the states just before the local cubes took over the remote's,
the command and the contact over the last physics step, the estimates just after, and the errors.

Names of columns end in their unit: `remote_x_m`, `linear_mass_kg`. Those of a local body begin with the name of its
estimator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from runner.errors import ResultError, nearest


class Frame(Mapping[str, Any]):
    """One row of `Frames`: `frame["remote_x_m"]`, or `frame.remote_x_m`. It can't be changed."""

    __slots__ = ("_columns", "_row")

    def __init__(self, columns: Mapping[str, np.ndarray], row: int) -> None:
        object.__setattr__(self, "_columns", columns)
        object.__setattr__(self, "_row", row)

    def __getitem__(self, name: str) -> Any:
        return self._columns[name][self._row].item()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._columns:
            raise AttributeError(f"A frame has no column '{name}'. {nearest(name, self._columns)}")
        return self[name]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError("A frame can't be changed.")

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"Frame({', '.join(f'{k}={v:.6g}' for k, v in self.items())})"


@dataclass(frozen=True)
class Frames:
    """Columns of equal length, by name, read-only. Those that are given are copied if they can be written to."""

    columns: Mapping[str, np.ndarray]

    def __post_init__(self) -> None:
        frozen = {name: _frozen(column) for name, column in self.columns.items()}
        lengths = {name: len(column) for name, column in frozen.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns of different lengths: {lengths}")
        object.__setattr__(self, "columns", MappingProxyType(frozen))

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()))) if self.columns else 0

    def __getitem__(self, row: int) -> Frame:
        if not -len(self) <= row < len(self):
            raise IndexError(f"frame {row} of {len(self)}")
        return Frame(self.columns, row)

    def __iter__(self) -> Iterator[Frame]:
        return (Frame(self.columns, row) for row in range(len(self)))

    def column(self, name: str) -> np.ndarray:
        """Return a column, (n,).

        Raises:
            ResultError: If there is none of that name, naming the nearest.
        """
        if name not in self.columns:
            raise ResultError(f"no column '{name}'. {nearest(name, self.columns)}")
        return self.columns[name]

    def table(self) -> pd.DataFrame:
        """Return the frames as a table of its own memory."""
        return pd.DataFrame({name: column.copy() for name, column in self.columns.items()})


def _frozen(column: np.ndarray) -> np.ndarray:
    if column.flags.writeable:
        column = column.copy()
        column.setflags(write=False)
    return column


class Status(Enum):
    """How a run ended."""

    done = "done"
    unconverged = "not converged"  # it went to its end; an estimate is not where what was measured has it
    diverged = "diverged"  # the physics blew up; what was recorded until then is kept
    failed = "failed"


ENDED = (Status.done.value, Status.unconverged.value)  # of runs that went to their end


class Truth(NamedTuple):
    """A parameter's true and start value, and what its errors are relative to; None: the true value."""

    true: float
    start: float
    scale: float | None = None

    def error(self, value: Any) -> Any:
        """Return the signed error of values, relative to the scale."""
        return (value - self.true) / (self.true if self.scale is None else self.scale)


@dataclass(frozen=True)
class RunResult:
    """What a run leaves behind.

    Attributes:
        make_steps, make_updates: Make the frames, see `steps` and `updates`.
        step_count, update_count: Number of physics steps and of updates.
        estimators: Names of the estimators, each with a local body; the first is the one that summaries speak of.
        parameters: Estimated parameters by estimator, with true and start values: `parameters["linear"]["mass_kg"]`.
        half_size_m: Of the cubes, (3,).
        timestep_s: Physics step.
        wall_s: Time that the loop took on the clock.
        status: How it ended.
        reason: Why, where it did not end well.
    """

    make_steps: Callable[[], Frames]
    make_updates: Callable[[], Frames]
    step_count: int
    update_count: int
    estimators: tuple[str, ...]
    parameters: Mapping[str, Mapping[str, Truth]]
    half_size_m: tuple[float, float, float]
    timestep_s: float
    wall_s: float
    status: Status = Status.done
    reason: str = ""

    @cached_property
    def updates(self) -> Frames:
        """A frame for every update; the columns are made when they are first asked for."""
        return self.make_updates()

    @cached_property
    def steps(self) -> Frames:
        """A frame for every physics step; the columns are made when they are first asked for."""
        return self.make_steps()
