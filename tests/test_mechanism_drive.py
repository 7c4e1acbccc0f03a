"""The drive behind a joint, with play and with a spring, against closed forms and integration by scipy."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from mechanisms import (
    ARM,
    FREE_SLIDER,
    SLIDER,
    SLIDER_DAMPING,
    SLIDER_DRY_N,
    SLIDER_KG,
    Until,
    compiled,
    move,
)
from scipy.integrate import solve_ivp

from runner.effects import mechanism as m

DRIVE_KG, LINK_KG = 0.4, 1.6


def two_bodies(play: float, force: float, rate: float, duration: float, damping: float, share: float) -> np.ndarray:
    """Return position of link and drive at the end: rigid flanks without rebound, found by events."""

    def forces(t: float, y: np.ndarray) -> tuple[float, float]:
        return -(1 - share) * damping * y[2], force * math.sin(rate * t) - share * damping * y[3]

    def apart(t: float, y: np.ndarray) -> list[float]:
        on_link, on_drive = forces(t, y)
        return [y[2], y[3], on_link / LINK_KG, on_drive / DRIVE_KG]

    def together(t: float, y: np.ndarray) -> list[float]:
        a = sum(forces(t, y)) / (LINK_KG + DRIVE_KG)
        return [y[2], y[3], a, a]

    def pressed(t: float, y: np.ndarray) -> float:  # force of the drive on the link
        on_link, on_drive = forces(t, y)
        return (LINK_KG * on_drive - DRIVE_KG * on_link) / (LINK_KG + DRIVE_KG)

    t, y, side = 0.0, np.zeros(4), 0.0
    while t < duration - 1e-12:
        if side == 0.0:
            ahead = Until(lambda _t, y: y[0] - y[1] - play / 2, 1)
            behind = Until(lambda _t, y: y[0] - y[1] + play / 2, -1)
            run = solve_ivp(apart, (t, duration), y, events=(ahead, behind), rtol=1e-10, atol=1e-12, max_step=0.01)
            t, y = float(run.t[-1]), run.y[:, -1].copy()
            if run.status == 1:
                y[2:] = (LINK_KG * y[2] + DRIVE_KG * y[3]) / (LINK_KG + DRIVE_KG)
                side = -1.0 if len(run.t_events[1]) else 1.0
                if side * pressed(t, y) > 0:  # the drive pulls away at once
                    side = 0.0
        else:
            leaves = Until(lambda t, y: side * pressed(t, y), 1)  # noqa: B023
            run = solve_ivp(together, (t, duration), y, events=leaves, rtol=1e-10, atol=1e-12, max_step=0.01)
            t, y, side = float(run.t[-1]), run.y[:, -1].copy(), 0.0
    return y


@pytest.mark.parametrize("duration", [0.35, 0.6, 1.1, 1.6])
def test_backlash_moves_as_two_bodies_with_play(duration: float) -> None:
    """Link and drive are where rigid flanks without rebound bring them, after several impacts."""
    play, share = 0.01, 0.75
    xml = SLIDER.replace('frictionloss="3"', "").replace('timestep="0.0002"', 'timestep="0.0001"')
    model = compiled(xml, m.Backlash("slide", play, share))
    _, q, _ = move(model, duration, command=lambda t: [6.0 * math.sin(9.0 * t)])
    expected = two_bodies(play, 6.0, 9.0, duration, SLIDER_DAMPING, share)
    columns = [int(model.joint(name).qposadr[0]) for name in ("slide", "slide~drive")]
    np.testing.assert_allclose(q[-1, columns], expected[:2], atol=2e-4)


def test_backlash_shares_friction() -> None:
    """The drive alone holds its share of dry friction within the play, link and drive together all of it."""
    model = compiled(SLIDER, m.Backlash("slide", 0.02, 0.75))
    drive, link = (int(model.joint(name).qposadr[0]) for name in ("slide~drive", "slide"))
    share = 0.75 * SLIDER_DRY_N
    _, q, _ = move(model, 0.5, command=lambda _t: [0.97 * share])
    assert abs(q[-1, drive]) < 1e-4
    _, q, _ = move(model, 1.0, command=lambda _t: [1.1 * share])
    assert q[-1, drive] - q[-1, link] == pytest.approx(0.01, abs=2e-4)  # across half the play
    assert abs(q[-1, link]) < 1e-3
    _, q, _ = move(model, 0.5, command=lambda _t: [1.3 * SLIDER_DRY_N])
    assert q[-1, link] > 0.02


def test_the_whole_of_friction_and_inertia_stays() -> None:
    """What the drive gets the link has lost, and what friction is set to afterwards is the sum of both."""
    plain = compiled(SLIDER)
    for effects in ([m.Backlash("slide", 0.01, 0.3)], [m.Compliance("slide", 1e4)]):
        model = compiled(SLIDER, *effects)
        for name in ("dof_frictionloss", "dof_damping", "dof_armature"):
            assert getattr(model, name).sum() == pytest.approx(getattr(plain, name).sum(), rel=1e-12)
        model = compiled(SLIDER, *effects, m.JointFriction("slide", 4.0), m.JointDamping("slide", 1.0))
        assert model.dof_frictionloss.sum() == pytest.approx(4.0)
        assert model.dof_damping.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("effect", [m.Backlash("slide", 0.02), m.Compliance("slide", 2000.0)])
def test_a_settled_start_stays(effect: m.Backlash | m.Compliance) -> None:
    """What is held against its weight from the start does not drop through its play, nor swing on its spring."""
    xml = SLIDER.replace('axis="1 0 0"', 'axis="0 0 1"').replace('frictionloss="3"', "")
    model = compiled(xml, effect)
    weight = 1.6 * 9.81
    assert dict(effect.follows) == {"slide~drive": "slide"}
    moved = []
    for settled in (True, False):
        data = mujoco.MjData(model)
        data.ctrl[:] = weight
        if settled:
            effect.edit_start(model, data)
        for _ in range(2000):
            mujoco.mj_step(model, data)
        moved.append(abs(float(data.joint("slide").qpos[0])))
    assert moved[0] < 5e-5
    assert moved[1] > 1e-3


def test_compliance_swings_at_its_frequency() -> None:
    """Link against drive swing at sqrt(k (1/m + 1/M)), and give k^-1 per N in the end."""
    stiffness = 400.0
    model = compiled(FREE_SLIDER, m.Compliance("slide", stiffness))
    t, q, _ = move(model, 1.0, speed={"slide": 0.2})
    link, drive = (int(model.joint(name).qposadr[0]) for name in ("slide", "slide~drive"))
    difference = q[:, link] - q[:, drive]
    up = np.flatnonzero((difference[:-1] < 0) & (difference[1:] >= 0))
    times = t[up] - difference[up] * (t[1] - t[0]) / (difference[up + 1] - difference[up])
    frequency = math.sqrt(stiffness * (1 / LINK_KG + 1 / DRIVE_KG))
    damped = frequency * math.sqrt(1 - 0.05**2)
    assert len(times) > 4
    np.testing.assert_allclose(np.diff(times), 2 * math.pi / damped, rtol=2e-3)
    # the drive pushes steadily: the link's inertia winds the spring up
    _, q, _ = move(model, 5.0, command=lambda _t: [8.0])
    assert q[-1, drive] - q[-1, link] == pytest.approx(8.0 * LINK_KG / SLIDER_KG / stiffness, rel=1e-3)


@pytest.mark.parametrize("stiffness", [1e5, 1e7, 1e9])
def test_stiff_compliance_is_rigid_and_stable(stiffness: float) -> None:
    """Far beyond what the step could follow, link and drive move as one, like the nominal slider."""
    xml = SLIDER.replace('timestep="0.0002"', 'timestep="0.002"').replace('integrator="implicitfast"', "")
    _, q, _ = move(compiled(xml), 1.0, command=lambda t: [8.0 * math.sin(6 * t)])
    model = compiled(xml, m.Compliance("slide", stiffness))
    _, soft, _ = move(model, 1.0, command=lambda t: [8.0 * math.sin(6 * t)])
    link = int(model.joint("slide").qposadr[0])
    np.testing.assert_allclose(soft[:, link], q[:, 0], atol=2e-3)


@pytest.mark.parametrize("step_s", [0.0002, 0.001, 0.004])
@pytest.mark.parametrize("stiffness", [300.0, 3e4, 3e6])
def test_compliance_gives_as_much_at_any_step(step_s: float, stiffness: float) -> None:
    """Under a steady load the joint gives F / k, whether the step can follow the spring or not."""
    effect = m.Compliance("slide", stiffness)
    base = compiled(FREE_SLIDER, effect)
    base.opt.timestep = step_s
    effect.edit_model(base)  # as a simulator does that has a step of its own
    _, q, _ = move(base, 4.0, command=lambda _t: [8.0])
    link, drive = (int(base.joint(name).qposadr[0]) for name in ("slide", "slide~drive"))
    expected = 8.0 * LINK_KG / SLIDER_KG / stiffness
    assert q[-1, drive] - q[-1, link] == pytest.approx(expected, rel=0.02, abs=2e-9)


def test_what_is_absent_is_not_built() -> None:
    """Without play, and without give, a model is compiled like the nominal one, whatever else is in it."""
    for effect in (m.Backlash("slide", 0.0), m.Compliance("slide", math.inf)):
        assert not effect.structural
        assert compiled(SLIDER, effect).nq == 1
    assert m.Backlash("slide", 1e-6).structural
    assert m.Compliance("slide", 1e9).structural


@pytest.mark.parametrize("order", [0, 1])
def test_play_and_spring_on_one_joint(order: int) -> None:
    """A joint with both gives half the play and then F / k, whichever was written down first."""
    effects = [m.Backlash("slide", 0.02), m.Compliance("slide", 1000.0)]
    model = compiled(FREE_SLIDER, *(effects[::-1] if order else effects))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    link, drive = model.joint("slide"), model.joint("slide~drive")
    for apart, force in ((0.009, 0.0), (0.015, -5.0), (-0.013, 3.0)):
        data.qpos[int(link.qposadr[0])] = apart
        data.qpos[int(drive.qposadr[0])] = 0.0
        mujoco.mj_forward(model, data)
        assert data.qfrc_passive[int(link.dofadr[0])] == pytest.approx(force, abs=1e-9)


def test_a_drive_is_plain_mjcf() -> None:
    """The model with play can be written as XML, and moves the same when it is read again."""
    spec = mujoco.MjSpec.from_string(ARM)
    m.Backlash("shoulder", 0.02).edit_spec(spec)
    m.Compliance("elbow", 30.0).edit_spec(spec)
    model = spec.compile()
    again = mujoco.MjModel.from_xml_string(spec.to_xml())

    def push(t: float) -> list[float]:
        return [math.sin(9 * t), 0.5]

    np.testing.assert_allclose(move(model, 0.3, command=push)[1], move(again, 0.3, command=push)[1], atol=1e-6)


def test_names_keep_their_meaning_behind_a_drive() -> None:
    """Sensors, limits and keyframes stay with the link, what the actuator feels is the drive."""
    xml = ARM.replace(
        "</actuator>",
        """</actuator><sensor><jointpos name="q" joint="elbow"/><jointactuatorfrc name="tau" joint="elbow"/>
        <actuatorpos name="encoder" actuator="elbow"/></sensor>""",
    ).replace('joint name="elbow"', 'joint name="elbow" limited="true" range="-60 60"')
    model = compiled(xml, m.Backlash("elbow", 0.05))
    data = mujoco.MjData(model)
    data.joint("elbow").qpos[0] = 0.3
    data.joint("elbow~drive").qpos[0] = 0.29
    data.ctrl[1] = 0.4
    mujoco.mj_forward(model, data)
    assert data.sensor("q").data[0] == 0.3
    assert data.sensor("encoder").data[0] == 0.29
    assert data.sensor("tau").data[0] == pytest.approx(4 * (0.4 - 0.29))
    assert model.jnt_limited[model.joint("elbow").id] == 1
    assert model.jnt_limited[model.joint("elbow~drive").id] == 0


def test_keyframes_survive_a_drive() -> None:
    """A model with a keyframe can be given a drive."""
    xml = ARM.replace("</mujoco>", '<keyframe><key name="home" qpos="0.1 0.2"/></keyframe></mujoco>')
    model = compiled(xml, m.Backlash("elbow", 0.05))
    assert model.key_qpos[0, int(model.joint("elbow").qposadr[0])] == 0.2
