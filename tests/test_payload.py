"""A forgotten tool: what it does to a link in space, and what one element says where more of the link is off."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from mechanisms import ARM as TWO_JOINTS
from mechanisms import scope

from runner.diagnosis.ranking import values_of
from runner.effects.mechanism import ComOffset, Inertia, Mass, Payload, parts
from runner.effects.mechanism.inertials import as_told, inertials
from runner.effects.mechanism.parts import changed
from runner.effects.vocabulary import Vocabulary
from runner.effects.wording import Values
from runner.inference.doubts import errors_off
from runner.inference.least_squares import Fitter
from runner.inference.search import search
from runner.noise.measured import measure
from runner.systems.mechanism import MechanismSystem
from tests.mechanism_cases import PENDULUM, followed, joint_channels, system_of, write_case

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


def test_a_model_holds_no_place_that_was_not_told(model: mujoco.MjModel) -> None:
    """Where nothing turns about an axis along which it is off, a fit leaves it where it began: 6 cm to the side."""
    fitted = (
        Payload("forearm", 0.25, 0.002, 0.06, -0.26),
        ComOffset("forearm", 0.022, 0.01, 0.0),
        Mass("forearm", 0.7),
    )
    held = as_told(model, fitted, ERRORS)
    assert held == (Payload("forearm", 0.25, 0.002, 0.0, -0.26), ComOffset("forearm", 0.022, 0.0, 0.0), fitted[2])


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


CARRIED = Payload("lever", 0.3, 0.06, 0.0, -0.52)


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    """A lever that MuJoCo swung in steps of a tenth of a millisecond, with a load on it that its model lacks."""
    xml = PENDULUM.format(damping=0.05)
    spec = mujoco.MjSpec.from_string(xml)
    spec.body("lever").add_body(
        pos=[CARRIED.x_m, CARRIED.y_m, CARRIED.z_m],
        mass=CARRIED.mass_kg,
        ipos=[0.0] * 3,
        inertia=[1e-9] * 3,
        explicitinertial=True,
    )
    spec.option.timestep = 1e-4
    swinging, t, columns = spec.compile(), 0.01 * np.arange(301), []
    for seed, (amplitude, hz) in enumerate(((1.5, 0.6), (2.5, 0.9))):
        u = amplitude * np.sin(2 * np.pi * hz * t)
        q = followed(swinging, u)
        columns.append({"t": t, "u": u, "q_hinge": q + 1e-3 * np.random.default_rng(seed).normal(size=len(t))})
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"], velocities=False),
        "noise": {"q_hinge": 1e-3},
        "start": "rest",
    }
    return system_of(write_case(tmp_path_factory.mktemp("carried"), xml, columns, nominal))


def test_a_load_along_the_link_is_found(system: MechanismSystem) -> None:
    """As one effect, among mass, centre and inertia, and by far more than its errors."""
    own = {"mass", "com_offset", "inertia", "payload", "joint_damping", "armature"}
    known = MechanismSystem(system.recording)
    known.vocabulary = Vocabulary(tuple(c for c in known.vocabulary if c.effect.name in own))
    fitter = Fitter(known, known.simulator(threads=1), measure(known))
    found = search(fitter, (0, 1), most=3)
    best = found.best
    assert best.fit.explanation.names == ("payload[lever]",)
    values, errors = (by["payload[lever]"] for by in values_of(best, fitter.context))
    for name in ("mass_kg", "x_m", "z_m"):
        assert values[name] == pytest.approx(getattr(CARRIED, name), abs=4 * errors[name])
    assert errors["mass_kg"] < 0.02 * CARRIED.mass_kg
    assert "does not tell y" in Payload.phrase(Values(values, errors), fitter.system.beliefs, "lever").amount
    ((candidate, part),) = best.fit.explanation.parts(fitter.context)
    assert errors_off(best, candidate, part, fitter.context, found.contenders) > 10.0


def test_it_is_written_into_a_model_that_moves_as_it_does(system: MechanismSystem, tmp_path: Path) -> None:
    """Mass, centre and moments about every axis, as MuJoCo reads them; what was written is compared on the way."""
    effect = replace(CARRIED, y_m=0.04)
    assert system.write_model((effect,), tmp_path) == ("model.xml",)
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    wanted = changed(system.context.model, effect)
    body = written.body("lever").id
    for name in ("body_mass", "body_ipos", "body_inertia"):
        found = getattr(written, name)[body]
        np.testing.assert_allclose(found, getattr(wanted, name)[wanted.body("lever").id], rtol=1e-4, atol=1e-6)


def test_a_tool_far_from_a_small_link_is_written_where_it_is(model: mujoco.MjModel) -> None:
    """It is told to a tenth, though to no better than the size of the link."""
    beliefs, far = replace(scope(TWO_JOINTS), model=model), parts.body_size_m(model, "forearm") * 8
    values = {"mass_kg": 0.05, "x_m": 0.11 + far, "y_m": 0.0, "z_m": 0.0}
    errors = {"mass_kg": 0.01, "x_m": 0.15 * far, "y_m": 10.0, "z_m": 0.01}
    phrase = Payload.phrase(Values(values, errors), beliefs, "forearm")
    assert "does not tell y" in phrase.amount
    assert f'pos="{0.11 + 0.05 * far / 0.65:.5g} 0 0"' in phrase.remedy
