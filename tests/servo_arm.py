"""An arm of two position servos: its MJCF, and what MuJoCo with another step and integrator makes of it."""

from __future__ import annotations

import mujoco
import numpy as np

from tests.mechanism_cases import joint_channels

ARM = """<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 -9.81"/>
<default><joint type="hinge" axis="0 -1 0" damping="0.1"/><position kp="{kp}" kv="0.4"/></default>
<worldbody><body name="upper"><joint name="shoulder"/>
<inertial pos="0 0 -0.15" mass="0.6" diaginertia=".01 .01 .001"/>
<body name="forearm" pos="0 0 -0.3"><joint name="elbow"/>
<inertial pos="0 0 -0.1" mass="{mass}" diaginertia="{inertia} {inertia} .001"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder"/><position name="elbow" joint="elbow"/></actuator></mujoco>"""
STEP_S, JOINTS = 0.01, ("shoulder", "elbow")
NOISE = {f"q_{j}": 5e-4 for j in JOINTS} | {f"dq_{j}": 5e-3 for j in JOINTS}
NOMINAL = {"commands": {f"u_{j}": {"actuator": j} for j in JOINTS}, "channels": joint_channels(JOINTS), "noise": NOISE}
Push = tuple[int, float, float, float]  # joint, from and until in s, N m


def written(kp: float, mass: float) -> str:
    """Return the MJCF with servos and a forearm like that; its inertia grows with its mass."""
    return ARM.format(kp=kp, mass=mass, inertia=0.0125 * mass)


def recorded(
    model: str, seed: int, *, samples: int, step_s: float, friction: float = 0.0, push: Push | None = None
) -> dict[str, np.ndarray]:
    """Return an episode that starts hanging at rest, with white noise.

    Args:
        model: MJCF.
        seed: Of targets and noise.
        samples: So many.
        step_s: Of the physics.
        friction: Dry friction of both joints, N m.
        push: A torque that is not in the record.
    """
    random = np.random.default_rng(seed)
    world = mujoco.MjModel.from_xml_string(model)
    world.opt.timestep, world.opt.integrator = step_s, mujoco.mjtIntegrator.mjINT_RK4
    world.dof_frictionloss[:] = friction
    data = mujoco.MjData(world)
    t = np.arange(samples) * STEP_S
    slow, fast = random.uniform(2, 5, 2)
    target = np.array([0.8 * np.sin(slow * t), 0.9 * np.sin(fast * t + 1)])
    q, dq = np.empty((2, len(t))), np.empty((2, len(t)))
    joint, begin, end, torque = push or (0, 0.0, 0.0, 0.0)
    for k in range(len(t)):
        q[:, k], dq[:, k] = data.qpos, data.qvel
        data.ctrl[:] = target[:, k]
        for _ in range(round(STEP_S / step_s)):
            data.qfrc_applied[joint] = torque if begin <= data.time < end else 0.0
            mujoco.mj_step(world, data)
    q, dq = q + 5e-4 * random.standard_normal(q.shape), dq + 5e-3 * random.standard_normal(dq.shape)
    out = {"t": t}
    for i, name in enumerate(JOINTS):
        out |= {f"u_{name}": target[i], f"q_{name}": q[i], f"dq_{name}": dq[i]}
    return out
