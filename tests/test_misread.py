"""What was read as something else than it is: units of joints, and the order of quaternions, told by the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest

from runner.effects.planar_box import Friction
from runner.systems.case import open_case
from runner.systems.mechanism.system import MechanismSystem
from runner.systems.planar_box.system import PlanarBox
from tests.cases import made
from tests.mechanism_cases import write_case
from tests.servo_arm import JOINTS, NOISE, NOMINAL, recorded, written
from tests.tosses import COLUMNS, toss_case, world

RADIAN = np.pi / 180


def stretched_out(mass: float) -> str:
    """Return an arm that its servos hold against its weight: hanging down a small motion is as good as a large one."""
    return written(kp=20.0, mass=mass).replace('gravity="0 0 -9.81"', 'gravity="9.81 0 0"')


def arm(folder: Path, factor: float, mass: float = 0.4) -> tuple[str, ...]:
    """Return what is said of an arm whose forearm weighs so much, all angles and targets so many times as large."""
    episodes = [recorded(stretched_out(mass), seed, samples=200, step_s=0.0005) for seed in (1, 2)]
    angles = [f"{kind}_{joint}" for joint in JOINTS for kind in ("u", "q", "dq")]
    wrong = [e | {name: factor * e[name] for name in angles} for e in episodes]
    of_arm = {**NOMINAL, "noise": {name: factor * of for name, of in NOISE.items()}}
    return open_case(write_case(folder, stretched_out(0.4), wrong, of_arm)).misread()


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e-3 / RADIAN, "deg that were read as mrad"),
        (RADIAN, "rad that were read as deg"),
        (1e-3, "rad that were read as mrad"),
    ],
)
def test_a_wrong_unit_of_all_angles_is_told(tmp_path: Path, factor: float, said: str) -> None:
    """A servo's gain so many times as large would follow as well; the model as believed tells otherwise."""
    (told,) = arm(tmp_path, factor)
    assert told.startswith("Angles")
    assert said in told


@pytest.mark.parametrize(
    ("kinds", "factor", "said"),
    [
        (("q", "dq"), 1 / RADIAN, "Measurements of joint 'elbow' may have been read in a wrong unit"),
        (("u",), RADIAN, "Commands 'u_elbow' may have been read in a wrong unit"),
    ],
)
def test_a_wrong_unit_of_one_joint_is_told(tmp_path: Path, kinds: tuple[str, ...], factor: float, said: str) -> None:
    """Of its measurements, or of what its servo is told."""
    episodes = [recorded(stretched_out(0.4), seed, samples=200, step_s=0.0005) for seed in (1, 2)]
    wrong = [e | {f"{kind}_elbow": factor * e[f"{kind}_elbow"] for kind in kinds} for e in episodes]
    of_arm = {**NOMINAL, "noise": {name: of * (factor if name[-5:] == "elbow" else 1) for name, of in NOISE.items()}}
    told = open_case(write_case(tmp_path, stretched_out(0.4), wrong, of_arm)).misread()
    assert any(one.startswith(said) for one in told)
    assert not any("shoulder" in one for one in told)


@pytest.mark.parametrize("mass", [0.4, 0.2, 0.8])
def test_a_wrong_model_is_no_wrong_unit(tmp_path: Path, mass: float) -> None:
    """A forearm of half or twice the weight is what a diagnosis is for."""
    assert arm(tmp_path, 1.0, mass) == ()


@pytest.mark.parametrize("shift", [1, -1])
def test_the_scalar_of_quaternions_in_the_wrong_place_is_told(tmp_path: Path, shift: int) -> None:
    """A box that was read so is deep in the floor that it hits; as it is it is not, though it is a little larger."""
    case = toss_case(tmp_path, world(half_m=0.052), tosses=4)
    assert open_case(case).misread() == ()
    table, turn = pd.read_parquet(case / "recording.parquet"), list(COLUMNS[3:])
    table[turn] = np.roll(table[turn].to_numpy(), shift, axis=1)
    table.to_parquet(case / "recording.parquet", index=False)
    (told,) = open_case(case).misread()
    assert "scalar in the wrong place" in told


def test_the_poses_that_are_drawn_are_those_that_were_measured(tmp_path: Path) -> None:
    """Of a body that is measured as a whole at once for all samples, as one by one where a reading was lost."""
    system = open_case(toss_case(tmp_path, world(), tosses=2))
    assert isinstance(system, MechanismSystem)
    table = pd.read_parquet(tmp_path / "recording.parquet").query("episode == 0")
    shown = np.array(system.values()[0])
    at_once = system.initial.positions(0, shown)
    turn = table[list(COLUMNS[3:])].to_numpy()
    np.testing.assert_allclose(at_once[:, :3], table[list(COLUMNS[:3])], atol=1e-12)
    np.testing.assert_allclose(
        at_once[:, 3:] * np.sign(np.sum(at_once[:, 3:] * turn, axis=1))[:, None], turn, atol=1e-9
    )
    shown[:, 3:6] = [0.1, -0.2, 0.3]  # a prediction that is turned against what was measured
    turned = system.initial.positions(0, shown)
    shown[0, 0] = np.nan
    np.testing.assert_allclose(system.initial.positions(0, shown)[1:], turned[1:], atol=1e-7)


BLOCK = """<mujoco><option timestep="0.0005"/><worldbody><geom type="plane" size="5 5 1"/>
<body name="block" pos="0 0 1"><freejoint/><geom type="box" size="0.1 0.06 0.03" mass="0.4"/></body>
</worldbody></mujoco>"""


def tumbling(seed: int) -> dict[str, np.ndarray]:
    """A block that turns about all its axes, far above the floor: 0.4 s at 120 Hz, with noise of 1 mrad."""
    random, model = np.random.default_rng(seed), mujoco.MjModel.from_xml_string(BLOCK)
    data, rows = mujoco.MjData(model), []
    data.qpos[2], data.qvel[3:] = 2.0, random.normal(0.0, 10.0, 3)
    model.opt.timestep = 1 / 120 / 20
    for _ in range(48):
        turn = data.qpos[3:7].copy()
        mujoco.mju_quatIntegrate(turn, 1e-3 * random.standard_normal(3), 1.0)
        rows.append([data.time, *data.qpos[:3] + 5e-4 * random.standard_normal(3), *turn])
        mujoco.mj_step(model, data, nstep=20)
    return dict(zip(("t", *COLUMNS), np.array(rows).T, strict=True))


@pytest.mark.parametrize("shift", [0, 1, -1])
def test_a_body_that_never_touches_anything_tumbles_otherwise(tmp_path: Path, shift: int) -> None:
    """Euler's equations tell of three different moments of inertia which number of a quaternion is the scalar."""
    channels: dict[str, object] = {a: {"body": "block", "quantity": "position", "axis": a} for a in "xyz"}
    channels["quat"] = {"body": "block", "quantity": "orientation", "columns": list(COLUMNS[3:])}
    episodes = [tumbling(seed) for seed in range(3)]
    for each in episodes:
        each |= dict(zip(COLUMNS[3:], np.roll([each[c] for c in COLUMNS[3:]], shift, axis=0), strict=True))
    told = open_case(write_case(tmp_path, BLOCK, episodes, {"channels": channels})).misread()
    assert len(told) == bool(shift)
    assert all("scalar in the wrong place" in one and "of its turning" in one for one in told)


@pytest.mark.parametrize(("kind", "said"), [("u", "commands 'u_shoulder' and 'u_elbow'"), ("q", "joints")])
def test_joints_in_each_other_s_place_are_told(tmp_path: Path, kind: str, said: str) -> None:
    """Of a servo that hardly bears a load nothing else than its motion says whose target it follows."""
    episodes = [recorded(stretched_out(0.4), seed, samples=200, step_s=0.0005) for seed in (1, 2)]
    kinds = ("u",) if kind == "u" else ("q", "dq")
    pairs = {f"{k}_{a}": f"{k}_{b}" for k in kinds for a, b in (JOINTS, JOINTS[::-1])}
    wrong = [e | {name: e[other] for name, other in pairs.items()} for e in episodes]
    (told,) = open_case(write_case(tmp_path, stretched_out(0.4), wrong, NOMINAL)).misread()
    assert told.startswith("Signals may have been exchanged: within 0.5 s the model as believed misses")
    assert said in told


@pytest.mark.parametrize(("factor", "said"), [(10.0, "mm that were read as cm"), (0.1, "cm that were read as mm")])
def test_positions_of_a_box_in_a_wrong_unit_are_told(factor: float, said: str) -> None:
    """By how far what pushes it can have moved it, whatever the friction is believed to be."""
    recording, _ = made(episodes=3)
    assert PlanarBox(recording).misread() == ()
    shares = np.array([factor, factor, 1.0])
    episodes = tuple(replace(e, pose=e.pose * shares, twist=e.twist * shares) for e in recording.episodes)
    (told,) = PlanarBox(replace(recording, episodes=episodes)).misread()
    assert told.startswith("Positions may have been read in a wrong unit")
    assert said in told


def test_a_floor_that_is_believed_wrong_is_no_wrong_unit() -> None:
    """Twice or half the friction is what a diagnosis is for."""
    for friction in (0.15, 0.5):
        assert PlanarBox(made((Friction(friction),), episodes=3)[0]).misread() == ()
