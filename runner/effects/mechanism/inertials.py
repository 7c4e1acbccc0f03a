"""What stands in the `<inertial>` of one body, where several effects change it."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping

import mujoco

from runner.effects.base import AbstractEffect, Effects, in_stages
from runner.effects.mechanism import parts
from runner.effects.mechanism.base import MechanismEffect
from runner.effects.mechanism.com_offset import ComOffset
from runner.effects.mechanism.inertia import FreeInertia, Inertia
from runner.effects.mechanism.mass import Mass
from runner.effects.mechanism.payload import Payload

Errors = Mapping[str, Mapping[str, float]]
PLACED = (ComOffset, Payload)  # along an axis that the body turns about nothing may be told of them
OF_A_BODY = (Mass, ComOffset, Inertia, FreeInertia, Payload)


def inertials(model: mujoco.MjModel, effects: Iterable[AbstractEffect], errors: Errors) -> dict[str, str]:
    """Return what to write for those effects that change the `<inertial>` of one body together, by their names.

    The sentence is that of the first of them; of the others it is empty. Nothing for what changes it alone.
    """
    out = dict[str, str]()
    for body, own in _by_body(effects).items():
        if len(own) > 1:
            told = [e for e in as_told(model, own, errors) if isinstance(e, MechanismEffect)]
            out |= dict.fromkeys((e.full_name for e in own), "")
            out[own[0].full_name] = parts.to_give(parts.changed(model, *in_stages(told)), body)
    return out


def as_told(model: mujoco.MjModel, effects: Iterable[AbstractEffect], errors: Errors) -> Effects:
    """Return effects with their places where the motion tells those, and elsewhere as the model has them."""
    return tuple(e.as_told(model, errors.get(e.full_name, {})) if isinstance(e, PLACED) else e for e in effects)


def _by_body(effects: Iterable[AbstractEffect]) -> dict[str, list[MechanismEffect]]:
    found = sorted((e for e in effects if isinstance(e, OF_A_BODY)), key=lambda e: e.target)
    return {body: list(own) for body, own in itertools.groupby(found, key=lambda e: e.target)}
