"""Force sequences keep their impulse at any time step, push when they should, and refuse what they can't be."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from runner.config import options
from runner.errors import ConfigError
from runner.physics.forces import (
    AbstractForces,
    Chirp,
    CsvForces,
    Offcentre,
    PaperForces,
    Push,
    Ramp,
    RandomForces,
    Straight,
    push_means,
)

SEQUENCES = [PaperForces(), Straight(), Offcentre(), Ramp(), Chirp(), RandomForces(seed=3)]
TIMESTEPS_S = st.sampled_from([1 / 480, 1 / 240, 1 / 60, 0.002, 0.0137])


def whole(forces: AbstractForces, timestep_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, forces and points of a whole sequence."""
    t_s = np.arange(math.ceil(forces.duration_s / timestep_s)) * timestep_s
    return (t_s, *forces.columns(t_s, timestep_s))


@given(TIMESTEPS_S, st.sampled_from([f for f in SEQUENCES if not isinstance(f, Chirp)]))
def test_impulse_does_not_depend_on_the_time_step(timestep_s: float, forces: AbstractForces) -> None:
    """The sum of mean force times step is the same on a coarse and on a fine grid."""
    _, fine, _ = whole(forces, 1e-4)
    _, force, _ = whole(forces, timestep_s)
    np.testing.assert_allclose(force.sum(axis=0) * timestep_s, fine.sum(axis=0) * 1e-4, atol=1e-6)


def test_paper_sequence_gives_its_pushes() -> None:
    """Ten pushes of 15 N for 0.5 s, every other one off-centre to either side, rests between."""
    forces = PaperForces()
    t_s, force, point = whole(forces, 1 / 480)
    assert forces.duration_s == 15.5
    size = np.linalg.norm(force, axis=1)
    assert set(size.round(9)) == {0.0, 15.0}
    starts = np.flatnonzero(np.diff(size) > 1) + 1
    np.testing.assert_allclose(t_s[starts], 0.5 + 1.5 * np.arange(10), atol=1e-9)
    assert size.sum() / 480 == pytest.approx(10 * 15 * 0.5, rel=1e-12)
    moment = point[:, 0] * force[:, 1] - point[:, 1] * force[:, 0]  # about z, for a cube that has not turned
    np.testing.assert_allclose(moment[starts], 1.5 * np.array([0, -1, 0, 1, 0, -1, 0, 1, 0, -1]), atol=1e-12)
    np.testing.assert_allclose(force[starts][:4] / 15, [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], atol=1e-15)


@given(st.floats(0.0, 0.9), st.floats(0.001, 0.9), TIMESTEPS_S)
def test_a_push_that_begins_inside_a_step_is_averaged_over_it(start: float, length: float, timestep_s: float) -> None:
    """Each step's mean is its overlap with the push, at any phase."""
    t_s = np.arange(int(2 / timestep_s)) * timestep_s
    force, _ = push_means([Push(start, start + length, (4.0, 0.0, 0.0))], t_s, timestep_s)
    assert force[:, 0].sum() * timestep_s == pytest.approx(4 * length, abs=1e-6)
    assert force[t_s + timestep_s < start - 1e-9].sum() == 0
    assert force[t_s > start + length].sum() == 0
    inside = (t_s > start) & (t_s + timestep_s < start + length)
    assert (force[inside, 0] == 4.0).all()


def test_pushes_that_share_a_step_share_its_point() -> None:
    """The point of a shared step is the mean by impulse, so that one force direction keeps its moment."""
    pushes = [Push(0.0, 0.25, (8.0, 0, 0), (0.0, 0.4, 0)), Push(0.25, 1.0, (8.0, 0, 0), (0.0, -0.2, 0))]
    force, point = push_means(pushes, np.array([0.0]), 1.0)
    assert force[0, 0] == pytest.approx(8.0)
    assert force[0, 0] * point[0, 1] == pytest.approx(8 * (0.25 * 0.4 - 0.75 * 0.2))


def test_ramp_reaches_its_height() -> None:
    """The mean of a step on the slope is the force at its middle; on the plateau it is slope times rise."""
    forces = Ramp(slope_n_s=5.0, ramp_s=3.0, hold_s=0.5, lead_s=0.25, angle_rad=0.3)
    force, _ = forces.columns(np.array([0.1, 1.0, 3.3, 3.9]), 0.01)
    size = np.hypot(force[:, 0], force[:, 1])
    np.testing.assert_allclose(size, [0.0, 5 * 0.755, 15.0, 0.0], atol=1e-9)
    assert math.atan2(force[1, 1], force[1, 0]) == pytest.approx(0.3)


def test_chirp_is_the_mean_of_the_sine() -> None:
    """Means over steps equal an adaptive quadrature of the swept sine, also over the step in which it ends."""
    forces = Chirp(force_n=20.0, start_hz=0.2, end_hz=3.0, sweep_s=12.0)
    for t, h in ((0.0, 1 / 60), (3.1, 1 / 60), (11.99, 1 / 60)):
        end = min(t + h, 12.0)
        wanted, _ = quad(lambda s: 20 * math.sin(2 * math.pi * (0.2 * s + 2.8 / 24 * s * s)), t, end)
        assert forces.columns(np.array([t]), h)[0][0, 0] == pytest.approx(wanted / h, abs=1e-9)


def test_random_depends_on_its_seed_alone() -> None:
    """The same seed gives the same pushes, another seed others; the run's seed is used where there is none."""
    same, other = RandomForces(seed=5), RandomForces(seed=6)
    assert np.array_equal(whole(same, 0.01)[1], whole(RandomForces(seed=5), 0.01)[1])
    assert same.duration_s != other.duration_s
    assert RandomForces().with_seed(5) == same
    assert same.with_seed(6) is same
    with pytest.raises(ConfigError, match="seed: a random sequence needs one"):
        _ = RandomForces().duration_s


def test_random_stays_in_its_limits() -> None:
    """Sizes, places and lengths of a thousand pushes lie in the spans that were asked for."""
    forces = RandomForces(seed=1, pushes=1000, force_n=(2.0, 3.0), push_s=(0.1, 0.2), reach_m=0.3)
    pushes, end = forces._train
    sizes = np.array([math.hypot(*p.force_n) for p in pushes])
    assert len(pushes) == 1000
    assert end == forces.duration_s
    assert 2.0 <= sizes.min() < 2.05
    assert 2.95 < sizes.max() <= 3.0
    assert all(0.1 <= p.end_s - p.start_s <= 0.2 and max(map(abs, p.point_m)) <= 0.3 for p in pushes)


def test_csv_holds_each_row_until_the_next(tmp_path: Path) -> None:
    """Rows act from their time to the next one's; the last ends the sequence; columns left out are zero."""
    file = tmp_path / "push.csv"
    file.write_text("t, fx, fy, py\n0, 0, 0, 0\n0.5, 3, -4, 0.1\n0.75, 0, 0, 0\n1.0, 9, 9, 9\n")
    forces = CsvForces(str(file))
    assert forces.duration_s == 1.0
    force, point = forces.columns(np.array([0.4, 0.5, 0.7, 0.8, 1.2]), 0.1)
    np.testing.assert_allclose(force[:, 0], [0, 3, 1.5, 0, 0], atol=1e-9)
    np.testing.assert_allclose(force[:, 1], [0, -4, -2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(point[1], [0, 0.1, 0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,fx\n0,1\n1,1\n", r"line 1: column 'fy' is missing; allowed: t, fx, fy, fz"),
        ("t,fx,fy,mass\n0,1,1,1\n1,1,1,1\n", r"line 1: column 'mass' is unknown"),
        ("t,fx,fy\n0,1,1\n1,x,1\n", r"line 3: fx must be a finite number, got 'x'"),
        ("t,fx,fy\n0,1,1\n1,,1\n", r"line 3: fx must be a finite number, got ''"),
        ("t,fx,fy\n0,1,inf\n1,1,1\n", r"line 2: fy must be a finite number, got 'inf'"),
        ("t,fx,fy\n0,1,1\n2,1,1\n2,1,1\n", r"line 4: t must grow from row to row, got 2 s after 2 s"),
        ("t,fx,fy\n-1,1,1\n2,1,1\n", r"line 2: t must not be negative"),
        ("t,fx,fy\n0,1,1\n", r"needs at least two rows"),
        ("", r"is no CSV file"),
    ],
)
def test_csv_says_which_line_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    """Every fault of a file is one line that names the file, the line and the column."""
    file = tmp_path / "push.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message) as error:
        CsvForces(str(file))
    assert "\n" not in str(error.value)
    assert "push.csv" in str(error.value)


def test_csv_must_exist(tmp_path: Path) -> None:
    """A missing file is named."""
    with pytest.raises(ConfigError, match=r"path: no file '.*nothing.csv'"):
        CsvForces(str(tmp_path / "nothing.csv"))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PaperForces(force_n=math.nan), r"force_n: must be a finite number in \]0, 1e\+06\] N, got nan"),
        (lambda: PaperForces(pushes=0), r"pushes: must be"),
        (lambda: Straight(force_n=(1.0, 2.0)), r"force_n: must be 3 numbers in N"),  # ty: ignore[invalid-argument-type]  # it is tested
        (lambda: Offcentre(point_m=(0.0, math.inf, 0.0)), r"point_m\[1\]"),
        (lambda: Chirp(end_hz=-1.0), r"end_hz: must be"),
        (lambda: RandomForces(push_s=(0.5, 0.2)), r"push_s: must be \[smallest, largest\], got \[0.5, 0.2\] s"),
    ],
)
def test_wrong_values_are_refused(make: Callable[[], object], message: str) -> None:
    """A value out of range, NaN or of the wrong length is refused on making the sequence."""
    with pytest.raises(ConfigError, match=message):
        make()


def test_every_sequence_has_a_file() -> None:
    """For each registered sequence there is a YAML file of its name."""
    files = {p.stem for p in (Path(__file__).parents[1] / "conf" / "forces").glob("*.yaml")}
    assert set(options("forces")) == files
