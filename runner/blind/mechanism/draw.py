"""Plausible mechanisms, drawn: what an owner believes, with numbers of four digits that a file holds exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from runner.blind.mechanism.physics import Actuator, Joint, Link, Sensor, World

GRAVITY = 9.81
UNLIMITED = 0.6  # share of the servos whose force has no limit


@dataclass(frozen=True)
class Needs:
    """What a mechanism must have for an effect to be planted in it.

    Args:
        servo, motor: An actuator of that kind.
        dry: Dry friction in every joint.
        velocities: All velocities measured at every sample.
    """

    servo: bool = False
    motor: bool = False
    dry: bool = False
    velocities: bool = False

    def __or__(self, other: Needs) -> Needs:
        return Needs(
            self.servo or other.servo,
            self.motor or other.motor,
            self.dry or other.dry,
            self.velocities or other.velocities,
        )


def rounded(value: float) -> float:
    """Return a number with four digits."""
    return float(f"{value:.4g}")


def _log(g: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(g.uniform(math.log(low), math.log(high))))


def _link(g: np.random.Generator, mass: float, length: float) -> Link:
    arm = length * g.uniform(0.35, 0.6)
    inertia = mass * arm**2 * g.uniform(0.15, 0.5)
    return Link(rounded(mass), (0.0, -rounded(arm)), rounded(inertia))


def _kinds(count: int, needs: Needs, g: np.random.Generator) -> list[bool]:
    """Return which actuators are servos."""
    servos = [bool(g.random() < 0.4) for _ in range(count)]
    if needs.servo and not any(servos):
        servos[int(g.integers(count))] = True
    if needs.motor and all(servos):
        servos[int(g.integers(count))] = False
    return servos


def _driven(
    g: np.random.Generator, inertia: float, pull: float, needs: Needs, *, servo: bool
) -> tuple[Joint, Actuator, float]:
    """Return a joint and its actuator for an inertia and the largest torque of gravity, and the inertia in all."""
    armature = inertia * g.uniform(0.03, 0.3)
    whole = inertia + armature
    swing = math.sqrt(pull / whole)
    dry = pull * g.uniform(0.01, 0.06) if needs.dry or g.random() < 0.85 else 0.0
    joint = Joint(rounded(dry), rounded(whole * swing * g.uniform(0.03, 0.25)), rounded(armature))
    if not servo:
        return joint, Actuator(), whole
    kp = max(whole * g.uniform(8.0, 20.0) ** 2, 2.0 * pull)
    kv = 2.0 * g.uniform(0.15, 0.6) * math.sqrt(kp * whole)
    limit = math.inf if g.random() < UNLIMITED else rounded(pull + kp * g.uniform(0.2, 0.5))
    return joint, Actuator(1.0, rounded(kp), rounded(kv), limit), whole


def _assembled(slides: bool, links: list[Link], driven: list, length_m: float) -> World:
    sensors = tuple((Sensor(), Sensor()) for _ in links)
    joints, actuators = (tuple(part[k] for part in driven) for k in (0, 1))
    return World(slides, tuple(links), joints, actuators, sensors, length_m, (0.0, -GRAVITY))


def _pendulum(needs: Needs, g: np.random.Generator) -> World:
    (servo,) = _kinds(1, needs, g)
    link = _link(g, _log(g, 0.3, 3.0), g.uniform(0.25, 0.9))
    arm = -link.com_m[1]
    inertia = link.inertia_kg_m2 + link.mass_kg * arm**2
    return _assembled(False, [link], [_driven(g, inertia, link.mass_kg * GRAVITY * arm, needs, servo=servo)], 0.0)


def _arm2(needs: Needs, g: np.random.Generator) -> World:
    servos = _kinds(2, needs, g)
    length, mass = rounded(g.uniform(0.2, 0.5)), _log(g, 0.5, 3.0)
    upper, forearm = _link(g, mass, length), _link(g, mass * g.uniform(0.3, 0.8), length * g.uniform(0.7, 1.0))
    a, b = -upper.com_m[1], -forearm.com_m[1]
    own = forearm.inertia_kg_m2 + forearm.mass_kg * b**2
    whole = upper.inertia_kg_m2 + upper.mass_kg * a**2 + forearm.inertia_kg_m2 + forearm.mass_kg * (length + b) ** 2
    pulls = GRAVITY * (upper.mass_kg * a + forearm.mass_kg * (length + b)), GRAVITY * forearm.mass_kg * b
    driven = [
        _driven(g, inertia, pull, needs, servo=s) for inertia, pull, s in zip((whole, own), pulls, servos, strict=True)
    ]
    return _assembled(False, [upper, forearm], driven, length)


def _slider_servo(needs: Needs, g: np.random.Generator) -> World:
    mass = rounded(_log(g, 0.5, 5.0))
    armature = rounded(mass * g.uniform(0.05, 0.4))
    whole = mass + armature
    kp, ratio = whole * g.uniform(8.0, 25.0) ** 2, g.uniform(0.15, 0.5)
    dry = rounded(whole * g.uniform(0.05, 0.5)) if needs.dry or g.random() < 0.85 else 0.0
    joint = Joint(dry, rounded(whole * g.uniform(0.2, 2.0)), armature)
    limit = math.inf if g.random() < UNLIMITED else rounded(kp * g.uniform(0.08, 0.2))
    servo = Actuator(1.0, rounded(kp), rounded(2.0 * ratio * math.sqrt(kp * whole)), limit)
    return _assembled(True, [Link(mass)], [(joint, servo)], 0.0)


DRAWN: dict[str, Callable[[Needs, np.random.Generator], World]] = {
    "pendulum": _pendulum,
    "arm2": _arm2,
    "slider_servo": _slider_servo,
}
