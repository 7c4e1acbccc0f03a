"""Cases in which a pin pushes: what is read and written, what is refused, and the cases of the plates example."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from runner.errors import RecordingError
from runner.recording import read_case, write_case
from runner.systems.case import open_case
from runner.systems.simulator import Run

MAKER = Path(__file__).parents[1] / "examples" / "plates" / "make_cases.py"
RATE_HZ, RADIUS_M, SPEED_M_S = 250, 0.004745, 0.08
CORNERS = 0.045 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
TRAVEL_S, REST_S = 0.5, 0.1


def pushed_square(push: int, force_valid: bool) -> pd.DataFrame:
    """Return one push of a square plate through its middle as the real recordings have it, by kinematics alone."""
    t = np.arange(round((TRAVEL_S + REST_S) * RATE_HZ)) / RATE_HZ
    travel = np.minimum(t, TRAVEL_S) * SPEED_M_S
    moves = t < TRAVEL_S
    zero = np.zeros(len(t))
    return pd.DataFrame(
        {"episode": push, "t": t, "x": 0.1 + travel, "y": zero, "yaw": zero}
        | {"vx": np.where(moves, SPEED_M_S, 0.0), "vy": zero, "wz": zero}
        | {"fx": np.where(moves, 2.0, 0.0) if force_valid else np.nan, "fy": 0.0 if force_valid else np.nan}
        | {"px": -0.045, "py": zero, "tip_x": 0.1 + travel - 0.045 - RADIUS_M, "tip_y": zero}
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of cases that the example's script has made of tables like the real ones; not to be changed."""
    tmp_path = tmp_path_factory.mktemp("plates")
    folder = tmp_path / "pushes"
    folder.mkdir()
    numbers = range(6)
    pd.concat([pushed_square(n, force_valid=n != 5) for n in numbers]).to_parquet(folder / "train.parquet", index=False)
    pd.DataFrame(
        {"episode": numbers, "shape": ["square"] * 5 + ["other"], "mass_kg": 0.8374, "izz_kg_m2": 0.001131}
        | {"force_valid": [True] * 5 + [False]}
    ).to_csv(folder / "episodes.csv", index=False)
    corners = pd.DataFrame(CORNERS, columns=["x", "y"])
    pd.concat([corners.assign(shape=s) for s in ("square", "other")]).to_csv(folder / "outlines.csv", index=False)
    for way in ("path", "force"):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("sys.argv", [str(MAKER), str(folder), str(tmp_path / way), "--driven-by", way])
            runpy.run_path(str(MAKER), run_name="__main__")
    return tmp_path


@pytest.fixture
def case(made: Path, tmp_path: Path) -> Path:
    """Return one of the cases, to be changed."""
    return shutil.copytree(made / "path" / "square" / "fitted", tmp_path / "case")


def test_the_example_makes_cases_of_pushes(made: Path) -> None:
    """By path there is a pin and no commanded force, by force the other way round, and only where it was valid."""
    cases = {p.parent for p in (made / "path").rglob("nominal.yaml")}
    assert {c.relative_to(made / "path").parts[0] for c in cases} == {"square", "other"}
    episodes = []
    for case in cases:
        recording = read_case(case)
        assert recording.nominal.pin is not None
        assert recording.nominal.pin.radius_m == RADIUS_M
        episodes += [e.index for e in recording.episodes]
        assert all(e.pin_m is not None for e in recording.episodes)
        assert not [note for note in recording.notes if note.startswith("warning")]
    assert sorted(episodes) == list(range(6))
    by_force = [p.parent for p in (made / "force").rglob("nominal.yaml")]
    assert {c.relative_to(made / "force").parts[0] for c in by_force} == {"square"}
    assert all(e.pin_m is None for c in by_force for e in read_case(c).episodes)


def test_a_plate_follows_its_pin(made: Path) -> None:
    """Replayed, the plate goes where it went, but for what it coasts when the pin stops."""
    system = open_case(next(p.parent for p in (made / "path" / "square").rglob("nominal.yaml")))
    start = np.array([0.1, 0, 0, SPEED_M_S, 0, 0])
    end = system.simulator(threads=1).predict(0, [Run((), start)])[0, -1]
    coasts = SPEED_M_S**2 / (2 * 0.25 * 9.81)
    assert end[0] == pytest.approx(0.1 + TRAVEL_S * SPEED_M_S + coasts, abs=2e-4)
    assert end[1:3] == pytest.approx([0, 0], abs=2e-4)


def test_what_is_written_is_read_back(made: Path, tmp_path: Path) -> None:
    """Path, pin and the gaps of a measured force survive."""
    for case in (p.parent for p in (made / "path").rglob("nominal.yaml")):
        recording = read_case(case)
        write_case(recording, tmp_path / "again")
        again = read_case(tmp_path / "again")
        assert again.nominal == recording.nominal
        for a, b in zip(recording.episodes, again.episodes, strict=True):
            for name in ("pose", "twist", "force_n", "point_m", "pin_m"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize(
    ("pin", "drop", "words"),
    [
        ({"radius": 0.0, "friction": 0.2}, [], "pin.radius: must be a finite number in m > 0"),
        ({"radius": 0.005, "friction": -1}, [], "pin.friction: must be a finite number >= 0"),
        ({"radius": 0.005, "mu": 0.2}, [], "unknown key 'pin.mu'"),
        ({"radius": 0.005}, [], "missing 'pin.friction'; needed: 'pin.radius', 'pin.friction'"),
        (0.005, [], "pin: must hold 'radius' in m, 'friction' and perhaps 'height'"),
        ({"radius": 0.005, "friction": 0.2}, ["tip_y"], "missing column 'tip_y'"),
        ({"radius": 0.005, "friction": 0.2}, ["x"], "missing column 'x'"),
    ],
)
def test_what_can_not_be_a_pin_is_refused(case: Path, pin: object, drop: list[str], words: str) -> None:
    """In one line that says what was wrong and what is allowed."""
    content = yaml.safe_load((case / "nominal.yaml").read_text()) | {"pin": pin}
    (case / "nominal.yaml").write_text(yaml.safe_dump(content))
    table = pd.read_parquet(case / "recording.parquet").drop(columns=drop)
    table.to_parquet(case / "recording.parquet", index=False)
    with pytest.raises(RecordingError) as refused:
        read_case(case)
    assert words in str(refused.value)


def test_a_path_must_be_whole_and_a_force_need_not_be(case: Path) -> None:
    """NaN in the path is refused; without force columns the force was not measured; without `pin` the path is extra."""
    table = pd.read_parquet(case / "recording.parquet")
    table.drop(columns=["fx", "fy", "px", "py"]).to_parquet(case / "recording.parquet", index=False)
    assert np.isnan(read_case(case).episodes[0].force_n[:, :2]).all()
    broken = table.copy()
    broken.loc[7, "tip_x"] = np.nan
    broken.to_parquet(case / "recording.parquet", index=False)
    with pytest.raises(RecordingError, match="column 'tip_x' must be a finite number in m, got nan"):
        read_case(case)
    content = yaml.safe_load((case / "nominal.yaml").read_text())
    del content["pin"]
    (case / "nominal.yaml").write_text(yaml.safe_dump(content))
    table.to_parquet(case / "recording.parquet", index=False)
    recording = read_case(case)
    assert recording.episodes[0].pin_m is None
    assert any("'tip_x', 'tip_y'" in note for note in recording.notes)
