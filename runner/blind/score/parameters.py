"""Parameters that a verdict states beside those that were planted: how often its intervals hold them, how far off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd

from runner.blind.planted import difference, planted
from runner.diagnosis.score import full_name, grouped, share

WIDE = 1.959964  # standard errors to each side of a 95 % interval
PLACED = ("friction_patch", "tether")


def compared(case: str, answer: dict[str, Any], verdict: dict[str, Any], beliefs: Any) -> list[dict[str, Any]]:
    """Return the parameters that the first answer states of effects that were planted, under their own names.

    One without a standard error claims to hold exactly that value; one without a value holds nothing.
    """
    first = verdict["ranked"][0]
    right = set(first["effects"]) == {full_name(e) for e in answer["effects"]}
    rows = []
    for effect in answer["effects"]:
        name, true = full_name(effect), planted(effect, answer, beliefs)
        for parameter, value in first["parameters"].get(name, {}).items():
            error = first["standard_errors"].get(name, {}).get(parameter) or 0.0
            if parameter in true:
                value = math.nan if value is None else value
                off = difference(effect["name"], parameter, value, true[parameter])
                rows.append(
                    {"case": case, "effect": name, "parameter": parameter, "true": true[parameter], "value": value,
                     "standard_error": error, "errors_off": off / error if error > 0 else math.nan,
                     "covered": abs(off) <= WIDE * error, "right": right}
                )  # fmt: skip
    return rows


def coverage_of(parameters: pd.DataFrame) -> pd.DataFrame:
    groups = [(("all", ""), parameters), *grouped(parameters, ["effect", "parameter"])]
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
    for (case, effect), part in grouped(parameters[parameters["effect"].isin(PLACED)], ["case", "effect"]):
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
