"""Trees of joints that are stepped without the engine move as MuJoCo's own steps let them move."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from mujoco import rollout as engine

from runner.physics import joint_law, joint_tree
from runner.physics.joint_law import JointLaw
from runner.systems.mechanism import midpoint
from runner.systems.mechanism.simulator import CONTROL, FULL

STEPS, STEP_S = 400, 0.001
JOINTS = """<joint name="{name}" type="{type}" axis="{axis}" pos="{pos}" damping="{damping}" stiffness="{stiffness}"
 springref="0.1" frictionloss="{friction}" armature="0.02" limited="true" range="{range}" margin="0.01"
 solreffriction="{solref}" solimpfriction="0.9 0.999 0.001" {limit}/>"""


@pytest.fixture(autouse=True, scope="module")
def _laws() -> None:
    joint_law.install()
    midpoint.install()


def numbers(values: np.ndarray) -> str:
    """Return numbers as an attribute of an MJCF has them."""
    return " ".join(f"{v:.6g}" for v in np.atleast_1d(values))


def body(rng: np.random.Generator, name: str, inside: str) -> str:
    """Return a body with one or two joints, turned and off in every way, around others."""
    joints = "".join(
        JOINTS.format(
            name=f"{name}{k}", type=rng.choice(["hinge", "slide"]), axis=numbers(rng.normal(size=3)),
            pos=numbers(0.1 * rng.normal(size=3)), damping=rng.choice([0.0, 0.2]), stiffness=rng.choice([0.0, 3.0]),
            friction=rng.choice([0.0, 0.3]), range="-0.2 0.3", solref=rng.choice(["0.02 1", "-900 -40"]),
            limit=rng.choice(["", 'actuatorfrclimited="true" actuatorfrcrange="-0.5 0.7"']),
        )
        for k in range(rng.integers(1, 3))
    )  # fmt: skip
    place, turned = numbers(0.2 * rng.normal(size=3)), numbers(rng.normal(size=4))
    inertia = (
        f'pos="{numbers(0.1 * rng.normal(size=3))}" quat="{numbers(rng.normal(size=4))}" mass="{rng.uniform(0.5, 2)}"'
    )
    gravcomp = rng.choice(["0", "0.6"])
    return (
        f'<body name="{name}" pos="{place}" quat="{turned}" gravcomp="{gravcomp}">'
        f'<inertial {inertia} diaginertia="0.02 0.03 0.04"/>{joints}{inside}</body>'
    )


def tree(seed: int) -> mujoco.MjModel:
    """Return a model of two branches on one trunk, with motors, servos, and two tendons between the branches."""
    rng = np.random.default_rng(seed)
    branch = body(rng, "b", body(rng, "c", '<body pos="0.1 0 0"><geom size="0.03" mass="0.2"/></body>'))
    trunk = body(rng, "a", branch + body(rng, "d", ""))
    xml = f"""<mujoco><option timestep="{STEP_S}" gravity="1 -2 -9"/><worldbody>{trunk}</worldbody>
    <tendon><fixed name="s" stiffness="40" damping="0.8" springlength="-0.05 0.05"><joint joint="b0" coef="1"/>
    <joint joint="d0" coef="-1.5"/></fixed><fixed name="l" limited="true" range="-0.1 0.1" margin="0.01">
    <joint joint="a0" coef="0.7"/><joint joint="c0" coef="1"/></fixed></tendon>
    <actuator><motor joint="a0" gear="2" ctrllimited="true" ctrlrange="-0.8 0.8"/>
    <position joint="b0" kp="30" kv="2" forcelimited="true" forcerange="-2 2"/><velocity joint="c0" kv="1.5"/>
    <general joint="d0" gaintype="affine" gainprm="1 0.3 -0.2" biastype="affine" biasprm="0.1 -2 -0.3"/></actuator>
    </mujoco>"""
    return ready(xml)


def ready(xml: str) -> mujoco.MjModel:
    """Return a model as a diagnosis steps it."""
    spec = mujoco.MjSpec.from_string(xml)
    joint_law.reserve(spec)
    midpoint.reserve(spec)
    for part in spec.bodies[1:]:
        part.simple = 0
    model = spec.compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    model.opt.tolerance = 0.0
    taken = np.zeros(model.nu)
    taken[1:2] = 0.01
    midpoint.mark(model, taken, free=False)
    return model


def both(model: mujoco.MjModel, seed: int, *, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return what MuJoCo makes of a motion and what we make of it, (n, 1 + 2 V) each."""
    rng, time = np.random.default_rng(seed), np.arange(STEPS) * STEP_S
    start = np.zeros((1, mujoco.mj_stateSize(model, FULL)))
    start[0, 0], start[0, 1:] = 0.7, 0.1 * size * rng.normal(size=2 * model.nv)
    waves = np.sin(time[:, None] * rng.uniform(5, 40, model.nu + model.nv) + rng.uniform(0, 6, model.nu + model.nv))
    control = (size * waves * np.concatenate([np.ones(model.nu), 0.3 * np.ones(model.nv)]))[None]
    theirs, _ = engine.Rollout(nthread=0).rollout([model], [mujoco.MjData(model)], start, control, control_spec=CONTROL)
    found = joint_tree.tree_of(model)
    assert found is not None
    return theirs[0], joint_tree.rollout([found], start, control)[0]


@pytest.mark.parametrize("seed", range(12))
def test_steps_are_the_engines(seed: int) -> None:
    """Of branching trees with all that is allowed in them, through stops, saturated servos and turns of friction."""
    theirs, ours = both(tree(seed), seed)
    assert np.isfinite(theirs).all()
    assert np.ptp(theirs[:, 1:], axis=0).max() > 0.05
    assert np.abs(ours - theirs).max() < 1e-7 * np.abs(theirs).max()


@pytest.mark.parametrize("seed", range(6))
def test_steps_have_the_law_of_joints(seed: int) -> None:
    """Stribeck's friction, one that grows with load, differences between directions, ripple, and a push."""
    rng, model = np.random.default_rng(100 + seed), tree(seed)
    names = (
        "offset",
        "excess",
        "load_share",
        "dry_difference",
        "viscous_difference",
        "ripple_sin",
        "ripple_cos",
        "push",
    )
    for joint in range(model.njnt):
        law = JointLaw(model, joint)
        for name in names:
            law[name] = 0.3 * rng.random()
        law["excess_speed"], law["excess_power"], law["ripple_rate"] = 0.1, 1.5, 9.0
        law["push_from"], law["push_until"] = 0.7503, 0.9001
    theirs, ours = both(model, seed)
    unchanged, _ = both(tree(seed), seed)
    assert np.abs(unchanged - theirs).max() > 1e-3
    assert np.abs(ours - theirs).max() < 1e-7 * np.abs(theirs).max()


def test_many_are_simulated_at_once_each_with_its_own_numbers() -> None:
    """In two threads as in one, and as each alone."""
    model, heavier = tree(1), tree(1)
    heavier.body_mass[1:] *= 1.5
    trees = [t for t in map(joint_tree.tree_of, (model, heavier)) if t is not None]
    rng = np.random.default_rng(5)
    start = 0.1 * rng.normal(size=(5, 1 + 2 * model.nv))
    control = rng.normal(size=(5, 30, model.nu + model.nv))
    of = [trees[i] for i in (0, 1, 1, 0, 1)]
    together = joint_tree.rollout(of, start, control, 2)
    assert np.array_equal(together, joint_tree.rollout(of, start, control))
    for i, one in enumerate(of):
        assert np.array_equal(together[i : i + 1], joint_tree.rollout([one], start[i : i + 1], control[i : i + 1]))
    assert not np.allclose(*joint_tree.rollout(trees, start[:1].repeat(2, 0), control[:1].repeat(2, 0)))


def test_what_diverges_is_no_number_from_there_on() -> None:
    """A spring far too stiff for the step; others go on."""
    model = tree(2)
    model.jnt_stiffness[:] = 1e9
    found = joint_tree.tree_of(model)
    sound = joint_tree.tree_of(tree(2))
    assert found is not None
    assert sound is not None
    start = np.full((2, 1 + 2 * model.nv), 0.1)
    out = joint_tree.rollout([found, sound], start, np.zeros((2, STEPS, model.nu + model.nv)))
    lost = np.isnan(out[0]).any(axis=1)
    assert lost.any()
    assert lost[np.argmax(lost) :].all()
    assert np.isfinite(out[1]).all()


ARM = """<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/>
{inside}</body></worldbody>{more}</mujoco>"""


@pytest.mark.parametrize(
    ("inside", "more", "change"),
    [
        ("", '<actuator><position joint="j" timeconst="0.1"/></actuator>', None),
        ("", '<equality><joint joint1="j"/></equality>', None),
        ("", '<worldbody><body><freejoint/><geom size="0.1"/></body></worldbody>', None),
        ('<body pos="1 0 0"><joint type="ball"/><geom size="0.1"/></body>', "", None),
        ("", "", lambda m: setattr(m.opt, "density", 1.2)),
        ("", "", lambda m: setattr(m.opt, "integrator", 0)),
        ("", "", lambda m: setattr(m.opt, "o_margin", 0.0)),
        ("", "", lambda m: setattr(m.opt, "disableflags", 0)),
        ("", "", lambda m: m.dof_dampingpoly.__setitem__(0, 0.1)),
    ],
)
def test_what_is_more_than_a_tree_of_joints_is_left_to_the_engine(inside: str, more: str, change: object) -> None:
    """Activations, equalities, bodies that fly, air, contacts, another way to integrate."""
    model = ready(ARM.format(inside=inside, more=more))
    if callable(change):
        assert joint_tree.tree_of(model) is not None
        change(model)
    assert joint_tree.tree_of(model) is None
