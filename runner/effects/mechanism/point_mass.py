"""Mass, centre of mass and inertia of one body together: what stands in its `<inertial>`, and what they look like.

A tool, a payload or a battery that a model lacks changes all three, and each by itself says little. What a point mass
m at r adds to a body of mass M, centre of mass c and inertia I is told by two of them; the third has to agree:

    m = M' - M,   r = (M' c' - M c) / m,   I' = I + M |c - c'|^2 + m |r - c'|^2   (about each axis; Steiner)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from runner.effects.base import AbstractEffect
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect
from runner.effects.mechanism.com_offset import ComOffset
from runner.effects.mechanism.inertia import FreeInertia, Inertia
from runner.effects.mechanism.mass import Mass
from runner.effects.wording import length, listed, number

Errors = Mapping[str, Mapping[str, float]]
SURE = 2.0  # standard errors within which two numbers agree, and from which on one is there at all
OF_A_BODY = (Mass, ComOffset, Inertia, FreeInertia)


def inertials(model: mujoco.MjModel, effects: Iterable[AbstractEffect], errors: Errors) -> dict[str, str]:
    """Return what to write for those effects that change the `<inertial>` of one body together, by their names.

    The sentence is that of the first of them; of the others it is empty. Nothing for what changes it alone.
    """
    out = dict[str, str]()
    for body, own in _by_body(effects).items():
        if len(own) > 1:
            told = [e.as_told(model, errors.get(_name(e), {})) if isinstance(e, ComOffset) else e for e in own]
            out |= dict.fromkeys((_name(e) for e in own), "")
            out[_name(own[0])] = parts.to_give(parts.changed(model, *told), body)
    return out


def point_masses(model: mujoco.MjModel, effects: Iterable[AbstractEffect], errors: Errors) -> list[str]:
    """Return a sentence for each body of which mass, centre of mass and inertia differ as a point mass makes them."""
    return [said for body, own in _by_body(effects).items() if (said := _point_mass(model, body, own, errors))]


def _by_body(effects: Iterable[AbstractEffect]) -> dict[str, list[MechanismEffect]]:
    found = sorted((e for e in effects if isinstance(e, OF_A_BODY)), key=lambda e: e.target)
    return {body: list(own) for body, own in itertools.groupby(found, key=lambda e: e.target)}


def _name(effect: MechanismEffect) -> str:
    return f"{effect.name}[{getattr(effect, 'target', '')}]"


def _point_mass(model: mujoco.MjModel, body: str, effects: Sequence[MechanismEffect], errors: Errors) -> str:
    """Return what a point mass would be, in words; empty: there is none that makes these numbers."""
    if {type(e) for e in effects} != {Mass, ComOffset, Inertia}:
        return ""
    index, axes = model.body(body).id, _axes(model, body)
    mass, place, moments = _inertial(model, index, axes)

    def told(own: Sequence[MechanismEffect]) -> np.ndarray:
        """Return the mass (1), where it is (3), what it adds to the moments, and what those lack then, (4 + 2 n,)."""
        mass_then, place_then, moments_then = _inertial(parts.changed(model, *own), index, axes)
        more = mass_then - mass
        where = (mass_then * place_then - mass * place) / more
        away = [mass * _square(place - place_then, n) + more * _square(where - place_then, n) for n in axes]
        return np.array([more, *where, *away, *(moments_then - moments - away)])

    values, spread = told(effects), _spread(told, effects, errors)
    adds, lacks = np.split(values[4:], 2)
    adds_error, lacks_error = np.split(spread[4:], 2)
    agrees = len(axes) > 0 and (np.abs(lacks) < SURE * lacks_error).all()
    if not (agrees and values[0] > SURE * spread[0] and (adds > SURE * np.maximum(adds_error, lacks_error)).all()):
        return ""
    size = parts.body_size_m(model, body)
    where = [
        f"{axis} {length(float(v) if abs(v) > e else 0.0)}"
        for axis, v, e in zip("xyz", values[1:4], spread[1:4], strict=True)
        if e < 0.5 * size  # along an axis that it turns about nothing is told
    ]
    return (
        f"Mass, centre of mass and inertia of '{body}' differ together as a point mass of "
        f"about {number(values[0], 2)} kg at about {listed(where)} in its axes makes them: a tool, a payload or a part "
        "that the model lacks?"
    )


def _spread(
    told: Callable[[Sequence[MechanismEffect]], np.ndarray], effects: Sequence[MechanismEffect], errors: Errors
) -> np.ndarray:
    """Return about how uncertain what numbers come to is, from their standard errors (the delta method).

    How those hang together is not known here: they are taken to be independent, so that it tells what agrees and is not
    told as a standard error.
    """
    total = np.zeros_like(told(effects))
    for i, effect in enumerate(effects):
        for name, error in errors.get(_name(effect), {}).items():
            value = getattr(effect, name)
            step = 1e-3 * error
            ends = [
                told([*effects[:i], replace(effect, **{name: value + side * step}), *effects[i + 1 :]])
                for side in (-1.0, 1.0)
            ]
            total = total + ((ends[1] - ends[0]) / 2e-3) ** 2
    return np.sqrt(total)


def _inertial(model: mujoco.MjModel, body: int, axes: Sequence[np.ndarray]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre of mass (3,), and the moments of inertia about axes through that, (n,)."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    principal = [turn.reshape(3, 3).T @ n for n in axes]
    moments = np.array([float(model.body_inertia[body] @ n**2) for n in principal])
    return float(model.body_mass[body]), np.array(model.body_ipos[body]), moments


def _axes(model: mujoco.MjModel, body: str) -> list[np.ndarray]:
    """Return the axes of the hinges that turn a body, in its axes, (3,) each, as the model stands."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = data.body(body).xmat.reshape(3, 3)
    hinges = [j for j in parts.joints_above(model, body) if int(model.jnt_type[j]) == parts.HINGE]
    return [turn.T @ data.xaxis[j] for j in hinges]


def _square(offset: np.ndarray, axis: np.ndarray) -> float:
    """Return the square of how far a point is from an axis through the origin."""
    return float(offset @ offset - (offset @ axis) ** 2)
