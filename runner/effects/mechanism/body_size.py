"""The size of a body."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.mechanism import contacts
from runner.effects.mechanism.base import MechanismEffect, Scope, effect
from runner.effects.wording import Values, number
from runner.errors import check_range

BOX, SPHERE = int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_SPHERE)
CYLINDER, CAPSULE = int(mujoco.mjtGeom.mjGEOM_CYLINDER), int(mujoco.mjtGeom.mjGEOM_CAPSULE)
ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
SHAPES = (BOX, SPHERE, CYLINDER, CAPSULE, ELLIPSOID)
UNIFORM = 0.01  # relative: an inertia that is so near that of a uniform body is meant to be one


@effect
@dataclass(frozen=True)
class BodySize(MechanismEffect):
    """A body is `ratio` times as large, about its origin. Fitted as the log.

    Its mass stays; its inertia does so too, unless it is that of a uniform solid of the believed size: then it goes on
    being that, and grows with the square.
    """

    name: ClassVar[str] = "body_size"
    label: ClassVar[str] = "a different size"
    target_kind: ClassVar[str] = "body"
    target: str
    ratio: float

    def __post_init__(self) -> None:
        check_range("body_size.ratio", self.ratio, 0.01, 100.0)

    def edit_model(self, model: mujoco.MjModel) -> None:
        if is_uniform(model, self.target):
            model.body_inertia[model.body(self.target).id] *= self.ratio**2
        for geom in contacts.geoms_of(model, self.target):
            model.geom_size[geom] *= self.ratio
            model.geom_pos[geom] *= self.ratio
            model.geom_rbound[geom] *= self.ratio
            model.geom_aabb[geom] *= self.ratio

    @classmethod
    def applies(cls, scope: Scope) -> bool:
        model, geoms = scope.model, contacts.geoms_of(scope.model, scope.target)
        known = all(int(model.geom_type[g]) in SHAPES for g in geoms)
        return known and contacts.touches(model, scope.target)

    @classmethod
    def parameters(cls, context: Scope) -> tuple[Parameter, ...]:
        return (Parameter("log_size_ratio", "", 0.02, -0.5, 0.5),)

    @classmethod
    def from_vector(cls, x: Vector, context: Scope) -> Self:
        return cls(str(context.target), math.exp(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Scope, target: str | None = None) -> Phrase:
        ratio = of["ratio"]
        return Phrase(
            f"body '{target}' is {'larger' if ratio > 1 else 'smaller'} than in the model",
            f"{of.show('ratio')} times the believed size",
            f'Multiply the sizes and positions of the geoms of <body name="{target}"> by {number(ratio, 5)}.',
            f"Measure '{target}' with a caliper; if it is right, the scale of what tracks it is not.",
        )


def is_uniform(model: mujoco.MjModel, body: str) -> bool:
    """Whether a body is one box, ball or ellipsoid at its origin with the inertia of a uniform solid."""
    number_, geoms = model.body(body).id, contacts.geoms_of(model, body)
    if len(geoms) != 1 or int(model.geom_type[geoms[0]]) not in (BOX, SPHERE, ELLIPSOID):
        return False
    size = np.array(model.geom_size[geoms[0]])
    box = int(model.geom_type[geoms[0]]) == BOX
    half = np.full(3, size[0]) if int(model.geom_type[geoms[0]]) == SPHERE else size
    squares = half**2 * (1 / 3 if box else 1 / 5)
    solid = float(model.body_mass[number_]) * (squares.sum() - squares)
    return bool(np.allclose(np.sort(model.body_inertia[number_]), np.sort(solid), rtol=UNIFORM))
