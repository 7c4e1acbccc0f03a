"""What a case says to whoever diagnoses it: the MJCF, `nominal.yaml` and the recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd

from runner.blind.drake_body.physics import Shape, Toss, World
from runner.storage.writing import write_parquet, write_text, write_yaml

MODEL = "model.xml"
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
# the impedance is constant, so that a contact is the damped spring that its solref speaks of, and the cone is round
IMPEDANCE = "0.9999 0.9999 0.001 0.5 2"


def name_of(world: World) -> str:
    """Return what the body is called."""
    return world.shape.value


def mjcf(world: World) -> str:
    """Return the MJCF of a world in which nothing is the matter."""
    name, bounce = name_of(world), world.bounce_rad_s
    inertia = " ".join(f"{moment:.6g}" for moment in world.uniform_inertia)
    hx, hy, hz = world.half_size
    shape = (
        f'type="cylinder" size="{hx} {hz}"' if world.shape is Shape.CYLINDER else f'type="box" size="{hx} {hy} {hz}"'
    )
    contact = f"{-(bounce**2):.5g} {-2.0 * world.damping_ratio * bounce:.5g}"
    return (
        f'<mujoco model="{name}">\n'
        f'<option timestep="0.0005" integrator="implicitfast" cone="elliptic" gravity="0 0 {-world.gravity!r}"/>\n'
        f'<worldbody>\n<geom name="table" type="plane" size="2 2 0.1"/>\n<body name="{name}" pos="0 0 0.2">\n'
        f'<freejoint name="{name}"/>\n<inertial pos="0 0 0" mass="{world.mass!r}" diaginertia="{inertia}"/>\n'
        f'<geom name="{name}" {shape} friction="{world.friction!r}" priority="1" solref="{contact}" '
        f'solimp="{IMPEDANCE}"/>\n</body>\n</worldbody>\n</mujoco>\n'
    )


def by_mujoco(xml: str, tosses: Sequence[Toss]) -> list[np.ndarray]:
    """Return where plain MuJoCo takes the body from the true starts: paths of poses, (T, 7) each."""
    model = mujoco.MjModel.from_xml_string(xml)
    paths = []
    for toss in tosses:
        data = mujoco.MjData(model)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, toss.quaternion)
        data.qpos[:] = *toss.place, *toss.quaternion
        data.qvel[:] = *toss.velocity, *(turn.reshape(3, 3).T @ toss.spin)
        substeps = max(1, round(1.0 / (toss.rate_hz * model.opt.timestep)))
        model.opt.timestep = 1.0 / (toss.rate_hz * substeps)
        path = np.empty((toss.samples, 7))
        for k in range(toss.samples):
            path[k] = data.qpos
            for _ in range(substeps):
                mujoco.mj_step(model, data)
        paths.append(path)
    return paths


def nominal_of(world: World, noise: dict[str, float | None] | None) -> dict[str, Any]:
    """Return what stands in `nominal.yaml`; noise by channel as it is stated."""
    name = name_of(world)
    return {
        "model": MODEL,
        "channels": {
            **{axis: {"body": name, "quantity": "position", "axis": axis} for axis in "xyz"},
            "quat": {"body": name, "quantity": "orientation", "columns": list(POSE[3:])},
        },
        "noise": noise,
    }


def table_of(tosses: Sequence[Toss], measured: Sequence[np.ndarray]) -> pd.DataFrame:
    """Return the recording of measured paths, (T, 7) each."""
    rows = []
    for number, (toss, path) in enumerate(zip(tosses, measured, strict=True)):
        row: dict[str, np.ndarray] = {"episode": np.full(len(path), number, np.int32)}
        row["t"] = np.arange(len(path)) / toss.rate_hz
        row |= {name: column.astype(np.float32) for name, column in zip(POSE, path.T, strict=True)}
        rows.append(pd.DataFrame(row))
    return pd.concat(rows, ignore_index=True)


def write_case(folder: Path, world: World, nominal: dict[str, Any], table: pd.DataFrame) -> None:
    """Write a case into its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / MODEL, mjcf(world))
    write_yaml(folder / "nominal.yaml", nominal)
    write_parquet(folder / "recording.parquet", table)
