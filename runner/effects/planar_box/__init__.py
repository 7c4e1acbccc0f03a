"""The effects of a box on a floor, one file each; a name may have several variants."""

# isort: off
# The order of the imports is that of the vocabulary: what a search tries first among equals depends on it. Files that
# are not named here come last, by name.
from runner.effects import import_all
from runner.effects.planar_box.base import EFFECTS as EFFECTS
from runner.effects.planar_box.base import Context as Context
from runner.effects.planar_box.base import Motion as Motion
from runner.effects.planar_box.base import PlanarEffect as PlanarEffect
from runner.effects.planar_box.base import Target as Target
from runner.effects.planar_box.actuator_gain import ActuatorGain as ActuatorGain
from runner.effects.planar_box.actuator_delay import ActuatorDelay as ActuatorDelay
from runner.effects.planar_box.actuator_lag import ActuatorLag as ActuatorLag
from runner.effects.planar_box.actuator_saturation import ActuatorSaturation as ActuatorSaturation
from runner.effects.planar_box.application_point_offset import ApplicationPointOffset as ApplicationPointOffset
from runner.effects.planar_box.force_misalignment import ForceMisalignment as ForceMisalignment
from runner.effects.planar_box.dead_band import DeadBand as DeadBand
from runner.effects.planar_box.body_size import BodySize as BodySize
from runner.effects.planar_box.friction import Friction as Friction
from runner.effects.planar_box.anisotropic_friction import AnisotropicFriction as AnisotropicFriction
from runner.effects.planar_box.anisotropic_friction import AxisFriction as AxisFriction
from runner.effects.planar_box.stribeck import Stribeck as Stribeck
from runner.effects.planar_box.stribeck import StribeckFromRest as StribeckFromRest
from runner.effects.planar_box.stiction import Stiction as Stiction
from runner.effects.planar_box.friction_patch import FrictionPatch as FrictionPatch
from runner.effects.planar_box.contact_pressure import ContactPressure as ContactPressure
from runner.effects.planar_box.pressure_shape import PressureShape as PressureShape
from runner.effects.planar_box.viscous_drag import ViscousDrag as ViscousDrag
from runner.effects.planar_box.viscous_drag import ViscousFilm as ViscousFilm
from runner.effects.planar_box.mass import Mass as Mass
from runner.effects.planar_box.inertia import Inertia as Inertia
from runner.effects.planar_box.com_offset import ComOffset as ComOffset
from runner.effects.planar_box.mass_leak import MassLeak as MassLeak
from runner.effects.planar_box.floor_tilt import FloorTilt as FloorTilt
from runner.effects.planar_box.wind import Wind as Wind
from runner.effects.planar_box.air_drag import AirDrag as AirDrag
from runner.effects.planar_box.rotational_damping import RotationalDamping as RotationalDamping
from runner.effects.planar_box.tether import Tether as Tether
from runner.effects.planar_box.observation_delay import ObservationDelay as ObservationDelay
from runner.effects.planar_box.pin_friction import PinFriction as PinFriction
from runner.effects.planar_box.pin_offset import PinOffset as PinOffset
from runner.effects.planar_box.sensor_scale import SensorScale as SensorScale

import_all(__name__, __path__)
