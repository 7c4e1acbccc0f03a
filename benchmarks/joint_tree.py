"""Time of a step of a mechanism without the engine around it, as a ratio to MuJoCo's own of the same model.

    python -m benchmarks.joint_tree [rounds]

A chain of one, two and six links with servos and dry friction moves for 20,000 steps, in `mujoco.rollout` and in
`physics.joint_tree`, both in one thread and from a compiled model. The two take turns, so that a busy machine slows
both; the figures are medians over the rounds.
"""

from __future__ import annotations

import sys
import time

import mujoco
import numpy as np
from mujoco import rollout

from runner.physics import joint_law, joint_tree
from runner.systems.mechanism import midpoint
from runner.systems.mechanism.simulator import CONTROL, FULL

STEPS = 20_000


def chain(links: int) -> mujoco.MjModel:
    """Return a chain of links that hang from each other, as a diagnosis steps it."""
    inside, servos = "", ""
    for k in reversed(range(links)):
        inside = f"""<body pos="0 0 {-0.2 * (k > 0)}"><joint name="j{k}" axis="{k % 2} 1 0" damping="0.1"
        armature="0.01" frictionloss="0.2" solreffriction="0.002 1"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.5"
        contype="0" conaffinity="0"/>{inside}</body>"""
        servos = f'<position joint="j{k}" kp="20" kv="1"/>{servos}'
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="0.001"/><worldbody>{inside}</worldbody><actuator>{servos}</actuator></mujoco>'
    )
    joint_law.reserve(spec)
    midpoint.reserve(spec)
    model = spec.compile()
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONTACT) | int(off.mjDSBL_ISLAND)
    model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    midpoint.mark(model, np.zeros(model.nu), free=False)
    return model


def microseconds(links: int, rounds: int) -> tuple[float, float]:
    """Return how long a step takes in MuJoCo and without it."""
    model = chain(links)
    tree = joint_tree.tree_of(model)
    if tree is None:
        raise RuntimeError("a chain of links is a tree of joints")
    start = np.zeros((1, mujoco.mj_stateSize(model, FULL)))
    control = np.zeros((1, STEPS, model.nu + model.nv))
    control[0, :, : model.nu] = np.sin(0.005 * np.arange(STEPS))[:, None]
    engine, data = rollout.Rollout(nthread=0), [mujoco.MjData(model)]
    joint_tree.rollout([tree], start, control[:, :2])
    took = []
    for _ in range(rounds):
        at = [time.perf_counter()]
        engine.rollout([model], data, start, control, control_spec=CONTROL)
        at.append(time.perf_counter())
        joint_tree.rollout([tree], start, control)
        took.append(np.diff([*at, time.perf_counter()]))
    theirs, ours = np.median(took, axis=0) / STEPS * 1e6
    return float(theirs), float(ours)


def main() -> None:
    """Print what a step takes."""
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    joint_law.install()
    midpoint.install()
    for links in (1, 2, 6):
        theirs, ours = microseconds(links, rounds)
        print(f"{links} joints: {ours / theirs:.2f} of MuJoCo's {theirs:.2f} microseconds a step")


if __name__ == "__main__":
    main()
