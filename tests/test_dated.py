"""What pushed once and stands in no log is dated, and nothing is where nobody pushed."""

from __future__ import annotations

from pathlib import Path

import pytest

from runner.localise import dated
from runner.localise.dated import DatedDisturbance, dated_disturbances
from runner.noise.measured import measure
from tests.mechanism_cases import system_of, write_case
from tests.servo_arm import JOINTS, NOMINAL, Push, recorded, written


def found_in(
    folder: Path, friction: float, push: Push | None, *, samples: int, count: int = 4
) -> tuple[DatedDisturbance, ...]:
    """Return what is found in some episodes, the third of which may be disturbed; friction is not in the model."""
    model = written(10.0, 0.4)
    episodes = [
        recorded(model, k, samples=samples, step_s=5e-4, friction=friction, push=push if k == 2 else None)
        for k in range(count)
    ]
    case = write_case(folder, model, episodes, NOMINAL)
    system = system_of(case)
    return dated_disturbances(system, system.simulator(threads=1), (), measure(system))


@pytest.mark.parametrize(
    ("friction", "push"),
    [
        pytest.param(0.0, (1, 3.33, 4.12, 0.15), id="a good model"),
        pytest.param(0.05, (0, 6.1, 6.4, -0.8), id="a model without friction", marks=pytest.mark.slow),
    ],
)
def test_a_push_is_dated(friction: float, push: Push, tmp_path: Path) -> None:
    """Episode, joint, beginning and end within 50 ms, size within 20 %."""
    joint, begin, end, torque = push
    (only,) = found_in(tmp_path, friction, push, samples=round(100 * end) + 101)
    assert only.episode == 2
    assert only.label == f"torque at '{JOINTS[joint]}' [N m]"
    assert only.force[0] == pytest.approx(torque, rel=0.2)
    assert only.from_s[0] == pytest.approx(begin, abs=0.05)
    assert only.until_s[0] == pytest.approx(end, abs=0.05)
    assert f"torque at '{JOINTS[joint]}'" in only.sentence


def test_what_has_no_size_is_no_push(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows that stand out by chance: the force that fits them is no larger than its own error."""
    monkeypatch.setattr(dated, "_runs", lambda *_: [dated._Run(2, 1, 300, 360, 50.0)])
    assert found_in(tmp_path, 0.0, None, samples=401, count=3) == ()


def test_friction_that_is_missing_is_no_push(tmp_path: Path) -> None:
    """It is missing everywhere, at every reversal."""
    assert found_in(tmp_path, 0.05, None, samples=501) == ()
