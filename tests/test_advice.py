"""What is advised is written as it is read."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.diagnosis import advice
from runner.effects.vocabulary import spoken


@pytest.mark.parametrize(
    ("effect", "read"),
    [
        ("joint_friction[upper_arm]", "joint friction of upper_arm"),
        ("servo_gain[*]", "servo gain of all"),
        ("floor_tilt", "floor tilt"),
    ],
)
def test_targets_keep_their_names(effect: str, read: str) -> None:
    """What a part is called is its owner's choice, underscores and all."""
    assert spoken(effect) == read


def test_the_next_experiment_names_effects_as_the_ranking_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """`actuator delay of pivot_servo`, not `actuator delay[pivot servo]`."""

    def contender(_: Any, ranked: Any, __: Any) -> Any:
        fit = SimpleNamespace(explanation=SimpleNamespace(names=ranked.effects), x=None)
        return SimpleNamespace(fit=fit, evidence=SimpleNamespace(covariance=None))

    monkeypatch.setattr(advice, "contender_of", contender)
    monkeypatch.setattr(advice, "best_experiment", lambda *_, **__: None)
    system = SimpleNamespace(
        vocabulary=(), experiment="experiment", reach="these commands", reach_further="command more"
    )
    fitter: Any = SimpleNamespace(system=system, measured=None, context=None)
    ranked: Any = [
        SimpleNamespace(effects=(name,), equivalent=(), probability=0.5)
        for name in ("actuator_delay[pivot_servo]", "observation_delay")
    ]
    found: Any = None
    assert advice.next_push(ranked, found, (), fitter, None) == (
        "No experiment within these commands would tell actuator delay of pivot_servo from observation delay; "
        "command more."
    )


def test_no_experiment_is_proposed_to_tell_what_is_one() -> None:
    """Of what such recordings cannot tell from the answer; of another rival an experiment is sought."""
    system = SimpleNamespace(vocabulary=(), experiment="toss", reach="these tosses", reach_further="toss harder")
    fitter: Any = SimpleNamespace(system=system, measured=None, context=None)
    ranked: Any = [SimpleNamespace(effects=("frame_tilt",), equivalent=(("gravity",),), probability=0.97)]
    found: Any = SimpleNamespace(contenders=())

    def rival(name: str) -> Any:
        fit = SimpleNamespace(explanation=SimpleNamespace(names=(name,)), x=None, information=lambda: np.eye(1))
        return SimpleNamespace(confounded=True, rival=name, instead=fit)

    lead = SimpleNamespace(fit=SimpleNamespace(explanation=SimpleNamespace(names=("frame_tilt",)), x=None))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(advice, "contender_of", lambda *_: lead)
        patched.setattr(advice, "best_experiment", lambda *_, **__: None)
        assert advice.next_push(ranked, found, [rival("gravity")], fitter, None) is None
        other = advice.next_push(ranked, found, [rival("gravity"), rival("air_drag")], fitter, None)
    assert other == "No toss within these tosses would tell frame tilt from air drag; toss harder."
