"""What may be wrong with the recording of a mechanism, in words, and an edit that makes it so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tests.corruptions.edits import (
    Edit,
    at_other_times,
    constant,
    doubled,
    exchanged,
    frozen,
    jitter,
    lacking,
    late,
    noise,
    of_another_episode,
    rate_off_in_last,
    rounded,
    scaled,
    shifted,
    shuffled,
    spike,
    without,
    zero,
)

DEGREES = 180 / np.pi


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
        f"`{q}` constant": constant(q),
        f"`{q}` x 1000": scaled(1000, q),
        f"`{q}` x 180/pi": scaled(DEGREES, q),
        f"`{q}` mirrored": scaled(-1, q),
        f"`{q}` noise": noise(0.5, q),
        f"`{q}` held for half a second": frozen(second // 2, second, q),
        f"`{q}` off by 3 in one sample": spike(q, 3.0, second),
        f"`{q}` off by 3 in three samples": shifted(3.0, second, second + 3, q),
        f"`{q}` off by 3 in the first sample": shifted(3.0, 0, 1, q),
        f"`{q}` steps by 1": shifted(1.0, second, None, q),
        f"`{q}` steps by a turn": shifted(2 * np.pi, second, None, q),
        f"`{q}` drifts by 0.5 per second": lambda f: f.assign(**{q: f[q] + 0.5 * f["t"]}),
        f"`{q}` half a second late": late(second // 2, q),
        f"`{q}` of another episode": of_another_episode(q),
        f"`{q}` rounded to 0.1": rounded(0.1, q),
    }
    if len(names) > 1:
        out[f"`{q}` and `{names[1]}` exchanged"] = exchanged((q, names[1]))
    return out


def _of_velocities(positions: list[str], names: list[str], second: int) -> dict[str, Edit]:
    q, dq = positions[0], names[0]
    out = {
        f"`{q}` and `{dq}` exchanged": exchanged((q, dq)),
        f"`{dq}` mirrored": scaled(-1, dq),
        f"`{q}` and `{dq}` mirrored": scaled(-1, q, dq),
        f"`{dq}` zero": zero(dq),
        f"`{dq}` x 1000": scaled(1000, dq),
        f"`{dq}` / 1000": scaled(0.001, dq),
        f"`{dq}` x 180/pi": scaled(DEGREES, dq),
        f"`{dq}` a tenth": scaled(0.1, dq),
        f"`{q}` and `{dq}` x 1000": scaled(1000, q, dq),
        f"`{q}` and `{dq}` x 180/pi": scaled(DEGREES, q, dq),
        f"`{dq}` noise": noise(0.5, dq),
        f"`{dq}` held for half a second": frozen(second // 2, second, dq),
        f"`{dq}` off by 50 in one sample": spike(dq, 50.0, second),
        f"`{dq}` with an offset of 1": shifted(1.0, 0, None, dq),
        f"`{dq}` half a second late": late(second // 2, dq),
        f"`{dq}` of another episode": of_another_episode(dq),
        f"`{dq}` NaN in all rows": lacking(0, None, dq),
    }
    if len(names) > 1:
        out[f"`{dq}` and `{names[1]}` exchanged"] = exchanged((dq, names[1]))
        both = ((q, positions[1]), (dq, names[1]))
        out[f"`{q}`, `{dq}` and `{positions[1]}`, `{names[1]}` exchanged"] = exchanged(*both)
    return out


def _of_commands(names: list[str], second: int) -> dict[str, Edit]:
    u = names[0]
    out = {
        f"`{u}` mirrored": scaled(-1, u),
        f"`{u}` x 1000": scaled(1000, u),
        f"`{u}` / 1000": scaled(0.001, u),
        f"`{u}` x 180/pi": scaled(DEGREES, u),
        f"`{u}` zero": zero(u),
        f"`{u}` noise": noise(0.5, u),
        f"`{u}` held for half a second": frozen(second // 2, second, u),
        f"`{u}` a second late": late(second, u),
        f"`{u}` a second early": late(-second, u),
        f"`{u}` of another episode": of_another_episode(u),
        f"`{u}` off by 1000 in one sample": spike(u, 1000.0, second),
        f"`{u}` NaN in one row": lacking(second, second + 1, u),
    }
    if len(names) > 1:
        out[f"`{u}` and `{names[1]}` exchanged"] = exchanged((u, names[1]))
    return out


def _of_times() -> dict[str, Edit]:
    return {
        "`t` in ms": at_other_times(lambda f: f["t"] * 1000),
        "`t` x 60": at_other_times(lambda f: f["t"] * 60),
        "`t` / 1000": at_other_times(lambda f: f["t"] / 1000),
        "`t` twice as fast": at_other_times(lambda f: f["t"] / 2),
        "`t` from zero to zero": at_other_times(lambda f: 0.0 * f["t"]),
        "`t` backwards": at_other_times(lambda f: -f["t"]),
        "`t` off by up to half a step": at_other_times(jitter(0.5)),
        "`t` 5 % faster in the last episode": at_other_times(rate_off_in_last(0.05)),
        "`t` in seconds since 1970": at_other_times(lambda f: f["t"] + 1.7e9),
    }


def _of_rows(q: str) -> dict[str, Edit]:
    return {
        "10 rows lost": without(100, 110),
        "every other row lost": lambda f: f.iloc[::2].reset_index(drop=True),
        "10 rows twice": doubled(100, 110),
        "rows shuffled": shuffled(),
        "rows backwards": lambda f: f.iloc[::-1].reset_index(drop=True),
        "all rows one episode": lambda f: f.assign(episode=0),
        "two rows only": lambda f: f.head(2),
        f"`{q}` NaN in 10 rows": lacking(100, 110, q),
        f"`{q}` NaN in all rows": lacking(0, None, q),
        f"`{q}` infinite in one row": spike(q, np.inf, 100),
        f"`{q}` missing": lambda f: f.drop(columns=q),
    }
