"""Effects of a mechanism against closed forms, and against integration by scipy."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, replace

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
    TOSSED,
    coast,
    compiled,
    move,
    scope,
    stopped,
)

from runner.effects import mechanism as m
from runner.effects.mechanism import EFFECTS, Command, MechanismEffect, Reading, Scope
from runner.effects.wording import Values
from runner.inference.parameters import is_out_of_range

VOCABULARY = (
    "mass com_offset inertia payload link_length gravity joint_friction joint_damping stribeck asymmetric_friction "
    "load_friction joint_stiffness torque_offset torque_ripple backlash compliance armature disturbance "
    "actuator_gain actuator_delay "
    "actuator_lag actuator_saturation dead_band servo_gain servo_damping sensor_offset sensor_scale sensor_lag "
    "observation_delay clock_scale "
    "friction restitution contact_stiffness friction_cone body_size air_drag rotational_damping frame_tilt"
)


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


ALL = [(xml, cls, context) for xml in (SLIDER, ARM, TOSSED) for cls, context in bound(xml)]
each_effect = pytest.mark.parametrize(
    ("xml", "cls", "context"), ALL, ids=[f"{c.__name__}-{s.target}" for _, c, s in ALL]
)


# What all of them have in common


def test_measurements_that_are_younger_than_their_stamps_are_told_from_older_ones() -> None:
    """In the amount, too: a table shows it without the sentence."""
    older, younger = (
        m.ObservationDelay.phrase(Values({"delay_s": delay_s}, {"delay_s": 1e-4}), scope(SLIDER), None)
        for delay_s in (5e-4, -5e-4)
    )
    assert (older.amount, younger.amount) == ("0.50 ± 0.10 ms", "0.50 ± 0.10 ms younger")


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
            before[1][: len(after[1]), int(model.joint(j).qposadr[0]) + k]
            - after[1][: len(before[1]), int(changed.joint(j).qposadr[0]) + k]
        ).max()
        for j in joints
        for k in range(len(model.joint(j).qpos0))
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
    # a cone is one of two
    assert "±" in phrase.amount or cls is m.FrictionCone
    assert phrase.remedy.isascii()
    assert phrase.remedy.endswith(".")
    assert phrase.check.endswith(".")
    assert not re.search(r"\b(nan|inf)\b|\?", phrase.what + phrase.amount + phrase.remedy)
    # of what fits as well there are no values, and its check is told all the same
    assert cls.phrase(Values({}, {}), context, context.target).check


@pytest.mark.parametrize(("pos", "geom"), [("0.05 0 0", ""), ("0 0.05 0", '<geom size="0.1"/>')])
def test_a_centre_of_mass_is_written_as_far_as_the_motion_tells_it(pos: str, geom: str) -> None:
    """As an element that compiles, mass and inertia with it; along what is not told it stays where it was believed."""
    xml = f"""<mujoco><worldbody><body name="arm"><joint name="j" axis="0 0 1"/><inertial pos="{pos}" mass="2"
    diaginertia="0.01 0.01 0.01"/>{geom}</body></worldbody></mujoco>"""
    values, errors = {"x_m": 0.02, "y_m": 0.001, "z_m": 0.007}, {"x_m": 1e-4, "y_m": 1e-4, "z_m": 1.0}
    model = mujoco.MjModel.from_xml_string(xml)
    context = replace(scope(ARM, "lower"), model=model, target="arm")
    told = m.ComOffset.phrase(Values(values, errors), context, "arm")
    assert "the motion does not tell z" in told.amount
    assert ("what its geoms weigh" in told.remedy) is ("inertiafromgeom" in told.remedy) is bool(geom)
    inertial = told.remedy[told.remedy.index("<inertial") : told.remedy.index("/>") + 2]
    by_hand = mujoco.MjModel.from_xml_string(re.sub(r"<inertial.*?/>", inertial, xml, flags=re.DOTALL))
    assert by_hand.body("arm").ipos == pytest.approx(model.body("arm").ipos + np.array([0.02, 0.001, 0.0]))
    assert by_hand.body("arm").mass == pytest.approx(2.0)


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


def with_payload(link: int, mass_kg: float, at: tuple[float, float]) -> TwoLinks:
    """Return the links with a point mass on one of them: two masses about the centre that they have in common."""
    mass, com, inertia = list(LINKS.mass), list(LINKS.com), list(LINKS.inertia)
    total = mass[link] + mass_kg
    centre = (mass[link] * np.array(com[link]) + mass_kg * np.array(at)) / total
    for own, place in ((mass[link], com[link]), (mass_kg, at)):
        inertia[link] += own * float(np.sum((np.array(place) - centre) ** 2))
    mass[link], com[link] = total, (float(centre[0]), float(centre[1]))
    return replace(LINKS, mass=tuple(mass), com=tuple(com), inertia=tuple(inertia))


TILT = 0.05


@pytest.mark.parametrize(
    ("effect", "links"),
    [
        (m.Mass("forearm", 1.0), replace(LINKS, mass=(1.5, 1.0), inertia=(0.012, 0.005))),
        (m.Mass("upper", 1.2), replace(LINKS, mass=(1.2, 0.8), inertia=(0.0096, 0.004))),
        (m.Inertia("upper", 1.3), replace(LINKS, inertia=(0.0156, 0.004))),
        (m.ComOffset("forearm", 0.02, 0.0, -0.03), replace(LINKS, com=((0.0, -0.15), (0.02, -0.15)))),
        (m.Payload("forearm", 0.2, 0.05, 0.3, -0.28), with_payload(1, 0.2, (0.05, -0.28))),
        (m.Payload("upper", 0.5, -0.1, 0.0, 0.0), with_payload(0, 0.5, (-0.1, 0.0))),
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


@pytest.mark.parametrize(("nsample", "late_steps"), [(15, 15), (5, 5)])
def test_actuator_delay_is_what_the_remedy_says(nsample: int, late_steps: int) -> None:
    """A delay of the actuator, with the samples that it asks for, is the command sent later; fewer shorten it."""
    step_s, first = 0.0002, 2.0
    effect = m.ActuatorDelay("slide", 15 * step_s)
    remedy = m.ActuatorDelay.phrase(Values(effect.report(), {}), scope(SLIDER), "slide").remedy
    found = re.search(r'delay="([0-9.e-]*)"', remedy)
    assert found is not None
    assert "nsample to at least delay / timestep" in remedy
    spec = mujoco.MjSpec.from_string(SLIDER)
    (actuator,) = (a for a in spec.actuators if a.name == "slide")
    actuator.delay, actuator.nsample = float(found[1]), nsample
    delayed, plain = spec.compile(), mujoco.MjModel.from_xml_string(SLIDER)
    commands = first + 10 * np.sin(0.1 * np.arange(200))
    late = np.concatenate([np.full(late_steps, first), commands])[: len(commands)]
    one, other = mujoco.MjData(delayed), mujoco.MjData(plain)
    mujoco.mj_initCtrlHistory(delayed, one, delayed.actuator("slide").id, None, np.full(nsample, first))
    for sent, arrived in zip(commands, late, strict=True):
        one.actuator("slide").ctrl[:], other.actuator("slide").ctrl[:] = sent, arrived
        mujoco.mj_step(delayed, one)
        mujoco.mj_step(plain, other)
        assert one.qpos == pytest.approx(other.qpos, abs=1e-15)


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


def test_a_ripple_goes_round() -> None:
    """Less than about once per turn, or half of that over the way that was recorded, is any smooth force."""
    way = 2 * 0.6
    for xml, joint, least in ((SLIDER, "slide", 0.5 / way), (ARM, "elbow", 0.5 * 2 * math.pi / way)):
        where = scope(xml, joint)
        slowest = np.array([p.lower for p in m.TorqueRipple.parameters(where)])
        assert m.TorqueRipple.from_vector(slowest, where).cycles == pytest.approx(least)
        slow = np.array([*m.TorqueRipple.starts(where)[0][:2], slowest[2]])
        assert is_out_of_range(m.TorqueRipple.parameters(where), slow)
    far = replace(scope(ARM, "elbow"), reach={"elbow": math.pi})
    slowest = np.array([p.lower for p in m.TorqueRipple.parameters(far)])
    assert m.TorqueRipple.from_vector(slowest, far).cycles == pytest.approx(0.9)
    assert len(m.TorqueRipple.starts(far)) > len(m.TorqueRipple.starts(scope(ARM, "elbow"))) > 0


def test_disturbance() -> None:
    """A force for some time gives its impulse, and nothing before and after."""
    _, _, v = move(compiled(FREE_SLIDER, m.Disturbance("slide", -3.0, 0.1001, 0.2503)), 0.4)
    assert v[500, 0] == 0.0
    assert v[-1, 0] == pytest.approx(-3.0 * 0.1502 / SLIDER_KG, rel=1e-9)
    assert v[-1, 0] == v[1252, 0]


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


@pytest.mark.parametrize("medium", ["", ' density="1.2"'])
def test_air_drag_is_c_v_v_whichever_way_a_body_is_turned(medium: str) -> None:
    """And nothing else: no torque, however it spins; beside what a believed medium does."""
    box = TOSSED.replace(".05 .05 .05", ".05 .03 .08").replace("<worldbody", f"<option{medium}/><worldbody")
    alone, airy = (compiled(box, *e) for e in ((), (m.AirDrag("cube", 0.8),)))
    rng = np.random.default_rng(0)
    for _ in range(20):
        passive, velocity = [], rng.normal(size=6) * [3.0, 3.0, 3.0, 20.0, 20.0, 20.0]
        turn = rng.normal(size=4)
        for model in (alone, airy):
            data = mujoco.MjData(model)
            data.qpos[3:7], data.qvel[:] = turn / np.linalg.norm(turn), velocity
            mujoco.mj_forward(model, data)
            passive.append(np.array(data.qfrc_passive))
        drag = -0.8 * np.linalg.norm(velocity[:3]) * velocity[:3]
        np.testing.assert_allclose(passive[1] - passive[0], [*drag, 0.0, 0.0, 0.0], rtol=1e-5, atol=1e-6)
