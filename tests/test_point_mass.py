"""What a forgotten tool does to mass, centre of mass and inertia of a link: told as that, and as one element."""

from __future__ import annotations

import mujoco
import pytest

from runner.effects.mechanism import ComOffset, Inertia, Mass
from runner.effects.mechanism.point_mass import inertials, point_masses

# a link of 0.6 kg, and 0.15 kg that were put 0.11 m further out
ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 -1 0"/>
<inertial pos="0.12 0 0" mass="0.9" diaginertia="0.0005 0.004 0.004"/>
<body name="forearm" pos="0.25 0 0"><joint name="elbow" axis="0 -1 0"/>
<inertial pos="0.11 0 0" mass="0.6" diaginertia="0.0003 0.00242 0.00242"/></body></body></worldbody></mujoco>"""
AWAY = 0.6 * 0.022**2 + 0.15 * 0.088**2
RATIO = (0.00242 + AWAY) / (1.25 * 0.00242)
TOOL = (Mass("forearm", 0.7498), ComOffset("forearm", 0.0220, 0.0, -0.00014), Inertia("forearm", RATIO + 0.005))
ERRORS = {
    "mass[forearm]": {"mass_kg": 7e-4},
    "com_offset[forearm]": {"x_m": 2e-4, "y_m": 0.012, "z_m": 7e-5},
    "inertia[forearm]": {"ratio": 0.014},
}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """The arm without its tool."""
    return mujoco.MjModel.from_xml_string(ARM)


def test_a_tool_is_told_with_its_mass_and_its_place(model: mujoco.MjModel) -> None:
    """Along the axis of its joints nothing is told of it."""
    (said,) = point_masses(model, TOOL, ERRORS)
    assert "of 'forearm' differ together as a point mass of about 0.15 kg at about x 22.0 cm and z " in said
    assert "y " not in said.partition(" at ")[2].partition(" in its axes")[0]


@pytest.mark.parametrize(
    "other",
    [Inertia("forearm", RATIO + 0.1), Mass("forearm", 0.5), ComOffset("forearm", 0.0, 0.0, 0.0), None],
    ids=["turns harder", "lighter", "where it was", "not told"],
)
def test_what_is_no_point_mass_is_not_called_one(model: mujoco.MjModel, other: Mass | None) -> None:
    """One number that does not agree with the others, or is not there, is enough."""
    own = [e for e in TOOL if type(e) is not type(other)] + ([] if other is None else [other])
    assert not point_masses(model, own if other is not None else TOOL[:2], ERRORS)


def test_without_errors_nothing_is_told(model: mujoco.MjModel) -> None:
    """How well numbers agree hangs on how well they are known."""
    assert point_masses(model, TOOL, {}) == []


def test_one_body_has_one_element(model: mujoco.MjModel) -> None:
    """With the last numbers in it, those of all three; what stands alone keeps its own sentence."""
    off = ComOffset("forearm", 0.0220, 0.004, -0.00014)  # along y, about which it turns, the motion tells nothing
    said = inertials(model, (TOOL[0], off, TOOL[2]), ERRORS)
    assert list(said) == ["mass[forearm]", "com_offset[forearm]", "inertia[forearm]"]
    first, *rest = said.values()
    assert rest == ["", ""]
    assert first.startswith('Give <body name="forearm"> <inertial pos="0.132 0 -0.00014" mass="0.7498" diaginertia="')
    written = float(first.split('diaginertia="')[1].split()[1])
    assert written == pytest.approx(0.00242 * (RATIO + 0.005) * 0.7498 / 0.6, rel=1e-4)
    assert inertials(model, TOOL[:1], ERRORS) == {}
