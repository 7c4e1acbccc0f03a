"""A compound object, and one box in its place: ten inertial parameters in 3-D from pushes at any height.

The remote is made of several boxes of different density; MuJoCo composes its mass, centre of mass and inertia. The
local model is one box of the same outer size with free inertial parameters. In each episode the object hangs from a
point, is held upright, let go and pushed at the same time. All are simulated from rest by `mujoco.rollout` and compared
with the measured motion (output error), least squares by scipy's trust region.

Why hanging. On four corners a push that slides the object makes its leading edge chatter: measured, a change of the
mass by 1e-5 changes the velocity half a second later by up to 1e4 times as much, in either direction, so that no
gradient says anything. Tipping over an edge is smooth until the object falls back. Hanging, all ten parameters show in
a motion without contact. Pushes on the floor at any height, sliding, turning and tipping, are the test instead: what
the fitted box does under them beside what the object does.
"""

from __future__ import annotations

from runner.estimation.space.inertial import (
    Inertial,
    from_vector,
    inertial_in,
    pseudo_inertia,
    to_vector,
    write_inertial,
)
from runner.studies.compound.fit import InertialFit, fit
from runner.studies.compound.pokes import HUNG, Part, Poke, PokeSimulator, compound_mjcf, differences, with_noise
from runner.studies.compound.study import NOISE, Compound

__all__ = [
    "HUNG",
    "NOISE",
    "Compound",
    "Inertial",
    "InertialFit",
    "Part",
    "Poke",
    "PokeSimulator",
    "compound_mjcf",
    "differences",
    "fit",
    "from_vector",
    "inertial_in",
    "pseudo_inertia",
    "to_vector",
    "with_noise",
    "write_inertial",
]
