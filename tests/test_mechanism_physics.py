"""Mechanisms are simulated as closed forms and independent integrators say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.systems.mechanism import MechanismSystem
from runner.systems.simulator import Run
from tests.mechanism_cases import ARM, MOTOR, PENDULUM, joint_channels, slide_case, system_of, write_case

SERVO = '<position name="drive" joint="slide" kp="200" kv="20"/>'


def predicted(system: MechanismSystem, start: list[float], episode: int = 0) -> np.ndarray:
    return system.simulator().predict(episode, [Run((), np.array(start))])[0]


@pytest.mark.parametrize("integrator", ["implicitfast", "Euler", "RK4"])
def test_a_pendulum_swings_with_its_period(tmp_path: Path, integrator: str):
    """Twenty times 2 pi sqrt(I / m g l) (1 + amplitude^2 / 16), the first term of its series."""
    t = np.arange(2001) * 0.005
    columns = {"t": t, "u": 0.0 * t, "q_hinge": 0.0 * t, "dq_hinge": 0.0 * t}
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["hinge"])}
    system = system_of(
        write_case(tmp_path, PENDULUM.format(damping=0).replace("implicitfast", integrator), [columns], nominal)
    )
    q, dq = predicted(system, [0.02, 0.0]).T
    inertia = 0.01 + 1.5 * 0.4**2
    rate = np.sqrt(1.5 * 9.81 * 0.4 / inertia) * (1 - 0.02**2 / 16)
    assert q == pytest.approx(0.02 * np.cos(rate * t), abs=5e-6)
    assert dq == pytest.approx(-0.02 * rate * np.sin(rate * t), abs=3e-5)


@pytest.mark.parametrize("speed", [0.4, -0.9])
def test_dry_friction_stops_a_slide_after_the_coulomb_distance(tmp_path: Path, speed: float):
    """v0^2 m / (2 F), after v0 m / F; then it stays."""
    system = system_of(slide_case(tmp_path, friction=3.0, mass=2.0))
    q, dq = predicted(system, [0.0, speed]).T
    t = system.recording.episodes[0].t_s
    assert q[-1] == pytest.approx(np.sign(speed) * speed**2 * 2.0 / (2 * 3.0), rel=1e-4)
    moving = t < abs(speed) * 2.0 / 3.0
    assert dq[moving] == pytest.approx((speed - np.sign(speed) * 1.5 * t)[moving], abs=1e-6)
    assert np.abs(np.diff(q[t > abs(speed) * 2.0 / 3.0 + 0.02])).max() < 1e-7


@pytest.mark.parametrize("damping", [1.0, 30.0])
def test_damping_slows_a_slide_exponentially(tmp_path: Path, damping: float):
    """Speed is v0 exp(-b t / m): the trapezoidal rule has no error of first order."""
    system = system_of(slide_case(tmp_path, damping=damping, mass=2.0))
    q, dq = predicted(system, [0.0, 1.0]).T
    decay = np.exp(-damping * system.recording.episodes[0].t_s / 2.0)
    assert dq == pytest.approx(decay, abs=2e-4)
    assert q == pytest.approx(2.0 / damping * (1 - decay), abs=1e-5)


def test_a_servo_settles_as_its_gains_say(tmp_path: Path):
    """Step of the target: the under-damped second-order answer with kp, kv and the mass."""
    case = slide_case(tmp_path, actuator=SERVO, command=lambda t: np.where(t < 0.5 - 1e-9, 0.0, 0.1), start="rest")
    system = system_of(case)
    q, _ = predicted(system, [0.0, 0.0]).T
    t = system.recording.episodes[0].t_s - 0.5
    decay, rate = 20 / 4.0, np.sqrt(200 / 2.0 - (20 / 4.0) ** 2)
    answer = 0.1 * (1 - np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t)))
    assert q == pytest.approx(np.where(t > 0, answer, 0.0), abs=2e-6)


def test_a_servo_at_its_limit_pushes_with_it(tmp_path: Path):
    """Full force is m a, as long as the target is far; damping of the servo does not count meanwhile."""
    servo = SERVO.replace("/>", ' forcerange="-4 4"/>')
    case = slide_case(tmp_path, actuator=servo, command=lambda t: np.full_like(t, 50.0), length_s=0.5)
    system = system_of(case)
    q, dq = predicted(system, [0.0, 0.0]).T
    t = system.recording.episodes[0].t_s
    assert dq == pytest.approx(2.0 * t, rel=1e-9, abs=1e-4)
    # but for its first step
    assert q == pytest.approx(t**2, abs=0.5 * 10 * system.step_s**2)


def test_a_force_turns_a_sliding_carriage_round(tmp_path: Path):
    """Reversals under dry friction are exact within a step: F acts against the motion until it turns."""
    case = slide_case(tmp_path, friction=2.0, command=lambda t: np.full_like(t, -5.0), length_s=1.0)
    system = system_of(case)
    t = system.recording.episodes[0].t_s
    for speed in (0.3, 0.301, 0.3037, 0.306):
        q, dq = predicted(system, [0.0, speed]).T
        turn = speed / 3.5
        after = np.maximum(t - turn, 0.0)
        assert dq == pytest.approx(np.where(t < turn, speed - 3.5 * t, -1.5 * after), abs=1e-5)
        assert q[-1] == pytest.approx(speed * turn / 2 - 0.75 * after[-1] ** 2, abs=2e-5)


def arm_equations(torque, target):
    """Return the accelerations of `ARM`, from Lagrange's equations of two links in a vertical plane."""
    m1, m2, l1, c1, c2, i1, i2, g = 1.2, 0.7, 0.3, 0.15, 0.1, 0.02, 0.01, 9.81

    def change(t: float, y: np.ndarray) -> np.ndarray:
        a, b, da, db = y
        cross = m2 * l1 * c2
        m11 = i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2) + 2 * cross * np.cos(b)
        m12 = i2 + m2 * c2**2 + cross * np.cos(b)
        m22 = i2 + m2 * c2**2
        s = cross * np.sin(b)
        servo = np.clip(6 * (target(t) - b) - 0.4 * db, -1.5, 1.5)
        pull = m2 * g * c2 * np.sin(a + b)
        f1 = torque(t) - 0.05 * da + s * (2 * da * db + db**2) - (m1 * c1 + m2 * l1) * g * np.sin(a) - pull
        f2 = servo - 0.02 * db - s * da**2 - pull
        return np.array([da, db, *np.linalg.solve([[m11, m12], [m12, m22]], [f1, f2])])

    return change


def test_an_arm_moves_as_another_integrator_says(tmp_path: Path):
    """Coriolis forces, a servo that saturates, held commands: below a tenth of 1 mrad and of 10 mrad/s."""
    t = np.arange(401) * 0.01
    torque, target = 3.0 * np.sign(np.sin(3.0 * t)), 1.2 * np.sin(5.0 * t)

    def held(values):
        return lambda time: values[min(int(time / 0.01 + 1e-9), len(values) - 1)]

    # each sample on its own: within it the commands are constant
    states = [np.array([0.8, -0.4, 1.0, -2.0])]
    for k in range(len(t) - 1):
        change = arm_equations(held(torque), held(target))
        span = (t[k], t[k + 1])
        middle = (t[k] + t[k + 1]) / 2
        answer = solve_ivp(lambda _, y, f=change, at=middle: f(at, y), span, states[-1], rtol=1e-9, atol=1e-11)
        states.append(answer.y[:, -1])
    truth = np.array(states)
    columns = {"t": t, "ua": torque, "ub": target}
    columns |= dict(zip(("q_shoulder", "q_elbow", "dq_shoulder", "dq_elbow"), truth.T, strict=True))
    nominal = {
        "commands": {"ua": {"actuator": "shoulder"}, "ub": {"actuator": "elbow"}},
        "channels": joint_channels(["shoulder", "elbow"]),
        "noise": {"q_shoulder": 1e-3, "q_elbow": 1e-3, "dq_shoulder": 1e-2, "dq_elbow": 1e-2},
    }
    system = system_of(write_case(tmp_path, ARM, [columns], nominal))
    error = (predicted(system, list(states[0])) - truth) / [1e-3, 1e-3, 1e-2, 1e-2]
    assert system.step_s > 0.0005
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 0.1


def test_errors_fall_with_the_square_of_the_step(tmp_path: Path):
    """Halving the step quarters the error of a damped, swinging arm."""
    from runner.systems.mechanism.simulator import MechanismSimulator, Stretch

    t = np.arange(201) * 0.008
    columns = {"t": t, "ua": np.sin(4 * t), "ub": 0.3 * np.sin(2 * t)}
    columns |= dict.fromkeys(("q_shoulder", "q_elbow", "dq_shoulder", "dq_elbow"), np.sin(t))
    nominal = {
        "commands": {"ua": {"actuator": "shoulder"}, "ub": {"actuator": "elbow"}},
        "channels": joint_channels(["shoulder", "elbow"]),
    }
    system = system_of(write_case(tmp_path, ARM, [columns], nominal))
    start = np.array([1.0, 0.5, -1.0, 2.0])

    def end(step_s: float) -> np.ndarray:
        simulator = MechanismSimulator(system.recording, system.simulator().models, step_s, 1)
        return simulator.simulate([Stretch(0, 0, len(t), (), start)])[0]

    exact = end(0.008 / 64)
    errors = [np.abs(end(0.008 / n) - exact).max() for n in (2, 4, 8)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.25)


def test_what_diverges_is_nan_and_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd):
    """A spring that pushes away makes NaN, not a state that began anew, and MuJoCo writes nothing."""
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    case = slide_case(tmp_path / "case", actuator='<position name="drive" joint="slide" kp="-2e5"/>', length_s=1.0)
    system = MechanismSystem(system_of(case).recording, step_s=0.001)
    q, dq = predicted(system, [0.01, 0.0]).T
    assert np.isfinite(q[0])
    assert np.isnan(q[-1])
    assert np.isnan(dq[-1])
    assert list((tmp_path / "cwd").iterdir()) == []
    assert "WARNING" not in capfd.readouterr().err


def test_held_commands_act_from_their_sample_on(tmp_path: Path):
    """On an uneven clock the impulse until each sample is the exact one of what was held."""
    rng = np.random.default_rng(1)
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.003, 0.009, 200))])
    force = rng.normal(0, 2, len(t))
    case = slide_case(tmp_path, command=lambda _: force, t_s=t, actuator=MOTOR)
    system = system_of(case)
    _, dq = predicted(system, [0.0, 0.1]).T
    speed = 0.1 + np.concatenate([[0.0], np.cumsum(force[:-1] * np.diff(t))]) / 2.0
    # a step that holds a change of the command is drawn as one slope: off by at most (h / 4) |change| / m
    assert dq == pytest.approx(speed, abs=0.25 * system.step_s * np.abs(np.diff(force)).max() / 2.0)
