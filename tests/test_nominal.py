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
    BelievedPin,
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
        known: [mass, com_offset]
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
        known=("mass", "com_offset"),
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


CORNERS = [[0.06, 0.0], [0.0, 0.05], [-0.06, 0.0], [0.0, -0.05]]
PLATE = BELIEVED | {"half_size": [0.06, 0.05, 0.006], "mass": 0.9, "rate_hz": 250}
TABLE = "shape,x,y\n" + "".join(f"kite,{x},{y}\n" for x, y in CORNERS) + "dot,0,0\ndot,0,1\n"


def plate(outline: object, folder: Path, **other: object) -> Nominal:
    (folder / "nominal.yaml").write_text(yaml.safe_dump(PLATE | other | {"outline": outline}))
    return read_nominal(folder)


def test_outlines_are_read(tmp_path: Path) -> None:
    """Corners in the file or in a table, and round ones; what is read is written so that it is read again."""
    (tmp_path / "outlines.csv").write_text(TABLE)
    corners = plate(CORNERS, tmp_path)
    assert plate("outlines.csv#kite", tmp_path) == corners
    assert plate(CORNERS[::-1], tmp_path).outline is not None
    assert corners.volume_m3 == pytest.approx(0.006 * 0.12 * 0.1)
    assert corners.yaw_inertia_kg_m2 == pytest.approx(0.9 * (0.06**2 + 0.05**2) / 6)
    disc = plate({"disc": 0.05}, tmp_path, half_size=[0.05, 0.05, 0.006])
    assert disc == plate({"ellipse": [0.05, 0.05]}, tmp_path, half_size=[0.05, 0.05, 0.006])
    assert disc.yaw_inertia_kg_m2 == pytest.approx(0.9 * 0.05**2 / 2, rel=1e-4)
    wedge = plate([[0.0, 0.0], [0.12, 0.0], [0.0, 0.09]], tmp_path, half_size=[0.06, 0.045, 0.006])
    assert wedge.centre_of_mass_m == pytest.approx((0.04, 0.03, 0.0))
    for nominal in (corners, disc, wedge):
        write_nominal(nominal, tmp_path / "nominal.yaml")
        assert read_nominal(tmp_path) == nominal


@pytest.mark.parametrize(
    ("outline", "said"),
    [
        ("../outlines.csv", "must be a .csv file in the folder of the case, got '../outlines.csv'"),
        ("/etc/passwd", "must be a .csv file in the folder of the case"),
        ("link.csv", "must be a .csv file in the folder of the case"),
        ("nowhere.csv", "no such file"),
        ("outlines.csv", "has several shapes"),
        ("outlines.csv#kit", "no shape 'kit'. Valid: 'dot', 'kite'. Did you mean 'kite'?"),
        ("outlines.csv#dot", "must have 3 to 2000 corners, got 2"),
        ("bad.csv", "line 3: y must be a finite number in m, got 'one'"),
        ("narrow.csv", "needs one column 'y', got: x, z"),
        ("disc", "must be a .csv file"),
        ({"disc": -1}, "outline.disc: must be a finite number in m (its radius)"),
        ({"disc": 0.05, "ellipse": [1, 1]}, "must be corners"),
        ({"ellipse": [0.05]}, "must be corners"),
        ([[0, 0], [1, "a"], [1, 1]], "outline[1] y: must be a finite number in m"),
        ([[0, 0], [1, 0]], "must have 3 to 2000 corners, got 2"),
        ([[60, 0], [0, 50], [-60, 0], [0, -50]], "spans 120 x 100 m, allowed: 0.0001 to 100 m; in metres?"),
        ([[6, 0], [0, 5], [-6, 0], [0, -5]], "half_size: [0.06, 0.05, 0.006] m is not that of the outline"),
        ([[0.06, 0.05], [-0.06, -0.05], [0.06, -0.05], [-0.06, 0.05]], "does not cross itself"),
        ([[0, 0], [0.12, 0.1], [0.06, 0.05], [0.12, 0.1]], "meet"),
        ([[0.2, 0.0], [0.32, 0.0], [0.32, 0.1], [0.2, 0.1]], "its corners must be relative to the geometric centre"),
        (7, "must be corners"),
        ([], "must be corners"),
    ],
)
def test_what_is_no_outline_is_refused(outline: object, said: str, tmp_path: Path) -> None:
    """In a line that names the key or the file; no file from elsewhere is opened, not through a link either."""
    case, elsewhere = tmp_path / "case", tmp_path / "outlines.csv"
    case.mkdir()
    for file in (elsewhere, case / "outlines.csv"):
        file.write_text(TABLE)
    (case / "bad.csv").write_text("x,y\n0,0\n1,one\n1,1\n")
    (case / "narrow.csv").write_text("x,z\n0,0\n")
    (case / "link.csv").symlink_to(elsewhere)
    with pytest.raises(RecordingError, match=re.escape(said)) as caught:
        plate(outline, case)
    assert "\n" not in str(caught.value)


def test_corners_do_not_carry_an_outline(tmp_path: Path) -> None:
    """The load of a body with an outline is spread; that it rests on corners is refused."""
    with pytest.raises(RecordingError, match="spread over its base: 'patch'"):
        plate(CORNERS, tmp_path, contact="corners")


def test_a_pin_touches_at_a_height_that_may_be_stated(tmp_path: Path) -> None:
    """It is read as it was written; at the height of the geometric centre where nothing is said; within the body."""
    stated = Nominal((0.08, 0.05, 0.03), 0.9, 0.3, 9.81, 30.0, pin=BelievedPin(0.005, 0.2, -0.02))
    write_nominal(stated, tmp_path / "nominal.yaml")
    assert read_nominal(tmp_path / "nominal.yaml").pin == stated.pin
    text = (tmp_path / "nominal.yaml").read_text()
    (tmp_path / "nominal.yaml").write_text(text.replace("height: -0.02", "height: 0.04"))
    with pytest.raises(RecordingError, match=r"within the body.*0\.03"):
        read_nominal(tmp_path / "nominal.yaml")
    (tmp_path / "nominal.yaml").write_text("\n".join(row for row in text.splitlines() if "height" not in row))
    read = read_nominal(tmp_path / "nominal.yaml")
    assert read.pin is not None
    assert read.pin.height_m == 0.0
