"""What is in a scene, as configuration: kind of motion and contact, and the boxes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from runner.errors import ConfigError, check_range, check_vector


class Dof(Enum):
    """How a body may move."""

    planar = "planar"
    free = "free"


class FloorContact(Enum):
    """What carries a body on the floor."""

    patch = "patch"
    feet = "feet"
    corners = "corners"


class Base(Enum):
    """Which part of the base bears under the compiled friction: all of it evenly, or its four corners."""

    even = "even"
    corners = "corners"


@dataclass(frozen=True)
class SceneConfig:
    """What all bodies share: `timestep_s`, gravity, the kind of motion and of contact.

    `grid` is the number of base points (patch) or feet along each edge.
    """

    dof: Dof = Dof.planar
    contact: FloorContact = FloorContact.patch
    timestep_s: float = 1 / 480
    gravity_m_s2: float = 9.81
    grid: int = 8

    def __post_init__(self) -> None:
        check_range("scene.timestep_s", self.timestep_s, 1e-5, 1 / 50, unit="s")
        check_range("scene.gravity_m_s2", self.gravity_m_s2, 0.1, 100.0, unit="m/s2")
        check_range("scene.grid", self.grid, 2, 16)
        if self.dof is Dof.free and self.contact is FloorContact.patch:
            raise ConfigError(
                "scene.contact: 'patch' spreads the load of a body that can't tip, so it needs scene.dof=planar; "
                "with scene.dof=free choose 'corners' or 'feet'."
            )


@dataclass(frozen=True)
class PinConfig:
    """A round pin that moves as it is told and may touch a body.

    `radius_m`, the friction between the two, and how high above the body frame it touches: where that is not the height
    of the centre of mass, the load on the base shifts to where its moment is in balance.
    """

    radius_m: float
    friction: float
    height_m: float = 0.0

    def __post_init__(self) -> None:
        check_range("pin.height_m", self.height_m, -100.0, 100.0, unit="m")
        check_range("pin.radius_m", self.radius_m, 0.0, 100.0, unit="m", lower_open=True)
        check_range("pin.friction", self.friction, 0.0, 10.0)


LEAST_MASS = 1e-14  # ten times mjMINVAL, below which MuJoCo takes a mass for none


@dataclass(frozen=True)
class BodyConfig:
    """One box. `com_m` is relative to the geometric centre; `inertia_kg_m2` is diagonal, about the CoM, in body axes.

    None for the inertia means that of a uniform box of this mass.
    """

    mass_kg: float
    friction: float
    half_size_m: tuple[float, float, float] = (0.5, 0.5, 0.5)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_kg_m2: tuple[float, float, float] | None = None
    base: Base = Base.even

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 1e6, unit="kg", lower_open=True)
        check_range("friction", self.friction, 0.0, 10.0)
        check_vector("half_size_m", self.half_size_m, 3, unit="m")
        for i, (half, com) in enumerate(zip(self.half_size_m, self.com_m, strict=True)):
            check_range(f"half_size_m[{i}]", half, 0.0, 100.0, unit="m", lower_open=True)
            check_range(f"com_m[{i}]", com, -half, half, unit="m (inside the body)")
        if self.inertia_kg_m2 is not None:
            check_inertia("inertia_kg_m2", self.inertia_kg_m2)
        if not min(self.mass_kg, *self.inertia) > LEAST_MASS:
            raise ConfigError(
                f"mass_kg: {self.mass_kg:g} kg makes the smallest inertia {min(self.inertia):.3g} kg m2; MuJoCo takes "
                f"masses and inertias above {LEAST_MASS:g}."
            )

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Diagonal inertia about the CoM, kg m2."""
        return self.inertia_kg_m2 or box_inertia(self.mass_kg, self.half_size_m)


def box_inertia(mass_kg: float, half_size_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the diagonal inertia of a uniform box about its centre, kg m2: m/3 (b^2 + c^2) in half sizes."""
    a, b, c = half_size_m
    return (mass_kg * (b * b + c * c) / 3, mass_kg * (a * a + c * c) / 3, mass_kg * (a * a + b * b) / 3)


def check_inertia(key: str, inertia: tuple[float, ...]) -> None:
    """Refuse a diagonal inertia that no mass distribution has (positive, triangle inequality)."""
    check_vector(key, inertia, 3, unit="kg m2")
    for i, value in enumerate(inertia):
        check_range(f"{key}[{i}]", value, 0.0, 1e9, unit="kg m2", lower_open=True)
    largest = max(inertia)
    if sum(inertia) - largest < largest * (1 - 1e-9):
        raise ConfigError(
            f"{key}: no body has these moments: each must be at most the sum of the others, got {inertia!r}."
        )
