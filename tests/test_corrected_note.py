"""A corrected model that can't be written costs itself and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from runner.diagnosis.corrected import folder_of, read_corrected, write_equals
from runner.effects.planar_box import FloorTilt, Wind
from runner.errors import ResultError, WriteError
from runner.outputs.one import with_corrected
from runner.systems.planar_box.system import PlanarBox
from tests.cases import made
from tests.mechanism_cases import system_of, write_case
from tests.servo_arm import NOMINAL, recorded, written


@dataclass(frozen=True)
class Simulated:
    """A system whose written model fails as `error`; None: it does not."""

    error: Exception | None = None

    def is_solved(self, effects: Any) -> bool:
        """Return False: there is one way to solve it."""
        return False

    def as_told(self, effects: Any, errors: Any) -> Any:
        """Return them as they are."""
        return effects

    def write_model(self, effects: Any, folder: Path) -> tuple[str, ...]:
        """Fail, or write nothing."""
        if self.error is not None:
            raise self.error
        return ()


@dataclass(frozen=True)
class Found:
    """What is asked of a diagnosis."""

    system: Simulated
    notes: tuple[str, ...] = ("The noise was not stated.",)
    effects: tuple[Any, ...] = field(default=())


def test_the_rest_is_kept(tmp_path: Path) -> None:
    """The reason stands among the notes, which report and verdict show."""
    odd = Simulated(ResultError("model.xml: joint 'elbow' does not move as it does in the simulation."))
    found: Any = Found(odd)
    assert with_corrected(found, tmp_path).notes == (
        "The noise was not stated.",
        "No corrected model was written. model.xml: joint 'elbow' does not move as it does in the simulation.",
    )
    assert not (tmp_path / "corrected.yaml").exists()


def test_a_model_that_can_be_written_is(tmp_path: Path) -> None:
    """Then nothing is said."""
    found: Any = Found(Simulated())
    assert with_corrected(found, tmp_path) is found
    assert (tmp_path / "corrected.yaml").exists()


def test_a_full_disk_is_still_an_error(tmp_path: Path) -> None:
    """Nothing else could be written either."""
    found: Any = Found(Simulated(WriteError("model.xml: can't be written: No space left on device.")))
    with pytest.raises(WriteError):
        with_corrected(found, tmp_path)


def test_what_fits_as_well_is_written_beside_it(tmp_path: Path) -> None:
    """A tilt of the floor and a wind make the same motion; a test that tells them needs both models."""
    recording, _ = made((FloorTilt(0.01, 0.5),), episodes=2, seconds=1.0)
    system = PlanarBox(recording)
    wind = {"wind": {"force_n": 0.2, "direction_rad": 0.5}}
    tilt: Any = SimpleNamespace(equal_numbers={("wind",): (wind, {})})
    write_equals(tmp_path / "found", tilt, system)
    effects, _ = read_corrected(tmp_path / "found" / folder_of(["wind"]), system)
    assert effects == (Wind(0.2, 0.5),)


def test_each_has_a_folder_of_its_own() -> None:
    """However its joints are called, and however many effects it has."""
    assert folder_of(["actuator_delay[*]", "mass[arm]"]) == "or_actuator_delay_all+mass_arm"
    alike = (["mass[left-arm]"], ["mass[left arm]"], ["mass[+]"], ["mass[*]"], ["mass[../../x]"], ["mass[left_arm]"])
    assert len({folder_of(names) for names in alike}) == len(alike)
    assert not any(set("/\\. ") & set(folder_of(names)) for names in alike)
    assert len(folder_of([f"joint_friction[finger_joint_{k}_of_the_left_gripper]" for k in range(6)])) < 128


def test_one_that_cannot_be_written_costs_itself_alone(tmp_path: Path) -> None:
    """The corrected model is there, and what fails is said."""
    equal = {("none_such",): ({}, {})}
    odd = Simulated(ResultError("model.xml: joint 'elbow' does not move as it does in the simulation."))
    (said,) = write_equals(tmp_path, cast(Any, SimpleNamespace(equal_numbers=equal)), cast(Any, odd))
    assert said.startswith("The model with none_such in it was not written. model.xml: joint 'elbow'")


def test_what_all_of_a_kind_share_is_written_for_each(tmp_path: Path) -> None:
    """As in the corrected model itself."""
    xml = written(10.0, 0.4)
    arm = system_of(write_case(tmp_path, xml, [recorded(xml, 0, samples=101, step_s=1e-3)], NOMINAL))
    late: Any = SimpleNamespace(equal_numbers={("actuator_delay[*]",): ({"actuator_delay[*]": {"delay_s": 0.02}}, {})})
    write_equals(tmp_path / "found", late, arm)
    effects, _ = read_corrected(tmp_path / "found" / "or_actuator_delay_all", arm)
    assert [e.full_name for e in effects] == ["actuator_delay[shoulder]", "actuator_delay[elbow]"]
