"""What an owner believes is read from `nominal.yaml`, or refused with its key."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from recording_cases import BELIEVED, NOMINAL, SAVED, nominals

from runner.errors import RecordingError
from runner.recording import (
    Noise,
    Nominal,
    Support,
    read_nominal,
    write_nominal,
)


@SAVED
@given(nominal=nominals())
def test_any_nominal_is_read_back(nominal: Nominal, tmp_path: Path) -> None:
    """Every key survives, those that are null too."""
    write_nominal(nominal, tmp_path / "nominal.yaml")
    assert read_nominal(tmp_path) == nominal
    assert read_nominal(tmp_path / "nominal.yaml").path == tmp_path / "nominal.yaml"


def test_beliefs_are_read(tmp_path: Path) -> None:
    """Every key, with numbers that YAML takes for text, two numbers for the centre of mass, null for unknown noise."""
    text = """
        half_size: [0.1, 2e-1, 0.3]
        mass: 5e0
        friction: 3e-1
        gravity: 9.81
        contact: corners
        rate_hz: 60
        noise: {position: 5e-4, yaw: null, rate: 0.01}
        com: [0.01, -0.02]
        inertia: 0.1
    """
    (tmp_path / "nominal.yaml").write_text(text)
    assert read_nominal(tmp_path) == Nominal(
        half_size_m=(0.1, 0.2, 0.3),
        mass_kg=5.0,
        friction=0.3,
        gravity_m_s2=9.81,
        rate_hz=60.0,
        contact=Support.CORNERS,
        noise=Noise(position_m=5e-4, rate_rad_s=0.01),
        com_m=(0.01, -0.02, 0.0),
        inertia_kg_m2=0.1,
    )


def test_uniform_yaw_inertia() -> None:
    """A uniform box turns about z with m ((2 hx)^2 + (2 hy)^2) / 12; what is given goes before."""
    box = replace(NOMINAL, half_size_m=(0.1, 0.3, 0.7))
    assert box.yaw_inertia_kg_m2 == pytest.approx(3.0 * (0.2**2 + 0.6**2) / 12)
    assert replace(box, inertia_kg_m2=0.2).yaw_inertia_kg_m2 == 0.2
    assert replace(box, inertia_kg_m2=(0.1, 0.2, 0.25)).yaw_inertia_kg_m2 == 0.25


NOMINAL_ERRORS = [
    ({"mas": 3.0, "mass": None}, r"unknown key 'mas'\. Valid: .* Did you mean 'mass'\?"),
    ({"mu": 0.3}, r"unknown key 'mu'\. .* Did you mean 'friction'\?"),
    ({"mass": None}, r"missing 'mass'; needed: 'half_size', 'mass', 'friction', 'gravity', 'rate_hz'"),
    ({"mass": 0.0}, r"mass: must be a finite number in kg > 0, got 0\.0"),
    ({"mass": -3}, r"mass: must be a finite number in kg > 0, got -3"),
    ({"mass": float("nan")}, r"mass: must be a finite number in kg, got nan"),
    ({"mass": "3 kg"}, r"mass: must be a finite number in kg, got '3 kg'"),
    ({"mass": True}, r"mass: must be a finite number in kg, got True"),
    ({"mass": 3e9}, r"3e\+09 kg make 3e\+09 kg/m3, allowed: 0\.01 to 100000; probably mass in g"),
    ({"half_size": 500}, r"500.* kg make 3e-09 kg/m3, .* probably half_size in mm"),
    ({"half_size": [0.5, 0.5]}, r"half_size: must be 1 or 3 numbers in m, got 2: \[0\.5, 0\.5\]"),
    ({"half_size": [0.5, 0.5, 0]}, r"half_size: must be a finite number in m > 0, got 0"),
    ({"half_size": [0.5, "wide", 0.5]}, r"half_size\[1\]: must be a finite number in m, got 'wide'"),
    ({"friction": -0.1}, r"friction: must be a finite number >= 0 and <= 10, got -0\.1"),
    ({"gravity": -9.81}, r"gravity: must be a finite number in m/s2 \(its magnitude\) > 0 and <= 300, got -9\.81"),
    ({"gravity": 981}, r"gravity: .* <= 300, got 981"),
    ({"rate_hz": 0}, r"rate_hz: must be a finite number in Hz > 0 and <= 1e\+06, got 0"),
    ({"contact": "corner"}, r"contact: unknown 'corner'\. Valid: 'corners', 'patch'\. Did you mean 'corners'\?"),
    ({"noise": 0.01}, r"noise: must be null or hold 'position', 'yaw', 'velocity', 'rate', got 0\.01"),
    ({"noise": {"speed": 1}}, r"unknown key 'noise\.speed'\. Valid: 'position', 'rate', 'velocity', 'yaw'"),
    ({"noise": {"yaw": 0}}, r"noise\.yaw \(null where not known\): must be a finite number in rad > 0, got 0"),
    ({"noise": {"rate": -1}}, r"noise\.rate .*: must be a finite number in rad/s > 0, got -1"),
    ({"noise": {"position": float("nan")}}, r"noise\.position: must be a finite number, got nan"),
    ({"com": 0.1}, r"com: must be 2 or 3 numbers in m, got 1: 0\.1"),
    ({"com": [0, 0.6]}, r"com \(inside the box\): must be a finite number in m >= -0\.5 and <= 0\.5, got 0\.6"),
    ({"inertia": 0}, r"inertia: must be a finite number in kg m2 > 0, got 0"),
    ({"inertia": [1, 1, 3]}, r"inertia: none may exceed the sum of the other two, got \[1\.0, 1\.0, 3\.0\] kg m2"),
    ({"inertia": 500}, r"inertia: 500 kg m2 about z can't be: 3 kg inside this box has at most 1\.5"),
]


@pytest.mark.parametrize(("change", "message"), NOMINAL_ERRORS)
def test_beliefs_are_refused(change: dict[str, object], message: str, tmp_path: Path) -> None:
    """One line with the file, the key, the value and what is allowed."""
    content = {key: value for key, value in (BELIEVED | change).items() if value is not None}
    (tmp_path / "nominal.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(RecordingError, match=re.escape(f"{tmp_path / 'nominal.yaml'}: ") + ".*" + message) as error:
        read_nominal(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"nominal\.yaml: is empty; it needs 'half_size'"),
        ("- 1\n- 2\n", r"must hold `key: value` lines, got a list"),
        ("mass: 3\nfriction: [0.3\n", r" line 3, column 1: not valid YAML: "),
        ("mass: 3\nfriction: 0.3\nmass: 4\n", r" line 3, column 1: not valid YAML: key 'mass' is given twice"),
        ("mass: \x00", r"not valid YAML: .*not allowed"),
    ],
)
def test_broken_yaml_is_refused(text: str, message: str, tmp_path: Path) -> None:
    """With the line, where there is one."""
    (tmp_path / "nominal.yaml").write_text(text)
    with pytest.raises(RecordingError, match=message) as error:
        read_nominal(tmp_path)
    assert "\n" not in str(error.value)
