"""The values that a case consists of. Arrays are private copies and can't be written to."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.numerics.polygon import Polygon

WARNING = "warning: "  # a note begins with it where something is wrong and yet something may follow


class Support(StrEnum):
    """What carries the box: its whole base, or its corners."""

    PATCH = "patch"
    CORNERS = "corners"


class Form(StrEnum):
    """Which columns a recording has: x, y, yaw, or position and orientation in space."""

    PLANAR = "planar"
    SPATIAL = "spatial"


def check_number(
    key: str, value: object, unit: str, *, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> None:
    """Refuse anything but a finite number > `above`, >= `least` and <= `most`.

    Raises:
        RecordingError: Naming the key, the value and what is allowed.
    """
    if isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool):
        number = float(value)
        if math.isfinite(number) and number > above and least <= number <= most:
            return
    limits = [f"> {above:g}"] * (above > -math.inf) + [f">= {least:g}"] * (least > -math.inf)
    limits += [f"<= {most:g}"] * (most < math.inf)
    kind = " ".join(["a finite number", *(["in", unit] if unit else []), " and ".join(limits)]).rstrip()
    raise RecordingError(f"{key}: must be {kind}, got {value!r}.")


@dataclass(frozen=True)
class Noise:
    """Standard deviation of each kind of measurement; None: the owner doesn't know it.

    Raises:
        RecordingError: If one is not a finite number above zero.
    """

    position_m: float | None = None
    yaw_rad: float | None = None
    velocity_m_s: float | None = None
    rate_rad_s: float | None = None

    def __post_init__(self) -> None:
        units = {"position_m": "m", "yaw_rad": "rad", "velocity_m_s": "m/s", "rate_rad_s": "rad/s"}
        for name, unit in units.items():
            value = getattr(self, name)
            if value is not None:
                check_number(f"noise.{name.split('_')[0]} (null where not known)", value, unit, above=0.0)


@dataclass(frozen=True)
class BelievedPin:
    """A round pin that pushes the body: its radius, and the coefficient of friction between the two.

    And how high above the geometric centre it touches: the load on the base shifts so that moments balance.

    Raises:
        RecordingError: If one is not possible.
    """

    radius_m: float
    friction: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        check_number("pin.radius", self.radius_m, "m", above=0.0, most=100.0)
        check_number("pin.friction", self.friction, "", least=0.0, most=10.0)


@dataclass(frozen=True)
class Nominal:
    """What the owner of a recording believes of the world. Messages name the keys of `nominal.yaml`.

    Args:
        half_size_m: Half the edges of the box along its own axes; with an outline, of the box around it.
        mass_kg: Uniform density unless `com_m` or `inertia_kg_m2` says otherwise.
        friction: Coulomb coefficient between box and floor; 0 is allowed.
        gravity_m_s2: Magnitude.
        contact: What carries the box.
        rate_hz: Samples per second.
        noise: Standard deviations of what was measured.
        com_m: Centre of mass relative to the geometric centre, body axes; None: at the geometric centre, with an
            outline at the centre of its area.
        inertia_kg_m2: About the centre of mass: about z alone, or about x, y, z; None: uniform density.
        outline: Of the body and its base seen from above, relative to the geometric centre, body axes; None: a box.
        pin: That pushes the body on a path that was recorded; None: forces are commanded.
        known: Effects that are not the case, as what they would change was measured.
        path: The file it was read from; not part of a comparison.

    Raises:
        RecordingError: If a value is not possible: its key, the value, what is allowed.
    """

    half_size_m: tuple[float, float, float]
    mass_kg: float
    friction: float
    gravity_m_s2: float
    rate_hz: float
    contact: Support = Support.PATCH
    noise: Noise = Noise()
    com_m: tuple[float, float, float] | None = None
    inertia_kg_m2: float | tuple[float, float, float] | None = None
    outline: Polygon | None = None
    pin: BelievedPin | None = None
    known: tuple[str, ...] = ()
    path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        for size in self.half_size_m:
            check_number("half_size", size, "m", above=0.0)
        check_number("mass", self.mass_kg, "kg", above=0.0)
        check_number("friction", self.friction, "", least=0.0, most=10.0)
        check_number("gravity", self.gravity_m_s2, "m/s2 (its magnitude)", above=0.0, most=300.0)
        check_number("rate_hz", self.rate_hz, "Hz", above=0.0, most=1e6)
        if self.pin is not None:
            height = self.half_size_m[2]
            check_number(
                "pin.height (from the geometric centre, within the body)",
                self.pin.height_m,
                "m",
                least=-height,
                most=height,
            )
        for offset, size in zip(self.com_m or (), self.half_size_m, strict=False):
            check_number("com (inside the box)", offset, "m", least=-size, most=size)
        moments = self.inertia_kg_m2 if isinstance(self.inertia_kg_m2, tuple) else (self.inertia_kg_m2,)
        for moment in moments:
            if moment is not None:
                check_number("inertia", moment, "kg m2", above=0.0)
        if len(moments) == 3 and 2 * max(moments) > sum(moments) * (1 + 1e-9):
            raise RecordingError(f"inertia: none may exceed the sum of the other two, got {list(moments)!r} kg m2.")

    @property
    def centre_of_mass_m(self) -> tuple[float, float, float]:
        """Centre of mass relative to the geometric centre, body axes."""
        if self.com_m is not None or self.outline is None:
            return self.com_m or (0.0, 0.0, 0.0)
        x, y = map(float, self.outline.centroid_m)
        return x, y, 0.0

    @property
    def volume_m3(self) -> float:
        """Volume of the body."""
        hx, hy, hz = self.half_size_m
        return 8 * hx * hy * hz if self.outline is None else 2 * hz * self.outline.area_m2

    @property
    def yaw_inertia_kg_m2(self) -> float:
        """Inertia about the vertical through the centre of mass; uniform density: of a box m (hx^2 + hy^2) / 3."""
        if isinstance(self.inertia_kg_m2, tuple):
            return self.inertia_kg_m2[2]
        if self.inertia_kg_m2 is not None:
            return self.inertia_kg_m2
        if self.outline is not None:
            return self.mass_kg * float(np.trace(self.outline.spread_m2))
        hx, hy, _ = self.half_size_m
        return self.mass_kg * (hx**2 + hy**2) / 3


@dataclass(frozen=True, eq=False)
class Episode:
    """One episode: T samples at even times, what was measured and what was commanded from each to the next.

    Args:
        index: Its number in the recording.
        t_s: Time of each sample, shape (T,), s.
        pose: Of the geometric centre in the world: x, y, yaw, shape (T, 3), m and rad (yaw unwrapped), or
            x, y, z, qw, qx, qy, qz, shape (T, 7), m and a unit quaternion (body to world, without sign flips).
        twist: Velocity of the geometric centre and rate, world axes: vx, vy, wz, shape (T, 3), m/s and rad/s, or
            vx, vy, vz, wx, wy, wz, shape (T, 6).
        force_n: Force held from each sample to the next, world axes, shape (T, 3), N.
        point_m: Where it acts, relative to the geometric centre, body axes, shape (T, 3), m.
        pin_m: Path of the pin that pushes, world, shape (T, 2), m; None: the force was commanded. Where there is one,
            the force is that of the pin on the body at each sample, as measured.

    NaN in a pose or twist, and in space or of a pin in a force and point: not measured.

    Raises:
        RecordingError: If the shapes don't belong together.
    """

    index: int
    t_s: FloatArray
    pose: FloatArray
    twist: FloatArray
    force_n: FloatArray
    point_m: FloatArray
    pin_m: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("t_s", "pose", "twist", "force_n", "point_m"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        if self.pin_m is not None:
            object.__setattr__(self, "pin_m", frozen_array(self.pin_m))
        shapes = tuple(getattr(self, name).shape for name in ("t_s", "pose", "twist", "force_n", "point_m"))
        n = len(self.t_s) if self.t_s.ndim == 1 else 0
        pushes = ((n, 3), (n, 3))
        allowed = (((n,), (n, 3), (n, 3), *pushes), ((n,), (n, 7), (n, 6), *pushes))
        if n < 1 or shapes not in allowed:
            raise RecordingError(
                f"episode {self.index}: t_s, pose, twist, force_n and point_m must have the shapes (T,), (T, 3), "
                f"(T, 3), (T, 3), (T, 3) or (T,), (T, 7), (T, 6), (T, 3), (T, 3), got {', '.join(map(str, shapes))}."
            )
        if self.pin_m is not None and self.pin_m.shape != (n, 2):
            raise RecordingError(f"episode {self.index}: pin_m must have the shape (T, 2), got {self.pin_m.shape}.")

    def __len__(self) -> int:
        return len(self.t_s)

    @property
    def form(self) -> Form:
        """Planar or in space."""
        return Form.PLANAR if self.pose.shape[1] == 3 else Form.SPATIAL

    @property
    def step_s(self) -> float:
        """Time from one sample to the next; needs two samples."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)


@dataclass(frozen=True, eq=False)
class Recording:
    """A case: episodes of one body on one floor, and what their owner believes of both.

    Args:
        path: Where it was read from.
        form: Planar or in space, the same for all episodes.
        nominal: What the owner believes.
        episodes: At least one, in the order of the file.
        notes: What was odd about the file, yet no error: one sentence each.

    Raises:
        RecordingError: If there is no episode, or one is of another form.
    """

    path: Path
    form: Form
    nominal: Nominal
    episodes: tuple[Episode, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.episodes:
            raise RecordingError(f"{self.path}: a recording needs at least one episode.")
        for episode in self.episodes:
            if episode.form is not self.form:
                raise RecordingError(f"{self.path}: episode {episode.index} is {episode.form}, not {self.form}.")


@dataclass(frozen=True)
class Span:
    """Part of an episode, from sample `begin` until before sample `end`, with a start state of its own."""

    episode: int
    begin: int
    end: int


def warnings(notes: Iterable[str]) -> list[str]:
    """Return those notes that say that something is wrong with a recording."""
    return [note for note in notes if note.startswith(WARNING)]


def introduced(note: str) -> str:
    """Return a note as a sentence in a line of its own, with a word before it that says what it is."""
    said = note[0].upper() + note[1:] if note.startswith(WARNING) else f"Note: {note}"
    return said if said.endswith((".", "?")) else f"{said}."


def frozen_array(values: ArrayLike) -> FloatArray:
    """Return a private copy that can't be written to."""
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy
