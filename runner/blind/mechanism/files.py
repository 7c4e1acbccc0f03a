"""What a case says to whoever diagnoses it: the MJCF, `nominal.yaml` and the recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.blind.mechanism.case import Names, Unplanted
from runner.blind.mechanism.physics import Actuator, Joint, Link, World
from runner.storage.writing import write_parquet, write_text, write_yaml

MODEL = "model.xml"
# dry friction as hard as MuJoCo has it, for joints that truly stick
HARD = 'solreffriction="0.001 1" solimpfriction="0.995 0.999 0.001 0.5 2"'


def mjcf(world: World, names: Names) -> str:
    """Return the MJCF of a world in which nothing is the matter."""
    bodies = ""
    for i in reversed(range(len(world.links))):
        place = f"0 0 {-world.length_m!r}" if i else "0 0 0"
        bodies = (
            f'<body name="{names.bodies[i]}" pos="{place}">\n'
            f"{_joint(world, world.joints[i], names.joints[i])}{_link(world, world.links[i])}{bodies}</body>\n"
        )
    actuators = "".join(_actuator(a, names, i) for i, a in enumerate(world.actuators))
    gx, gz = world.gravity_m_s2
    return (
        f'<mujoco model="{" ".join(names.bodies)}">\n'
        f'<option timestep="0.0005" integrator="implicitfast" gravity="{gx!r} 0 {gz!r}"/>\n'
        f"<worldbody>\n{bodies}</worldbody>\n<actuator>\n{actuators}</actuator>\n</mujoco>\n"
    )


def _joint(world: World, joint: Joint, name: str) -> str:
    kind = 'type="slide" axis="1 0 0"' if world.slides else 'type="hinge" axis="0 -1 0"'
    return (
        f'<joint name="{name}" {kind} damping="{joint.damping!r}" frictionloss="{joint.dry!r}" '
        f'armature="{joint.armature!r}" {HARD}/>\n'
    )


def _link(world: World, link: Link) -> str:
    x, z = link.com_m
    turning = link.inertia_kg_m2 or 0.01 * link.mass_kg
    shape = (
        '<geom type="box" size="0.05 0.03 0.03"'
        if world.slides
        else f'<geom type="capsule" fromto="0 0 0 {2 * x!r} 0 {2 * z!r}" size="0.01"'
    )
    return (
        f'<inertial pos="{x!r} 0 {z!r}" mass="{link.mass_kg!r}" diaginertia="{turning!r} {turning!r} {turning!r}"/>\n'
        f'{shape} mass="0" contype="0" conaffinity="0"/>\n'
    )


def _actuator(actuator: Actuator, names: Names, i: int) -> str:
    head = f'name="{names.actuators[i]}" joint="{names.joints[i]}"'
    limit = f' forcerange="{-actuator.limit!r} {actuator.limit!r}"' if math.isfinite(actuator.limit) else ""
    if actuator.servo:
        return f'<position {head} kp="{actuator.kp!r}" kv="{actuator.kv!r}"{limit}/>\n'
    return f"<motor {head}{limit}/>\n"


def nominal_of(case: Unplanted, noise: dict[str, float | None] | None) -> dict[str, Any]:
    """Return what stands in `nominal.yaml`; noise by channel as it is stated."""
    names = case.names
    channels = {
        case.channel(i, of_velocity=v): {"joint": names.joints[i], "quantity": "velocity" if v else "position"}
        for i in range(case.count)
        for v in (False, True)
    }
    return {
        "model": MODEL,
        "commands": {f"u_{n}": {"actuator": n} for n in names.actuators},
        "channels": {name: channels[name] for name in case.channels},
        "noise": noise,
        "start": "rest" if case.episodes[0].held else "free",
    }


def table_of(case: Unplanted, measured: Sequence[np.ndarray]) -> pd.DataFrame:
    """Return the recording: commands and measured channels, each (T, C)."""
    rows = []
    for episode, values in zip(case.episodes, measured, strict=True):
        row: dict[str, np.ndarray] = {"episode": np.full(len(values), episode.number, np.int32), "t": episode.t_s}
        row |= {f"u_{n}": c.astype(np.float32) for n, c in zip(case.names.actuators, episode.commands.T, strict=True)}
        row |= {n: c.astype(np.float32) for n, c in zip(case.channels, values.T, strict=True)}
        rows.append(pd.DataFrame(row))
    return pd.concat(rows, ignore_index=True)


def write_case(folder: Path, case: Unplanted, nominal: dict[str, Any], table: pd.DataFrame) -> None:
    """Write a case into its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / MODEL, mjcf(case.world, case.names))
    write_yaml(folder / "nominal.yaml", nominal)
    write_parquet(folder / "recording.parquet", table)
