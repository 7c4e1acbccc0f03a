"""What pushed once and stands in no log is dated, and nothing is where nobody pushed."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from runner.localise.dated import DatedDisturbance, dated_disturbances
from runner.noise.measured import measure
from tests.mechanism_cases import joint_channels, system_of, write_case
from tests.test_leap import JOINTS, STEP_S, written

NOISE = {f"q_{j}": 5e-4 for j in JOINTS} | {f"dq_{j}": 5e-3 for j in JOINTS}
Push = tuple[int, float, float, float]


def recorded(seed: int, friction: float, push: Push | None) -> dict[str, np.ndarray]:
    """Return 8 s of MuJoCo's own, with another step and integrator; a torque on one joint for some time."""
    random = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(written(10.0, 0.4))
    model.opt.timestep, model.opt.integrator = 5e-4, mujoco.mjtIntegrator.mjINT_RK4
    model.dof_frictionloss[:] = friction
    data = mujoco.MjData(model)
    t = np.arange(801) * STEP_S
    slow, fast = random.uniform(2, 5, 2)
    target = np.array([0.8 * np.sin(slow * t), 0.9 * np.sin(fast * t + 1)])
    q, dq = np.empty((2, len(t))), np.empty((2, len(t)))
    for k in range(len(t)):
        q[:, k], dq[:, k] = data.qpos, data.qvel
        data.ctrl[:] = target[:, k]
        for _ in range(round(STEP_S / model.opt.timestep)):
            joint, begin, end, torque = push or (0, 0.0, 0.0, 0.0)
            data.qfrc_applied[joint] = torque if begin <= data.time < end else 0.0
            mujoco.mj_step(model, data)
    q, dq = q + 5e-4 * random.standard_normal(q.shape), dq + 5e-3 * random.standard_normal(dq.shape)
    out = {"t": t}
    for i, joint in enumerate(JOINTS):
        out |= {f"u_{joint}": target[i], f"q_{joint}": q[i], f"dq_{joint}": dq[i]}
    return out


def found_in(folder: Path, friction: float, push: Push | None) -> tuple[DatedDisturbance, ...]:
    """Return what is found in four episodes, the third of which may be disturbed; friction is not in the model."""
    case = write_case(
        folder,
        written(10.0, 0.4),
        [recorded(k, friction, push if k == 2 else None) for k in range(4)],
        {"commands": {f"u_{j}": {"actuator": j} for j in JOINTS}, "channels": joint_channels(JOINTS), "noise": NOISE},
    )
    system = system_of(case)
    return dated_disturbances(system, system.simulator(threads=1), (), measure(system))


@pytest.mark.parametrize(
    ("friction", "push"),
    [(0.0, (1, 3.33, 4.12, 0.15)), (0.05, (0, 6.1, 6.4, -0.8))],
    ids=["a good model", "a model without friction"],
)
def test_a_push_is_dated(friction: float, push: Push, tmp_path: Path) -> None:
    """Episode, joint, beginning and end within 50 ms, size within 20 %."""
    joint, begin, end, torque = push
    (only,) = found_in(tmp_path, friction, push)
    assert only.episode == 2
    assert only.label == f"torque at '{JOINTS[joint]}' [N m]"
    assert only.force[0] == pytest.approx(torque, rel=0.2)
    assert only.from_s[0] == pytest.approx(begin, abs=0.05)
    assert only.until_s[0] == pytest.approx(end, abs=0.05)
    assert f"torque at '{JOINTS[joint]}'" in only.sentence


def test_friction_that_is_missing_is_no_push(tmp_path: Path) -> None:
    """It is missing everywhere, at every reversal."""
    assert found_in(tmp_path, 0.05, None) == ()
