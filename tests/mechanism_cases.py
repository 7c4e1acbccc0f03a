"""Cases in model form for tests: small mechanisms, and what they should have done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import yaml

from runner.recording.model_form import read_model_case
from runner.systems.mechanism import MechanismSystem

HARD = 'solreffriction="0.001 1" solimpfriction="0.995 0.999 0.001 0.5 2"'
SLIDE = """
<mujoco>
  <option timestep="0.0005" integrator="implicitfast" gravity="0 0 -9.81"/>
  <worldbody><body name="carriage">
    <joint name="slide" type="slide" axis="1 0 0" damping="{damping}" frictionloss="{friction}" HARD/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="1 1 1"/>
  </body></worldbody>
  <actuator>{actuator}</actuator>
</mujoco>""".replace("HARD", HARD)
MOTOR = '<motor name="drive" joint="slide"/>'
PENDULUM = """
<mujoco>
  <option timestep="0.0005" integrator="implicitfast" gravity="0 0 -9.81"/>
  <worldbody><body name="lever">
    <joint name="hinge" type="hinge" axis="0 -1 0" damping="{damping}" frictionloss="0"/>
    <inertial pos="0 0 -0.4" mass="1.5" diaginertia="0.01 0.01 0.01"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.4" size=".01" mass="0" contype="0" conaffinity="0"/>
  </body></worldbody>
  <actuator><motor name="drive" joint="hinge"/></actuator>
</mujoco>"""
ARM = """
<mujoco>
  <option timestep="0.0005" integrator="implicitfast" gravity="0 0 -9.81"/>
  <worldbody><body name="upper">
    <joint name="shoulder" type="hinge" axis="0 -1 0" damping="0.05"/>
    <inertial pos="0 0 -0.15" mass="1.2" diaginertia="0.02 0.02 0.001"/>
    <body name="forearm" pos="0 0 -0.3">
      <joint name="elbow" type="hinge" axis="0 -1 0" damping="0.02"/>
      <inertial pos="0 0 -0.1" mass="0.7" diaginertia="0.01 0.01 0.001"/>
    </body>
  </body></worldbody>
  <actuator>
    <motor name="shoulder" joint="shoulder"/>
    <position name="elbow" joint="elbow" kp="6" kv="0.4" forcerange="-1.5 1.5"/>
  </actuator>
</mujoco>"""
BODY = """
<mujoco>
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <worldbody><body name="object"><freejoint name="free"/>
    <inertial pos="0 0 0" mass="2" diaginertia="0.02 0.03 0.04"/>
    <geom type="box" size=".1 .1 .1" mass="0" contype="0" conaffinity="0"/>
    <site name="imu"/>
  </body></worldbody>
  <sensor><gyro name="gyro" site="imu"/></sensor>
</mujoco>"""


def joint_channels(joints: Sequence[str], *, velocities: bool = True) -> dict[str, dict[str, object]]:
    """Return channels `q_JOINT` and `dq_JOINT`."""
    out: dict[str, dict[str, object]] = {f"q_{j}": {"joint": j, "quantity": "position"} for j in joints}
    if velocities:
        out |= {f"dq_{j}": {"joint": j, "quantity": "velocity"} for j in joints}
    return out


def write_case(
    folder: Path,
    model: str,
    columns: Sequence[Mapping[str, np.ndarray]],
    nominal: Mapping[str, object],
    *,
    csv: bool = False,
) -> Path:
    """Write a case: its MJCF, `nominal.yaml`, and one table of episodes; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.xml").write_text(model)
    (folder / "nominal.yaml").write_text(yaml.safe_dump({"model": "model.xml", **nominal}, sort_keys=False))
    table = pd.concat([pd.DataFrame({"episode": i, **c}) for i, c in enumerate(columns)], ignore_index=True)
    if csv:
        table.to_csv(folder / "recording.csv", index=False)
    else:
        table.to_parquet(folder / "recording.parquet", index=False)
    return folder


def followed(model: mujoco.MjModel, u: np.ndarray, step_s: float = 0.01) -> np.ndarray:
    """Return the angle of a joint that plain MuJoCo moves by one actuator, whose commands last so long, (T,)."""
    data, q = mujoco.MjData(model), np.zeros(len(u))
    for k in range(len(u)):
        data.ctrl[0], q[k] = u[k], data.qpos[0]
        mujoco.mj_step(model, data, nstep=round(step_s / model.opt.timestep))
    return q


def system_of(folder: Path) -> MechanismSystem:
    """Return the system of a case with its episodes as they are, be there but one."""
    return MechanismSystem(read_model_case(folder))


def slide_case(
    folder: Path,
    *,
    friction: float = 0.0,
    damping: float = 0.0,
    mass: float = 2.0,
    actuator: str = MOTOR,
    command: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    motion: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
    length_s: float = 2.0,
    step_s: float = 0.005,
    start: str = "free",
    noise: Mapping[str, float] | None = None,
    t_s: np.ndarray | None = None,
) -> Path:
    """Write a case of a carriage on an axis; without a motion it stands still."""
    t = np.arange(round(length_s / step_s) + 1) * step_s if t_s is None else t_s
    q, dq = (np.zeros_like(t), np.zeros_like(t)) if motion is None else motion(t)
    return write_case(
        folder,
        SLIDE.format(friction=friction, damping=damping, mass=mass, actuator=actuator),
        [{"t": t, "u": command(t), "q_slide": q, "dq_slide": dq}],
        {
            "commands": {"u": {"actuator": "drive"}},
            "channels": joint_channels(["slide"]),
            "noise": dict(noise or {"q_slide": 1e-3, "dq_slide": 1e-2}),
            "start": start,
        },
    )
