"""Drag of the air."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts, parts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values
from runner.errors import check_range

LEAST_SPEED = 0.1  # m/s, for the size of a drag that one would not be surprised to meet


@effect
@dataclass(frozen=True)
class AirDrag(MechanismEffect):
    """The air resists a free body with `coefficient_n_s2_per_m2` times its speed squared.

    MuJoCo's own model of a fluid: the density of the medium acts on the box of the body's inertia, along each of its
    axes with that face, and on its turning. So the drag of a body depends on how it is turned, and the coefficient is
    the mean over all directions of motion, as a tumbling body shows it. The medium is one for all bodies; so it is told
    of a body that moves alone.
    """

    name: ClassVar[str] = "air_drag"
    label: ClassVar[str] = "drag of the air"
    target_kind: ClassVar[str] = "body"
    commonness: ClassVar[int] = 2
    target: str
    coefficient_n_s2_per_m2: float

    def __post_init__(self) -> None:
        check_range("air_drag.coefficient_n_s2_per_m2", self.coefficient_n_s2_per_m2, 0.0, 1e6, unit="N s2/m2")

    def edit_model(self, model: mujoco.MjModel) -> None:
        model.opt.density += self.coefficient_n_s2_per_m2 / per_density(model, self.target)

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model = scope.model
        moving = [b for b in range(1, model.nbody) if int(model.body_weldid[b]) != 0]
        return contacts.is_free(model, scope.target) and moving == [model.body(scope.target).id]

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        usual = per_density(context.model, context.target)  # of something as light as water is heavy: 1 kg/m3 is air
        return (Parameter("coefficient_n_s2_per_m2", "N s2/m2", 3.0 * usual, 0.0, 1000.0 * usual),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), max(float(x[0]), 0.0))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        density = of["coefficient_n_s2_per_m2"] / per_density(beliefs.model, str(target))
        return Phrase(
            f"the air slows body '{target}' down",
            of.show("coefficient_n_s2_per_m2", "N s²/m²"),
            f'Set <option density="{parts.attribute(density + beliefs.model.opt.density)}"/>.',
            f"Throw '{target}' fast and far, and compare the two halves of its flight.",
        )


def per_density(model: mujoco.MjModel, body: str | None) -> float:
    """Return the mean drag of a body over all directions for a medium of 1 kg/m3, N s2/m2.

    Along each axis i of its inertia's box it is 2 r_j r_k v_i^2; of motion along n that resists by the sum of
    2 r_j r_k |n_i|^3, and the mean of |n_i|^3 over the sphere is 1/4.
    """
    body_ = model.body(body).id
    inertia, mass = np.array(model.body_inertia[body_]), float(model.body_mass[body_])
    half = 0.5 * np.sqrt(np.maximum(inertia.sum() - 2 * inertia, 1e-12) * 6.0 / mass)
    return float(0.25 * 2.0 * np.sum([half[1] * half[2], half[0] * half[2], half[0] * half[1]]))
