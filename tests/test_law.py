"""The compiled law against closed forms, and against an independent integration (`reference.Box`)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drive import SQUARE_RADIUS, STEP_S, G, make, outputs, play, set_planar, set_push, twist, wait
from hypothesis import assume, given
from hypothesis import strategies as st
from reference import Box
from scipy.integrate import dblquad, quad

from runner import law
from runner.scene import Base, BodyConfig

CUBE = BodyConfig(mass_kg=3.0, friction=0.5)
FRICTIONLESS = replace(CUBE, friction=0.0)
# off the middle in all axes, lying box, inertia of no uniform body
ODD = BodyConfig(
    mass_kg=2.0,
    friction=0.4,
    half_size_m=(0.5, 0.4, 0.3),
    com_m=(0.1, -0.07, 0.05),
    inertia_kg_m2=(0.3, 0.35, 0.45),
)


def angles(values: tuple[float, ...] = (0.0, math.pi / 4, 1.1)) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("angle_rad", values)


def towards(angle_rad: float, size: float = 1.0) -> np.ndarray:
    return size * np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])


# The whole set of equations


@st.composite
def situations(draw: st.DrawFn) -> tuple[BodyConfig, dict[str, float], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A body, its law, gravity, a motion, and a push, with every option somewhere."""

    def number(low: float, high: float) -> float:
        return low + (high - low) * draw(st.integers(0, 1000)) / 1000

    half = np.array([number(0.2, 0.6), number(0.2, 0.6), number(0.1, 0.4)])
    inertia = np.array([number(0.5, 1.5) for _ in range(3)]) + 1.0
    mass = number(0.3, 10)
    body = BodyConfig(
        mass_kg=mass,
        friction=number(0.05, 1.0),
        half_size_m=tuple(half),
        com_m=tuple(half * [number(-0.25, 0.25), number(-0.25, 0.25), number(-0.5, 0.5)]),
        inertia_kg_m2=tuple(mass * 0.1 * inertia),
        base=draw(st.sampled_from(Base)),
    )
    record: dict[str, float] = {}
    if draw(st.booleans()):
        record |= {"along": number(0.5, 1.5), "across": number(0.5, 1.5), "aniso_angle": number(-3, 3)}
    if draw(st.booleans()):
        record |= {"stribeck": number(-0.5, 1.0), "stribeck_speed": number(0.2, 1.0)}
    if draw(st.booleans()):
        record |= {"patch": number(-0.9, 1.0), "patch_x": number(-1, 1), "patch_y": number(-1, 1)}
    if draw(st.booleans()):
        record |= {"film": number(0.0, 10.0), "air_drag": number(0.0, 5.0), "mass_leak": number(0.0, 0.5)}
    if draw(st.booleans()) and body.base is Base.even:
        record |= {"pressure": number(-0.9, 0.9)}
    tilt = np.array([number(-0.5, 0.5), number(-0.5, 0.5), -G])
    velocity = towards(number(-3.2, 3.2), number(0.5, 3.0))
    state = np.array([number(-1, 1), number(-1, 1), number(-4, 4), velocity[0], velocity[1], number(-4, 4)])
    force = towards(number(-3.2, 3.2), number(0, 1.5) * body.friction * mass * G)
    force[2] = number(-0.3, 0.3) * mass * G
    point = half * [number(-1, 1), number(-1, 1), number(-1, 1)]
    return body, record, tilt, state, force, point


@given(situations())
def test_law_agrees_with_independent_equations(
    case: tuple[BodyConfig, dict[str, float], np.ndarray, np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """In a vanishing step, acceleration, friction and load are those of equations written about the CoM."""
    body, record, gravity, state, force, point = case
    scene = make(body, **record)
    scene.model.opt.timestep = h = 1e-7
    scene.model.opt.gravity[:] = gravity
    set_planar(scene, state)
    scene.data.time = t = 0.3
    set_push(scene, force, point)
    before = twist(scene)
    wait(scene, STEP_S)  # one step
    got = (twist(scene) - before)[[0, 1, 5]] / h
    out = outputs(scene)
    cop = out[law.OUT_COP : law.OUT_COP + 2]
    assume(np.all(np.abs(cop) < 0.8 * np.array(body.half_size_m[:2])))  # or it would tip

    view = scene.law("b0")
    numbers = scene.model.body_user[scene.body("b0").body_id][law.STRIDE :]
    points = numbers[: int(view["points"]) * law.POINT_STRIDE].reshape(-1, law.POINT_STRIDE)

    def coefficient(speed: np.ndarray, place: np.ndarray) -> np.ndarray:
        near = np.hypot(place[:, 0] - view["patch_x"], place[:, 1] - view["patch_y"]) - view["patch_radius"]
        inside = 1 / (1 + np.exp(np.clip(near / (0.08 * view["patch_radius"]), -700, 700)))
        falls = np.exp(-((speed / view["stribeck_speed"]) ** 2))
        return body.friction * (1 + view["stribeck"] * falls) * (1 + view["patch"] * inside)

    box = Box(
        mass_kg=body.mass_kg,
        friction=body.friction,
        inertia_kg_m2=body.inertia[2],
        half_size_m=body.half_size_m,
        com_m=body.com_m,
        gravity_m_s2=(gravity[0], gravity[1], gravity[2]),
        points=points[:, :2],
        areas=points[:, 2],
        pressure=1 + view["pressure"] * points[:, 3],
        slip_eps_m_s=law.SLIP_EPS,
        friction_of=coefficient,
        axes=(view["along"], view["across"]),
        axis_rad=view["aniso_angle"],
        film_n_s_m=view["film"],
        air_n_s2_m2=view["air_drag"],
        leak_per_s=view["mass_leak"],
    )
    loads = box.loads(t, box.to_com(state[None])[0], lambda _: (force, point))
    # the geometric centre's acceleration: that of the CoM, and of turning about it
    left = 1 - view["mass_leak"] * t
    turning = loads.torque_nm / (body.inertia[2] * left)
    c, s = np.cos(state[2]), np.sin(state[2])
    lx, ly = c * body.com_m[0] - s * body.com_m[1], s * body.com_m[0] + c * body.com_m[1]
    linear = loads.force_n / (body.mass_kg * left) + turning * np.array([ly, -lx]) + state[5] ** 2 * np.array([lx, ly])
    np.testing.assert_allclose(got, [*linear, turning], atol=1e-5 * (G + abs(turning)))
    np.testing.assert_allclose(out[law.OUT_FORCE : law.OUT_FORCE + 2], loads.friction_n, atol=1e-5 * loads.carried_n)
    assert out[law.OUT_LOAD] == pytest.approx(loads.carried_n, rel=1e-6)
    np.testing.assert_allclose([c * cop[0] - s * cop[1], s * cop[0] + c * cop[1]], loads.centre_m, atol=1e-5)
