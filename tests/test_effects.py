"""Every effect, planted in an independent integration of the same box, moves it as our edit says, and is found."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runner.blind.planar_box.physics import PlannedEpisode, World, simulate
from runner.effects import planar_box as fx
from runner.effects.base import AbstractEffect
from runner.effects.planar_box.base import Motion, ahead, late
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import NONE, Explanation
from runner.inference.multiple_shooting import begun
from runner.physics.dry_friction import base_points
from runner.recording import Episode, Form, Noise, Nominal, Recording
from runner.systems.planar_box.simulator import Simulator
from runner.systems.simulator import Run
from tests.cases import fitter_of

HALF, MASS, MU, RATE = (0.3, 0.3, 0.3), 2.0, 0.25, 60.0
NOISE = Noise(0.0005, 0.0008, 0.003, 0.005)
SIGMA = np.array([0.0005, 0.0005, 0.0008, 0.003, 0.003, 0.005])

# (the effect as a model edit, the same thing in the other integrator, how near the fit must come: of each parameter)
PLANTED: dict[str, tuple[AbstractEffect, dict[str, Any], float]] = {
    "mass": (fx.Mass(2.3), {"mass": 2.3}, 0.01),
    "friction": (fx.Friction(0.28), {"friction": 0.28}, 0.01),
    "com_offset": (fx.ComOffset(0.03, -0.04), {"com": (0.03, -0.04)}, 0.1),
    "inertia": (fx.Inertia(1.4), {"inertia": 1.4 * MASS * 0.18 / 3}, 0.06),
    "anisotropic_friction": (
        fx.AnisotropicFriction(1.15 / 0.85, 0.4),
        {"anisotropy": (1.15, 0.85), "anisotropy_angle": 0.4},
        0.05,
    ),
    "anisotropic_friction of axes": (
        fx.AxisFriction(1.3 / 0.7, 0.4),
        {"anisotropy": (1.3, 0.7), "anisotropy_angle": 0.4, "anisotropy_flow": "scaled"},
        0.05,
    ),
    "viscous_drag": (fx.ViscousDrag(0.8), {"viscous_drag": 0.8}, 0.05),
    "viscous_drag film": (fx.ViscousFilm(0.8), {"film": 0.8}, 0.05),
    "air_drag": (fx.AirDrag(0.8), {"air_drag": 0.8}, 0.05),
    "rotational_damping": (fx.RotationalDamping(0.1), {"rotational_damping": 0.1}, 0.1),
    "stribeck": (fx.Stribeck(0.3, 0.3), {"stribeck": 0.3, "stribeck_speed": 0.3}, 0.02),
    "stribeck of another exponent": (
        fx.Stribeck(0.3, 0.3, 1.0),
        {"stribeck": 0.3, "stribeck_speed": 0.3, "stribeck_exponent": 1.0},
        0.02,
    ),
    "stribeck from rest": (
        fx.StribeckFromRest(0.5, 0.3, 1.0),
        {"stribeck": 0.5 / 1.5, "stribeck_speed": 0.3, "stribeck_exponent": 1.0, "stribeck_reference": 1.0},
        0.02,
    ),
    "stiction": (fx.Stiction(0.7), {"stiction": 0.7}, 0.3),
    "stiction that fades slowly": (fx.Stiction(0.7, 0.01), {"stiction": 0.7, "stiction_speed": 0.01}, 0.3),
    "friction_patch": (
        fx.FrictionPatch(0.4, 0.1, 0.1, 0.5),
        {"patch": 0.4, "patch_place": (0.1, 0.1), "patch_radius": 0.5},
        0.3,
    ),
    "floor_tilt": (fx.FloorTilt(0.03, 0.7), {"tilt": 0.03, "downhill": 0.7}, 0.05),
    "wind": (fx.Wind(0.6, -2.0), {"wind": (0.6 * math.cos(-2), 0.6 * math.sin(-2))}, 0.05),
    "tether": (
        fx.Tether(1.0, 0.8, -0.5, 0.6),
        {"tether": 1.0, "tether_place": (0.8, -0.5), "tether_rest": 0.6},
        0.2,
    ),
    "mass_leak": (fx.MassLeak(0.04), {"mass_leak": 0.04}, 0.1),
    "actuator_gain": (fx.ActuatorGain(1.1), {"gain": 1.1}, 0.01),
    "actuator_delay": (fx.ActuatorDelay(0.0621), {"delay": 0.0621}, 0.03),
    "actuator_lag": (fx.ActuatorLag(0.08), {"lag": 0.08}, 0.05),
    "actuator_saturation": (fx.ActuatorSaturation(8.5), {"saturation": 8.5}, 0.02),
    "application_point_offset": (fx.ApplicationPointOffset(0.04, 0.02), {"point_offset": (0.04, 0.02)}, 0.15),
    "force_misalignment": (fx.ForceMisalignment(0.15), {"misalignment": 0.15}, 0.05),
    "observation_delay": (fx.ObservationDelay(0.05), {"observation_delay": 0.05}, 0.03),
    "sensor_scale": (fx.SensorScale(1.1), {"sensor_scale": 1.1}, 0.02),
}


def pushes(seed: int, seconds: float = 4.0) -> np.ndarray:
    """Straight and off-centre pushes with rests, (n, 5)."""
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE) + 1
    command = np.zeros((n, 5))
    t = 15
    while t < n - 40:
        angle, size = rng.uniform(-math.pi, math.pi), rng.uniform(6.5, 11)
        push = slice(t, t + int(rng.uniform(25, 45)))
        command[push, :2] = size * np.array([math.cos(angle), math.sin(angle)])
        command[push, 2:4] = rng.uniform(-0.2, 0.2, 2) * (rng.random() < 0.7)
        t = push.stop + int(rng.uniform(15, 50))
    return command


STARTS = (np.zeros(6), np.array([0.3, -0.2, 0.5, 0.9, 0.4, 1.5]), np.array([-0.2, 0.4, -1, 0.0, 0, 0]))


def recorded(world: World, *, noise: float = 0.0, seconds: float = 4.0) -> Recording:
    rng = np.random.default_rng(7)
    episodes = []
    for i, start in enumerate(STARTS):
        command = pushes(i, seconds)
        state = simulate(world, PlannedEpisode(start, command, RATE), points=12)
        state = state + noise * SIGMA * rng.normal(size=state.shape)
        force = np.column_stack([command[:, :2], np.zeros(len(command))])
        time = np.arange(len(command)) / RATE
        episodes.append(Episode(i, time, state[:, :3], state[:, 3:], force, command[:, 2:5]))
    return Recording(Path("planted"), Form.PLANAR, Nominal(HALF, MASS, MU, 9.81, RATE, noise=NOISE), tuple(episodes))


def world(**changes: Any) -> World:
    values: dict[str, Any] = {"half_size": HALF, "mass": MASS, "friction": MU}
    return World(**(values | changes))


@pytest.mark.parametrize("name", PLANTED)
def test_the_edited_model_moves_like_an_independent_integration(name: str) -> None:
    """Poses agree within 3 mm and 6 mrad rms over 4 s, and the effect matters at least eight times as much.

    6 mm where our form differs on purpose: a patch has a smooth edge.
    """
    effect, changes, _ = PLANTED[name]
    recording = recorded(world(**changes))
    simulator = Simulator(recording, grid=12, step_rate_hz=240, threads=1)
    off, moved = [], []
    for e, start in enumerate(STARTS):
        if name == "sensor_scale":
            start = start / np.array([1.1, 1.1, 1, 1.1, 1.1, 1])
        nominal, planted = simulator.predict(e, [Run((), STARTS[e]), Run((effect,), start)])
        off.append(planted[:, :3] - recording.episodes[e].pose)
        moved.append(nominal[:, :3] - recording.episodes[e].pose)
    error, change = (np.sqrt(np.mean(np.concatenate(d) ** 2, axis=0)) for d in (off, moved))
    assert np.hypot(error[0], error[1]) < (0.006 if name == "friction_patch" else 0.003)
    assert error[2] < 0.006
    assert max(change / np.array([0.003, 0.003, 0.006])) > 2
    assert max(change / np.maximum(error, 1e-9)) > 8


def told(effect: AbstractEffect) -> dict[str, float]:
    """Return what a recording tells of an effect: its values; of friction by speed the curve, of static friction how
    much it is, as speed and exponent make up for each other."""
    if isinstance(effect, fx.Stribeck):
        share = effect.change / (1 + effect.reference * effect.change)
        falls = {v: math.exp(-((v / effect.speed_m_s) ** effect.exponent)) for v in (0.05, 0.2, 0.4)}
        return {f"at {v} m/s": 1 + share * (fall - effect.reference) for v, fall in falls.items()}
    return {k: v for k, v in effect.report().items() if not isinstance(effect, fx.Stiction) or k == "excess"}


# other forms of what is there in one form anyway
OTHER_FORMS = ("stribeck of another exponent", "stribeck from rest", "stiction that fades slowly")


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in OTHER_FORMS else n for n in PLANTED])
def test_its_parameters_are_recovered(name: str) -> None:
    """A fit to noisy recordings of the other integrator finds what was planted."""
    effect, changes, tolerance = PLANTED[name]
    recording = recorded(world(**changes), noise=1.0, seconds=3.0)
    fitter = fitter_of(recording)
    explanation = Explanation((Candidate(type(effect)),))
    starts = type(effect).starts(fitter.context)
    episodes = range(len(recording.episodes))
    # as the search does where the nominal model goes far astray: from pieces of the episodes
    spans = fitter.pieces(1.0, episodes)
    short, pieces = fitter.parts(spans), range(len(spans))
    near = short.fit(NONE, pieces)
    scale = np.array([p.scale for p in explanation.parameters(fitter.context)])
    candidates = starts if len(starts) else [0.05 * scale]
    rough = [
        short.fit(explanation, pieces, x=x, near=near, iterations=6) for x in candidates[:: max(len(starts) // 3, 1)]
    ]
    best, nominal = min(rough, key=lambda f: f.total), fitter.fit(NONE, episodes)
    fits = [fitter.fit(explanation, episodes, x=best.x, starts=begun(best, spans, nominal), iterations=25)]
    if not len(starts):
        fits.append(fitter.fit(explanation, episodes, x=0.05 * scale, near=nominal, iterations=25))
    fit = min(fits, key=lambda f: f.total)
    found = told(explanation.make(fit.x, fitter.context)[0])
    for key, true in told(effect).items():
        near_enough = tolerance * abs(true) if not key.endswith(("_rad",)) else max(tolerance, 0.1)
        assert abs(found[key] - true) <= near_enough, (key, found[key], true)


def test_every_effect_of_the_vocabulary_is_planted() -> None:
    """No effect goes untested; the shape of contact pressure is tested with dry friction."""
    names = {PLANTED[key][0].name for key in PLANTED}
    assert names | {"contact_pressure"} == set(fx.EFFECTS)


def test_pressure_on_the_rim_resists_turning_more() -> None:
    """Spin-down time scales with the mean radius of the load."""
    recording = recorded(world())
    spin = np.array([0, 0, 0, 0, 0, 3.0])
    quiet = Simulator(
        Recording(
            recording.path,
            recording.form,
            recording.nominal,
            (
                Episode(
                    0, np.arange(61) / RATE, np.zeros((61, 3)), np.zeros((61, 3)), np.zeros((61, 3)), np.zeros((61, 3))
                ),
            ),
        ),
        grid=12,
        threads=1,
    )
    even, rim, middle = quiet.predict(
        0, [Run(e, spin) for e in ((), (fx.ContactPressure(0.5),), (fx.ContactPressure(-0.5),))]
    )
    x, y, w, shape = base_points(0.3, 0.3, 12).T
    radius = np.hypot(x, y)
    slow = 10  # samples, before any of the three has stopped
    for share, motion in ((0.0, even), (0.5, rim), (-0.5, middle)):
        load = w * (1 + share * shape)
        torque = MU * MASS * 9.81 * float(np.sum(load * radius) / np.sum(load))
        assert 3.0 - motion[slow, 5] == pytest.approx(torque / (MASS * 0.18 / 3) * slow / RATE, rel=2e-3)


def test_a_delay_of_part_of_a_step_is_exact_for_uniform_acceleration() -> None:
    """Whole steps late and the rest read ahead: the motion is that of the delayed push, between steps too."""
    step, delay, n = 1 / 120, 0.0213, 60
    columns = np.zeros((n, 12))
    columns[:, 0] = 2.0
    pushed = late(columns, delay, step)[:, 0]
    velocity = np.concatenate([[0], np.cumsum(pushed * step)])
    position = np.concatenate([[0], np.cumsum(0.5 * step * (velocity[1:] + velocity[:-1]))])
    time = np.arange(n + 1) * step
    zeros = np.zeros(n + 1)
    motion = Motion(time, np.column_stack([position, zeros, zeros]), np.column_stack([velocity, zeros, zeros]))
    read = ahead(motion, delay)
    moving = time > delay + step
    np.testing.assert_allclose(read.twist[moving, 0], 2 * (time[moving] - delay), atol=1e-12)
    np.testing.assert_allclose(read.pose[moving, 0], (time[moving] - delay) ** 2, atol=1e-12)


def test_what_is_confounded_is_so_both_ways() -> None:
    """Each of a pair names the other, for one reason and with one advice; one of them stands for both."""
    pairs = [(cls, other) for classes in fx.EFFECTS.values() for cls in classes for other in cls.confounded]
    assert len(pairs) == 6
    for cls, other in pairs:
        (theirs,) = (c for variant in fx.EFFECTS[other.name] for c in variant.confounded)
        assert (theirs.name, theirs.why, theirs.advice) == (cls.name, other.why, other.advice)
        assert {cls.commonness, fx.EFFECTS[other.name][0].commonness} == {0, 1}
