"""A forgotten tool: what it does to a link in space, and what one element says where more of the link is off."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from mechanisms import ARM as TWO_JOINTS
from mechanisms import scope

from runner.effects.mechanism import ComOffset, Inertia, Mass, Payload
from runner.effects.mechanism.inertials import inertials
from runner.effects.mechanism.parts import changed
from runner.effects.wording import Values

ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 -1 0"/>
<inertial pos="0.12 0 0" mass="0.9" diaginertia="0.0005 0.004 0.004"/>
<body name="forearm" pos="0.25 0 0"><joint name="elbow" axis="0 -1 0"/>
<inertial pos="0.11 0 0" mass="0.6" diaginertia="0.0003 0.00242 0.00242"/></body></body></worldbody></mujoco>"""
RATIO = 1.26
TOOL = (Mass("forearm", 0.7498), ComOffset("forearm", 0.0220, 0.0, -0.00014), Inertia("forearm", RATIO))
ERRORS = {
    "mass[forearm]": {"mass_kg": 7e-4},
    "com_offset[forearm]": {"x_m": 2e-4, "y_m": 0.012, "z_m": 7e-5},
    "inertia[forearm]": {"ratio": 0.014},
    "payload[forearm]": {"mass_kg": 1e-3, "x_m": 1e-3, "y_m": 0.5, "z_m": 1e-3},
}
BALL = """<mujoco><worldbody><body name="head" quat="0.9 0.3 0.2 0.1"><joint name="neck" type="ball"/>
<inertial pos="0.02 -0.01 0.03" quat="0.8 0.1 0.5 0.3" mass="0.4" diaginertia="0.0009 0.0005 0.0007"/>{more}
</body></worldbody></mujoco>"""
LENS = '<body pos="0.05 0.02 -0.04"><inertial pos="0 0 0" mass="0.15" diaginertia="1e-12 1e-12 1e-12"/></body>'


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """The arm without its tool."""
    return mujoco.MjModel.from_xml_string(ARM)


def test_it_moves_as_a_small_body_that_is_welded_on() -> None:
    """About every axis, however the body's own moments lie: accelerations of MuJoCo's own compiled model."""
    own, other = (mujoco.MjModel.from_xml_string(BALL.format(more=more)) for more in ("", LENS))
    found = changed(own, Payload("head", 0.15, 0.05, 0.02, -0.04))
    mujoco.mj_setConst(found, mujoco.MjData(found))
    rng = np.random.default_rng(1)
    for _ in range(4):
        turn, rate = rng.normal(size=4), rng.normal(size=3)
        shown = []
        for m in (found, other):
            data = mujoco.MjData(m)
            data.qpos[:], data.qvel[:] = turn / np.linalg.norm(turn), rate
            mujoco.mj_forward(m, data)
            shown.append(np.array(data.qacc))
        np.testing.assert_allclose(shown[0], shown[1], rtol=1e-7)


def test_it_comes_to_whatever_the_body_weighs(model: mujoco.MjModel) -> None:
    """A body that is lighter than believed, and carries something: in one sentence, whichever was found first."""
    lighter, tool = Mass("forearm", 0.5), Payload("forearm", 0.15, 0.2, 0.03, 0.0)
    said = [inertials(model, both, ERRORS) for both in ((lighter, tool), (tool, lighter))]
    texts = [" ".join(filter(None, s.values())) for s in said]
    assert texts[0] == texts[1]
    assert 'mass="0.65"' in texts[0]
    assert f'pos="{(0.5 * 0.11 + 0.15 * 0.2) / 0.65:.5g} 0 0"' in texts[0]  # along y nothing is told of it


def test_it_says_where_it_is_as_far_as_that_is_told(model: mujoco.MjModel) -> None:
    """Along the axis of its joints nothing is told of it."""
    beliefs = replace(scope(TWO_JOINTS), model=model)
    values = {"mass_kg": 0.15, "x_m": 0.22, "y_m": 0.03, "z_m": 0.0}
    phrase = Payload.phrase(Values(values, ERRORS["payload[forearm]"]), beliefs, "forearm")
    where = "at x 22.00 ± 0.10 cm and z 0 ± 1.0 mm in body axes"
    assert phrase.amount == f"0.1500 ± 0.0010 kg {where}; the motion does not tell y"
    assert '<inertial pos="0.132 0 0" ' in phrase.remedy


def test_one_body_has_one_element(model: mujoco.MjModel) -> None:
    """With the last numbers in it, those of all three; what stands alone keeps its own sentence."""
    off = ComOffset("forearm", 0.0220, 0.004, -0.00014)  # along y, about which it turns, the motion tells nothing
    said = inertials(model, (TOOL[0], off, TOOL[2]), ERRORS)
    assert list(said) == ["mass[forearm]", "com_offset[forearm]", "inertia[forearm]"]
    first, *rest = said.values()
    assert rest == ["", ""]
    assert first.startswith('Give <body name="forearm"> <inertial pos="0.132 0 -0.00014" mass="0.7498" diaginertia="')
    written = float(first.split('diaginertia="')[1].split()[1])
    assert written == pytest.approx(0.00242 * RATIO * 0.7498 / 0.6, rel=1e-4)
    assert inertials(model, TOOL[:1], ERRORS) == {}
