"""Force sequences: what is commanded to both cubes, as functions of time, averaged over physics steps.

A sequence gives, for every physics step, the mean force over that step and the body-fixed point at which it acts.
Means keep the impulse whatever the time step is, also where a push begins inside a step. A sequence knows nothing of
frames or updates.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from runner.config import registered
from runner.errors import ConfigError, check_range, check_vector
from runner.storage.csv_text import CsvError, number, read_csv

Vector = tuple[float, float, float]


class AbstractForces(ABC):
    """A force on a body-fixed point as a function of time."""

    @property
    @abstractmethod
    def duration_s(self) -> float:
        """When the sequence ends, s; an experiment lasts so long."""

    @abstractmethod
    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean force over each physics step, and where it acts.

        Args:
            t_s: Start of each step, (n,), s.
            timestep_s: Length of a step, s.

        Returns:
            Force (n, 3), N, world axes; point (n, 3), m, relative to the geometric centre, body axes. Where two
            pushes share a step, the point is their mean weighted by impulse.
        """

    def with_seed(self, seed: int) -> AbstractForces:
        """Return the sequence for the seed of a run: itself, unless chance has a part in it."""
        return self


@dataclass(frozen=True)
class Push:
    """A constant force (N, world axes) at a point (m, body axes) from `start_s` to `end_s`."""

    start_s: float
    end_s: float
    force_n: Vector
    point_m: Vector = (0.0, 0.0, 0.0)


def push_means(pushes: list[Push], t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the means of a train of pushes over steps, see `AbstractForces.columns`; the overlaps are exact.

    `t_s` must grow.
    """
    force, point = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
    weight = np.zeros(len(t_s))
    for push in pushes:
        near = slice(*np.searchsorted(t_s, [push.start_s - 2 * timestep_s, push.end_s + timestep_s]))
        overlap = np.minimum(t_s[near] + timestep_s, push.end_s) - np.maximum(t_s[near], push.start_s)
        # a whole step is exactly one: the difference of two times is not
        share = np.clip(np.round(overlap / timestep_s, 9), 0.0, 1.0)
        size = share * math.sqrt(sum(f * f for f in push.force_n))
        force[near] += share[:, None] * push.force_n
        point[near] += size[:, None] * push.point_m
        weight[near] += size
    point /= np.where(weight > 0, weight, 1.0)[:, None]
    return force, point


# Gauss-Legendre nodes and weights on [0, 1]: five points are exact to order 9 over a step
_NODES, _WEIGHTS = (0.5 * (a + shift) for a, shift in zip(np.polynomial.legendre.leggauss(5), (1, 0), strict=True))


def direction(angle_rad: float) -> Vector:
    """Return the unit vector at this angle from the world's x axis, level."""
    return (math.cos(angle_rad), math.sin(angle_rad), 0.0)


def scaled(vector: Vector, factor: float) -> Vector:
    """Return a multiple of a vector."""
    x, y, z = vector
    return (factor * x, factor * y, factor * z)


@registered("forces", "paper")
@dataclass(frozen=True)
class PaperForces(AbstractForces):
    """The published test sequence: pushes of one magnitude, straight and off-centre in turn, with rests between.

    Push k points along `turn_rad` * k. Odd pushes act `offset_m` beside the centre, to either side in turn, so that
    the cube turns to and fro. The rests let friction stop the cube, so that each push starts from rest. With quarter
    turns, as here by default, a cube comes back after four pushes. `height_m` is that of the point above the centre.
    """

    force_n: float = 15.0
    push_s: float = 0.5
    rest_s: float = 1.0
    pushes: int = 10
    offset_m: float = 0.1
    height_m: float = 0.0
    turn_rad: float = math.pi / 2
    lead_s: float = 0.5

    def __post_init__(self) -> None:
        check_range("force_n", self.force_n, 0.0, 1e6, unit="N", lower_open=True)
        check_range("push_s", self.push_s, 1e-3, 1e3, unit="s")
        check_range("rest_s", self.rest_s, 0.0, 1e3, unit="s")
        check_range("pushes", self.pushes, 1, 10_000)
        check_range("offset_m", self.offset_m, -100.0, 100.0, unit="m")
        check_range("height_m", self.height_m, -100.0, 100.0, unit="m")
        check_range("turn_rad", self.turn_rad, -2 * math.pi, 2 * math.pi, unit="rad")
        check_range("lead_s", self.lead_s, 0.0, 1e3, unit="s")

    @property
    def duration_s(self) -> float:
        return self.lead_s + self.pushes * (self.push_s + self.rest_s)

    @cached_property
    def _train(self) -> list[Push]:
        out = []
        for k in range(self.pushes):
            angle = self.turn_rad * k
            side = (0, 1, 0, -1)[k % 4] * self.offset_m
            # beside the centre as seen along the push, for a cube that has not turned
            point = (-side * math.sin(angle), side * math.cos(angle), self.height_m)
            start = self.lead_s + k * (self.push_s + self.rest_s)
            out.append(Push(start, start + self.push_s, scaled(direction(angle), self.force_n), point))
        return out

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return push_means(self._train, t_s, timestep_s)


@dataclass(frozen=True)
class _OnePush(AbstractForces):
    """One push of constant force after a lead, then a rest."""

    force_n: Vector = (20.0, 0.0, 0.0)
    lead_s: float = 0.25
    push_s: float = 1.0
    rest_s: float = 1.0

    def __post_init__(self) -> None:
        check_vector("force_n", self.force_n, 3, unit="N", limit=1e6)
        for name in ("lead_s", "push_s", "rest_s"):
            check_range(name, getattr(self, name), 0.0, 1e3, unit="s")
        check_range("push_s", self.push_s, 1e-3, 1e3, unit="s")

    @property
    def duration_s(self) -> float:
        return self.lead_s + self.push_s + self.rest_s

    def _means(self, point_m: Vector, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return push_means([Push(self.lead_s, self.lead_s + self.push_s, self.force_n, point_m)], t_s, timestep_s)


@registered("forces")
@dataclass(frozen=True)
class Straight(_OnePush):
    """One push through the geometric centre."""

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return self._means((0.0, 0.0, 0.0), t_s, timestep_s)


@registered("forces")
@dataclass(frozen=True)
class Offcentre(_OnePush):
    """One push at a point beside the geometric centre, `point_m` in body axes."""

    point_m: Vector = (0.0, 0.15, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_vector("point_m", self.point_m, 3, unit="m", limit=100.0)

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return self._means(self.point_m, t_s, timestep_s)


@registered("forces")
@dataclass(frozen=True)
class Ramp(AbstractForces):
    """A force that grows from nothing by `slope_n_s` for `ramp_s`, holds for `hold_s`, and ends; then a rest.

    It finds the force at which a body breaks away.
    """

    slope_n_s: float = 10.0
    ramp_s: float = 3.0
    hold_s: float = 0.5
    rest_s: float = 2.0
    lead_s: float = 0.25
    angle_rad: float = 0.0
    point_m: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_range("slope_n_s", self.slope_n_s, -1e6, 1e6, unit="N/s")
        check_range("ramp_s", self.ramp_s, 1e-3, 1e3, unit="s")
        for name in ("hold_s", "rest_s", "lead_s"):
            check_range(name, getattr(self, name), 0.0, 1e3, unit="s")
        check_range("angle_rad", self.angle_rad, -2 * math.pi, 2 * math.pi, unit="rad")
        check_vector("point_m", self.point_m, 3, unit="m", limit=100.0)

    @property
    def duration_s(self) -> float:
        return self.lead_s + self.ramp_s + self.hold_s + self.rest_s

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        def impulse(t: np.ndarray) -> np.ndarray:
            since = np.clip(t - self.lead_s, 0.0, self.ramp_s + self.hold_s)
            rising = np.minimum(since, self.ramp_s)
            return self.slope_n_s * (0.5 * rising**2 + self.ramp_s * (since - rising))

        size = (impulse(t_s + timestep_s) - impulse(t_s)) / timestep_s
        return size[:, None] * direction(self.angle_rad), np.tile(self.point_m, (len(t_s), 1))


@registered("forces")
@dataclass(frozen=True)
class Chirp(AbstractForces):
    """A sine whose frequency sweeps evenly from `start_hz` to `end_hz` over `sweep_s`, then a rest."""

    force_n: float = 20.0
    start_hz: float = 0.2
    end_hz: float = 3.0
    sweep_s: float = 12.0
    rest_s: float = 1.0
    angle_rad: float = 0.0
    point_m: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        check_range("force_n", self.force_n, 0.0, 1e6, unit="N", lower_open=True)
        check_range("start_hz", self.start_hz, 0.0, 100.0, unit="Hz")
        check_range("end_hz", self.end_hz, 0.0, 100.0, unit="Hz")
        check_range("sweep_s", self.sweep_s, 1e-2, 1e3, unit="s")
        check_range("rest_s", self.rest_s, 0.0, 1e3, unit="s")
        check_range("angle_rad", self.angle_rad, -2 * math.pi, 2 * math.pi, unit="rad")
        check_vector("point_m", self.point_m, 3, unit="m", limit=100.0)

    @property
    def duration_s(self) -> float:
        return self.sweep_s + self.rest_s

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        # integrate over the part of the step that lies inside the sweep
        length = np.clip(self.sweep_s - t_s, 0.0, timestep_s)
        t = t_s[:, None] + length[:, None] * _NODES
        cycles = self.start_hz * t + 0.5 * (self.end_hz - self.start_hz) / self.sweep_s * t**2
        size = self.force_n * (np.sin(2 * np.pi * cycles) @ _WEIGHTS) * length / timestep_s
        return size[:, None] * direction(self.angle_rad), np.tile(self.point_m, (len(t_s), 1))


@registered("forces", "random")
@dataclass(frozen=True)
class RandomForces(AbstractForces):
    """Pushes of random size, direction, place and length, with random rests; the seed alone decides which.

    `seed` None takes the seed of the run.
    """

    seed: int | None = None
    pushes: int = 10
    force_n: tuple[float, float] = (15.0, 30.0)
    push_s: tuple[float, float] = (0.2, 0.8)
    rest_s: tuple[float, float] = (0.5, 1.5)
    reach_m: float = 0.2
    height_m: tuple[float, float] = (0.0, 0.0)
    lead_s: float = 0.25

    def __post_init__(self) -> None:
        if self.seed is not None:
            check_range("seed", self.seed, 0, 2**63 - 1)
        check_range("pushes", self.pushes, 1, 10_000)
        for name, unit, limit in (("force_n", "N", 1e6), ("push_s", "s", 1e3), ("rest_s", "s", 1e3)):
            _check_span(name, getattr(self, name), 0.0, limit, unit)
        _check_span("height_m", self.height_m, -100.0, 100.0, "m")
        check_range("reach_m", self.reach_m, 0.0, 100.0, unit="m")
        check_range("lead_s", self.lead_s, 0.0, 1e3, unit="s")

    def with_seed(self, seed: int) -> RandomForces:
        """Return the sequence for the seed of a run; one with a seed of its own keeps it."""
        if self.seed is not None:
            return self
        return replace(self, seed=seed)

    @property
    def duration_s(self) -> float:
        return self._train[1]

    @cached_property
    def _train(self) -> tuple[list[Push], float]:
        if self.seed is None:
            raise ConfigError("seed: a random sequence needs one; the run's seed is given by `with_seed`.")
        rng = np.random.default_rng(self.seed)
        t, out = self.lead_s, []
        for _ in range(self.pushes):
            end = t + rng.uniform(*self.push_s)
            angle, size = rng.uniform(0, 2 * math.pi), rng.uniform(*self.force_n)
            x, y = rng.uniform(-self.reach_m, self.reach_m, 2)
            force = scaled(direction(angle), size)
            out.append(Push(t, end, force, (float(x), float(y), rng.uniform(*self.height_m))))
            t = end + rng.uniform(*self.rest_s)
        return out, t

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return push_means(self._train[0], t_s, timestep_s)


def _check_span(key: str, span: tuple[float, float], lower: float, upper: float, unit: str) -> None:
    check_vector(key, span, 2, unit=unit)
    for i, value in enumerate(span):
        check_range(f"{key}[{i}]", value, lower, upper, unit=unit)
    if span[0] > span[1]:
        raise ConfigError(f"{key}: must be [smallest, largest], got {list(span)!r} {unit}.")


CSV_COLUMNS = ("t", "fx", "fy", "fz", "px", "py", "pz")
CSV_REQUIRED = ("t", "fx", "fy")


@registered("forces", "csv")
@dataclass(frozen=True)
class CsvForces(AbstractForces):
    """Forces from a CSV file: `t,fx,fy[,fz][,px,py[,pz]]` in s, N (world axes) and m (body axes).

    Each row holds from its time to the next row's; the last row ends the sequence, its force does not act. Columns
    that are left out are zero.
    """

    path: str
    _pushes: list[Push] = field(init=False, repr=False, compare=False, hash=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_pushes", _read_csv(Path(self.path)))

    @property
    def duration_s(self) -> float:
        return self._pushes[-1].end_s

    def columns(self, t_s: np.ndarray, timestep_s: float) -> tuple[np.ndarray, np.ndarray]:
        return push_means(self._pushes, t_s, timestep_s)


def _read_csv(path: Path) -> list[Push]:
    """Read and check a file of forces; errors name the file and the line."""
    if not path.is_file():
        raise ConfigError(f"path: no file '{path}'.")
    try:
        table = read_csv(path)
    except CsvError as error:
        raise ConfigError(f"path: '{path}' is no CSV file: {error}") from None
    names = table.header
    wrong = [c for c in names if c not in CSV_COLUMNS] or [c for c in CSV_REQUIRED if c not in names]
    if wrong:
        raise ConfigError(
            f"path: '{path}', line 1: column '{wrong[0]}' is {'unknown' if wrong[0] in names else 'missing'}; "
            f"allowed: {', '.join(CSV_COLUMNS)}, of which {', '.join(CSV_REQUIRED)} must be there."
        )
    if twice := [c for c in names if names.count(c) > 1]:
        raise ConfigError(f"path: '{path}', line 1: column '{twice[0]}' is there more than once.")
    values = np.zeros((len(table.lines), len(CSV_COLUMNS)))
    for name, column in zip(names, table.columns, strict=False):  # no columns where there are no rows
        values[:, CSV_COLUMNS.index(name)] = _numbers(path, column, name, table.lines)
    if len(values) < 2:
        raise ConfigError(f"path: '{path}': needs at least two rows, the last of which ends the sequence.")
    for line, before, now in zip(table.lines[1:], values[:-1, 0], values[1:, 0], strict=True):
        if now <= before:
            raise ConfigError(
                f"path: '{path}', line {line}: t must grow from row to row, got {now:g} s after {before:g} s."
            )
    if values[0, 0] < 0:
        raise ConfigError(f"path: '{path}', line {table.lines[0]}: t must not be negative, got {values[0, 0]:g} s.")
    rows = [tuple(map(float, row)) for row in values]
    return [Push(a[0], b[0], (a[1], a[2], a[3]), (a[4], a[5], a[6])) for a, b in pairwise(rows)]


def _numbers(path: Path, column: Sequence[str], name: str, lines: Sequence[int]) -> np.ndarray:
    out = np.full(len(column), np.nan)
    for i, text in enumerate(column):
        with suppress(ValueError):
            out[i] = number(text)
        if not np.isfinite(out[i]):
            raise ConfigError(f"path: '{path}', line {lines[i]}: {name} must be a finite number, got '{text}'.")
    return out
