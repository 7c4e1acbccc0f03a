"""Where the compiled functions find the numbers of a world: columns of its tables."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from runner.blind.mechanism.physics.world import Actuator, Joint, World

_JOINT = [f.name for f in fields(Joint) if f.name != "swings"]
_ACTUATOR = [f.name for f in fields(Actuator)]
(
    DRY, DAMPING, ARMATURE, OFFSET, EXCESS, EXCESS_SPEED, DRY_DIFFERENCE, VISCOUS_DIFFERENCE, LOAD_SHARE, STIFFNESS,
    REST, RIPPLE, RIPPLE_RATE, RIPPLE_PHASE, PUSH, PUSH_FROM, PUSH_UNTIL, PLAY, GIVE, DRIVE_SHARE, SPRING_DAMPING,
    QUADRATIC, CUBIC, CUBIC_REST, DAHL, DAHL_RATE, WARM_UP, WARM_UP_S, PATCH, PATCH_AT, PATCH_WIDTH, STOP_STIFFNESS,
    STOP_AT, STOP_SIDE,
) = range(len(_JOINT))  # fmt: skip
(
    SERVO, KP, KV, LIMIT, GAIN, DELAY, LAG, DEAD_BAND, ONE_SIDED, FADE, FADE_S, FADE_FORCE, SLIP, SLIP_AT, CROSSTALK,
    QUANTUM, SLEW, JITTER, DROPOUT,
) = range(len(_ACTUATOR))  # fmt: skip
# of the whole: then per link mass, x and z of its centre, inertia
SLIDES, LENGTH, GRAVITY_X, GRAVITY_Z, LINKS = range(5)
MASS, COM_X, COM_Z, INERTIA, LINK = range(5)
WAVES = 8  # swings of a joint at most


def pack(world: World) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a world as tables: of the whole, of joints, of actuators, of swings (joint, wave, 3), of sensors' lags."""
    whole = [float(world.slides), world.length_m, *world.gravity_m_s2]
    for link in world.links:
        whole += [link.mass_kg, *link.com_m, link.inertia_kg_m2]
    joints = np.array([[float(getattr(j, name)) for name in _JOINT] for j in world.joints])
    actuators = np.array([[float(getattr(a, name)) for name in _ACTUATOR] for a in world.actuators])
    swings = np.zeros((len(joints), WAVES, 3))
    for i, joint in enumerate(world.joints):
        swings[i, : len(joint.swings)] = np.array(joint.swings).reshape(-1, 3)
    lags = np.array([sensor.lag_s for pair in world.sensors for sensor in pair])
    return np.array(whole), joints, actuators, swings, lags
