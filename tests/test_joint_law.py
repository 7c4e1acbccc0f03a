"""The compiled law of joints against closed forms, and against integration by scipy."""

from __future__ import annotations

import math

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from drive import G, make, set_planar, twist, wait
from mechanisms import SLIDER, SLIDER_DAMPING, SLIDER_DRY_N, SLIDER_KG, coast, compiled, move, stopped
from scipy.integrate import solve_ivp

from runner.physics import dry_friction, joint_law
from runner.physics.joint_law import JointLaw
from runner.physics.scene import BodyConfig

TWO = """<mujoco><option timestep="0.001" gravity="0 0 0"><flag island="{}"/></option><worldbody>
<body><joint name="a" type="slide" frictionloss="1" solreffriction="0.002 1"/><inertial pos="0 0 0" mass="1"
diaginertia="1 1 1"/></body>
<body><joint name="b" type="slide" frictionloss="1" solreffriction="0.002 1"/><inertial pos="0 0 0" mass="1"
diaginertia="1 1 1"/></body></worldbody>
<equality><joint joint1="a" joint2="b" active="false"/></equality><actuator><motor joint="a"/></actuator></mujoco>"""


def slider(**numbers: float) -> mujoco.MjModel:
    model = compiled(SLIDER)
    law = JointLaw(model, 0)
    for name, value in numbers.items():
        law[name] = value
    return model


@pytest.mark.parametrize("island", ["enable", "disable"])
def test_limit_acts_in_the_same_step(island: str) -> None:
    """The friction limit that is written before the solver is what it solves with, with islands and without."""
    model = compiled(TWO.format(island))
    law, data = JointLaw(model, 0), mujoco.MjData(model)
    law["excess"], law["excess_speed"], law["excess_power"] = 1.0, 1.0, 2.0
    data.qvel[:] = 1.0
    data.ctrl[0] = 4.0
    mujoco.mj_forward(model, data)
    assert data.nisland == (2 if island == "enable" else 0)
    np.testing.assert_allclose(data.qacc, [4.0 - (1.0 + math.exp(-1.0)), -1.0], atol=1e-6)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qacc, [4.0 - (1.0 + math.exp(-1.0)), -1.0], atol=1e-6)


def test_without_numbers_the_law_is_absent() -> None:
    """A model with room for the law and without numbers moves bit for bit as one without room."""
    plain = mujoco.MjModel.from_xml_string(SLIDER)
    for a, b in zip(move(plain, 0.3, speed={"slide": 1.0}), move(slider(), 0.3, speed={"slide": 1.0}), strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_steady_friction_is_the_excess_at_each_speed(exponent: float) -> None:
    """Fc (1 + e exp(-(v/vs)^d)): at vs 1/e of the excess is left whatever the exponent, elsewhere what d says."""
    model = slider(excess=0.7, excess_speed=0.2, excess_power=exponent)
    data = mujoco.MjData(model)
    left = {
        0.5: {0.05: math.exp(-0.5), 0.2: math.exp(-1.0), 0.8: math.exp(-2.0)},
        1.0: {0.05: math.exp(-0.25), 0.2: math.exp(-1.0), 0.8: math.exp(-4.0)},
        2.0: {0.05: math.exp(-0.0625), 0.2: math.exp(-1.0), 0.8: math.exp(-16.0)},
    }[exponent]
    for speed, share in left.items():
        for sign in (1.0, -1.0):
            data.qvel[0] = sign * speed
            mujoco.mj_forward(model, data)
            assert data.qfrc_constraint[0] == pytest.approx(-sign * SLIDER_DRY_N * (1 + 0.7 * share), rel=1e-9)


@pytest.mark.parametrize(("speed", "exponent"), [(0.8, 2.0), (-0.8, 2.0), (0.8, 1.0), (-0.8, 0.5)])
def test_stribeck_coasts_like_its_equation(speed: float, exponent: float) -> None:
    """Time and distance until rest are those of F = Fc (1 + e exp(-(v/vs)^d)) + b v, however steep it is at rest."""
    excess, at = 0.7, 0.15

    def resistance(v: float) -> float:
        fall = math.exp(-((abs(v) / at) ** exponent))
        return math.copysign(SLIDER_DRY_N * (1 + excess * fall), v) + SLIDER_DAMPING * v

    model = slider(excess=excess, excess_speed=at, excess_power=exponent)
    found = stopped(*move(model, 1.2, speed={"slide": speed}))
    np.testing.assert_allclose(found, coast(speed, resistance), rtol=3e-3)


@pytest.mark.parametrize("exponent", [0.5, 1.0, 2.0])
def test_stribeck_breaks_away_at_its_peak(exponent: float) -> None:
    """At rest it holds up to Fc (1 + e); beyond, it goes as its equation says."""
    model = slider(excess=0.5, excess_speed=0.05, excess_power=exponent)

    def acceleration(v: float) -> float:
        friction = SLIDER_DRY_N * (1 + 0.5 * math.exp(-((abs(v) / 0.05) ** exponent)))
        return (1.1 * peak - friction - SLIDER_DAMPING * v) / SLIDER_KG

    peak = 1.5 * SLIDER_DRY_N
    _, q, _ = move(model, 0.5, command=lambda _t: [0.99 * peak])
    assert abs(q[-1, 0]) < 1e-4
    _, q, _ = move(model, 0.5, command=lambda _t: [1.1 * peak])
    run = solve_ivp(lambda _t, y: [y[1], acceleration(y[1])], (0, 0.5), [0.0, 0.0], rtol=1e-9, atol=1e-12)
    assert q[-1, 0] == pytest.approx(run.y[0, -1], rel=3e-3)


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_friction_of_each_direction(speed: float) -> None:
    """Dry and viscous friction of the two directions are mean (1 +- difference / 2)."""
    dry, viscous = 0.3, -0.4

    def resistance(v: float) -> float:
        s = 1.0 if v > 0 else -1.0
        return s * SLIDER_DRY_N * (1 + s * dry / 2) + SLIDER_DAMPING * (1 + s * viscous / 2) * v

    found = stopped(*move(slider(dry_difference=dry, viscous_difference=viscous), 1.2, speed={"slide": speed}))
    np.testing.assert_allclose(found, coast(speed, resistance), rtol=2e-3)


@pytest.mark.parametrize(("push", "moves"), [(3.4, False), (3.5, True), (-2.5, False), (-2.6, True)])
def test_asymmetric_friction_holds_as_much_as_it_resists(push: float, moves: bool) -> None:
    """At rest each direction is held by the friction of that direction: here 3.45 and 2.55 N."""
    _, q, _ = move(slider(dry_difference=0.3), 1.0, command=lambda _t: [push])
    assert (abs(q[-1, 0]) > 2e-3) == moves


@pytest.mark.parametrize("push", [25.0, 3.0])
def test_load_friction_on_an_incline(push: float) -> None:
    """Up and down a slope: dry friction is Fc + share (push + m g sin) / 2."""
    share, slope = 0.2, 0.5
    xml = SLIDER.replace('axis="1 0 0"', f'axis="{math.cos(slope)} 0 {math.sin(slope)}"').replace(
        'damping="2"', 'damping="0"'
    )
    model = compiled(xml)
    law = JointLaw(model, 0)
    law["load_share"] = share
    weight = 1.6 * 9.81 * math.sin(slope)
    friction = SLIDER_DRY_N + share * 0.5 * (push + weight)
    t, _, v = move(model, 0.2, speed={"slide": 0.1 if push > weight else -0.1}, command=lambda _t: [push])
    expected = (push - weight - math.copysign(friction, push - weight)) / SLIDER_KG
    assert v[-1, 0] - v[0, 0] == pytest.approx(expected * t[-1], rel=1e-4)


def test_load_friction_forgets_what_data_held_before() -> None:
    """The load is that of this state and command, whatever was computed in the same MjData before."""
    model = slider(load_share=0.3)
    fresh, used = mujoco.MjData(model), mujoco.MjData(model)
    used.ctrl[0] = 100.0
    mujoco.mj_step(model, used)
    mujoco.mj_setState(model, used, np.zeros(1 + model.nq + model.nv), mujoco.mjtState.mjSTATE_PHYSICS | 1)
    used.qacc_warmstart[:] = 0
    fresh.ctrl[0] = used.ctrl[0] = 5.0
    mujoco.mj_step(model, fresh)
    mujoco.mj_step(model, used)
    assert np.array_equal(fresh.qvel, used.qvel)


def test_ripple_is_a_force_of_position() -> None:
    """The static force is the sine and cosine of the position."""
    model = slider(ripple_sin=0.5, ripple_cos=0.2, ripple_rate=30.0)
    data = mujoco.MjData(model)
    for q in np.linspace(-0.3, 0.3, 7):
        data.qpos[0] = q
        mujoco.mj_forward(model, data)
        assert data.qfrc_passive[0] == pytest.approx(0.5 * math.sin(30 * q) + 0.2 * math.cos(30 * q), abs=1e-12)


def test_push_has_its_impulse_wherever_steps_begin() -> None:
    """A push from 0.01234 s until 0.04567 s gives F (until - from), whatever the step."""
    xml = SLIDER.replace('frictionloss="3"', "").replace('damping="2"', "")
    for step in ("0.0002", "0.003", "0.007"):
        model = compiled(xml.replace('timestep="0.0002"', f'timestep="{step}"'))
        law = JointLaw(model, 0)
        law["push"], law["push_from"], law["push_until"] = 6.0, 0.01234, 0.04567
        _, _, v = move(model, 0.07)
        assert v[-1, 0] == pytest.approx(6.0 * (0.04567 - 0.01234) / SLIDER_KG, rel=1e-9)


def test_rollout_in_threads_is_the_same() -> None:
    """`rollout` with two threads gives bit for bit what stepping gives."""
    model = slider(excess=0.5, excess_speed=0.1, excess_power=2.0, load_share=0.2, offset=0.3)
    starts = np.zeros((6, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    starts[:, 2] = np.linspace(-1, 1, 6)
    control = np.sin(np.arange(200) / 20)[None, :, None] * np.linspace(1, 9, 6)[:, None, None]
    states, _ = mujoco.rollout.rollout(
        model, [mujoco.MjData(model), mujoco.MjData(model)], starts, control, persistent_pool=False
    )
    for start, command, state in zip(starts, control, states, strict=True):
        data = mujoco.MjData(model)
        data.qvel[0] = start[2]
        for u in command:
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
        assert data.qpos[0] == state[-1, 1]


def test_stays_out_of_the_way_of_the_box() -> None:
    """A box under its law slides as far with the law of joints in the process, and so does a joint beside it."""
    model = slider(excess=0.7, excess_speed=0.15, excess_power=2.0)
    _, alone, _ = move(model, 0.3, speed={"slide": 0.8})
    dry_friction.install()
    joint_law.install()
    _, beside, _ = move(model, 0.3, speed={"slide": 0.8})
    assert np.array_equal(alone, beside)
    box = make(BodyConfig(mass_kg=3.0, friction=0.5))
    set_planar(box, (0, 0, 0, 1.0, 0, 0))
    wait(box, 0.1)
    assert twist(box)[0] == pytest.approx(1.0 - 0.5 * G * 0.1, rel=1e-6)


def test_room_beside_the_owners_numbers() -> None:
    """User data of the model's owner stay as they are, and the law comes after them."""
    joint_law.install()
    spec = mujoco.MjSpec.from_string(SLIDER.replace('name="slide" type', 'name="slide" user="7 8" type'))
    joint_law.reserve(spec)
    model = spec.compile()
    JointLaw(model, 0)["offset"] = 2.5
    assert list(model.jnt_user[0, :2]) == [7.0, 8.0]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == 2.5


def test_no_room_is_said() -> None:
    """A model that was compiled without `reserve` is refused, not written over."""
    with pytest.raises(ValueError, match="reserve"):
        JointLaw(mujoco.MjModel.from_xml_string(SLIDER), 0)
