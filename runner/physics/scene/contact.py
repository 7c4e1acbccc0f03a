"""Contact settings under which MuJoCo's own contacts let a box slide without hopping."""

from __future__ import annotations

import math
from typing import Any

from runner.physics.scene.config import Dof, SceneConfig

# Contact settings under which MuJoCo's elliptic contact slides by Coulomb's law. Its convex cone adds a normal push
# that grows with slip, D_n mu b_t |slip|, which makes a sliding box hop. The tiny `IMPEDANCE` makes the normal rows so
# soft that the push drowns; a direct `solref` puts the wanted spring and damper back; `solreffriction` gives the
# friction rows their own rate b_t; `impratio` makes those rows hard again, in proportion to the mass.
# Measured: acceleration exact to 1e-12, creep below 0.8 um/s, from 0.3 to 10 kg and friction 0.05 to 1.
#
# What remains is in b_t, whatever the step: the push gives faster points a little more load (in proportion to b_t and
# to the number of contacts; a body that can tip evens some of it out), and speeds below mu g / b_t fade instead of
# stopping dead. `FRICTION_RATE` is the best compromise over 20 s episodes of sliding and spinning.
IMPEDANCE = 1e-4  # the least that MuJoCo takes
FRICTION_RATE = {Dof.planar: 400.0, Dof.free: 1600.0}  # b_t times the root of the number of contacts, 1/s
FRICTION_REGULARISER = 3.5e-5  # per root of the number of contacts, times the mass; the creep is in proportion to it


def impratio(contacts: int) -> float:
    """Return how much harder friction is than these contacts, so many of which carry a body."""
    return 1 / IMPEDANCE / FRICTION_REGULARISER / math.sqrt(contacts)


def penetration_m(gravity_m_s2: float, timestep_s: float) -> float:
    """Static penetration under the body's own weight: the contact spring has omega * dt = 0.5."""
    return gravity_m_s2 * (timestep_s / 0.5) ** 2


def floor_contact(share: float, sunk_m: float, scene: SceneConfig, contacts: int) -> dict[str, Any]:
    """Return the attributes of a `<pair>` that carries so large a share of a body, one of so many, but its friction.

    Args:
        share: Of the weight, where the body sinks in evenly.
        sunk_m: How far it sinks in then.
        scene: Of its gravity, step and kind of motion.
        contacts: How many carry the body.
    """
    rate = min(FRICTION_RATE[scene.dof] / math.sqrt(contacts), 1 / scene.timestep_s)
    stiffness = share * scene.gravity_m_s2 / sunk_m
    damping = share * 2 * math.sqrt(scene.gravity_m_s2 / sunk_m)
    return {
        "condim": 3,
        "solref": (-stiffness, -damping),
        "solimp": (IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2),
        "solreffriction": (-1.0, -IMPEDANCE * rate),
    }


def coefficients(friction: float) -> tuple[float, ...]:
    """Return the five friction coefficients of a `<pair>` that slides alike in all directions."""
    return (friction, friction, 0.005, 1e-4, 1e-4)
