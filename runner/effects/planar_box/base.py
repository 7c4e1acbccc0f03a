"""Effects of a box on a floor: where they act, and what they may know of box, floor and pushes.

An effect acts at up to five places, each a method that does nothing unless overridden:

    edit_mjcf         elements that must exist before compiling (a tendon)
    edit_model        numbers of the compiled model (mass, gravity, friction law)
    edit_command      the recorded command, outside the engine: means over physics steps
    edit_pin          the recorded path of a pin that pushes, outside the engine
    edit_measurement  the predicted measurement, outside the engine
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, TypeVar

import mujoco
import numpy as np
from dm_control import mjcf

from runner.effects.base import AbstractEffect
from runner.physics.dry_friction import FrictionView


class BelievedContact(Protocol):
    """What an owner believes of a pin that pushes the box."""

    @property
    def friction(self) -> float: ...


class Beliefs(Protocol):
    """What an owner believes of box and floor, as far as words need it; `Nominal` of a recording is one."""

    @property
    def mass_kg(self) -> float: ...

    @property
    def friction(self) -> float: ...

    @property
    def centre_of_mass_m(self) -> tuple[float, float, float]: ...

    @property
    def yaw_inertia_kg_m2(self) -> float: ...

    @property
    def pin(self) -> BelievedContact | None: ...


@dataclass(frozen=True)
class Context:
    """What may be known when an effect is made from a vector: the nominal body, and how it was moved.

    `centre_m` and `reach_m` span the floor that was visited, `speed_m_s` is the fastest that the body was seen to move,
    `force_n` is the largest commanded force, `pin_friction`
    what is believed between the body and a pin that pushes it (None: there is no pin), `pin_height_m` how high that
    touches above the geometric centre.
    """

    mass_kg: float
    friction: float
    half_size_m: tuple[float, float, float]
    gravity_m_s2: float
    centre_m: tuple[float, float] = (0.0, 0.0)
    reach_m: float = 2.0
    force_n: float = 20.0
    pin_friction: float | None = None
    pin_height_m: float = 0.0
    speed_m_s: float = 3.0

    def at(self, target: str | None) -> Context:
        """There is one body, and nothing to choose."""
        return self

    @property
    def size_m(self) -> float:
        """Mean half edge of the base."""
        return 0.5 * (self.half_size_m[0] + self.half_size_m[1])

    @property
    def friction_n(self) -> float:
        """Nominal sliding friction."""
        return max(self.friction, 0.02) * self.mass_kg * self.gravity_m_s2


@dataclass(frozen=True)
class Target:
    """The compiled model and the body that an effect changes; `scratch` is for MuJoCo's derived constants."""

    model: mujoco.MjModel
    body_id: int
    scratch: mujoco.MjData

    @property
    def dry_friction(self) -> FrictionView:
        """The body's dry friction."""
        return FrictionView(self.model, self.body_id)

    @property
    def dofs(self) -> slice:
        """The body's degrees of freedom."""
        adr, num = int(self.model.body_dofadr[self.body_id]), int(self.model.body_dofnum[self.body_id])
        return slice(adr, adr + num)


@dataclass(frozen=True)
class Motion:
    """A motion at every physics step: `t_s` (T,), `pose` and `twist` (..., T, 3): x, y, yaw and their rates."""

    t_s: np.ndarray
    pose: np.ndarray
    twist: np.ndarray


class PlanarEffect(AbstractEffect):
    """A difference between a box on a floor and its model; see the module's docstring."""

    of_command: ClassVar[bool] = False  # changes a commanded force, and nothing where there is none
    of_pin: ClassVar[bool] = False  # there is nothing to change without a pin

    def edit_mjcf(self, root: mjcf.RootElement, body: str) -> None:
        """Add the elements that the effect needs."""

    def edit_model(self, target: Target) -> None:
        """Write the effect's numbers into a compiled model that holds the nominal ones."""

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        """Return the command that the body really gets, (n, 12) means over physics steps (see `push_columns`)."""
        return columns

    def edit_pin(self, path: np.ndarray, step_s: float) -> np.ndarray:
        """Return the path of the pin as it really is, (n, 2), m, at physics steps."""
        return path

    def edit_measurement(self, motion: Motion) -> Motion:
        """Return what the sensors report of a motion."""
        return motion


def late(rows: np.ndarray, delay_s: float, step_s: float, before: np.ndarray | float = 0.0) -> np.ndarray:
    """Return a command (n, k) that comes late by the next whole number of steps; `ahead` makes up for the rest.

    A command that switches within a step can't be replaced by its mean: half a force may not overcome friction.
    `before` is what was commanded until then, (k,): no force, or where a path begins.
    """
    steps = min(whole_steps(delay_s, step_s), len(rows))
    return np.vstack([np.broadcast_to(before, (steps, rows.shape[1])), rows[: len(rows) - steps]])


def ahead(motion: Motion, delay_s: float) -> Motion:
    """Read a motion at every step (see `Motion`) by the part of a step that `late` has delayed too much.

    Between steps the velocity is linear: forces switch at steps. Beyond the last it goes on as it did.
    """
    step = float(motion.t_s[1] - motion.t_s[0])
    part = overdone(delay_s, step)
    change = np.diff(motion.twist, axis=-2)
    change = np.concatenate([change, change[..., -1:, :]], axis=-2)
    return Motion(
        motion.t_s,
        motion.pose + part * step * (motion.twist + 0.5 * part * change),
        motion.twist + part * change,
    )


def overdone(delay_s: float, step_s: float) -> float:
    """Return the part of a step by which `late` delays too much."""
    return whole_steps(delay_s, step_s) - delay_s / step_s


def whole_steps(delay_s: float, step_s: float) -> int:
    """Return the least number of steps that is no shorter than a delay."""
    return int(np.ceil(delay_s / step_s - 1e-9))


EFFECTS: dict[str, list[type[PlanarEffect]]] = {}
E = TypeVar("E", bound=type[PlanarEffect])


def effect(cls: E) -> E:
    """Enter an effect class into the vocabulary; a name may have several variants."""
    EFFECTS.setdefault(cls.name, []).append(cls)
    return cls
