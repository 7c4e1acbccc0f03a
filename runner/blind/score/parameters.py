"""Parameters that a verdict states beside those that were planted: how often its intervals hold them, how far off."""

# pandas' own annotations name every type that an index could lead to, which no caller can narrow
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from runner.diagnosis.score import share
from runner.recording import Nominal

WIDE = 1.959964  # standard errors to each side of a 95 % interval
AXES = {("anisotropic_friction", "angle_rad")}  # a direction without a sense: known up to half a turn
PLACED = ("friction_patch", "tether")
RENAMED = {
    ("friction", "mu"): "friction",
    ("stribeck", "speed_m_s"): "speed_m_per_s",
    ("anisotropic_friction", "angle_rad"): "axis_1_rad",
    ("viscous_drag", "film_n_s_per_m"): "coefficient_n_s_per_m",
}


def planted(effect: Mapping[str, Any], answer: Mapping[str, Any], nominal: Nominal | None) -> dict[str, float]:
    """Return the true values of an effect under the names that a verdict has for them, SI units.

    What a verdict has no word for is left out: the profile of a pressure and of a patch with soft flanks differ in
    kind from those that are fitted, so that their numbers can't be compared; of the patch, its place can.
    """
    name, true = effect["name"], dict(effect.get("true", {}))
    if name == "contact_pressure":
        return {}
    if name == "friction_patch" and true.get("shape") == "gaussian":
        return {k: true[k] for k in ("x_m", "y_m")}
    if name == "anisotropic_friction":
        true["ratio"] = true["friction_1"] / true["friction_2"]
    if name == "inertia" and nominal is not None:
        masses = [e["true"]["mass_kg"] for e in answer["effects"] if e["name"] == "mass"]
        heavier = masses[0] / nominal.mass_kg if masses else 1.0
        true["ratio"] = true["inertia_kg_m2"] / (_yaw_inertia(nominal) * heavier)
    out = {k: v for k, v in true.items() if not isinstance(v, str)}
    return out | {new: out[old] for (kind, new), old in RENAMED.items() if kind == name and old in out}


def _yaw_inertia(nominal: Nominal) -> float:
    given = nominal.inertia_kg_m2
    if isinstance(given, float | int):
        return float(given)
    if given is not None:
        return float(given[2])
    return nominal.mass_kg * (nominal.half_size_m[0] ** 2 + nominal.half_size_m[1] ** 2) / 3.0


def compared(
    case: str, answer: dict[str, Any], verdict: dict[str, Any], nominal: Nominal | None
) -> list[dict[str, Any]]:
    """Return the parameters that the first answer states of effects that were planted, under their own names.

    One without a standard error claims to hold exactly that value; one without a value holds nothing.
    """
    first = verdict["ranked"][0]
    right = set(first["effects"]) == {e["name"] for e in answer["effects"]}
    rows = []
    for effect in answer["effects"]:
        name = effect["name"]
        true = planted(effect, answer, nominal)
        for parameter, value in first["parameters"].get(name, {}).items():
            error = first["standard_errors"].get(name, {}).get(parameter) or 0.0
            if parameter in true:
                value = math.nan if value is None else value
                off = difference(name, parameter, value, true[parameter])
                rows.append(
                    {"case": case, "effect": name, "parameter": parameter, "true": true[parameter], "value": value,
                     "standard_error": error, "errors_off": off / error if error > 0 else math.nan,
                     "covered": abs(off) <= WIDE * error, "right": right}
                )  # fmt: skip
    return rows


def difference(effect: str, parameter: str, value: float, true: float) -> float:
    """Return value less truth, angles the short way round."""
    if not parameter.endswith("_rad"):
        return value - true
    turn = math.pi if (effect, parameter) in AXES else 2 * math.pi
    return (value - true + turn / 2) % turn - turn / 2


def coverage_of(parameters: pd.DataFrame) -> pd.DataFrame:
    groups = [(("all", ""), parameters), *parameters.groupby(["effect", "parameter"])]
    rows = []
    for (effect, parameter), part in groups:
        value, low, high = share(part["covered"])
        off = part["errors_off"].dropna().to_numpy(float)
        typical = float(np.sqrt(np.mean(off**2))) if len(off) else math.nan
        rows.append(
            {"effect": effect, "parameter": parameter, "values": len(part), "covered": value, "low": low, "high": high,
             "errors_off": typical}
        )  # fmt: skip
    return pd.DataFrame(rows)


def places_of(parameters: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for key, part in parameters[parameters["effect"].isin(PLACED)].groupby(["case", "effect"]):
        case, effect = tuple(key)
        part = part.set_index("parameter")
        if {"x_m", "y_m"} <= set(part.index):
            off = part.loc[["x_m", "y_m"], "value"] - part.loc[["x_m", "y_m"], "true"]
            distance_m = float(np.linalg.norm(off))
            stated_m = float(np.linalg.norm(part.loc[["x_m", "y_m"], "standard_error"]))
            rows.append(
                {"case": case, "effect": effect, "distance_m": distance_m, "stated_error_m": stated_m,
                 "errors_off": distance_m / stated_m if stated_m > 0.0 else math.nan,
                 "right": bool(part["right"].iloc[0])}
            )  # fmt: skip
    columns = ["case", "effect", "distance_m", "stated_error_m", "errors_off", "right"]
    return pd.DataFrame(rows, columns=columns).sort_values(["effect", "distance_m"], ignore_index=True)
