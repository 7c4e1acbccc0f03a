"""Joints that were measured beyond their range: told where the model's own stop would not have let them go so far."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from runner.recording.model_form import read_model_case
from tests.mechanism_cases import ARM, joint_channels, write_case

LIMITED = ARM.replace('axis="0 -1 0" damping="0.05"', 'axis="0 -1 0" damping="0.05" range="-100 100"')
STEP_S = 0.005


def case_notes(folder: Path, shoulder: np.ndarray, drive: np.ndarray | float = 0.0) -> tuple[str, ...]:
    """Return what is said of a case of an arm whose shoulder was measured so, in rad, in its second episode."""
    t = np.arange(len(shoulder)) * STEP_S
    columns = [{"t": t, "u": drive + 0 * t, "q_shoulder": q, "q_elbow": 0 * t} for q in (0.1 * np.sin(t), shoulder)]
    nominal = {
        "commands": {"u": {"actuator": "shoulder"}},
        "channels": joint_channels(["shoulder", "elbow"], velocities=False),
    }
    notes = read_model_case(write_case(folder, LIMITED, columns, nominal)).notes
    return tuple(note for note in notes if "range" in note)


def test_a_joint_beyond_its_range_is_told(tmp_path: Path):
    t = np.arange(400) * STEP_S
    noise = np.radians(0.03) * np.random.default_rng(1).standard_normal(len(t))
    (note,) = case_notes(tmp_path, np.radians(-106.5) * np.sin(1.5 * t) + noise)
    assert note.startswith("joint 'shoulder' was measured at -106.")
    assert "beyond its range of -100 to 100 deg in the MJCF" in note
    assert "% of its samples in episode 1)" in note
    assert "widen `range` if that is so" in note


@pytest.mark.parametrize("size_deg", [99.0, 100.1])
def test_what_noise_takes_beyond_is_not_told(tmp_path: Path, size_deg: float):
    t = np.arange(400) * STEP_S
    noise = np.radians(0.05) * np.random.default_rng(1).standard_normal(len(t))
    assert not case_notes(tmp_path, np.radians(size_deg) * np.sin(3 * t) + noise)


def test_a_lone_sample_is_none(tmp_path: Path):
    shoulder = np.sin(np.arange(400) * STEP_S)
    shoulder[200] = 2.5
    assert not case_notes(tmp_path, shoulder)


@pytest.mark.parametrize("torque", [-6.0, -60.0])
def test_the_stop_of_the_model_itself_gives_way(tmp_path: Path, torque: float):
    """What MuJoCo does at its stop, by a hit or pressed against it, is no contradiction to the model."""
    model = mujoco.MjModel.from_xml_string(LIMITED)
    data = mujoco.MjData(model)
    data.ctrl[0] = torque
    shoulder = []
    for _ in range(200):
        shoulder.append(float(data.qpos[0]))
        mujoco.mj_step(model, data, round(STEP_S / model.opt.timestep))
    assert min(shoulder) < np.radians(-100.5)
    assert not case_notes(tmp_path, np.array(shoulder), torque)


def test_a_model_that_diverges_at_its_stop_says_nothing(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """MuJoCo begins anew, time included, after a bad acceleration: no case may be read for ever, nor print of it."""
    model = """<mujoco><option timestep="0.02"/><worldbody><body>
      <joint name="hinge" axis="0 1 0" range="-30 30"/>
      <geom type="capsule" size=".01" fromto="0 0 0 0 0 .2" mass=".05"/>
    </body></worldbody><actuator><position name="servo" joint="hinge" kp="5000"/></actuator></mujoco>"""
    t = np.arange(200) * 0.02
    column = {"t": t, "u": 0.9 * np.sin(np.pi * t), "q_hinge": 0.9 * np.sin(np.pi * t)}
    nominal = {"commands": {"u": {"actuator": "servo"}}, "channels": joint_channels(["hinge"], velocities=False)}
    assert not [
        n for n in read_model_case(write_case(tmp_path, model, [column, column], nominal)).notes if "range" in n
    ]
    assert "QACC" not in "".join(capfd.readouterr())


def test_what_a_recorded_force_presses_is_not_told(tmp_path: Path):
    """The stop gives way to a force that is not replayed."""
    t = np.arange(400) * STEP_S
    shoulder = np.radians(-106.5) * np.sin(1.5 * t)
    force = dict.fromkeys(("fx", "fy", "fz", "px", "py", "pz"), 0.0 * t)
    columns = [{"t": t, "u": 0 * t, "q_shoulder": shoulder, "q_elbow": 0 * t, **force}] * 2
    nominal = {
        "commands": {"u": {"actuator": "shoulder"}},
        "forces": [{"body": "forearm", "force": ["fx", "fy", "fz"], "point": ["px", "py", "pz"]}],
        "channels": joint_channels(["shoulder", "elbow"], velocities=False),
    }
    notes = read_model_case(write_case(tmp_path, LIMITED, columns, nominal)).notes
    assert not [n for n in notes if "range" in n]
