"""A second physics: a slide, a pendulum or a two-link arm, their equations of motion written out.

It shares nothing with MuJoCo, nor with the compiled law of joints that a diagnosis fits with, so that a recording made
here is other people's data to that diagnosis.

world      the numbers of a mechanism, and of what may be the matter with it
dynamics   the equations of motion
stepping   the integrator: implicit midpoint, cut at reversals and impacts, joints that truly stick
episode    what is sent when, and what the sensors show
"""

from __future__ import annotations

from runner.blind.mechanism.physics.episode import (
    COARSE_S,
    DivergedError,
    PlannedEpisode,
    simulate,
    simulate_or_none,
)
from runner.blind.mechanism.physics.world import Actuator, Joint, Link, Sensor, World

__all__ = [
    "COARSE_S",
    "Actuator",
    "DivergedError",
    "Joint",
    "Link",
    "PlannedEpisode",
    "Sensor",
    "World",
    "simulate",
    "simulate_or_none",
]
