"""Effects of a mechanism against closed forms, and against integration by scipy."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from mechanisms import ARM, SLIDER, SLIDER_DAMPING, SLIDER_DRY_N, SLIDER_KG, coast, compiled, move, scope, stopped
from scipy.integrate import solve_ivp

from runner.effects import mechanism as m
from runner.effects.mechanism import EFFECTS, Command, MechanismEffect, Reading, Scope
from runner.effects.wording import Values

VOCABULARY = (
    "mass com_offset inertia link_length gravity joint_friction joint_damping stribeck asymmetric_friction "
    "load_friction joint_stiffness torque_offset torque_ripple backlash compliance armature disturbance "
    "actuator_gain actuator_delay "
    "actuator_lag actuator_saturation dead_band servo_gain servo_damping sensor_offset sensor_scale sensor_lag "
    "observation_delay clock_scale"
)
FREE_SLIDER = SLIDER.replace('frictionloss="3"', "").replace('damping="2"', "")


def bound(xml: str) -> list[tuple[type[MechanismEffect], Scope]]:
    """Return every effect with every target that it applies to."""
    whole = scope(xml)
    model = whole.model
    targets = {
        "": [None],
        "joint": [model.joint(j).name for j in range(model.njnt)],
        "body": [model.body(b).name for b in range(1, model.nbody)],
        "actuator": [model.actuator(a).name for a in range(model.nu)],
        "channel": list(whole.signal),
    }
    return [
        (cls, whole.at(target))
        for cls in EFFECTS
        for target in targets[cls.target_kind]
        if cls.applies(whole.at(target))
    ]


ALL = [(xml, cls, context) for xml in (SLIDER, ARM) for cls, context in bound(xml)]
each_effect = pytest.mark.parametrize(
    ("xml", "cls", "context"), ALL, ids=[f"{c.__name__}-{s.target}" for _, c, s in ALL]
)


# What all of them have in common


def test_every_word_has_its_effect() -> None:
    """The names are those of the contract, and each applies to something here."""
    assert {cls.name for cls in EFFECTS} == set(VOCABULARY.split())
    assert {cls for _, cls, _ in ALL} == set(EFFECTS)


@each_effect
def test_zero_is_absent(xml: str, cls: type[MechanismEffect], context: Scope) -> None:
    """With a vector of zeros a motion is bit for bit the nominal one, and so are commands and readings."""
    effect = cls.from_vector(np.zeros(len(cls.parameters(context))), context)
    model = context.model
    start = {model.joint(j).name: 0.3 for j in range(model.njnt)}

    def push(t: float) -> list[float]:
        return [math.sin(9 * t)] * model.nu

    without = move(model, 0.1, position=start, speed=start, command=push)
    for a, b in zip(without, move(compiled(xml, effect), 0.1, position=start, speed=start, command=push), strict=True):
        assert np.array_equal(a, b)
    columns = {model.actuator(a).name: np.arange(5.0) for a in range(model.nu)}
    sent = effect.edit_command(Command(0.001, columns, dict.fromkeys(columns, 0.0)))
    assert all(np.array_equal(sent.columns[name], column) for name, column in columns.items())
    channels = {name: np.arange(5.0) for name in context.signal}
    shown = effect.edit_reading(Reading(np.arange(5.0), channels))
    assert all(np.array_equal(shown.channels[name], channel) for name, channel in channels.items())


@each_effect
def test_parameters_make_effects(xml: str, cls: type[MechanismEffect], context: Scope) -> None:
    """Bounds hold zero, starts lie within them, and every vector within makes an effect with the same report."""
    parameters = cls.parameters(context)
    lower, upper = (np.array([getattr(p, end) for p in parameters]) for end in ("lower", "upper"))
    assert all(p.scale > 0 for p in parameters)
    assert np.all(lower <= 0)
    assert np.all(upper > 0)
    starts = cls.starts(context)
    assert starts.shape[1] == len(parameters)
    assert np.all((starts >= lower) & (starts <= upper))
    scales = np.array([p.scale for p in parameters])
    names = set()
    for x in (lower, upper, np.clip(scales, lower, upper), np.clip(-scales, lower, upper), *starts):
        effect = cls.from_vector(x, context)
        assert getattr(effect, "target", None) == context.target
        assert effect.full_name == (cls.name if context.target is None else f"{cls.name}[{context.target}]")
        names.add(tuple(effect.report()))
    assert len(names) == 1


@each_effect
def test_a_usual_size_shows(xml: str, cls: type[MechanismEffect], context: Scope) -> None:
    """At about the size of its prior an effect changes motion, commands or readings."""
    scales = np.array([p.scale for p in cls.parameters(context)])
    starts = cls.starts(context)
    effect = cls.from_vector(starts[len(starts) // 2] if len(starts) else scales, context)
    model = context.model

    def push(t: float) -> list[float]:
        return [5.0 * math.sin(9 * t)] * model.nu

    start = {model.joint(j).name: 0.3 for j in range(model.njnt)}
    changed = compiled(xml, effect)
    length_s = 0.2 if cls is not m.Disturbance else 3.0
    before = move(model, length_s, speed=start, command=push)
    after = move(changed, length_s, speed=start, command=push)
    joints = [model.joint(j).name for j in range(model.njnt)]
    moved = max(
        np.abs(
            before[1][: len(after[1]), int(model.joint(j).qposadr[0])]
            - after[1][: len(before[1]), int(changed.joint(j).qposadr[0])]
        ).max()
        for j in joints
    )
    columns = {model.actuator(a).name: np.sin(np.arange(50) / 9.0) for a in range(model.nu)}
    sent = effect.edit_command(Command(0.01, columns, dict.fromkeys(columns, 0.0))).columns
    channels = {name: np.sin(np.arange(50) / 9.0) for name in context.signal}
    shown = effect.edit_reading(Reading(np.arange(50) * 0.01, channels)).channels
    outside = max(np.abs(a - b[k]).max() for a, b in ((sent, columns), (shown, channels)) for k, a in a.items())
    assert max(moved, outside) > 1e-6
    if cls is m.ClockScale:
        assert changed.opt.timestep != model.opt.timestep


@each_effect
def test_words(xml: str, cls: type[MechanismEffect], context: Scope) -> None:
    """Every phrase names its target, has a remedy that can be pasted, and no number that is not one."""
    starts = cls.starts(context)
    x = starts[0] if len(starts) else np.array([p.scale for p in cls.parameters(context)])
    values = cls.from_vector(x, context).report()
    phrase = cls.phrase(Values(values, {k: 0.05 * abs(v) for k, v in values.items()}), context, context.target)
    assert phrase.what[0].islower()
    assert context.target is None or context.target in phrase.what
    assert "±" in phrase.amount
    assert phrase.remedy.isascii()
    assert phrase.remedy.endswith(".")
    assert phrase.check.endswith(".")
    assert not re.search(r"\b(nan|inf)\b|\?", phrase.what + phrase.amount + phrase.remedy)


# Masses and lengths, against the equations of two links


@dataclass(frozen=True)
class TwoLinks:
    """The arm, without dry friction: equations by hand (Newton and Euler at the centres of mass)."""

    mass: tuple[float, float] = (1.5, 0.8)
    inertia: tuple[float, float] = (0.012, 0.004)
    com: tuple[tuple[float, float], tuple[float, float]] = ((0.0, -0.15), (0.0, -0.12))
    length: float = 0.3
    armature: tuple[float, float] = (0.02, 0.004)
    damping: tuple[float, float] = (0.1, 0.02)
    gravity: tuple[float, float] = (0.0, -9.81)

    def acceleration(self, q: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
        def turn(angle: float) -> np.ndarray:
            return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

        quarter = turn(math.pi / 2)
        angles, rates = (q[0], q[0] + q[1]), (v[0], v[0] + v[1])
        elbow = turn(angles[0]) @ [0.0, -self.length]
        inertia, rest = np.diag(self.armature), np.asarray(force, float) - np.multiply(self.damping, v)
        for i in range(2):
            arm = turn(angles[i]) @ self.com[i]
            at = [arm] if i == 0 else [elbow + arm, arm]
            jacobian = np.column_stack([quarter @ a for a in at] + [np.zeros(2)] * (1 - i))
            centripetal = -arm * rates[i] ** 2 - (elbow * rates[0] ** 2 if i else 0.0)
            spin = np.array([1.0, float(i)])
            inertia = inertia + self.mass[i] * jacobian.T @ jacobian + self.inertia[i] * np.outer(spin, spin)
            rest = rest + self.mass[i] * jacobian.T @ (np.array(self.gravity) - centripetal)
        return np.linalg.solve(inertia, rest)


LINKS = TwoLinks()
TILT = 0.05


@pytest.mark.parametrize(
    ("effect", "links"),
    [
        (m.Mass("forearm", 1.0), replace(LINKS, mass=(1.5, 1.0), inertia=(0.012, 0.005))),
        (m.Mass("upper", 1.2), replace(LINKS, mass=(1.2, 0.8), inertia=(0.0096, 0.004))),
        (m.Inertia("upper", 1.3), replace(LINKS, inertia=(0.0156, 0.004))),
        (m.ComOffset("forearm", 0.02, 0.0, -0.03), replace(LINKS, com=((0.0, -0.15), (0.02, -0.15)))),
        (m.LinkLength("elbow", 1.1), replace(LINKS, length=0.33)),
        (m.Gravity(0.9), replace(LINKS, gravity=(0.0, -8.829))),
        (m.GravityTilt(TILT, 0.0), replace(LINKS, gravity=(9.81 * math.sin(TILT), -9.81 * math.cos(TILT)))),
        (m.Armature("elbow", 0.01), replace(LINKS, armature=(0.02, 0.01))),
        (m.JointDamping("shoulder", 0.4), replace(LINKS, damping=(0.4, 0.02))),
    ],
    ids=lambda value: type(value).__name__,
)
def test_masses_and_lengths(effect: MechanismEffect, links: TwoLinks) -> None:
    """Accelerations in any state are those of two links with the changed number."""
    xml = re.sub(r'frictionloss="[^"]*"', "", ARM)
    model = compiled(xml, effect)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(3)
    for _ in range(5):
        data.qpos[:], data.qvel[:] = rng.normal(size=2), rng.normal(size=2)
        data.qfrc_applied[:] = rng.normal(size=2)
        data.ctrl[1] = data.qpos[1] + 0.3 / 4 * data.qvel[1]  # the servo gives nothing
        mujoco.mj_forward(model, data)
        expected = links.acceleration(data.qpos, data.qvel, data.qfrc_applied)
        np.testing.assert_allclose(data.qacc, expected, rtol=1e-9, atol=1e-9)


def test_length_of_a_link_with_parts_that_are_fixed_to_it() -> None:
    """The way to the parent joint goes through bodies without joints, which may be turned, and is stretched whole."""
    xml = """<mujoco><worldbody><body name="a"><joint name="one" pos="0.1 0 0"/><geom size=".1"/>
    <body name="bracket" pos="0 0 1" quat="0.7071067811865476 0.7071067811865476 0 0">
    <body name="b" pos="0 1 0"><joint name="two" pos="0 0 0.2"/><geom size=".1"/></body></body></body>
    </worldbody></mujoco>"""
    before, after = compiled(xml), compiled(xml, m.LinkLength("two", 1.5))
    ways = []
    for model in (before, after):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        ways.append(data.joint("two").xanchor - data.joint("one").xanchor)
    np.testing.assert_allclose(ways[1], 1.5 * ways[0], atol=1e-12)


# Friction and forces on joints


@pytest.mark.parametrize("friction", [1.0, 5.0])
def test_joint_friction(friction: float) -> None:
    """The slider coasts as far as with that dry friction."""
    found = stopped(*move(compiled(SLIDER, m.JointFriction("slide", friction)), 1.5, speed={"slide": 1.0}))
    expected = coast(1.0, lambda v: friction + SLIDER_DAMPING * v)
    np.testing.assert_allclose(found, expected, rtol=4e-3)


def test_stribeck() -> None:
    """The slider coasts as far as the equation says."""
    model = compiled(SLIDER, m.Stribeck("slide", 0.6, 0.2, 1.5))
    expected = coast(0.7, lambda v: SLIDER_DRY_N * (1 + 0.6 * math.exp(-((abs(v) / 0.2) ** 1.5))) + SLIDER_DAMPING * v)
    np.testing.assert_allclose(stopped(*move(model, 1.0, speed={"slide": 0.7})), expected, rtol=3e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_asymmetric_friction(sign: float) -> None:
    """The two directions differ by the given share of their mean, dry and viscous."""
    model = compiled(SLIDER, m.AsymmetricFriction("slide", 0.2, 0.5))
    dry, viscous = SLIDER_DRY_N * (1 + 0.1 * sign), SLIDER_DAMPING * (1 + 0.25 * sign)
    found = stopped(*move(model, 1.2, speed={"slide": sign}))
    np.testing.assert_allclose(found, coast(sign, lambda v: sign * dry + viscous * v), rtol=2e-3)


def test_load_friction_holds_more_under_load() -> None:
    """A loaded arm stays up to F = Fc + share (drive + load) / 2, here where the drive gives 10 % less than needed."""
    xml = SLIDER.replace('axis="1 0 0"', 'axis="0 0 1"').replace('frictionloss="3"', "")
    weight = 1.6 * 9.81
    for share, holds in ((0.10, False), (0.11, True)):
        model = compiled(xml, m.LoadFriction("slide", share))
        _, q, _ = move(model, 0.5, command=lambda _t: [0.9 * weight])
        assert (abs(q[-1, 0]) < 1e-3) == holds


def test_joint_stiffness_adds_to_the_models() -> None:
    """Two springs act as both together, at any position."""
    model = compiled(SLIDER.replace('type="slide"', 'type="slide" stiffness="5" springref="0.2"'))
    changed = compiled(
        SLIDER.replace('type="slide"', 'type="slide" stiffness="5" springref="0.2"'),
        m.JointStiffness("slide", 12.0, -0.1),
    )
    for q in (-0.4, 0.0, 0.3):
        forces = []
        for each in (model, changed):
            data = mujoco.MjData(each)
            data.qpos[0] = q
            mujoco.mj_forward(each, data)
            forces.append(data.qfrc_passive[0])
        assert forces[1] - forces[0] == pytest.approx(-12.0 * (q + 0.1), abs=1e-12)


def test_torque_offset_is_what_the_remedy_says() -> None:
    """The constant force, and the actuator that the remedy adds in its place, move the slider alike."""
    effect = m.TorqueOffset("slide", 4.5)
    phrase = m.TorqueOffset.phrase(Values(effect.report(), {}), scope(SLIDER), "slide")
    found = re.search(r"<general[^>]*/>", phrase.remedy)
    assert found is not None
    pasted = compiled(SLIDER.replace("</actuator>", f"{found.group()}</actuator>"))
    _, q, _ = move(compiled(SLIDER, effect), 0.5)
    _, same, _ = move(pasted, 0.5)
    np.testing.assert_allclose(q, same, atol=1e-12)
    expected = (4.5 - SLIDER_DRY_N) / SLIDER_DAMPING  # final speed
    tau = SLIDER_KG / SLIDER_DAMPING
    assert q[-1, 0] == pytest.approx(expected * (0.5 - tau * (1 - math.exp(-0.5 / tau))), rel=2e-3)


def test_torque_ripple() -> None:
    """The force is amplitude sin(2 pi cycles q + phase): q in m of a slide, in turns of a hinge."""
    for xml, joint, rate in ((SLIDER, "slide", 2 * math.pi * 3.0), (ARM, "elbow", 3.0)):
        model = compiled(xml, m.TorqueRipple(joint, 0.4, 3.0, 0.7))
        data = mujoco.MjData(model)
        for q in np.linspace(-1, 1, 5):
            data.joint(joint).qpos[0] = q
            mujoco.mj_forward(model, data)
            force = data.qfrc_passive[int(model.joint(joint).dofadr[0])]
            assert force == pytest.approx(0.4 * math.sin(rate * q + 0.7), abs=1e-12)


def test_disturbance() -> None:
    """A force for some time gives its impulse, and nothing before and after."""
    _, _, v = move(compiled(FREE_SLIDER, m.Disturbance("slide", -3.0, 0.1001, 0.2503)), 0.4)
    assert v[500, 0] == 0.0
    assert v[-1, 0] == pytest.approx(-3.0 * 0.1502 / SLIDER_KG, rel=1e-9)
    assert v[-1, 0] == v[1252, 0]


# The drive behind a joint

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

    def until(function, direction: float):
        event = lambda t, y: function(t, y)  # noqa: E731
        event.terminal, event.direction = True, direction
        return event

    t, y, side = 0.0, np.zeros(4), 0.0
    while t < duration - 1e-12:
        if side == 0.0:
            ahead = until(lambda _t, y: y[0] - y[1] - play / 2, 1)
            behind = until(lambda _t, y: y[0] - y[1] + play / 2, -1)
            run = solve_ivp(apart, (t, duration), y, events=(ahead, behind), rtol=1e-10, atol=1e-12, max_step=0.01)
            t, y = float(run.t[-1]), run.y[:, -1].copy()
            if run.status == 1:
                y[2:] = (LINK_KG * y[2] + DRIVE_KG * y[3]) / (LINK_KG + DRIVE_KG)
                side = -1.0 if len(run.t_events[1]) else 1.0
                if side * pressed(t, y) > 0:  # the drive pulls away at once
                    side = 0.0
        else:
            leaves = until(lambda t, y: side * pressed(t, y), 1)  # noqa: B023
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


# Actuators


def force_of(model: mujoco.MjModel, actuator: str, command: float, q: float = 0.0, v: float = 0.0) -> float:
    data = mujoco.MjData(model)
    joint = int(model.actuator(actuator).trnid[0])
    data.qpos[int(model.jnt_qposadr[joint])], data.qvel[int(model.jnt_dofadr[joint])] = q, v
    data.actuator(actuator).ctrl[0] = command
    mujoco.mj_forward(model, data)
    return float(data.actuator(actuator).force[0])


@pytest.mark.parametrize(
    ("effect", "actuator", "force"),
    [
        (m.ActuatorGain("shoulder", 0.8), "shoulder", 0.8 * 2.0),
        (m.ActuatorGain("elbow", 0.8), "elbow", 0.8 * (4 * 0.5 - 0.3 * 0.6)),
        (m.ServoGain("elbow", 1.25), "elbow", 5 * 0.5 - 0.3 * 0.6),
        (m.ServoDamping("elbow", 2.0), "elbow", 4 * 0.5 - 0.6 * 0.6),
        (m.ActuatorSaturation("shoulder", 1.7), "shoulder", 1.7),
        (m.ActuatorSaturation("elbow", 1.1), "elbow", 1.1),
    ],
    ids=lambda value: getattr(value, "full_name", None),
)
def test_forces_of_actuators(effect: MechanismEffect, actuator: str, force: float) -> None:
    """A motor at 2 N m, and a servo (kp 4, kv 0.3) 0.5 rad before its target at 0.6 rad/s, exert this."""
    model = compiled(ARM, effect)
    command = 2.0 if actuator == "shoulder" else 0.7
    assert force_of(model, actuator, command, 0.2, 0.6) == pytest.approx(force, rel=1e-12)


def test_saturation_may_lift_a_limit() -> None:
    """A negative share is a limit above the believed one of 3 N m."""
    effect = m.ActuatorSaturation.from_vector([-0.5], scope(ARM, "elbow"))
    assert effect.limit == pytest.approx(4.5)
    assert force_of(compiled(ARM, effect), "elbow", 2.0) == pytest.approx(4.5)
    assert force_of(compiled(ARM), "elbow", 2.0) == pytest.approx(3.0)


def command_of(column: np.ndarray, before: float = 0.0, step_s: float = 0.001) -> Command:
    return Command(step_s, {"u": column, "other": column}, {"u": before, "other": before})


def test_delay_is_exact_on_the_grid() -> None:
    """A command comes late by whole steps, preceded by what was commanded before; the other actuator's does not."""
    column = np.random.default_rng(1).normal(size=50)
    sent = m.ActuatorDelay("u", 0.007).edit_command(command_of(column, 0.6))
    assert np.array_equal(sent.columns["u"], np.r_[np.full(7, 0.6), column[:-7]])
    assert sent.columns["other"] is column


def test_delay_between_steps_is_the_mean() -> None:
    """A command that is held over each step has, 2.3 steps late, the mean of what holds over each step."""
    column = np.random.default_rng(1).normal(size=50)
    sent = m.ActuatorDelay("u", 0.0023).edit_command(command_of(column)).columns["u"]
    fine = np.repeat(column, 10)
    expected = np.r_[np.zeros(23), fine[:-23]].reshape(50, 10).mean(axis=1)
    np.testing.assert_allclose(sent, expected, atol=1e-12)


def test_lag_follows_a_step() -> None:
    """After a step from 0.5 to 2 the mean over each step is that of the exponential."""
    tau, h = 0.02, 0.001
    sent = m.ActuatorLag("u", tau).edit_command(command_of(np.full(80, 2.0), 0.5)).columns["u"]
    t = h * np.arange(81)
    integral = 2.0 * t - 1.5 * tau * (1 - np.exp(-t / tau))
    np.testing.assert_allclose(sent, np.diff(integral) / h, rtol=1e-10)


def test_dead_band() -> None:
    """Of every command the width is lost, and smaller ones do nothing."""
    sent = m.DeadBand("u", 0.5).edit_command(command_of(np.array([-2.0, -0.4, 0.0, 0.5, 0.7]))).columns["u"]
    np.testing.assert_allclose(sent, [-1.5, 0.0, 0.0, 0.0, 0.2], atol=1e-15)


# Sensors and clocks


def reading_of(values: np.ndarray, *, held_before: bool = False) -> Reading:
    return Reading(0.001 * np.arange(values.shape[-1]), {"q": values, "other": values}, held_before)


def test_sensor_offset_and_scale() -> None:
    """One channel shows a multiple, or more by a constant; the other the truth."""
    values = np.random.default_rng(1).normal(size=(3, 20))
    assert np.array_equal(m.SensorScale("q", 1.1).edit_reading(reading_of(values)).channels["q"], 1.1 * values)
    shown = m.SensorOffset("q", 0.2).edit_reading(reading_of(values))
    assert np.array_equal(shown.channels["q"], values + 0.2)
    assert shown.channels["other"] is values


def test_sensor_lag_follows_what_it_measures() -> None:
    """Of t^2 / 2 from rest a filter shows its exact answer; of a steady ramp it is behind by its time constant."""
    tau, t = 0.03, 0.001 * np.arange(200)
    shown = m.SensorLag("q", tau).edit_reading(reading_of(0.5 * t**2, held_before=True)).channels["q"]
    exact = 0.5 * t**2 - tau * t + tau**2 * (1 - np.exp(-t / tau))
    np.testing.assert_allclose(shown, exact, atol=2e-7)  # it takes the parabola as a polygon
    ramp = np.stack([3.0 + 2.0 * t, -t])
    shown = m.SensorLag("q", tau).edit_reading(reading_of(ramp)).channels["q"]
    np.testing.assert_allclose(shown, ramp - tau * np.array([[2.0], [-1.0]]), atol=1e-12)


def test_sensor_lag_follows_a_kink() -> None:
    """From rest, a speed that begins at once is shown as v (t - tau (1 - exp(-t / tau)))."""
    tau, t = 0.03, 0.001 * np.arange(200)
    shown = m.SensorLag("q", tau).edit_reading(reading_of(1.5 * t, held_before=True)).channels["q"]
    np.testing.assert_allclose(shown, 1.5 * (t - tau * (1 - np.exp(-t / tau))), atol=1e-12)


@pytest.mark.parametrize("delay_s", [0.02, -0.02])
def test_observation_delay(delay_s: float) -> None:
    """What is shown at a time is the state of delay_s before (or after), for all commands alike."""
    rate, h = 7.0, 0.0002
    n = 4000
    t = h * (np.arange(n) + 0.5)
    sent = m.ObservationDelay(delay_s).edit_command(Command(h, {"slide": np.cos(rate * t)}, {"slide": 0.0}))
    model = compiled(FREE_SLIDER)
    _, _, true = move(model, n * h, command=lambda t: [math.cos(rate * t)])
    start = {"slide": math.sin(rate * max(-delay_s, 0.0)) / rate / SLIDER_KG}  # of the state that is shown first
    _, _, shown = move(model, n * h, speed=start, command=lambda t: [sent.columns["slide"][int(t / h)]])
    k = round(delay_s / h)
    pair = (shown[max(k, 0) :, 0], true[: n + 1 - k, 0]) if k > 0 else (shown[: n + 1 + k, 0], true[-k:, 0])
    np.testing.assert_allclose(*pair, atol=1e-6)


def test_clock_scale() -> None:
    """A clock that shows 1.02 s in a second has the slider where it is after t / 1.02."""
    model = compiled(FREE_SLIDER, m.ClockScale(1.02))
    _, q, v = move(model, 0.5 / 1.02, command=lambda _t: [3.0])
    assert len(q) == 2501  # steps that the recording has in 0.5 s of its own
    assert v[-1, 0] == pytest.approx(3.0 / SLIDER_KG * 0.5 / 1.02, rel=1e-9)


# Together


def test_order_does_not_matter() -> None:
    """Effects on one mechanism make the same model in any order."""
    effects = [
        m.Mass("forearm", 1.0),
        m.Inertia("forearm", 1.4),
        m.JointFriction("elbow", 0.05),
        m.AsymmetricFriction("elbow", 0.3, 0.2),
        m.ActuatorGain("elbow", 0.9),
        m.ServoGain("elbow", 1.2),
        m.Gravity(1.01),
        m.GravityTilt(0.02, -0.03),
        m.Backlash("elbow", 0.02),
        m.LoadFriction("elbow", 0.1),
    ]
    start = {"shoulder": 0.5, "elbow": 0.4}
    motions = [
        move(
            compiled(ARM, *order), 0.2, position=start | {"elbow~drive": 0.4}, command=lambda t: [math.sin(9 * t), 0.2]
        )
        for order in itertools.islice(itertools.permutations(effects), 0, 10**6, 300_001)
    ]
    assert len(motions) > 2
    for motion in motions[1:]:
        np.testing.assert_allclose(motion[1], motions[0][1], atol=1e-9)
