"""Positions of a free body in a log, by their names."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from runner.importing.guess.poses import guess_frame, guess_poses
from runner.importing.signals import Part, Signal

MODEL = """<mujoco><worldbody><body name="block"><freejoint/><geom size=".05"/></body></worldbody></mujoco>"""


def part(*names: str) -> Part:
    """A part of a log with such signals, ten samples each."""
    return Part("log", {name: Signal(name, "log", np.linspace(0.1, 0.2, 10)) for name in names})


@pytest.mark.parametrize(
    ("names", "unit"),
    [
        (("pos_x_mm", "pos_y_mm", "pos_z_mm"), "mm"),
        (("position.x [cm]", "position.y [cm]", "position.z [cm]"), "cm"),
        (("position_x_m", "position_y_m", "position_z_m"), "m"),
    ],
)
def test_the_unit_behind_the_axis_is_understood(names: tuple[str, ...], unit: str) -> None:
    """Behind the axis, in brackets or not."""
    (pose,) = guess_poses(part(*names), mujoco.MjModel.from_xml_string(MODEL))
    assert list(pose.signals.values()) == list(names)
    assert {c["unit"] for c in pose.channels("z").values()} == {unit}


def test_without_a_unit_it_is_assumed_and_said() -> None:
    """Metres."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    log = part("pos_x", "pos_y", "pos_z")
    (pose,), _ = guess_frame(log, guess_poses(log, model), model, None)
    assert {c["unit"] for c in pose.channels("z").values()} == {"m"}
    assert "assumed" in pose.why


@pytest.mark.parametrize("names", [("q1", "q2", "q3", "q4"), ("o[0]", "o[1]", "o[2]", "o[3]")])
def test_four_numbers_of_unit_length_are_a_quaternion(names: tuple[str, ...]) -> None:
    """Whatever they are called; which of them is the scalar the first sample tells, or its owner has to."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    turns = np.random.default_rng(0).standard_normal((10, 4))
    turns[0] = [0.05, 0.1, 0.0, 5.0]
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    for k, order in ((0, "xyzw"), (1, "TODO")):
        log = Part("log", {n: Signal(n, "log", turns[k:, i]) for i, n in enumerate(names)})
        (pose,) = guess_poses(log, model)
        assert (pose.order, list(pose.signals.values())) == (order, list(names))
    longer = Part("log", {n: Signal(n, "log", 1.1 * turns[:, i]) for i, n in enumerate(names)})
    assert not guess_poses(longer, model)
