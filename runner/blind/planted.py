"""What was planted, under the names that a verdict has for it: where answers and verdicts speak of the same number.

The answers of `runner blind make` speak of the world that was simulated, a verdict of how the model must be changed.
Where an answer uses the verdict's own names, as those of other sources may, there is nothing to translate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

AXES = {("anisotropic_friction", "angle_rad")}  # a direction without a sense: known up to half a turn
# (effect, name in a verdict): name in an answer
RENAMED = {
    ("friction", "mu"): "friction",
    ("stribeck", "speed_m_s"): "speed_m_per_s",
    ("anisotropic_friction", "angle_rad"): "axis_1_rad",
    ("viscous_drag", "film_n_s_per_m"): "coefficient_n_s_per_m",
}


def planted(effect: Mapping[str, Any], answer: Mapping[str, Any], beliefs: Any) -> dict[str, float]:
    """Return the true values of an effect under the names that a verdict has for them, SI units.

    What a verdict has no word for is left out: the profile of a pressure and of a patch with soft flanks differ in
    kind from those that are fitted, so that their numbers can't be compared; of the patch, its place can.

    Args:
        effect: One of an answer.
        answer: All of it: what is planted beside the effect may count for it.
        beliefs: What the owner of the case believes, for what is relative to that; None: not known.
    """
    name, true = effect["name"], dict(effect.get("true", {}))
    if name == "contact_pressure":
        return {}
    if name == "friction_patch" and true.get("shape") == "gaussian":
        return {k: true[k] for k in ("x_m", "y_m")}
    if "friction_1" in true:
        true["ratio"] = true["friction_1"] / true["friction_2"]
    if "inertia_kg_m2" in true and beliefs is not None:
        masses = [e["true"]["mass_kg"] for e in answer["effects"] if e["name"] == "mass"]
        heavier = masses[0] / beliefs.mass_kg if masses else 1.0
        true["ratio"] = true["inertia_kg_m2"] / (beliefs.yaw_inertia_kg_m2 * heavier)
    out = {k: v for k, v in true.items() if not isinstance(v, str)}
    return out | {new: out[old] for (kind, new), old in RENAMED.items() if kind == name and old in out}


def difference(effect: str, parameter: str, value: float, true: float) -> float:
    """Return value less truth, angles the short way round."""
    if not parameter.endswith("_rad"):
        return value - true
    turn = math.pi if (effect, parameter) in AXES else 2 * math.pi
    return (value - true + turn / 2) % turn - turn / 2
