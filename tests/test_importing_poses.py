"""Positions of a free body in a log, by their names."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from runner.importing.guess.fall import falls_otherwise
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


def flight(*names: str, order: str = "wxyz") -> Part:
    """A log of a toss, metres and seconds, as nine columns: run, time, position, quaternion."""
    t = np.arange(60) / 100
    half = 2.0 * t + 0.7
    turn = {"w": np.cos(half), "x": 0.6 * np.sin(half), "y": 0.8 * np.sin(half), "z": 0 * t}
    columns = [0 * t, t, 0.3 * t, -0.2 * t, 2.0 + t - 9.81 / 2 * t**2, *(turn[a] for a in order)]
    return Part("log", {n: Signal(n, "log", c) for n, c in zip(names, columns, strict=True)})


@pytest.mark.parametrize(
    ("four", "order", "as_mapped"),
    [
        (("a", "b", "c", "d"), "TODO", ("a", "b", "c", "d")),
        (("c5", "c6", "c7", "c8"), "TODO", ("c5", "c6", "c7", "c8")),
        (("qr", "qi", "qj", "qk"), "xyzw", ("qi", "qj", "qk", "qr")),
        (("r_real", "r_i", "r_j", "r_k"), "xyzw", ("r_i", "r_j", "r_k", "r_real")),
    ],
)
def test_a_pose_is_known_by_what_it_does(four: tuple[str, ...], order: str, as_mapped: tuple[str, ...]) -> None:
    """Names that say nothing: four columns of length 1 are the orientation of the only free body, three that fall its
    position; where names do not tell the order of a quaternion, it is asked for."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    log = flight("run", "t", "c2", "c3", "c4", *four)
    times = log.signals["t"].values
    poses, up = guess_frame(log, guess_poses(log, model, besides=("t",), times_s=times), model, times)
    turn, place = poses
    assert (turn.order, tuple(turn.signals.values())) == (order, as_mapped)
    assert (tuple(place.signals.values()), place.unit, up.axis) == (("c2", "c3", "c4"), "m", "z")


@pytest.mark.parametrize(
    ("scale", "turned", "said"),
    [
        (1.0, (0, 1, 2), ""),
        (1e-3, (0, 1, 2), "falls with 0.00981 m/s2, where the model's gravity is 9.81"),
        (100.0, (0, 1, 2), "falls with 981 m/s2, where the model's gravity is 9.81"),
        (1.0, (0, 2, 1), "falls along -y of the case's world, where the model's gravity is (0, 0, -9.81) m/s2"),
        (-1.0, (2, 1, 0), "falls along +x of the case's world, where the model's gravity is (0, 0, -9.81) m/s2"),
    ],
)
def test_a_body_that_falls_otherwise_is_told(scale: float, turned: tuple[int, ...], said: str) -> None:
    """Two throws, one after the other; noise of half a millimetre. What rests or slides tells nothing."""
    log = flight("run", "t", "x", "y", "z", "a", "b", "c", "d")
    gravity, rng = np.array([0.0, 0.0, -9.81]), np.random.default_rng(0)
    once = np.stack([log.signals[a].values for a in "xyz"], axis=1)
    times, places = np.tile(log.signals["t"].values, 2), np.vstack([once, once])
    places += 5e-4 * rng.normal(size=places.shape)
    assert falls_otherwise(times, scale * places[:, turned], gravity) == said
    assert falls_otherwise(times, scale * (places - np.vstack([once, once])), gravity) == ""
    assert falls_otherwise(times, scale * places[:, turned], np.zeros(3)) == ""
