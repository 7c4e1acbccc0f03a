"""The law of joints as a module for plain MuJoCo, against the compiled one and against its equation."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanism_cases import joint_channels, system_of, write_case
from mechanisms import SLIDER, SLIDER_DAMPING, SLIDER_DRY_N, coast, stopped

from runner.effects.base import Effects
from runner.effects.mechanism import (
    ActuatorDelay,
    AsymmetricFriction,
    Backlash,
    Disturbance,
    LoadFriction,
    Mass,
    Stribeck,
    TorqueOffset,
    TorqueRipple,
)
from runner.errors import ResultError
from runner.physics import joint_law
from runner.physics.joint_law import written_law
from runner.physics.joint_law.record import FIELDS, MAGIC
from runner.systems.mechanism import MechanismSystem, model_file

ARM = """<mujoco><option timestep="0.0005" integrator="implicitfast"/>
<default><joint axis="0 -1 0" solreffriction="0.001 1" solimpfriction="0.99 0.999 0.001 0.5 2"/></default>
<worldbody><body name="upper"><joint name="shoulder" damping="0.1" frictionloss="0.1" armature="0.02" user="7 8"/>
<inertial pos="0 0 -0.15" mass="1.5" diaginertia=".012 .012 .0003"/>
<body name="forearm" pos="0 0 -0.3"><joint name="elbow" damping="0.02" frictionloss="0.05" armature="0.004"/>
<inertial pos="0 0 -0.12" mass="0.8" diaginertia=".004 .004 .0001"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/>
<position name="elbow" joint="elbow" kp="4" kv="0.3" forcerange="-3 3"/></actuator></mujoco>"""
# two masses that have nothing to do with each other: islands that MuJoCo solves apart
PAIR = SLIDER.replace(
    "</worldbody>",
    '<body name="other"><joint name="beside" type="slide" axis="1 0 0" damping="2" frictionloss="3" armature="0.4"/>'
    '<inertial pos="0 0 0" mass="1.6" diaginertia=".01 .01 .01"/></body></worldbody>',
).replace("<actuator>", '<equality><joint joint1="slide" joint2="beside" active="false"/></equality><actuator>')
LAWS: Mapping[str, Effects] = {
    "stribeck": (Stribeck("elbow", 2.0, 3.0),),
    "stribeck of another exponent": (Stribeck("elbow", 2.0, 3.0, 0.5),),
    "load": (LoadFriction("shoulder", 0.2), Mass("forearm", 0.9)),
    "load without dry friction": (LoadFriction("shoulder", 0.2),),
    "load on a drive": (Backlash("shoulder", 0.02), LoadFriction("shoulder", 0.2)),
    "directions": (AsymmetricFriction("shoulder", 1.0, 1.6),),
    "offset": (TorqueOffset("shoulder", 0.31), ActuatorDelay("shoulder", 0.02)),
    "ripple": (TorqueRipple("elbow", 0.11, 3.0, 0.7),),
    "push": (Disturbance("elbow", 0.4, 0.1013, 0.2017),),
    "several": (
        Stribeck("shoulder", 0.8, 0.3, 1.0),
        LoadFriction("shoulder", 0.1),
        TorqueOffset("shoulder", 0.2),
        TorqueOffset("elbow", -0.1),
    ),
}
PLAIN = """
import sys
sys.path.insert(0, sys.argv[1])
import mujoco, model
import numpy as np
for folder in sys.argv[1:]:
    m = model.load(folder + "/model.xml")
    d = mujoco.MjData(m)
    d.qvel[:] = float(np.load(folder + "/speed.npy"))
    sent, out = np.load(folder + "/sent.npy"), []
    for command in sent:
        d.ctrl[:] = command
        mujoco.mj_step(m, d)
        out.append(np.concatenate([d.qpos, d.qvel, [d.nisland]]))
    np.save(folder + "/moved.npy", out)
print(sorted({n.partition(".")[0] for n in sys.modules} & {"runner", "numba", "scipy"}))
"""


def case(folder: Path, model: str, joints: tuple[str, ...]) -> MechanismSystem:
    """Return a system of a model that was never moved."""
    t = np.arange(5) * 0.01
    columns = {"t": t} | {f"{d}q_{j}": 0.0 * t for j in joints for d in ("", "d")}
    nominal = {"commands": {}, "channels": joint_channels(joints), "start": "rest"}
    return system_of(write_case(folder, model, [columns], nominal))


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    return case(tmp_path_factory.mktemp("arm"), ARM, ("shoulder", "elbow"))


def plainly(*folders: Path) -> list[np.ndarray]:
    """Return how what was written moves in another process, of MuJoCo and NumPy: q, v and the number of islands."""
    run = subprocess.run(
        [sys.executable, "-c", PLAIN, *map(str, folders)], capture_output=True, text=True, check=False, cwd=folders[0]
    )
    assert (run.stderr, run.stdout) == ("", "[]\n")
    return [np.load(folder / "moved.npy") for folder in folders]


def test_each_law_moves_as_the_compiled_one(arm: MechanismSystem, tmp_path: Path) -> None:
    """Of drives, islands and commands that come late, too: to the digits that are written."""
    k = np.arange(700)
    sent = np.column_stack([1.2 * np.sin(k / 80), 0.9 * np.sin(k / 50 + 1)])
    before = mujoco.get_mjcb_passive()
    for name, effects in LAWS.items():
        (folder := tmp_path / name).mkdir()
        assert arm.write_model(effects, folder) == ("model.xml", "model.py")
        np.save(folder / "sent.npy", sent)
        np.save(folder / "speed.npy", 0.3)
    assert mujoco.get_mjcb_passive() is before
    for (name, effects), moved in zip(LAWS.items(), plainly(*(tmp_path / n for n in LAWS)), strict=True):
        model = arm._models.edited(effects)
        data, shown, without = mujoco.MjData(model), [], []
        bare = mujoco.MjModel.from_xml_path(str(tmp_path / name / "model.xml"))
        plain = mujoco.MjData(bare)  # the compiled law must leave what was written alone
        data.qvel[:] = plain.qvel[:] = 0.3
        late = 40 if name == "offset" else 0  # steps
        for i in k:
            plain.ctrl[:] = sent[i]
            data.ctrl[:] = sent[i - late, 0] if i >= late else 0.0, sent[i, 1]
            mujoco.mj_step(model, data)
            mujoco.mj_step(bare, plain)
            shown.append(np.concatenate([data.qpos, data.qvel]))
            without.append(np.concatenate([plain.qpos, plain.qvel]))
        size = np.abs(shown).max(axis=0)
        assert np.abs((moved[:, :-1] - shown) / size).max() < 1e-6, name
        assert np.abs((moved[:, :-1] - without) / size).max() > 1e-2, name


def test_written_friction_coasts_like_its_equation(tmp_path: Path) -> None:
    """Two masses under Stribeck's friction, in islands of their own, rest when and where theirs do."""
    system = case(tmp_path / "case", PAIR, ("slide", "beside"))
    (folder := tmp_path / "out").mkdir()
    system.write_model((Stribeck("slide", 0.7, 0.15), Stribeck("beside", 0.7, 0.15)), folder)
    np.save(folder / "sent.npy", np.zeros((4000, 1)))
    np.save(folder / "speed.npy", 0.8)
    (moved,) = plainly(folder)
    assert moved[0, -1] == 2
    expected = coast(0.8, lambda v: SLIDER_DRY_N * (1 + 0.7 * math.exp(-((v / 0.15) ** 2))) + SLIDER_DAMPING * v)
    for q, v in (moved[:, [0]], moved[:, [2]]), (moved[:, [1]], moved[:, [3]]):
        np.testing.assert_allclose(stopped(2e-4 * np.arange(1, 4001), q, v), expected, rtol=3e-3)


def test_what_is_written(arm: MechanismSystem, tmp_path: Path) -> None:
    """The XML says what to do; the numbers come after the owner's, and the module is the package's own text."""
    (tmp_path / "model.py").write_text("raise SystemExit")
    effects = TorqueOffset("elbow", 0.25), Mass("forearm", 0.9)
    arm.write_model(effects, tmp_path)
    assert [("with model.py" in arm.model_use(e)) for e in (effects, effects[1:])] == [True, False]
    first = (tmp_path / "model.xml").read_text().splitlines()[0]
    assert "Only with model.py, beside this file: torque_offset[elbow]." in first
    assert 'import model; m = model.load("model.xml")' in first
    assert (tmp_path / "model.py").read_text() == Path(written_law.__file__).read_text()
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    assert list(model.jnt_user[0, :4]) == [7.0, 8.0, 0.0, 0.0]
    assert list(model.jnt_user[1, :4]) == [0.0, 0.0, written_law.TAG, 0.25]


def test_a_written_model_may_be_put_into_another(arm: MechanismSystem, tmp_path: Path) -> None:
    """Beside joints with more numbers of their owner's, and after other degrees of freedom."""
    arm.write_model((Backlash("shoulder", 0.02), LoadFriction("shoulder", 0.2)), tmp_path)
    scene = mujoco.MjSpec.from_string(
        """<mujoco><compiler conflict="merge"/><size nuser_jnt="40"/>
        <worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>"""
    )
    scene.attach(mujoco.MjSpec.from_file(str(tmp_path / "model.xml")), prefix="arm_", frame=scene.worldbody.add_frame())
    with pytest.warns(UserWarning, match="nuser_jnt: parent has 40"):
        model = scene.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = 2.0
    mujoco.mj_forward(model, data)
    written_law.passive(model, data)
    dof = int(model.joint("arm_shoulder").dofadr[0])
    row = int(np.flatnonzero(data.efc_id[: data.nf] == dof)[0])
    added = data.efc_frictionloss[row] - model.dof_frictionloss[dof]
    assert added == pytest.approx(0.2 * 0.5 * 2.0, rel=1e-5)  # it hangs: the load is what the drive exerts


def test_numbers_have_one_order() -> None:
    """The module, which imports nothing of this package, names what the compiled law names."""
    assert (*FIELDS[:1], *written_law.FIELDS) == FIELDS
    assert float(f"{written_law.TAG:.6g}") == written_law.TAG != MAGIC


def test_a_callback_in_use_is_not_taken_away() -> None:
    """Not this package's compiled one either."""
    joint_law.install()
    before = mujoco.get_mjcb_passive()
    for call in written_law.install, lambda: written_law.load("any.xml"):
        with pytest.raises(RuntimeError, match="in use"):
            call()
        assert mujoco.get_mjcb_passive() is before


def test_a_written_law_that_acts_otherwise_is_refused(
    arm: MechanismSystem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_file.written_law, "passive", lambda model, data: None)
    with pytest.raises(ResultError, match="joint 'shoulder' does not move as it does in the simulation"):
        arm.write_model((TorqueOffset("shoulder", 0.3),), tmp_path)
