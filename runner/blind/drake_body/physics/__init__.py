"""A body above a table by Drake.

world         what is simulated, as values
points        where the body touches
plant         the `MultibodyPlant`
surroundings  forces on the body but weight and contact
poses         turning and comparing paths of poses
episode       stepping from sample to sample, and what the tracker shows
"""

from __future__ import annotations

from runner.blind.drake_body.physics.episode import STEP_S, DrakeError, Toss, simulate_all
from runner.blind.drake_body.physics.points import lowest_m, points_of
from runner.blind.drake_body.physics.poses import away
from runner.blind.drake_body.physics.world import Shape, Strange, World

__all__ = [
    "STEP_S",
    "DrakeError",
    "Shape",
    "Strange",
    "Toss",
    "World",
    "away",
    "lowest_m",
    "points_of",
    "simulate_all",
]
