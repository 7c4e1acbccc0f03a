"""Effects of forces from outside: gravity's direction, wind, drag, a tether."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from dm_control import mjcf

from runner.effects.base import Parameter, Vector
from runner.effects.planar_box.base import Context, PlanarEffect, Target, effect
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class FloorTilt(PlanarEffect):
    """The floor slopes down by `angle_rad` towards the world direction `downhill_rad`. Fitted as its two components."""

    name: ClassVar[str] = "floor_tilt"
    label: ClassVar[str] = "a floor that is not level"
    angle_rad: float
    downhill_rad: float

    def __post_init__(self) -> None:
        check_range("floor_tilt.angle_rad", self.angle_rad, 0.0, 1.2, unit="rad")
        check_range("floor_tilt.downhill_rad", self.downhill_rad, -10, 10, unit="rad")

    def edit_model(self, target: Target) -> None:
        g = float(np.linalg.norm(target.model.opt.gravity))
        down = g * math.sin(self.angle_rad)
        target.model.opt.gravity[:] = (
            down * math.cos(self.downhill_rad),
            down * math.sin(self.downhill_rad),
            -g * math.cos(self.angle_rad),
        )

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return tuple(Parameter(n, "rad", 0.02, -0.3, 0.3) for n in ("tilt_x", "tilt_y"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.hypot(x[0], x[1]), math.atan2(x[1], x[0]))


@effect
@dataclass(frozen=True)
class Wind(PlanarEffect):
    """A constant force `force_n` towards the world direction `direction_rad`, at the geometric centre."""

    name: ClassVar[str] = "wind"
    label: ClassVar[str] = "a constant force from outside"
    force_n: float
    direction_rad: float

    def __post_init__(self) -> None:
        check_range("wind.force_n", self.force_n, 0.0, 1e6, unit="N")
        check_range("wind.direction_rad", self.direction_rad, -10, 10, unit="rad")

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        out = columns.copy()
        out[:, 0] += self.force_n * math.cos(self.direction_rad)
        out[:, 1] += self.force_n * math.sin(self.direction_rad)
        return out

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        weight = context.mass_kg * context.gravity_m_s2
        return tuple(Parameter(n, "N", 0.02 * weight, -0.3 * weight, 0.3 * weight) for n in ("force_x", "force_y"))

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(math.hypot(x[0], x[1]), math.atan2(x[1], x[0]))


@effect
@dataclass(frozen=True)
class ViscousDrag(PlanarEffect):
    """A force against the velocity of the geometric centre, in proportion to it; it does not resist turning."""

    name: ClassVar[str] = "viscous_drag"
    label: ClassVar[str] = "a resistance in proportion to velocity"
    coefficient_n_s_per_m: float

    def __post_init__(self) -> None:
        check_range("viscous_drag.coefficient_n_s_per_m", self.coefficient_n_s_per_m, 0.0, 1e6, unit="N s/m")

    def edit_model(self, target: Target) -> None:
        linear = slice(target.dofs.start, target.dofs.stop - (3 if target.dofs.stop - target.dofs.start == 6 else 1))
        target.model.dof_damping[linear] += self.coefficient_n_s_per_m

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("coefficient_n_s_per_m", "N s/m", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])


@effect
@dataclass(frozen=True)
class AirDrag(PlanarEffect):
    """A force against the velocity of the geometric centre, in proportion to its square."""

    name: ClassVar[str] = "air_drag"
    label: ClassVar[str] = "a resistance in proportion to velocity squared"
    coefficient_n_s2_per_m2: float

    def __post_init__(self) -> None:
        check_range("air_drag.coefficient_n_s2_per_m2", self.coefficient_n_s2_per_m2, 0.0, 1e6, unit="N s2/m2")

    def edit_model(self, target: Target) -> None:
        target.law["air_drag"] = self.coefficient_n_s2_per_m2

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("coefficient_n_s2_per_m2", "N s2/m2", 0.1 * context.friction_n, 0.0, 5 * context.friction_n),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])


@effect
@dataclass(frozen=True)
class RotationalDamping(PlanarEffect):
    """A moment against the yaw rate, in proportion to it."""

    name: ClassVar[str] = "rotational_damping"
    label: ClassVar[str] = "a resistance to turning in proportion to the yaw rate"
    coefficient_n_m_s: float

    def __post_init__(self) -> None:
        check_range("rotational_damping.coefficient_n_m_s", self.coefficient_n_m_s, 0.0, 1e6, unit="N m s")

    def edit_model(self, target: Target) -> None:
        target.model.dof_damping[target.dofs.stop - 1] += self.coefficient_n_m_s

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        moment = 0.1 * context.friction_n * context.size_m
        return (Parameter("coefficient_n_m_s", "N m s", moment, 0.0, 50 * moment),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(x[0])


@effect
@dataclass(frozen=True)
class Tether(PlanarEffect):
    """A spring from the geometric centre to a fixed point at its height; slack when shorter than `rest_length_m`."""

    name: ClassVar[str] = "tether"
    label: ClassVar[str] = "a spring to a fixed point"
    structural: ClassVar[bool] = True
    stiffness_n_per_m: float
    x_m: float
    y_m: float
    rest_length_m: float = 0.0

    def __post_init__(self) -> None:
        check_range("tether.stiffness_n_per_m", self.stiffness_n_per_m, 0.0, 1e6, unit="N/m")
        check_range("tether.x_m", self.x_m, -1e4, 1e4, unit="m")
        check_range("tether.y_m", self.y_m, -1e4, 1e4, unit="m")
        check_range("tether.rest_length_m", self.rest_length_m, 0.0, 1e4, unit="m")

    def edit_mjcf(self, root: mjcf.RootElement, body: str) -> None:
        element = root.find("body", body)
        height = float(element.pos[2])
        root.worldbody.add("site", name=f"{body}_tether_anchor", pos=(0, 0, height))
        element.add("site", name=f"{body}_tether", pos=(0, 0, 0))
        tendon = root.tendon.add("spatial", name=f"{body}_tether", stiffness=1.0, springlength=(0.0, 1.0))
        tendon.add("site", site=f"{body}_tether_anchor")
        tendon.add("site", site=f"{body}_tether")

    def edit_model(self, target: Target) -> None:
        model = target.model
        name = model.body(target.body_id).name
        anchor, tendon = model.site(f"{name}_tether_anchor").id, model.tendon(f"{name}_tether").id
        model.site_pos[anchor, :2] = (self.x_m, self.y_m)
        model.tendon_stiffness[tendon] = self.stiffness_n_per_m
        model.tendon_lengthspring[tendon] = (0.0, self.rest_length_m)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        (cx, cy), reach = context.centre_m, context.reach_m
        stiffness = 0.1 * context.friction_n / max(reach, 0.1)
        return (
            Parameter("stiffness_n_per_m", "N/m", stiffness, 0.0, 200 * stiffness),
            Parameter("x_m", "m", reach, cx - 3 * reach, cx + 3 * reach),
            Parameter("y_m", "m", reach, cy - 3 * reach, cy + 3 * reach),
            Parameter("rest_length_m", "m", reach / 2, 0.0, 6 * reach, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0), x[1], x[2], max(x[3], 0.0))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        (cx, cy), reach = context.centre_m, context.reach_m
        stiffness = 0.1 * context.friction_n / max(reach, 0.1)
        grid = np.array([-1.2, 0.0, 1.2]) * reach
        taut = [[stiffness, cx + a, cy + b, 0.1 * reach] for a in grid for b in grid]
        return np.array([*taut, [stiffness, cx, cy, 0.7 * reach]])
