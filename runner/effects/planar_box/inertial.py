"""Effects of mass and how it is distributed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, PlanarEffect, Target, effect
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Mass(PlanarEffect):
    """The body's mass; its inertia scales with it. Fitted as the log of the ratio to the nominal mass."""

    name: ClassVar[str] = "mass"
    label: ClassVar[str] = "a different mass"
    mass_kg: float

    def __post_init__(self) -> None:
        check_range("mass.mass_kg", self.mass_kg, 0.0, 1e6, unit="kg", lower_open=True)

    def edit_model(self, target: Target) -> None:
        model, body = target.model, target.body_id
        ratio = self.mass_kg / model.body_mass[body]
        model.body_mass[body] *= ratio
        model.body_inertia[body] *= ratio
        mujoco.mj_setConst(model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_mass_ratio", "", 0.15, -1.6, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(context.mass_kg * math.exp(x[0]))


@effect
@dataclass(frozen=True)
class Inertia(PlanarEffect):
    """Inertia times `ratio`, mass unchanged. Fitted as the log of the ratio."""

    name: ClassVar[str] = "inertia"
    label: ClassVar[str] = "a different moment of inertia"
    ratio: float

    def __post_init__(self) -> None:
        check_range("inertia.ratio", self.ratio, 0.02, 50.0)

    def edit_model(self, target: Target) -> None:
        target.model.body_inertia[target.body_id] *= self.ratio
        mujoco.mj_setConst(target.model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("log_inertia_ratio", "", 0.25, -2.0, 1.6),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.exp(x[0]))


@effect
@dataclass(frozen=True)
class ComOffset(PlanarEffect):
    """The centre of mass lies at (`x_m`, `y_m`) from the geometric centre, body axes; inertia about it unchanged."""

    name: ClassVar[str] = "com_offset"
    label: ClassVar[str] = "a centre of mass off the geometric centre"
    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        check_range("com_offset.x_m", self.x_m, -100, 100, unit="m")
        check_range("com_offset.y_m", self.y_m, -100, 100, unit="m")

    def edit_model(self, target: Target) -> None:
        target.model.body_ipos[target.body_id, :2] += (self.x_m, self.y_m)
        mujoco.mj_setConst(target.model, target.scratch)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        hx, hy, _ = context.half_size_m
        return (
            Parameter("x_m", "m", 0.1 * hx, -0.6 * hx, 0.6 * hx),
            Parameter("y_m", "m", 0.1 * hy, -0.6 * hy, 0.6 * hy),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0], x[1])


@effect
@dataclass(frozen=True)
class MassLeak(PlanarEffect):
    """Mass and inertia times (1 - `share_per_s` * t), t from the start of the episode."""

    name: ClassVar[str] = "mass_leak"
    label: ClassVar[str] = "a mass that changes during the episode"
    share_per_s: float

    def __post_init__(self) -> None:
        check_range("mass_leak.share_per_s", self.share_per_s, -1.0, 1.0, unit="1/s")

    def edit_model(self, target: Target) -> None:
        target.law["mass_leak"] = self.share_per_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("share_per_s", "1/s", 0.03, -0.3, 0.12),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])
