"""The parameters that estimators may estimate, and how they are written into a model while it runs.

`mass_kg`; `com_x_m`, `com_y_m`: centre of mass from the geometric centre, body axes; `yaw_inertia_kgm2`: moment of
inertia about the vertical through the centre of mass; `friction_coefficient`: of the compiled dry friction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from runner.physics import dry_friction
from runner.physics.scene import BodyConfig
from runner.teleop.frames import Truth

MASS, COM_X, COM_Y, YAW_INERTIA, FRICTION = (
    "mass_kg", "com_x_m", "com_y_m", "yaw_inertia_kgm2", "friction_coefficient",
)  # fmt: skip
PARAMETERS = (MASS, COM_X, COM_Y, YAW_INERTIA, FRICTION)
_MU = dry_friction.COLUMN["mu"]


class ModelArrays(NamedTuple):
    """Live arrays of a model, by body: mass (b,), diagonal inertia (b, 3), CoM (b, 3), the friction record (b, n)."""

    body_mass: np.ndarray
    body_inertia: np.ndarray
    body_ipos: np.ndarray
    body_user: np.ndarray

    @classmethod
    def of(cls, model: mujoco.MjModel) -> ModelArrays:
        """Return those of a model."""
        return cls(*(getattr(model, name) for name in cls._fields))


def values_of(body: BodyConfig) -> dict[str, float]:
    """Return all parameters of a body."""
    return dict(
        zip(PARAMETERS, (body.mass_kg, *body.com_m[:2], body.inertia[2], body.friction), strict=True)
    )  # fmt: skip


def values_in(model: mujoco.MjModel, body_id: int) -> dict[str, float]:
    """Return all parameters of a body in a compiled model."""
    numbers = ModelArrays.of(model)
    x, y = numbers.body_ipos[body_id, :2]
    found = (numbers.body_mass[body_id], x, y, numbers.body_inertia[body_id, 2], numbers.body_user[body_id, _MU])
    return dict(zip(PARAMETERS, map(float, found), strict=True))


def truths(model: mujoco.MjModel, body_id: int, start: BodyConfig) -> dict[str, Truth]:
    """Return true values, as a compiled model has them, with start values; errors of the CoM count by the half size."""
    begin = values_of(start)
    scales = {COM_X: start.half_size_m[0], COM_Y: start.half_size_m[1]}
    return {name: Truth(true, begin[name], scales.get(name)) for name, true in values_in(model, body_id).items()}


def sizes(names: Sequence[str], body: BodyConfig, values: np.ndarray) -> np.ndarray:
    """Return what a change of each parameter is small or large against: itself, or the half size for the CoM."""
    half = {COM_X: body.half_size_m[0], COM_Y: body.half_size_m[1]}
    return np.array([half.get(name, value) for name, value in zip(names, values, strict=True)])


def writer(
    names: Sequence[str], numbers: ModelArrays, body_id: int, body: BodyConfig
) -> Callable[[Sequence[float] | np.ndarray], None]:
    """Return the function that writes values of these parameters into a body.

    Where the yaw inertia is not among them, the inertia follows the mass (eq. 3 of the paper).
    """
    mass, inertia = numbers.body_mass, numbers.body_inertia[body_id]
    per_kg = np.asarray(body.inertia) / body.mass_kg

    def write_mass(values: Sequence[float] | np.ndarray) -> None:
        (mass_kg,) = values
        mass[body_id] = mass_kg
        np.multiply(per_kg, mass_kg, out=inertia)

    if tuple(names) == (MASS,):
        return write_mass
    # the record is there only where somebody wants it
    places: dict[str, tuple[Any, Any]] = {
        COM_X: (numbers.body_ipos, (body_id, 0)),
        COM_Y: (numbers.body_ipos, (body_id, 1)),
        YAW_INERTIA: (numbers.body_inertia, (body_id, 2)),
        FRICTION: (numbers.body_user, (body_id, _MU)),
    }
    plan = [(i, *places[name]) for i, name in enumerate(names) if name != MASS]

    def write(values: Sequence[float] | np.ndarray) -> None:
        if MASS in names:
            write_mass((values[names.index(MASS)],))
        for i, array, place in plan:
            array[place] = values[i]

    return write
