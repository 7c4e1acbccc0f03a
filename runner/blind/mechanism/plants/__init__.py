"""Effects to plant in a mechanism: each drawn at random but for its size, which is found afterwards."""

from __future__ import annotations

from runner.blind.mechanism.draw import Needs
from runner.blind.mechanism.plants.outside import OUTSIDE
from runner.blind.mechanism.plants.plant import Kind, Plant
from runner.blind.mechanism.plants.signals import SIGNALS
from runner.blind.mechanism.plants.vocabulary import MECHANICAL

__all__ = ["OUTSIDE", "TOGETHER_ALIKE", "VOCABULARY", "Kind", "Needs", "Plant", "kinds_of"]

VOCABULARY: dict[str, Kind] = {**MECHANICAL, **SIGNALS}

# Pairs that are one effect to some such data, or whose numbers speak of the same.
TOGETHER_ALIKE = (
    {"gravity", "gravity_tilt"}, {"gravity_tilt", "sensor_offset"}, {"gravity_tilt", "com_offset"},
    {"sensor_offset", "com_offset"}, {"armature", "inertia"}, {"armature", "mass"}, {"joint_damping", "servo_damping"},
    {"torque_offset", "asymmetric_friction"}, {"torque_offset", "sensor_offset"},
    {"asymmetric_friction", "sensor_offset"}, {"actuator_delay", "observation_delay"}, {"backlash", "compliance"},
    # what lies between drive and link, and a friction that the two would have to share
    *({a, b} for a in ("backlash", "compliance") for b in ("stribeck", "asymmetric_friction", "load_friction")),
    *({"payload", of_body} for of_body in ("mass", "com_offset", "inertia")),
)  # fmt: skip


def kinds_of(system: str) -> tuple[dict[str, Kind], dict[str, Kind]]:
    """Return the kinds with a word, and those without, that a mechanism can have."""
    with_word, without = (
        {name: kind for name, kind in every.items() if not kind.systems or system in kind.systems}
        for every in (VOCABULARY, OUTSIDE)
    )
    return with_word, without
