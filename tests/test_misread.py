"""What was read as something else than it is: units of joints, and the order of quaternions, told by the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from runner.systems.case import open_case
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
    [(1e-3 / RADIAN, "deg read as mrad"), (RADIAN, "rad read as deg"), (1e-3, "rad read as mrad")],
)
def test_a_wrong_unit_of_all_angles_is_told(tmp_path: Path, factor: float, said: str) -> None:
    """A servo's gain so many times as large would follow as well; the model as believed tells otherwise."""
    (told,) = arm(tmp_path, factor)
    assert told.startswith("Angles")
    assert said in told


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
