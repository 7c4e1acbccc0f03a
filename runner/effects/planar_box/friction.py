"""Effects of the contact between base and floor, all in the compiled friction law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, PlanarEffect, Target, effect
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Friction(PlanarEffect):
    """The friction coefficient everywhere. Fitted as the log of the ratio to the nominal one."""

    name: ClassVar[str] = "friction"
    label: ClassVar[str] = "a different friction coefficient"
    mu: float

    def __post_init__(self) -> None:
        check_range("friction.mu", self.mu, 0.0, 10.0)

    def edit_model(self, target: Target) -> None:
        target.law["mu"] = self.mu
        model = target.model
        for pair in range(model.npair):
            if model.geom_bodyid[model.pair_geom2[pair]] == target.body_id:
                model.pair_friction[pair, :2] = self.mu

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        # up to 1.6, or what a floor that is believed to be ice may turn out to have
        mu = max(context.friction, 1e-3)
        return (Parameter("log_mu_ratio", "", 0.15, -2.5, min(max(1.6, math.log(1.0 / mu)), math.log(10.0 / mu))),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(context.friction, 1e-3) * math.exp(x[0]))


@effect
@dataclass(frozen=True)
class AnisotropicFriction(PlanarEffect):
    """Friction mu_1 along a body axis at `angle_rad` and mu_2 across it, `ratio` = mu_1 / mu_2, their mean as believed.

    It lies on an ellipse. Where the body slides at an angle to both axes, `normality` tells where on it: 1 is slip at
    right angles to the ellipse (Goyal, Ruina & Papadopoulos 1991), 0 a coefficient for each axis, N (mu_1 u_1, mu_2
    u_2) / |u|. Fitted as (a cos 2 angle, a sin 2 angle) with a = (mu_1 - mu_2) / (mu_1 + mu_2), which is smooth where
    the effect is absent.
    """

    name: ClassVar[str] = "anisotropic_friction"
    label: ClassVar[str] = "friction that differs between two directions of the body"
    ratio: float
    angle_rad: float
    normality: float = 1.0

    def __post_init__(self) -> None:
        check_range("anisotropic_friction.ratio", self.ratio, 0.02, 50.0)
        check_range("anisotropic_friction.angle_rad", self.angle_rad, -10, 10, unit="rad")
        check_range("anisotropic_friction.normality", self.normality, 0.0, 1.0)

    def edit_model(self, target: Target) -> None:
        a = (self.ratio - 1) / (self.ratio + 1)
        law = target.law
        law["along"], law["across"], law["aniso_angle"] = 1 + a, 1 - a, self.angle_rad
        law["normality"] = self.normality

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(n, "", 0.1, -0.6, 0.6) for n in ("contrast_cos", "contrast_sin"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        a = math.hypot(x[0], x[1])
        return cls((1 + a) / (1 - a), 0.5 * math.atan2(x[1], x[0]))

    def report(self) -> dict[str, float]:
        # which flow it is has not been fitted
        return {"ratio": self.ratio, "angle_rad": self.angle_rad}


@effect
@dataclass(frozen=True)
class AxisFriction(AnisotropicFriction):
    """The variant of anisotropic friction in which each of two body axes has a coefficient of its own."""

    label: ClassVar[str] = "friction with a coefficient for each of two axes of the body"
    normality: float = 0.0


@effect
@dataclass(frozen=True)
class Stribeck(PlanarEffect):
    """Friction times (1 + `change` exp(-(v / `speed_m_s`)^2)): more (or less) of it at low sliding speed."""

    name: ClassVar[str] = "stribeck"
    label: ClassVar[str] = "friction that changes with sliding speed"
    change: float
    speed_m_s: float

    def __post_init__(self) -> None:
        check_range("stribeck.change", self.change, -0.99, 20.0)
        check_range("stribeck.speed_m_s", self.speed_m_s, 1e-3, 100.0, unit="m/s")

    def edit_model(self, target: Target) -> None:
        target.law["stribeck"], target.law["stribeck_speed"] = self.change, self.speed_m_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (
            Parameter("change", "", 0.2, -0.8, 3.0),
            Parameter("log_speed", "", 0.8, math.log(0.01 / 0.2), math.log(3.0 / 0.2)),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], 0.2 * math.exp(x[1]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        return np.array([[0.15, math.log(v / 0.2)] for v in (0.05, 0.2, 0.8)])


@effect
@dataclass(frozen=True)
class Stiction(PlanarEffect):
    """Friction of a point at rest exceeds that of a sliding one by the share `excess`."""

    name: ClassVar[str] = "stiction"
    label: ClassVar[str] = "a static friction above the kinetic one"
    discontinuous: ClassVar[bool] = True
    detection_limit: ClassVar[float] = 0.08
    excess: float

    def __post_init__(self) -> None:
        check_range("stiction.excess", self.excess, 0.0, 20.0)

    def edit_model(self, target: Target) -> None:
        target.law["stiction"] = self.excess

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("excess", "", 0.3, 0.0, 3.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        # the motion hardly changes until a push fails to start it: look at several sizes
        return np.array([[s] for s in (0.1, 0.3, 0.8)])


@effect
@dataclass(frozen=True)
class FrictionPatch(PlanarEffect):
    """Friction times (1 + `change`) inside a disc of the floor, with a smooth edge."""

    name: ClassVar[str] = "friction_patch"
    label: ClassVar[str] = "friction that differs in one place of the floor"
    detection_limit: ClassVar[float] = 0.01
    change: float
    x_m: float
    y_m: float
    radius_m: float

    def __post_init__(self) -> None:
        check_range("friction_patch.change", self.change, -1.0, 20.0)
        check_range("friction_patch.x_m", self.x_m, -1e4, 1e4, unit="m")
        check_range("friction_patch.y_m", self.y_m, -1e4, 1e4, unit="m")
        check_range("friction_patch.radius_m", self.radius_m, 1e-3, 1e3, unit="m")

    def edit_model(self, target: Target) -> None:
        law = target.law
        law["patch"], law["patch_radius"] = self.change, self.radius_m
        law["patch_x"], law["patch_y"] = self.x_m, self.y_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        (cx, cy), reach = context.centre_m, context.reach_m
        return (
            Parameter("change", "", 0.3, -0.95, 3.0),
            Parameter("x_m", "m", reach / 2, cx - 1.3 * reach, cx + 1.3 * reach, may_rest=True),
            Parameter("y_m", "m", reach / 2, cy - 1.3 * reach, cy + 1.3 * reach, may_rest=True),
            Parameter("log_radius", "", 0.6, math.log(0.3 * context.size_m), math.log(6 * context.size_m)),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1], x[2], math.exp(x[3]))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        (cx, cy), reach = context.centre_m, context.reach_m
        grid = np.linspace(-0.8, 0.8, 5) * reach
        radius = max(1.2 * context.size_m, 0.3 * reach)  # overlapping neighbours
        return np.array([[0.2, cx + a, cy + b, math.log(radius)] for a in grid for b in grid])


@effect
@dataclass(frozen=True)
class ContactPressure(PlanarEffect):
    """The load is concentrated on the rim (`share` > 0) or in the middle (< 0) of the base."""

    name: ClassVar[str] = "contact_pressure"
    label: ClassVar[str] = "a load concentrated on the rim or in the middle of the base"
    share: float

    def __post_init__(self) -> None:
        check_range("contact_pressure.share", self.share, -50.0, 50.0)

    def edit_model(self, target: Target) -> None:
        target.law["pressure"] = self.share

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("share", "", 0.5, -15.0, 8.0),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])


@effect
@dataclass(frozen=True)
class ViscousFilm(PlanarEffect):
    """A film under the base that resists each point's slip in proportion to it; it resists turning as well."""

    name: ClassVar[str] = "viscous_drag"
    label: ClassVar[str] = "a viscous film under the base"
    film_n_s_per_m: float

    def __post_init__(self) -> None:
        check_range("viscous_drag.film_n_s_per_m", self.film_n_s_per_m, 0.0, 1e6, unit="N s/m")

    def edit_model(self, target: Target) -> None:
        target.law["film"] = self.film_n_s_per_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("film_n_s_per_m", "N s/m", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])
