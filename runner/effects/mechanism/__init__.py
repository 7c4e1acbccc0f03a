"""The effects of a mechanism: any MuJoCo model of joints and free bodies, its actuators, contacts and sensors.

One file per effect: what is in this folder is in the vocabulary, `EFFECTS` lists the classes. `base` has the places
where they act, `parts` what they ask of a model, `contacts` what they ask of a body's contacts, `drive` the drive
behind a joint that backlash and compliance lie in front of.
"""

from runner.effects import import_all
from runner.effects.mechanism.actuator_delay import ActuatorDelay
from runner.effects.mechanism.actuator_gain import ActuatorGain
from runner.effects.mechanism.actuator_lag import ActuatorLag
from runner.effects.mechanism.actuator_saturation import ActuatorSaturation
from runner.effects.mechanism.air_drag import AirDrag
from runner.effects.mechanism.armature import Armature
from runner.effects.mechanism.asymmetric_friction import AsymmetricFriction
from runner.effects.mechanism.backlash import Backlash
from runner.effects.mechanism.base import EFFECTS, Command, MechanismEffect, Reading, Scope
from runner.effects.mechanism.body_size import BodySize
from runner.effects.mechanism.clock_scale import ClockScale
from runner.effects.mechanism.com_offset import ComOffset
from runner.effects.mechanism.compliance import Compliance
from runner.effects.mechanism.contact_stiffness import ContactStiffness
from runner.effects.mechanism.dead_band import DeadBand
from runner.effects.mechanism.disturbance import Disturbance
from runner.effects.mechanism.frame_tilt import FrameTilt
from runner.effects.mechanism.friction import ContactFriction
from runner.effects.mechanism.friction_cone import FrictionCone
from runner.effects.mechanism.gravity import Gravity, GravityTilt
from runner.effects.mechanism.inertia import FreeInertia, Inertia
from runner.effects.mechanism.joint_damping import JointDamping
from runner.effects.mechanism.joint_friction import JointFriction
from runner.effects.mechanism.joint_stiffness import JointStiffness
from runner.effects.mechanism.link_length import LinkLength
from runner.effects.mechanism.load_friction import LoadFriction
from runner.effects.mechanism.mass import Mass
from runner.effects.mechanism.observation_delay import ObservationDelay
from runner.effects.mechanism.payload import Payload
from runner.effects.mechanism.restitution import Restitution
from runner.effects.mechanism.rotational_damping import RotationalDamping
from runner.effects.mechanism.sensor_lag import SensorLag
from runner.effects.mechanism.sensor_offset import SensorOffset
from runner.effects.mechanism.sensor_scale import SensorScale
from runner.effects.mechanism.servo_damping import ServoDamping
from runner.effects.mechanism.servo_gain import ServoGain
from runner.effects.mechanism.stribeck import Stribeck
from runner.effects.mechanism.torque_offset import TorqueOffset
from runner.effects.mechanism.torque_ripple import TorqueRipple

__all__ = [
    "EFFECTS",
    "ActuatorDelay",
    "ActuatorGain",
    "ActuatorLag",
    "ActuatorSaturation",
    "AirDrag",
    "Armature",
    "AsymmetricFriction",
    "Backlash",
    "BodySize",
    "ClockScale",
    "ComOffset",
    "Command",
    "Compliance",
    "ContactFriction",
    "ContactStiffness",
    "DeadBand",
    "Disturbance",
    "FrameTilt",
    "FreeInertia",
    "FrictionCone",
    "Gravity",
    "GravityTilt",
    "Inertia",
    "JointDamping",
    "JointFriction",
    "JointStiffness",
    "LinkLength",
    "LoadFriction",
    "Mass",
    "MechanismEffect",
    "ObservationDelay",
    "Payload",
    "Reading",
    "Restitution",
    "RotationalDamping",
    "Scope",
    "SensorLag",
    "SensorOffset",
    "SensorScale",
    "ServoDamping",
    "ServoGain",
    "Stribeck",
    "TorqueOffset",
    "TorqueRipple",
]

import_all(__name__, __path__)
