"""Bodies for the tests of dry friction, and situations that have every option of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drive import G
from hypothesis import strategies as st

from runner.physics.scene import Base, BodyConfig

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


@st.composite
def situations(draw: st.DrawFn) -> tuple[BodyConfig, dict[str, Any], np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A body, its friction, gravity, a motion, and a push, with every option somewhere."""

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
    record: dict[str, Any] = {}
    if draw(st.booleans()):
        record |= {"along": number(0.5, 1.5), "across": number(0.5, 1.5), "aniso_angle": number(-3, 3)}
        record |= {"normality": number(0.0, 1.0)}
    if draw(st.booleans()):
        record |= {"stribeck": number(-0.5, 0.9), "stribeck_speed": number(0.2, 1.0)}
        record |= {"stribeck_exponent": number(0.5, 2.0), "stribeck_reference": number(0.0, 1.0)}
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


def weave(t_s: float) -> tuple[np.ndarray, np.ndarray]:
    """A push that turns once in 4 s, swells and ebbs, at a point of the body that moves about; rests at both ends."""
    if not 1.0 <= t_s < 19.0:
        return np.zeros(3), np.zeros(3)
    phase = 0.5 * math.pi * t_s
    return towards(phase, 22 * (0.6 + 0.4 * math.sin(3 * phase))), np.array([0, 0.25 * math.sin(1.7 * phase), -0.2])
