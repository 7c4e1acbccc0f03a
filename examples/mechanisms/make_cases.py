"""Make cases of published measurements of real mechanisms, ready for `runner gap` and `runner diagnose`.

    python examples/mechanisms/make_cases.py FOLDER OUT [--belief KIND=FACTOR ...]

FOLDER holds `emps`, `dfki_double_pendulum`, `dfki_pendulum`, `xl330` and `so101`, each with one Parquet file (a row per
sample: episode, t and the columns named below) and `episodes.csv`; those that are not there are left out. OUT gets a
folder for each case, with its table, an MJCF of what the publishers say of the mechanism, and `nominal.yaml`.

A belief makes the MJCF wrong on purpose, to see whether a diagnosis says so: `--belief mass=0.7` puts 0.7 times the
published mass into it; `lever` and `gain` are the others. What is believed is written into the name of the case.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

HEAD = '<mujoco><option gravity="{gravity}" timestep="{step}" integrator="implicitfast"/><worldbody>'


@dataclass(frozen=True)
class Belief:
    """Factors on what the publishers say: of masses, lengths of levers, and gains of servos and motors."""

    mass: float = 1.0
    lever: float = 1.0
    gain: float = 1.0


@dataclass(frozen=True)
class Made:
    """A case: its table, its MJCF, which column drives which actuator, and which measures what of which joint."""

    table: pd.DataFrame
    model: str
    commands: dict[str, str]
    channels: dict[str, tuple[str, str]]


def emps(folder: Path, belief: Belief) -> dict[str, Made]:
    """A slide on a ball screw, driven by the recorded force (Janot, Gautier & Brunot): mass, friction as published."""
    rows = _rows(folder)
    model = HEAD.format(gravity="0 0 0", step=0.001) + (
        '<body name="carriage"><joint name="slide" type="slide" axis="1 0 0" damping="203.5" frictionloss="20.39"/>'
        f'<geom type="box" size="0.1 0.1 0.05" mass="{95.11 * belief.mass}"/></body></worldbody>'
        f'<actuator><motor name="drive" joint="slide" gear="{belief.gain}"/></actuator></mujoco>'
    )
    table = rows.assign(episode=0).loc[:, ["episode", "t", "q_slide", "u_slide"]]
    return {"emps": Made(table, model, {"u_slide": "drive"}, {"q_slide": ("slide", "position")})}


def pendulum(folder: Path, belief: Belief) -> dict[str, Made]:
    """A rod with a mass at its end, driven by the torque that the motor reports, where that explains the motion."""
    rows, episodes = _rows(folder), pd.read_csv(folder / "episodes.csv")
    fit = episodes.loc[episodes["torque_explains_motion"].astype(bool), "episode"]
    model = HEAD.format(gravity="0 0 -9.81", step=0.002) + (
        '<body name="rod"><joint name="joint" axis="0 -1 0" armature="0.0021857"/>'
        f'<inertial pos="0 0 {-0.45 * belief.lever}" mass="{0.676 * belief.mass}" diaginertia="0.0105 0.0105 0.0001"/>'
        f'</body></worldbody><actuator><motor name="motor" joint="joint" gear="{belief.gain}"/></actuator></mujoco>'
    )
    table = rows.loc[rows["episode"].isin(fit), ["episode", "t", "q_joint", "dq_joint", "tau_joint"]]
    return {"pendulum": Made(table, model, {"tau_joint": "motor"}, _states(["joint"]))}


def double_pendulum(folder: Path, belief: Belief) -> dict[str, Made]:
    """Two links with a motor in each joint, driven by the reported torques; nothing is believed of friction."""
    rows, episodes = _rows(folder), pd.read_csv(folder / "episodes.csv")
    m1, m2, l1, r1, r2, i1, i2, rotor = 0.52346, 0.62557, 0.2, 0.2, 0.25569, 0.031887, 0.050870, 6.287e-5 * 36
    upper, lower = max(i1 - m1 * r1**2, 1e-5), i2 - m2 * r2**2

    def link(mass: float, at: float, inertia: float) -> str:
        return f'<inertial pos="0 0 {-at}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia / 2}"/>'

    joint = f'axis="0 -1 0" armature="{rotor}" damping="0.001"'
    model = HEAD.format(gravity="0 0 -9.81", step=0.002) + (
        f'<body name="upper"><joint name="shoulder" {joint}/>{link(m1, r1, upper)}'
        f'<body name="lower" pos="0 0 {-l1}"><joint name="elbow" {joint}/>'
        f"{link(m2 * belief.mass, r2 * belief.lever, lower)}</body></body></worldbody><actuator>"
        f'<motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow" gear="{belief.gain}"/>'
        "</actuator></mujoco>"
    )
    names = ["shoulder", "elbow"]
    of_design = episodes["design"] == "C.1"
    out = {}
    for case, chosen in (("sys_id", episodes["kind"] == "sys_id"), ("swing_up", episodes["kind"] != "sys_id")):
        some = episodes.loc[chosen & of_design, "episode"]
        columns = ["episode", "t", *_states(names), *(f"tau_{j}" for j in names)]
        table = rows.loc[rows["episode"].isin(some), columns]
        out[f"double_pendulum_{case}"] = Made(table, model, {f"tau_{j}": j for j in names}, _states(names))
    return out


def xl330(folder: Path, belief: Belief) -> dict[str, Made]:
    """A hobby servo that lifts a weight: by the voltage on its bridge, and as a servo, a case for each of its gains."""
    rows, episodes = _rows(folder), pd.read_csv(folder / "episodes.csv")
    torque_constant, resistance, supply = 0.354 * belief.gain, 3.4, 7.4
    stall = torque_constant * supply / resistance
    rows = rows.loc[rows["torque_on"] == 1].assign(bridge_volts=lambda r: r["duty_horn"] * r["volts"])

    def model(actuator: str) -> str:
        return HEAD.format(gravity="0 0 -9.80665", step=0.001) + (
            f'<body name="arm"><joint name="horn" axis="0 -1 0" armature="0.0001" '
            f'damping="{torque_constant**2 / resistance}"/>'
            f'<geom name="load" type="sphere" pos="0 0 {-0.1 * belief.lever}" size="0.02" mass="{0.49 * belief.mass}"/>'
            f"</body></worldbody><actuator>{actuator}</actuator></mujoco>"
        )

    columns = ["episode", "t", *_states(["horn"])]
    motor = f'<general name="motor" joint="horn" gainprm="{torque_constant / resistance}"/>'
    out = {
        "xl330_volts": Made(
            rows.dropna(subset=["bridge_volts"]).loc[:, [*columns, "bridge_volts"]],
            model(motor),
            {"bridge_volts": "motor"},
            _states(["horn"]),
        )
    }
    for gain, some in episodes.groupby("kp")["episode"]:
        stiffness = stall * float(str(gain)) * 4096 / (2 * np.pi) / (256 * 885)
        servo = f'<position name="servo" joint="horn" kp="{stiffness}" forcerange="{-stall} {stall}"/>'
        table = rows.loc[rows["episode"].isin(some), [*columns, "u_horn"]]
        out[f"xl330_kp{gain}"] = Made(table, model(servo), {"u_horn": "servo"}, _states(["horn"]))
    return out


def so101(folder: Path, belief: Belief) -> dict[str, Made]:
    """A six-joint arm of hobby servos: the first 20 s of ten motions, with the softer of the published servo gains."""
    rows = _rows(folder)
    names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    stiff = 'kp="998.22" kv="2.731" forcerange="-2.94 2.94"'
    soft = f'kp="{17.8 * belief.gain}" kv="0" forcerange="-3.35 3.35"'
    model = (folder / "model" / "so101_inertials.xml").read_text().replace(stiff, soft)
    low, high = -0.17453297762778586, 1.7453291995659765  # range of the gripper, which is recorded as 0 to 1
    opened = {c: low + rows[c] * (high - low) for c in ("q_gripper", "u_gripper")}
    some = sorted(rows["episode"].unique())[:10]
    chosen = rows["episode"].isin(some) & (rows["t"] < 20.0)
    columns = ["episode", "t", *(f"{a}_{j}" for j in names for a in "qu")]
    channels = {f"q_{j}": (j, "position") for j in names}
    return {"so101": Made(rows.assign(**opened).loc[chosen, columns], model, {f"u_{j}": j for j in names}, channels)}


KINDS: dict[str, Callable[[Path, Belief], dict[str, Made]]] = {
    "emps": emps,
    "dfki_pendulum": pendulum,
    "dfki_double_pendulum": double_pendulum,
    "xl330": xl330,
    "so101": so101,
}


def _rows(folder: Path) -> pd.DataFrame:
    """Return the table of the one Parquet file of a folder, whatever part of the measurements it is."""
    files = sorted(folder.glob("*.parquet"))
    if len(files) != 1:
        raise SystemExit(f"{folder}: must hold one Parquet file, holds {len(files)}.")
    return pd.read_parquet(files[0])


def _states(joints: Iterable[str]) -> dict[str, tuple[str, str]]:
    """Return the channels of joints whose positions and velocities are measured."""
    return {f"{a}_{j}": (j, quantity) for j in joints for a, quantity in (("q", "position"), ("dq", "velocity"))}


def write(made: Made, folder: Path) -> None:
    """Write a case."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.xml").write_text(made.model)
    nominal = {
        "model": "model.xml",
        "commands": {column: {"actuator": actuator} for column, actuator in made.commands.items()},
        "channels": {c: {"joint": joint, "quantity": quantity} for c, (joint, quantity) in made.channels.items()},
    }
    (folder / "nominal.yaml").write_text(yaml.safe_dump(nominal, sort_keys=False))
    made.table.to_parquet(folder / "recording.parquet", index=False)


def main() -> None:
    """Make all cases whose measurements are there."""
    parser = argparse.ArgumentParser(description="Make cases of published measurements of real mechanisms.")
    parser.add_argument("folder", type=Path, help="holds emps, xl330, ...")
    parser.add_argument("out", type=Path)
    parser.add_argument("--belief", action="append", default=[], metavar="KIND=FACTOR", help="mass, lever or gain")
    given = parser.parse_args()
    wrong = {kind: float(factor) for kind, _, factor in (b.partition("=") for b in given.belief)}
    belief, ending = Belief(**wrong), "".join(f"_{kind}_{factor:g}" for kind, factor in wrong.items())
    for kind, make in KINDS.items():
        if not (given.folder / kind).is_dir():
            continue
        for name, made in make(given.folder / kind, belief).items():
            write(made, given.out / f"{name}{ending}")
            print(f"{name}{ending}: {made.table['episode'].nunique()} episodes, {len(made.table)} rows")


if __name__ == "__main__":
    main()
