"""A diagnosis says where MuJoCo's own steps are so far off that a sensor would tell."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from runner.diagnosis.engine_steps import said_of_engine_steps
from runner.noise.measured import measure
from runner.recording import Span
from runner.simulate.gap import measure_gap
from runner.systems.case import open_case
from runner.systems.mechanism import MechanismSystem
from runner.systems.simulator import Run
from tests.mechanism_cases import followed, system_of, write_case
from tests.tosses import toss_case, world

MODEL = """<mujoco><option timestep="0.002"/><worldbody><body name="lever">
<joint name="hinge" axis="0 -1 0" damping="0.05" frictionloss="0.1" solreffriction="0.02 1"/>
<inertial pos="0 0 -0.3" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator><motor name="drive" joint="hinge"/></actuator></mujoco>"""
EPISODES = 2


def swung(
    noise_rad: float, folder: Path, model: str = MODEL, *, made_in_s: float = 0.002
) -> tuple[MechanismSystem, list[np.ndarray]]:
    """Return a lever that plain MuJoCo swung in steps of some length, and its true angles; the noise is stated.

    What is believed of it is the same but for the steps, in `model`.
    """
    swinging = mujoco.MjModel.from_xml_string(MODEL)
    swinging.opt.timestep = made_in_s
    angles, columns = [], []
    t = np.arange(200) * 0.01
    for episode in range(EPISODES):
        u = 2.0 * np.sin(5.0 * t + episode)
        angle = followed(swinging, u)
        angles.append(angle)
        columns.append({"t": t, "u": u, "q": angle + noise_rad * np.random.default_rng(episode).normal(size=len(t))})
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": {"q": {"joint": "hinge", "quantity": "position"}},
        "noise": {"q": noise_rad},
        "start": "rest",
    }
    return system_of(write_case(folder / "case", model, columns, nominal)), angles


def test_by_itself_the_engine_steps_as_plain_mujoco_does(tmp_path: Path) -> None:
    """And, beside the simulator that everything uses, is ahead by half a step."""
    system, angles = swung(1e-3, tmp_path)
    engine, step_s = system.by_engine_alone() or pytest.fail("there is none")
    assert step_s == 0.002
    for episode, angle in enumerate(angles):
        run = [Run((), np.zeros(2))]
        np.testing.assert_allclose(engine.predict(episode, run)[0][:, 0], angle, atol=1e-12)
        smooth = system.simulator().predict(episode, run)[0][:, 0]
        rate = np.gradient(smooth, 0.01)
        # the rest is what damping and soft friction, first order too, make of it
        assert rate @ (angle - smooth) / (rate @ rate) == pytest.approx(step_s / 2, rel=0.2)


@pytest.mark.parametrize(("noise_rad", "said"), [(1e-3, 1), (2e-2, 0)])
def test_it_is_said_where_the_sensor_would_tell(noise_rad: float, said: int, tmp_path: Path) -> None:
    """Of steps of 2 ms, which make some milliradians; not beside a coarse sensor."""
    system, _ = swung(noise_rad, tmp_path)
    starts = {e: np.zeros(2) for e in range(EPISODES)}
    found = said_of_engine_steps(system, measure(system), (), starts, system.stretches())
    assert len(found) == said
    assert all("`timestep` of 0.002 s" in note and "'q'" in note for note in found)


def test_nothing_is_said_beside_a_model_that_is_off_by_more(tmp_path: Path) -> None:
    """By far more than steps make, as from a wrong start: nobody shortens those for it."""
    system, _ = swung(1e-3, tmp_path)
    right, wrong = ({e: np.array([q, 0.0]) for e in range(EPISODES)} for q in (0.0, 0.3))
    measured, spans = measure(system), system.stretches()
    assert said_of_engine_steps(system, measured, (), right, spans) != ()
    assert said_of_engine_steps(system, measured, (), wrong, spans) == ()


def test_the_step_that_would_do_does(tmp_path: Path) -> None:
    """What is said to be short enough is, with half of what would be borne to spare; four times as long is not."""
    starts = {e: np.zeros(2) for e in range(EPISODES)}

    def said(step_s: float, name: str) -> tuple[str, ...]:
        system, _ = swung(1e-3, tmp_path / name, MODEL.replace("0.002", str(step_s)), made_in_s=1e-4)
        return said_of_engine_steps(system, measure(system), (), starts, system.stretches())

    (note,) = said(0.002, "first")
    enough_s = float(note.partition("set it to ")[2].partition(" there")[0])
    assert said(enough_s, "short") == said(1.9 * enough_s, "twice") == ()
    assert said(4.0 * enough_s, "long") != ()


@pytest.mark.parametrize(("height_m", "said"), [(5.0, 1), (0.4, 0)])
def test_it_is_said_of_what_flies_and_not_of_what_lands(height_m: float, said: int, tmp_path: Path) -> None:
    """A fall of half a second is 2 mm off in steps of 1 ms; in shorter ones a contact would be another."""
    toss_case(tmp_path / "case", world(), tosses=3, height_m=height_m, length_s=0.5)
    system = open_case(tmp_path / "case")
    assert isinstance(system, MechanismSystem)
    measured = measure(system, scatter=system.scatter())
    whole = [Span(e, 0, len(v)) for e, v in enumerate(measured.values)]
    starts = measure_gap(system, measured, horizons_s=()).starts
    assert len(said_of_engine_steps(system, measured, (), starts, whole)) == said
