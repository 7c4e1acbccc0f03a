"""An estimate that did not converge is a status of its run, told from what was measured and not from the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from runner.__main__ import main
from runner.estimation.averaged import Averaged
from runner.estimation.convergence import judged, unconverged
from runner.estimation.eq6 import ComEq6
from runner.estimation.joint import Joint
from runner.physics.forces import PaperForces, Straight
from runner.physics.scene import Dof, FloorContact, SceneConfig
from runner.teleop.estimators import Linear, Rotational
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.frames import RunResult, Status
from runner.teleop.link import LinkConfig, NoiseConfig
from runner.teleop.loop import run

NOISE = NoiseConfig(0.0005, 0.001, 0.005, 0.01)


def experiment(**changes: Any) -> Experiment:
    """Return the published experiment with changes."""
    base = Experiment(
        seed=0,
        scene=SceneConfig(),
        forces=PaperForces(),
        remote=RemoteConfig(),
        start=StartConfig(),
        link=LinkConfig(),
        estimator={"linear": Linear()},
    )
    return replace(base, **changes)


def judge(**changes: Any) -> RunResult:
    """Return the result of a run with its status."""
    given = experiment(**changes)
    return judged(given, run(given))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"link": LinkConfig(rate_hz=1.0)}, "moves otherwise than the remote"),
        ({"remote": RemoteConfig(mass_kg=0.001)}, "have it far lower"),
        ({"remote": RemoteConfig(com_m=(0.0, 0.4, 0.0))}, "% higher"),
        ({"remote": RemoteConfig(com_m=(0.0, 0.2, 0.0))}, "% lower"),
        (
            {"forces": Straight(), "estimator": {"turning": Rotational()}},
            "turning: the pushes tell nothing",
        ),
        ({"forces": PaperForces(force_n=1.0)}, "the remote was never seen to move under a push"),
    ],
    ids=["1 Hz", "light", "CoM", "CoM, less", "untold", "unmoved"],
)
def test_wrong_numbers_are_not_called_done(changes: dict[str, Any], words: str) -> None:
    """Rates, masses and centres of mass at which the published rule goes astray: said, with what is wrong."""
    result = judge(**changes)
    assert result.status is Status.unconverged
    assert words in result.reason


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"start": StartConfig(30.0)},
        {"remote": RemoteConfig(mass_kg=0.1)},
        {"link": LinkConfig(rate_hz=10.0)},
        {"link": LinkConfig(delay_s=0.1, jitter_s=0.05, loss=0.2)},
        {"link": LinkConfig(noise=NOISE), "estimator": {"linear_median": Averaged(Linear())}},
        {"forces": PaperForces(pushes=1), "link": LinkConfig(noise=NOISE), "estimator": {"joint": Joint(noise=NOISE)}},
        {
            "remote": RemoteConfig(com_m=(0.05, 0.0, 0.0)),
            "start": StartConfig(3.0),
            "estimator": {"eq6": ComEq6()},
        },
    ],
    ids=["paper", "heavy start", "light", "10 Hz", "late", "noise", "joint", "eq. 6"],
)
def test_right_numbers_are_done(changes: dict[str, Any]) -> None:
    """Where the estimate is right, or as right as it says, nothing is said against it."""
    assert judge(**changes).status is Status.done


def test_the_truth_has_no_say() -> None:
    """The verdict is the same whatever is called the truth: it is made of what was measured."""
    given = experiment(link=LinkConfig(rate_hz=1.0))
    result = run(given)
    relabelled = replace(
        result, parameters={"linear": {"mass_kg": result.parameters["linear"]["mass_kg"]._replace(true=5.86)}}
    )
    assert unconverged(given, result) == unconverged(given, relabelled) != {}


def test_scenes_that_are_not_planar_say_nothing() -> None:
    """There is no body to send through the intervals once more."""
    free = SceneConfig(dof=Dof.free, contact=FloorContact.corners)
    assert judge(scene=free, forces=PaperForces(pushes=1), link=LinkConfig(rate_hz=1.0)).status is Status.done


def test_row_terminal_and_sweep_say_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The run ends with 0, its row has the status and the reason, a sweep counts such runs apart from failed ones."""
    assert main(["link.rate_hz=1", "log.rrd=off", f"out={tmp_path / 'r'}"]) == 0
    out = capsys.readouterr().out
    assert "not converged: linear: with the mass that it ends at the body moves otherwise than the remote" in out
    row = pd.read_parquet(tmp_path / "r" / "summary.parquet").iloc[0]
    assert (row["status"], round(row["mass_final_kg"], 2)) == ("not converged", 5.86)
    assert main(["-m", "link.rate_hz=1,60", "log.rrd=off", f"out={tmp_path / 's'}"]) == 0
    assert "2 runs in" in (out := capsys.readouterr().out)
    assert "1 of them did not converge" in out
    assert main(["table", str(tmp_path / "s"), "format=csv"]) == 0
    assert "not converged" in capsys.readouterr().out
