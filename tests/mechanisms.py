"""Small mechanisms for tests, built as a simulator builds them, and stepped by MuJoCo alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from runner.effects.mechanism import MechanismEffect, Scope
from runner.physics import joint_law

# dry friction that is nearly ideal at the steps used here
STIFF = 'solreffriction="0.0005 1" solimpfriction="0.999 0.9999 0.001 0.5 2"'

SLIDER = f"""<mujoco><option timestep="0.0002" integrator="implicitfast" gravity="0 0 -9.81"/>
<default><joint {STIFF}/></default>
<worldbody><body name="carriage">
<joint name="slide" type="slide" axis="1 0 0" damping="2" frictionloss="3" armature="0.4"/>
<inertial pos="0 0 0" mass="1.6" diaginertia=".01 .01 .01"/></body></worldbody>
<actuator><motor name="slide" joint="slide"/></actuator></mujoco>"""
SLIDER_KG, SLIDER_DRY_N, SLIDER_DAMPING = 2.0, 3.0, 2.0  # mass with the drive's
# without any friction
FREE_SLIDER = SLIDER.replace('frictionloss="3"', "").replace('damping="2"', "")

ARM = f"""<mujoco><option timestep="0.0002" integrator="implicitfast" gravity="0 0 -9.81"/>
<default><joint axis="0 -1 0" {STIFF}/></default>
<worldbody><body name="upper" pos="0 0 1">
<joint name="shoulder" damping="0.1" frictionloss="0.1" armature="0.02"/>
<inertial pos="0 0 -0.15" mass="1.5" diaginertia=".012 .012 .0003"/>
<body name="forearm" pos="0 0 -0.3">
<joint name="elbow" damping="0.02" frictionloss="0.02" armature="0.004"/>
<inertial pos="0 0 -0.12" mass="0.8" diaginertia=".004 .004 .0001"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/>
<position name="elbow" joint="elbow" kp="4" kv="0.3" forcerange="-3 3"/></actuator></mujoco>"""


# falls onto the floor within a tenth of a second from where tests put it
TOSSED = """<mujoco><option timestep="0.001" integrator="implicitfast"/>
<worldbody><geom name="floor" type="plane" size="1 1 1" pos="0 0 0.22"/>
<body name="cube" pos="0 0 0.3"><freejoint name="cube"/>
<geom name="cube" type="box" size=".05 .05 .05" mass="1" friction="0.3" priority="1"/></body></worldbody></mujoco>"""


def compiled(xml: str, *effects: MechanismEffect) -> mujoco.MjModel:
    """Return a model with effects in it: elements, compiling, numbers, derived constants."""
    joint_law.install()
    spec = mujoco.MjSpec.from_string(xml)
    for body in spec.bodies:
        if body.parent is not None:
            body.simple = 0
    for effect in effects:
        effect.edit_spec(spec)
    joint_law.reserve(spec)
    model = spec.compile()
    for effect in effects:
        effect.edit_model(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def move(
    model: mujoco.MjModel,
    duration_s: float,
    *,
    position: dict[str, float] | None = None,
    speed: dict[str, float] | None = None,
    command: Callable[[float], list[float]] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Step a model under a command of time; return times (n,), positions (n, nq), speeds (n, nv), the start first."""
    data = mujoco.MjData(model)
    for name, value in (position or {}).items():
        data.joint(name).qpos[:] = value
    for name, value in (speed or {}).items():
        data.joint(name).qvel[:] = value
    steps = round(duration_s / model.opt.timestep)
    q, v = np.empty((steps + 1, model.nq)), np.empty((steps + 1, model.nv))
    q[0], v[0] = data.qpos, data.qvel
    for k in range(steps):
        if command is not None:
            data.ctrl[:] = command(data.time + 0.5 * model.opt.timestep)
        mujoco.mj_step(model, data)
        q[k + 1], v[k + 1] = data.qpos, data.qvel
    return np.arange(steps + 1) * model.opt.timestep, q, v


@dataclass(frozen=True)
class Until:
    """An event that ends `solve_ivp`: a value of time and state goes through zero, upwards for 1, either way for 0."""

    value: Callable[[float, np.ndarray], float]
    direction: float = 0.0
    terminal: bool = True

    def __call__(self, t: float, y: np.ndarray) -> float:
        return self.value(t, y)


def coast(speed: float, resistance: Callable[[float], float]) -> tuple[float, float]:
    """Return time and distance of the slider until it rests, from integration of m dv/dt = -resistance(v)."""

    stops = Until(lambda _t, y: float(y[1]) * np.sign(speed) - 1e-9)
    run = solve_ivp(
        lambda _t, y: [y[1], -resistance(y[1]) / SLIDER_KG], (0, 20), [0.0, speed], events=stops, rtol=1e-9, atol=1e-12
    )
    return float(run.t[-1]), float(run.y[0, -1])


def stopped(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
    """Return time and place of the first rest of a motion."""
    first = int(np.argmax(abs(v[:, 0]) < 1e-6))
    return float(t[first]), float(q[first, 0])


def scope(xml: str, target: str | None = None) -> Scope:
    """Return what effects may know of one of these mechanisms, with plausible sizes."""
    model = compiled(xml)
    joints = [model.joint(j).name for j in range(model.njnt)]
    return Scope(
        model=model,
        target=target,
        speed=dict.fromkeys(joints, 1.5),
        reach=dict.fromkeys(joints, 0.6),
        force=dict.fromkeys(joints, 2.0),
        command={model.actuator(a).name: 5.0 for a in range(model.nu)},
        demand={model.actuator(a).name: 5.0 for a in range(model.nu)},
        signal={f"q_{joint}": 0.3 for joint in joints},
        length_s=5.0,
        step_s=0.01,
    )
