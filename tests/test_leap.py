"""Several effects at once: what the linear model proposes, and what all of a kind share."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from runner.inference.evidence import directions, sensitivities
from runner.inference.leap import RIDGE, Linear, gain_of, leaps
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.noise.measured import measure
from runner.report import words
from runner.systems.mechanism import MechanismSystem
from tests.mechanism_cases import joint_channels, system_of, write_case

ARM = """<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 -9.81"/>
<default><joint type="hinge" axis="0 -1 0" damping="0.1"/><position kp="{kp}" kv="0.4"/></default>
<worldbody><body name="upper"><joint name="shoulder"/>
<inertial pos="0 0 -0.15" mass="0.6" diaginertia=".01 .01 .001"/>
<body name="forearm" pos="0 0 -0.3"><joint name="elbow"/>
<inertial pos="0 0 -0.1" mass="{mass}" diaginertia="{inertia} {inertia} .001"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder"/><position name="elbow" joint="elbow"/></actuator></mujoco>"""
STEP_S, JOINTS = 0.01, ("shoulder", "elbow")


def written(kp: float, mass: float) -> str:
    """Return the MJCF with servos and a forearm like that; its inertia grows with its mass."""
    return ARM.format(kp=kp, mass=mass, inertia=0.0125 * mass)


def recorded(kp: float, mass: float, seed: int) -> dict[str, np.ndarray]:
    """Return an episode of MuJoCo's own, with another step and integrator, and white noise."""
    random = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(written(kp, mass).replace("0.001", "0.0002", 1))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    t = np.arange(301) * STEP_S
    target = np.array(
        [a * np.sin(w * t + p) for a, w, p in zip((0.8, 0.9), random.uniform(2, 5, 2), (0, 1), strict=True)]
    )
    q, dq = np.empty((2, len(t))), np.empty((2, len(t)))
    for k in range(len(t)):
        q[:, k], dq[:, k] = data.qpos, data.qvel
        data.ctrl[:] = target[:, k]
        mujoco.mj_step(model, data, nstep=round(STEP_S / model.opt.timestep))
    q, dq = q + 5e-4 * random.standard_normal(q.shape), dq + 5e-3 * random.standard_normal(dq.shape)
    out = {"t": t}
    for i, joint in enumerate(JOINTS):
        out |= {f"u_{joint}": target[i], f"q_{joint}": q[i], f"dq_{joint}": dq[i]}
    return out


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    """Servos of 0.8 times the believed stiffness, both of them, and a forearm of 1.3 times the believed mass."""
    noise = {f"q_{j}": 5e-4 for j in JOINTS} | {f"dq_{j}": 5e-3 for j in JOINTS}
    folder = write_case(
        tmp_path_factory.mktemp("arm"),
        written(10.0, 0.4),
        [recorded(8.0, 0.52, seed) for seed in range(3)],
        {"commands": {f"u_{j}": {"actuator": j} for j in JOINTS}, "channels": joint_channels(JOINTS), "noise": noise},
    )
    return system_of(folder)


def test_a_gain_is_that_of_the_model_without_its_own_mismatch() -> None:
    """Against the same sum computed anew for each direction, of columns whose sizes differ a thousandfold."""
    random = np.random.default_rng(0)
    columns = random.normal(size=(500, 6)) * [1, 1e3, 30, 1e2, 5, 10]
    residual = columns @ [0, 0.1, 0, 0.02, 0, 0] + random.normal(size=500)
    spread = np.full(6, 1e-3)
    gram, right = columns.T @ columns, columns.T @ residual
    metric, gradient, _ = Linear(gram, right, spread).beside()
    for i in range(6):
        without = np.where(np.arange(6) == i, 0.0, spread)
        h, g, _ = Linear(gram, right, without).beside()
        assert gain_of(metric, gradient, np.array([i]), spread) == pytest.approx(
            g[i] ** 2 / (h[i, i] + RIDGE), rel=1e-6
        )


def test_two_causes_are_found_in_one_leap(arm: MechanismSystem) -> None:
    """Both at once, from the model without either, and what both servos share as one number."""
    fitter = Fitter(arm, arm.simulator(threads=1), measure(arm))
    episodes = range(3)
    nominal = fitter.fit(NONE, episodes, iterations=20)
    every = directions(arm)
    worth = 0.03 * fitter.measured.count(episodes)
    fit = leaps(fitter, nominal, every, sensitivities(fitter, nominal, every), worth)[-1]
    assert nominal.total > 100 * fitter.measured.count(episodes)
    assert fit.total < 1.1 * fitter.measured.count(episodes)
    assert fit.explanation.names == ("mass[forearm]", "servo_gain[*]")
    values = {e.full_name: e.report() for e in fit.explanation.make(fit.x, fitter.context)}
    assert values["servo_gain[shoulder]"] == values["servo_gain[elbow]"]
    assert values["servo_gain[elbow]"]["ratio"] == pytest.approx(0.8, abs=0.002)
    assert values["mass[forearm]"]["mass_kg"] == pytest.approx(0.52, abs=0.002)


def test_what_all_share_is_one_effect(arm: MechanismSystem) -> None:
    """It has a name, words, a place beside others, and as many effects as targets."""
    shared = arm.vocabulary.by_name["servo_gain[*]"][0]
    alone = arm.vocabulary.by_name["servo_gain[elbow]"][0]
    assert shared.targets == JOINTS
    assert shared.each[1] == alone
    assert [e.full_name for e in shared.make([0.1], arm.context)] == ["servo_gain[shoulder]", "servo_gain[elbow]"]
    assert not shared.may_join((alone,))
    assert not alone.may_join((shared,))
    assert alone.may_join((arm.vocabulary.by_name["servo_gain[shoulder]"][0],))
    assert shared.may_join((arm.vocabulary.by_name["mass[forearm]"][0],))
    assert Explanation((shared,)).names == ("servo_gain[*]",)
    phrase = words.phrase(arm, "servo_gain[*]", {"ratio": 0.8}, {"ratio": 0.01})
    assert phrase.what.endswith("and so it is with elbow")
    assert words.title(["servo_gain[*]"]) == "servo gain of all"
    # what is believed to differ from joint to joint has no one value
    assert "mass[*]" not in arm.vocabulary.by_name
