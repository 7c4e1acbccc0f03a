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
