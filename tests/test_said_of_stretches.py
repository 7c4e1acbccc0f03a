"""Why models are replayed for less than an episode is said as it is."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.diagnosis.attempt import Attempt
from runner.recording import Span
from tests.mechanism_cases import joint_channels, system_of, write_case

WHOLE = (Span(0, 0, 800), Span(1, 0, 800))
HALVES = tuple(Span(e, a, a + 400) for e in (0, 1) for a in (0, 400))
EIGHTHS = tuple(Span(e, a, a + 100) for e in (0, 1) for a in range(0, 800, 100))


@pytest.mark.parametrize(
    ("known", "replayed", "for_time", "piles_up", "why"),
    [
        (WHOLE, WHOLE, False, False, None),
        (
            HALVES,
            HALVES,
            True,
            False,
            "4 s at a time, each with a start of its own: to save time, as about 30 s are searched",
        ),
        (
            HALVES,
            HALVES,
            False,
            False,
            "4 s at a time, each with a start of its own: over longer times small differences grow",
        ),
        (
            HALVES,
            EIGHTHS,
            True,
            False,
            "s at a time, each with a start of its own: over longer times small differences",
        ),
        (
            HALVES,
            EIGHTHS,
            True,
            True,
            "s at a time, each with a start of its own: over longer times what the model lacks",
        ),
    ],
)
def test_why_models_are_replayed_for_less(
    known: Any, replayed: Any, for_time: bool, piles_up: bool, why: str | None
) -> None:
    class Recorded(SimpleNamespace):
        def __len__(self) -> int:
            return 800

    recording = SimpleNamespace(episodes=[Recorded(step_s=0.01)] * 2)
    system = SimpleNamespace(
        recording=recording,
        stretches=lambda: known,
        stretched_for_time=for_time,
        searched_s=30.0,
        has_noisy_drive=False,
    )
    fitter: Any = SimpleNamespace(system=system, measured=SimpleNamespace(spans=replayed))
    found: Any = None
    said = Attempt((0,), (1,), fitter, found, piles_up=piles_up).said_of_stretches
    assert said == () if why is None else why in said[0]


@pytest.mark.parametrize(("lean", "for_time"), [(0.0, True), (np.pi, False)])
def test_a_pendulum_on_its_head_is_cut_for_what_it_does(tmp_path: Path, lean: float, for_time: bool) -> None:
    """One that hangs is cut for time alone: five episodes of ten seconds are more than is searched."""
    model = """<mujoco><option timestep="0.002"/><worldbody><body name="lever">
    <joint name="hinge" type="hinge" axis="0 1 0" damping="0.05"/>
    <inertial pos="0 0 -0.3" mass="1" diaginertia=".01 .01 .01"/></body></worldbody>
    <actuator><motor name="drive" joint="hinge"/></actuator></mujoco>"""
    rng, t = np.random.default_rng(0), np.arange(0.0, 10.0, 0.02)
    noise = {"q_hinge": 1e-3, "dq_hinge": 1e-2}
    episodes = [
        {
            "t": t,
            "u": 0.1 * np.sin(3.0 * t + k),
            "q_hinge": lean + 0.03 * np.sin(3.0 * t + k) + 1e-3 * rng.normal(size=len(t)),
            "dq_hinge": 0.09 * np.cos(3.0 * t + k) + 1e-2 * rng.normal(size=len(t)),
        }
        for k in range(5)
    ]
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["hinge"]), "noise": noise}
    system = system_of(write_case(tmp_path / "case", model, episodes, nominal))
    assert max(s.end - s.begin for s in system.stretches()) < len(t)
    assert system.stretched_for_time == for_time
