"""What may be wrong with the recording of a mechanism, in words, and an edit that makes it so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.corruptions import edits
from tests.corruptions.edits import DEGREES, Edit


def mechanisms(nominal: Mapping[str, Any], rate_hz: float) -> dict[str, Edit]:
    """Return what may be wrong with a recording, as far as it has the columns.

    Args:
        nominal: The content of its `nominal.yaml`.
        rate_hz: Of its samples.
    """
    by: dict[str, list[str]] = {"position": [], "velocity": []}
    for column, source in nominal["channels"].items():
        by[source["quantity"]].append(column)
    positions, velocities, commands = by["position"], by["velocity"], list(nominal.get("commands", {}))
    second = round(rate_hz)
    return {
        **_of_positions(positions, second),
        **(_of_velocities(positions, velocities, second) if velocities else {}),
        **_of_commands(commands, second),
        **_of_times(),
        **_of_rows(positions[0]),
    }


def _of_positions(names: list[str], second: int) -> dict[str, Edit]:
    q = names[0]
    out = {
        f"`{q}` constant": edits.constant(q),
        f"`{q}` x 1000": edits.scaled(1000, q),
        f"`{q}` x 180/pi": edits.scaled(DEGREES, q),
        f"`{q}` mirrored": edits.scaled(-1, q),
        f"`{q}` noise": edits.noise(0.5, q),
        f"`{q}` held for half a second": edits.frozen(second // 2, second, q),
        f"`{q}` off by 3 in one sample": edits.spike(q, 3.0, second),
        f"`{q}` off by 3 in three samples": edits.shifted(3.0, second, second + 3, q),
        f"`{q}` off by 3 in the first sample": edits.shifted(3.0, 0, 1, q),
        f"`{q}` steps by 1": edits.shifted(1.0, second, None, q),
        f"`{q}` steps by a turn": edits.shifted(2 * np.pi, second, None, q),
        f"`{q}` drifts by 0.5 per second": lambda f: f.assign(**{q: f[q] + 0.5 * f["t"]}),
        f"`{q}` half a second late": edits.late(second // 2, q),
        f"`{q}` of another episode": edits.of_another_episode(q),
        f"`{q}` rounded to 0.1": edits.rounded(0.1, q),
    }
    if len(names) > 1:
        out[f"`{q}` and `{names[1]}` exchanged"] = edits.exchanged((q, names[1]))
    return out


def _of_velocities(positions: list[str], names: list[str], second: int) -> dict[str, Edit]:
    q, dq = positions[0], names[0]
    out = {
        f"`{q}` and `{dq}` exchanged": edits.exchanged((q, dq)),
        f"`{dq}` mirrored": edits.scaled(-1, dq),
        f"`{q}` and `{dq}` mirrored": edits.scaled(-1, q, dq),
        f"`{dq}` zero": edits.zero(dq),
        f"`{dq}` x 1000": edits.scaled(1000, dq),
        f"`{dq}` / 1000": edits.scaled(0.001, dq),
        f"`{dq}` x 180/pi": edits.scaled(DEGREES, dq),
        f"`{dq}` a tenth": edits.scaled(0.1, dq),
        f"`{q}` and `{dq}` x 1000": edits.scaled(1000, q, dq),
        f"`{q}` and `{dq}` x 180/pi": edits.scaled(DEGREES, q, dq),
        f"`{dq}` noise": edits.noise(0.5, dq),
        f"`{dq}` held for half a second": edits.frozen(second // 2, second, dq),
        f"`{dq}` off by 50 in one sample": edits.spike(dq, 50.0, second),
        f"`{dq}` with an offset of 1": edits.shifted(1.0, 0, None, dq),
        f"`{dq}` half a second late": edits.late(second // 2, dq),
        f"`{dq}` of another episode": edits.of_another_episode(dq),
        f"`{dq}` NaN in all rows": edits.lacking(0, None, dq),
    }
    if len(names) > 1:
        out[f"`{dq}` and `{names[1]}` exchanged"] = edits.exchanged((dq, names[1]))
        both = ((q, positions[1]), (dq, names[1]))
        out[f"`{q}`, `{dq}` and `{positions[1]}`, `{names[1]}` exchanged"] = edits.exchanged(*both)
    return out


def _of_commands(names: list[str], second: int) -> dict[str, Edit]:
    u = names[0]
    out = {
        f"`{u}` mirrored": edits.scaled(-1, u),
        f"`{u}` x 1000": edits.scaled(1000, u),
        f"`{u}` / 1000": edits.scaled(0.001, u),
        f"`{u}` x 180/pi": edits.scaled(DEGREES, u),
        f"`{u}` zero": edits.zero(u),
        f"`{u}` noise": edits.noise(0.5, u),
        f"`{u}` held for half a second": edits.frozen(second // 2, second, u),
        f"`{u}` a second late": edits.late(second, u),
        f"`{u}` a second early": edits.late(-second, u),
        f"`{u}` of another episode": edits.of_another_episode(u),
        f"`{u}` off by 1000 in one sample": edits.spike(u, 1000.0, second),
        f"`{u}` NaN in one row": edits.lacking(second, second + 1, u),
    }
    if len(names) > 1:
        out[f"`{u}` and `{names[1]}` exchanged"] = edits.exchanged((u, names[1]))
    return out


def _of_times() -> dict[str, Edit]:
    return {
        **edits.TIMES,
        "`t` / 1000": edits.at_other_times(lambda f: f["t"] / 1000),
    }


def _of_rows(q: str) -> dict[str, Edit]:
    return {
        **edits.ROWS,
        f"`{q}` NaN in 10 rows": edits.lacking(100, 110, q),
        f"`{q}` NaN in all rows": edits.lacking(0, None, q),
        f"`{q}` infinite in one row": edits.spike(q, np.inf, 100),
        f"`{q}` missing": lambda f: f.drop(columns=q),
    }
