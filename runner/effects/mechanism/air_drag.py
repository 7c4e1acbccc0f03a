"""Drag of the air."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

THIN = 1e-6  # kg/m3, where no medium is believed: so thin that nothing else notices
LIGHT_KG = 1e-9  # MuJoCo's media pass over what has no mass
RADIUS_M = 0.001  # the medium that a sphere carries along grows with its volume: of this it weighs next to nothing
BLUNT, SLENDER = 1, 2  # columns of `geom_fluid`


@effect
@dataclass(frozen=True)
class AirDrag(MechanismEffect):
    """The air resists the motion of a free body: a force of `coefficient_n_s2_per_m2` |v| v against it.

    v is that of the believed centre of mass, where the force acts, against the believed wind: it does not turn the
    body. MuJoCo's own media do that to a sphere whose blunt and slender drag are alike, with nothing else in its
    ellipsoid model, so one is added that touches nothing and weighs next to nothing.
    """

    name: ClassVar[str] = "air_drag"
    label: ClassVar[str] = "drag of the air"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    structural: ClassVar[bool] = True
    target: str
    coefficient_n_s2_per_m2: float

    def __post_init__(self) -> None:
        check_range("air_drag.coefficient_n_s2_per_m2", self.coefficient_n_s2_per_m2, 0.0, 1e6, unit="N s2/m2")
        object.__setattr__(self, "structural", self.coefficient_n_s2_per_m2 > 0.0)

    @property
    def skeleton(self) -> AirDrag:
        return replace(self, coefficient_n_s2_per_m2=1.0)

    def edit_spec(self, spec: mujoco.MjSpec) -> None:
        if self.coefficient_n_s2_per_m2 > 0.0:
            _add_sphere(spec, self.target)

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.coefficient_n_s2_per_m2 > 0.0:
            geom = int(model.body(self.target + parts.AIR).geomadr[0])
            # of the area of the sphere, in its medium
            drag = self.coefficient_n_s2_per_m2 / (float(model.opt.density) * np.pi * RADIUS_M**2)
            model.geom_fluid[geom, [BLUNT, SLENDER]] += drag

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        return contacts.is_free(scope.model, scope.target) and not contacts.carries(scope.model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        usual = of_air(context.model, context.target)
        return (Parameter("coefficient_n_s2_per_m2", "N s2/m2", 3.0 * usual, 0.0, 1000.0 * usual),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        return Phrase(
            f"the air slows body '{target}' down",
            of.show("coefficient_n_s2_per_m2", "N s²/m²"),
            f"Give '{target}' the sphere that model.xml has, \"{target}{parts.AIR}\", whose `fluidcoef` is its drag in "
            "the thin medium of `<option density>`.",
            f"Throw '{target}' fast and far, and compare the two halves of its flight.",
        )


def of_air(model: mujoco.MjModel, body: str | None) -> float:
    """Return a mean drag of a body in a medium of 1 kg/m3, about that of air, N s2/m2.

    Of the box that has its inertia, as MuJoCo's media see it: along each axis i it is 2 r_j r_k v_i^2; of motion along
    n that resists by the sum of 2 r_j r_k |n_i|^3, and the mean of |n_i|^3 over the sphere is 1/4.
    """
    body_ = model.body(body).id
    inertia, mass = np.array(model.body_inertia[body_]), float(model.body_mass[body_])
    half = 0.5 * np.sqrt(np.maximum(inertia.sum() - 2 * inertia, 1e-12) * 6.0 / mass)
    return float(0.25 * 2.0 * np.sum([half[1] * half[2], half[0] * half[2], half[0] * half[1]]))


def _add_sphere(spec: mujoco.MjSpec, name: str) -> None:
    """Add the sphere that the medium acts on, at a body's centre of mass, unless a corrected model has it already."""
    if spec.option.density == 0.0:
        spec.option.density = THIN
    if spec.body(name + parts.AIR) is not None:
        return
    centre = np.array(spec.copy().compile().body(name).ipos)
    spec.body(name).add_body(name=name + parts.AIR, pos=centre).add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[RADIUS_M, 0.0, 0.0],
        pos=[0.0, 0.0, 0.0],
        mass=LIGHT_KG,
        contype=0,
        conaffinity=0,
        group=5,
        rgba=[0.0, 0.0, 0.0, 0.0],
        fluid_ellipsoid=1,
        fluid_coefs=np.zeros(5),
    )
