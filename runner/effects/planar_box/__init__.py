"""The effects of a box on a floor; a name may have several variants."""

from runner.effects.planar_box.actuation import (
    ActuatorDelay,
    ActuatorGain,
    ActuatorLag,
    ActuatorSaturation,
    ApplicationPointOffset,
    DeadBand,
    ForceMisalignment,
)
from runner.effects.planar_box.base import EFFECTS, Context, Motion, PlanarEffect, Target
from runner.effects.planar_box.friction import (
    AnisotropicFriction,
    AxisFriction,
    ContactPressure,
    Friction,
    FrictionPatch,
    Stiction,
    Stribeck,
    ViscousFilm,
)
from runner.effects.planar_box.inertial import ComOffset, Inertia, Mass, MassLeak
from runner.effects.planar_box.loads import AirDrag, FloorTilt, RotationalDamping, Tether, ViscousDrag, Wind
from runner.effects.planar_box.sensing import ObservationDelay, SensorScale

__all__ = [
    "EFFECTS",
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
    "PlanarEffect",
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
