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
from runner.physics import medium

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
            medium.add_sphere(spec, self.target)

    def edit_model(self, model: mujoco.MjModel) -> None:
        if self.coefficient_n_s2_per_m2 > 0.0:
            geom = int(model.body(self.target + medium.AIR).geomadr[0])
            drag = medium.of_sphere(self.coefficient_n_s2_per_m2, float(model.opt.density))
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
