"""The vocabulary of effects: what may differ between a model and the world."""

from runner.effects.actuation import (
    ActuatorDelay,
    ActuatorGain,
    ActuatorLag,
    ActuatorSaturation,
    ApplicationPointOffset,
    DeadBand,
    ForceMisalignment,
)
from runner.effects.base import EFFECTS, AbstractEffect, Context, Motion, Parameter, Target
from runner.effects.friction import (
    AnisotropicFriction,
    AxisFriction,
    ContactPressure,
    Friction,
    FrictionPatch,
    Stiction,
    Stribeck,
    ViscousFilm,
)
from runner.effects.inertial import ComOffset, Inertia, Mass, MassLeak
from runner.effects.loads import AirDrag, FloorTilt, RotationalDamping, Tether, ViscousDrag, Wind
from runner.effects.sensing import ObservationDelay, SensorScale

__all__ = [
    "EFFECTS",
    "AbstractEffect",
    "ActuatorDelay",
    "ActuatorGain",
    "ActuatorLag",
    "ActuatorSaturation",
    "AirDrag",
    "AnisotropicFriction",
    "ApplicationPointOffset",
    "AxisFriction",
    "ComOffset",
    "ContactPressure",
    "Context",
    "DeadBand",
    "FloorTilt",
    "ForceMisalignment",
    "Friction",
    "FrictionPatch",
    "Inertia",
    "Mass",
    "MassLeak",
    "Motion",
    "ObservationDelay",
    "Parameter",
    "RotationalDamping",
    "SensorScale",
    "Stiction",
    "Stribeck",
    "Target",
    "Tether",
    "ViscousDrag",
    "ViscousFilm",
    "Wind",
]
