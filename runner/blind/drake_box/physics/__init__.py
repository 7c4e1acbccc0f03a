"""A box on a floor by Drake: rigid body, contact and solver are the engine's, the surroundings are forces upon it.

scene         what is simulated, as values
base          the points that the box stands on
plant         the `MultibodyPlant`, and what is told to it while it runs
floor         friction that is not the same everywhere and always
push          what of the commanded pushes reaches the box
surroundings  all other forces
episode       stepping from sample to sample
"""

from __future__ import annotations

from runner.blind.drake_box.physics.episode import STEP_S, DrakeError, simulate, simulate_all
from runner.blind.drake_box.physics.scene import Scene, Strange

__all__ = ["STEP_S", "DrakeError", "Scene", "Strange", "simulate", "simulate_all"]
