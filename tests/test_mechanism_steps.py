"""Physics steps are so short that no number that is fitted notices them, and no shorter."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from runner.effects.mechanism import Compliance, Stribeck
from runner.recording.model_form import read_model_case
from runner.systems.mechanism import MechanismSystem
from runner.systems.simulator import Run
from tests.mechanism_cases import PENDULUM, joint_channels, slide_case, system_of, write_case

# each pushed by a velocity-damped servo of some tens of hertz, in steps of the file that would do for one reading
ARM = """<mujoco><option timestep="0.001" gravity="0 0 -9.81"/>
<worldbody><body name="upper"><joint name="shoulder" axis="0 -1 0" damping="0.4"/>
<inertial pos="0.14 0 0" mass="1.4" diaginertia="0.012 0.012 0.012"/>
<body name="fore" pos="0.30 0 0"><joint name="elbow" axis="0 -1 0" damping="0.2"/>
<inertial pos="0.13 0 0" mass="0.8" diaginertia="0.007 0.007 0.007"/></body></body></worldbody>
<actuator><position name="shoulder" joint="shoulder" kp="60" kv="3"/>
<position name="elbow" joint="elbow" kp="25" kv="1.2"/></actuator></mujoco>"""
STEP_S = 0.01


def arm_accelerates(q: np.ndarray, dq: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the accelerations of `ARM`, (2,), by Lagrange's equations of two links in a vertical plane."""
    m1, m2, l1, c1, c2, i1, i2, g = 1.4, 0.8, 0.3, 0.14, 0.13, 0.012, 0.007, 9.81
    cross, s = m2 * l1 * c2 * np.cos(q[1]), m2 * l1 * c2 * np.sin(q[1])
    m12 = i2 + m2 * c2**2 + cross
    inertia = [[i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2) + 2 * cross, m12], [m12, i2 + m2 * c2**2]]
    fore = m2 * g * c2 * np.cos(q[0] + q[1])
    weight = np.array([(m1 * c1 + m2 * l1) * g * np.cos(q[0]) + fore, fore])
    centrifugal = s * np.array([-dq[1] * (2 * dq[0] + dq[1]), dq[0] ** 2])
    servo = np.array([60.0, 25.0]) * (target - q) - np.array([3.4, 1.4]) * dq
    return np.linalg.solve(inertia, servo - weight - centrifugal)


def arm_moves(targets: np.ndarray) -> np.ndarray:
    """Return what an arm does whose targets (T, 2) are held, from rest: angles and their rates, (T, 4)."""
    states = [np.concatenate([targets[0], np.zeros(2)])]
    for target in targets[:-1]:
        answer = solve_ivp(
            lambda _, y, u=target: np.concatenate([y[2:], arm_accelerates(y[:2], y[2:], u)]),
            (0.0, STEP_S),
            states[-1],
            rtol=1e-8,
            atol=1e-10,
        )
        states.append(answer.y[:, -1])
    return np.array(states)


@cache
def arm_recorded(phase: float) -> dict[str, np.ndarray]:
    """Return an episode of an arm, without noise."""
    t = np.arange(251) * STEP_S
    targets = np.stack([0.3 + 0.4 * np.sin(5 * t + phase), 0.6 * np.sin(7 * t + 2 * phase)], axis=1)
    q = arm_moves(targets)[:, :2]
    return {"t": t, "ua": targets[:, 0], "ub": targets[:, 1], "q_shoulder": q[:, 0], "q_elbow": q[:, 1]}


def arm_system(folder: Path, noise_rad: float, *, model: str = ARM) -> MechanismSystem:
    """Return an arm that was recorded in two episodes with this noise, as is stated."""
    channels = joint_channels(["shoulder", "elbow"], velocities=False)
    nominal = {
        "commands": {"ua": {"actuator": "shoulder"}, "ub": {"actuator": "elbow"}},
        "channels": channels,
        "noise": dict.fromkeys(channels, noise_rad),
        "start": "rest",
    }
    return system_of(write_case(folder, model, [arm_recorded(0.0), arm_recorded(2.0)], nominal))


def missed(system: MechanismSystem) -> float:
    """Return what a system misses of its recording from the true starts, in noises, over all readings: a norm."""
    left = [
        system.simulator().predict(e, [Run((), np.concatenate([v[0], np.zeros(2)]))])[0] - v
        for e, v in enumerate(system.values())
    ]
    return float(np.linalg.norm(np.concatenate(left) / system.stated_noise()))


def test_no_fit_notices_the_steps_of_an_arm(tmp_path: Path):
    """By equations and an integrator that are not ours: all readings together are off by less than one noise."""
    assert missed(arm_system(tmp_path, 2e-4)) < 1.0


def test_friction_that_falls_with_speed_is_of_second_order(tmp_path: Path):
    """A carriage is slowed down, and turns round at the peak of its friction: half the step, a quarter of the error."""
    folder = slide_case(tmp_path, friction=3.0, step_s=0.01, length_s=1.0, command=lambda t: np.full_like(t, -8.0))
    t, speeds = np.arange(101) * 0.01, np.linspace(0.4, 0.7, 12)

    def moved(speed: float) -> np.ndarray:
        def change(way: float, v: float) -> float:
            return (-8.0 - way * 3.0 * (1.0 + np.exp(-abs(v) / 0.2))) / 2.0

        slowing = solve_ivp(
            lambda _, y: [y[1], change(1.0, y[1])], (0, 1), [0.0, speed], t_eval=t, events=lambda _, y: y[1],
            dense_output=True, rtol=1e-9, atol=1e-11,
        )  # fmt: skip
        turn, state = float(slowing.t_events[0][0]), slowing.y_events[0][0]
        back = solve_ivp(
            lambda _, y: [y[1], change(-1.0, y[1])], (turn, 1), state, t_eval=t[t > turn], rtol=1e-9, atol=1e-11
        )
        return np.concatenate([slowing.sol(t[t <= turn])[0], back.y[0]])

    expected = np.array([moved(speed) for speed in speeds])
    runs = [Run((Stribeck("slide", 1.0, 0.2, 1.0),), np.array([0.0, speed])) for speed in speeds]
    recording = read_model_case(folder)
    errors = [
        np.linalg.norm(MechanismSystem(recording, step_s=step_s).simulator().predict(0, runs)[..., 0] - expected)
        for step_s in (0.005, 0.0025)
    ]
    assert errors[1] < errors[0] / 3.0


def test_where_the_noise_is_coarse_steps_are_long(tmp_path: Path):
    """Steps of a third of the sample period will do where they do not show, and shorter ones would cost the more."""
    coarse, fine = (arm_system(tmp_path / str(noise), noise) for noise in (5e-3, 2e-4))
    assert coarse.step_s > 1.2 * fine.step_s
    assert missed(coarse) < 1.0


def test_steps_settle_by_how_uncertain_residuals_are(tmp_path: Path):
    """A search begins in steps that no single reading tells; where the model is far off otherwise, they will do."""
    system = arm_system(tmp_path, 4e-6)
    rough = system.roughly()
    assert rough.step_s > 4.0 * system.step_s
    assert rough.settled(1e12) is None
    settled = rough.settled(1.0)
    assert settled is not None
    assert settled.step_s == system.step_s
    assert settled.settled(4.0) is None
    between = rough.settled(4.0)
    assert between is not None
    assert system.step_s < between.step_s < rough.step_s


def test_a_spring_settles_where_it_may_be_meant(tmp_path: Path):
    """In a search how it rings may be off; of what is near the likeliest it is not, whatever others ask."""
    system = arm_system(tmp_path, 5e-3)
    rough, springs = system.roughly(), (Compliance("elbow", 50.0),)
    assert rough.step_s == system.step_s
    assert rough.settled(1.0) is None
    settled = rough.settled(1.0, [(), springs])
    assert settled is not None
    fine, coarse, own = (s.simulator().step_with(springs) for s in (settled, rough, system))
    assert fine == own < 0.5 * coarse
    assert settled.settled(1.0, [springs]) is None


def test_steps_are_shorter_than_the_files_where_it_takes_that(tmp_path: Path):
    """A pendulum in steps of the file, 2.5 ms, swings visibly too fast; its period is the closed form's."""
    t = np.arange(2001) * 0.005
    inertia = 0.01 + 1.5 * 0.4**2
    rate = np.sqrt(1.5 * 9.81 * 0.4 / inertia) * (1 - 0.1**2 / 16)
    columns = {"t": t, "u": 0.0 * t, "q_hinge": 0.1 * np.cos(rate * t), "dq_hinge": -0.1 * rate * np.sin(rate * t)}
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"]),
        "noise": {"q_hinge": 5e-6, "dq_hinge": 1e-4},
    }
    model = PENDULUM.format(damping=0).replace('timestep="0.0005"', 'timestep="0.0025"')
    system = system_of(write_case(tmp_path, model, [columns, columns], nominal))
    q = system.simulator().predict(0, [Run((), np.array([0.1, 0.0]))])[0][:, 0]
    assert system.step_s < 0.001
    # the series goes on with amplitude^4 11 / 3072, and a third harmonic of amplitude^3 / 192
    assert np.abs(q - columns["q_hinge"]).max() < 1e-5


def test_contacts_stay_as_hard_as_the_steps_of_the_file_make_them(tmp_path: Path):
    """Where bodies may touch, steps are not shorter than the file's, whatever the noise."""
    solid = ARM.replace("</body></body>", '<geom size=".01" mass="0"/></body></body><geom type="plane" size="1 1 1"/>')
    assert arm_system(tmp_path, 1e-6, model=solid).step_s > 0.999 * mujoco.MjModel.from_xml_string(solid).opt.timestep


def test_where_halving_does_not_help_steps_stay(tmp_path: Path):
    """A slide that nothing moves is at rest in steps of any length, and one is as good as another."""
    system = system_of(slide_case(tmp_path, friction=1.0))
    assert system.step_s == system.recording.step_s / 3
