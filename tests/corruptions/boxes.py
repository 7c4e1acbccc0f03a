"""What may be wrong with the recording of a pushed box, in words, and an edit that makes it so."""

from __future__ import annotations

import numpy as np

from tests.corruptions import edits
from tests.corruptions.edits import DEGREES, Edit

POSE, TWIST, FORCE, POINT = ("x", "y", "yaw"), ("vx", "vy", "wz"), ("fx", "fy"), ("px", "py")
MEASURED, COMMANDED = (*POSE, *TWIST), (*FORCE, *POINT)

BOXES: dict[str, Edit] = {
    # exchanged
    "`x`, `y`, `yaw` and `vx`, `vy`, `wz` exchanged": edits.exchanged(*zip(POSE, TWIST, strict=True)),
    "`x` and `y` exchanged": edits.exchanged(("x", "y")),
    "`vx` and `vy` exchanged": edits.exchanged(("vx", "vy")),
    "`x` and `vx` exchanged": edits.exchanged(("x", "vx")),
    "`yaw` and `wz` exchanged": edits.exchanged(("yaw", "wz")),
    "`yaw` and `x` exchanged": edits.exchanged(("yaw", "x")),
    "`fx` and `fy` exchanged": edits.exchanged(("fx", "fy")),
    "`px` and `py` exchanged": edits.exchanged(("px", "py")),
    "`fx`, `fy` and `px`, `py` exchanged": edits.exchanged(("fx", "px"), ("fy", "py")),
    # mirrored, turned
    "`x` mirrored": edits.scaled(-1, "x"),
    "`y` mirrored": edits.scaled(-1, "y"),
    "`vy` mirrored": edits.scaled(-1, "vy"),
    "`yaw` mirrored": edits.scaled(-1, "yaw"),
    "`wz` mirrored": edits.scaled(-1, "wz"),
    "`y` and `vy` mirrored": edits.scaled(-1, "y", "vy"),
    "`yaw` and `wz` mirrored": edits.scaled(-1, "yaw", "wz"),
    "`fx`, `fy` reversed": edits.scaled(-1, *FORCE),
    "`fy` mirrored": edits.scaled(-1, "fy"),
    "`fx`, `fy` turned by 90 degrees": lambda f: f.assign(fx=-f["fy"], fy=f["fx"]),
    "`px`, `py` mirrored": edits.scaled(-1, *POINT),
    "`py` mirrored": edits.scaled(-1, "py"),
    # scaled
    "`x`, `y` in mm": edits.scaled(1000, "x", "y"),
    "`x`, `y`, `vx`, `vy` in mm": edits.scaled(1000, "x", "y", "vx", "vy"),
    "`vx`, `vy` in mm/s": edits.scaled(1000, "vx", "vy"),
    "`vx`, `vy` a tenth": edits.scaled(0.1, "vx", "vy"),
    "`x` a thousandth": edits.scaled(0.001, "x"),
    "`yaw` in degrees": edits.scaled(DEGREES, "yaw"),
    "`wz` in degrees/s": edits.scaled(DEGREES, "wz"),
    "`yaw`, `wz` in degrees": edits.scaled(DEGREES, "yaw", "wz"),
    "`fx`, `fy` x 1000": edits.scaled(1000, *FORCE),
    "`fx`, `fy` / 1000": edits.scaled(0.001, *FORCE),
    "`px`, `py` in mm": edits.scaled(1000, *POINT),
    # dead, held, noise
    "`x`, `y`, `yaw` constant": edits.constant(*POSE),
    "`y` constant": edits.constant("y"),
    "`yaw` constant": edits.constant("yaw"),
    "`vx` zero": edits.zero("vx"),
    "`wz` zero": edits.zero("wz"),
    "`vx`, `vy`, `wz` zero": edits.zero(*TWIST),
    "all measured zero": edits.zero(*MEASURED),
    "all zero": edits.zero(*MEASURED, *COMMANDED),
    "`fx`, `fy` zero": edits.zero(*FORCE, *POINT),
    "`fy` zero": edits.zero("fy"),
    "`px`, `py` zero": edits.zero(*POINT),
    "`x` noise": edits.noise(0.5, "x"),
    "`vx` noise": edits.noise(0.5, "vx"),
    "`fx` noise": edits.noise(5.0, "fx"),
    "`x` held for 80 samples": edits.frozen(100, 180, "x"),
    "`vx` held for 80 samples": edits.frozen(100, 180, "vx"),
    "`fx`, `fy` held for 80 samples": edits.frozen(100, 180, *FORCE),
    # spikes, steps, offsets, drifts
    "`x` off by 10 m in one sample": edits.spike("x", 10.0),
    "`yaw` off by 2 rad in one sample": edits.spike("yaw", 2.0),
    "`yaw` off by a turn in one sample": edits.spike("yaw", 2 * np.pi),
    "`vy` off by 20 m/s in one sample": edits.spike("vy", -20.0),
    "`wz` off by 50 rad/s in one sample": edits.spike("wz", 50.0),
    "`fx` off by 10 kN in one sample": edits.spike("fx", 1e4),
    "`px` off by 10 m in one sample": edits.spike("px", 10.0),
    "`x` off by 10 m in three samples": edits.shifted(10.0, 700, 703, "x"),
    "`x` off by 10 m in the first sample": edits.shifted(10.0, 0, 1, "x"),
    "`x` steps by 1 m": edits.shifted(1.0, 660, None, "x"),
    "`yaw` steps by a turn": edits.shifted(2 * np.pi, 660, None, "yaw"),
    "`vx` with an offset of 0.5 m/s": edits.shifted(0.5, 0, None, "vx"),
    "`wz` with an offset of 0.5 rad/s": edits.shifted(0.5, 0, None, "wz"),
    "`x` drifts by 0.5 m/s": lambda f: f.assign(x=f["x"] + 0.5 * f["t"]),
    "`x` with an offset of 5 m": edits.shifted(5.0, 0, None, "x"),
    "`fx` with an offset of 20 N": edits.shifted(20.0, 0, None, "fx"),
    "`x`, `y` rounded to 0.1 m": edits.rounded(0.1, "x", "y"),
    # other times
    "forces a second late": edits.late(60, *COMMANDED),
    "forces a second early": edits.late(-60, *COMMANDED),
    "forces of another episode": edits.of_another_episode(*COMMANDED),
    "`x`, `y`, `yaw` half a second late": edits.late(30, *POSE),
    "`vx`, `vy`, `wz` half a second late": edits.late(30, *TWIST),
    "velocities of another episode": edits.of_another_episode(*TWIST),
    **edits.TIMES,
    # rows
    **edits.ROWS,
    "episodes interleaved": lambda f: f.sort_values(["t", "episode"]).reset_index(drop=True),
    "an episode of two samples": lambda f: f.assign(episode=f["episode"] + (np.arange(len(f)) >= len(f) - 2)),
    # not a number
    "`x` NaN in 10 rows": edits.lacking(100, 110, "x"),
    "`x` NaN in all rows": edits.lacking(0, None, "x"),
    "`vx` NaN in all rows": edits.lacking(0, None, "vx"),
    "`fx` NaN in one row": edits.lacking(100, 101, "fx"),
    "`x` infinite in one row": edits.spike("x", np.inf),
    "`t` NaN in one row": edits.lacking(100, 101, "t"),
    "`y` missing": lambda f: f.drop(columns="y"),
    "`vx` missing": lambda f: f.drop(columns="vx"),
}
