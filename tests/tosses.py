"""Tosses of a box onto a floor, simulated step by step, as recordings in the form in space."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import yaml

BELIEVED = {"half_size": 0.05, "mass": 0.5, "friction": 0.4, "gravity": 9.81, "rate_hz": 150}
NOISE = {"position": 1e-4, "yaw": 2e-3}
COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz")


def world(
    *,
    half_m: float = 0.05,
    friction: float = 0.4,
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81),
    mass_kg: float = 0.5,
    off_m: float = 0.0,
) -> mujoco.MjModel:
    """Return a box above a floor; its contacts are those of a rigid box as far as MuJoCo goes.

    Its centre of mass may be off the middle along its x axis; its frame is at the middle.
    """
    g, moment = " ".join(map(str, gravity)), mass_kg * (2 * half_m) ** 2 / 6
    inertial = (
        f'<inertial pos="{off_m} 0 0" mass="{mass_kg}" diaginertia="{moment} {moment} {moment}"/>' if off_m else ""
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="0.0005" cone="elliptic" integrator="implicitfast" gravity="{g}"/>
        <worldbody><geom type="plane" size="1 1 1"/><body name="box"><freejoint/>{inertial}
        <geom type="box" size="{half_m} {half_m} {half_m}" mass="{mass_kg}" friction="{friction}" priority="1"
        solref="0.004 1"/></body></worldbody></mujoco>"""
    )


def toss_case(
    folder: Path,
    truth: mujoco.MjModel,
    *,
    tosses: int,
    seed: int = 1,
    length_s: float = 0.6,
    push_n: float = 0.0,
    height_m: float = 0.16,
    spin_rad_s: float = 3.0,
) -> Path:
    """Write a case of tosses in the real world `truth`, with noise on every pose; return the folder.

    They begin at that height; the rate at which it turns about each axis has a spread of `spin_rad_s`.

    With a push, a recorded force of that size acts at the centre all the while, in a direction of each toss's own.
    """
    g, data = np.random.default_rng(seed), mujoco.MjData(truth)
    every = round(1 / BELIEVED["rate_hz"] / truth.opt.timestep)
    step_s = every * truth.opt.timestep
    frames = []
    for e in range(tosses):
        mujoco.mj_resetData(truth, data)
        turn = g.normal(size=4)
        data.qpos[:3], data.qpos[3:] = (0.0, 0.0, height_m), turn / np.linalg.norm(turn)
        data.qvel[:3], data.qvel[3:] = g.normal(size=3) * (0.8, 0.8, 0.2), spin_rad_s * g.normal(size=3)
        force = np.zeros(3)
        if push_n:
            force[:] = g.normal(size=3)
            force *= push_n / np.linalg.norm(force)
        data.xfrc_applied[1, :3] = force
        rows = []
        for _ in range(round(length_s / step_s)):
            rows.append(np.concatenate([[data.time], data.qpos]))
            mujoco.mj_step(truth, data, every)
        table = np.array(rows)
        table[:, 1:4] += NOISE["position"] * g.normal(size=(len(table), 3))
        for row in table:
            mujoco.mju_quatIntegrate(row[4:], NOISE["yaw"] * g.normal(size=3), 1.0)
        pushed = dict(zip(("fx", "fy", "fz", "px", "py", "pz"), (*force, 0.0, 0.0, 0.0), strict=True)) if push_n else {}
        frames.append(pd.DataFrame(table, columns=["t", *COLUMNS]).assign(episode=e, **pushed))
    return write(folder, pd.concat(frames, ignore_index=True), {**BELIEVED, "rate_hz": 1 / step_s})


def write(folder: Path, table: pd.DataFrame, nominal: dict[str, object]) -> Path:
    """Write a case in the form in space, without velocities."""
    folder.mkdir(parents=True, exist_ok=True)
    table = table.assign(**dict.fromkeys(("vx", "vy", "vz", "wx", "wy", "wz"), np.nan))
    table.to_parquet(folder / "recording.parquet", index=False)
    (folder / "nominal.yaml").write_text(yaml.safe_dump({**nominal, "noise": NOISE}))
    return folder
