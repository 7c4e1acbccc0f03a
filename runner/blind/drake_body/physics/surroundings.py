"""Forces on a body but its weight and what carries it."""

from __future__ import annotations

import numpy as np

from runner.blind.drake_body.physics.points import points_of
from runner.blind.drake_body.physics.world import World

MAGNET_BELOW_M = 0.02
TOUCHING_M = 1.5e-3  # what is no further from the table is held by what is sticky


class Surroundings:
    """The wrench about the geometric centre of all that surrounds a body."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._corners = points_of(world)[0]

    @property
    def empty(self) -> bool:
        """Whether there is nothing."""
        w, s = self._world, self._world.strange
        forces = (w.air_drag, w.rotational_damping, s.magnet_n, s.fan_n, s.magnus_kg, s.sticky_kg_per_s)
        return not any(forces)

    def wrench(self, place: np.ndarray, turn: np.ndarray, spin: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return torque about the geometric centre and force, N m and N, world axes, (6,).

        Args:
            place: Of the geometric centre, m, (3,).
            turn: Body to world, (3, 3).
            spin: rad/s, world axes, (3,).
            velocity: Of the geometric centre, m/s, (3,).
        """
        w, s = self._world, self._world.strange
        arm = turn @ np.array(w.com)
        of_centre = velocity + np.cross(spin, arm)
        force, torque = np.zeros(3), -w.rotational_damping * spin
        if w.air_drag > 0.0:
            force -= w.air_drag * np.linalg.norm(of_centre) * of_centre
        if s.magnus_kg != 0.0:
            force += s.magnus_kg * np.cross(spin, of_centre)
        if s.fan_n > 0.0:
            along = np.array([np.cos(s.fan_direction), np.sin(s.fan_direction), 0.0])
            across = (-along[1] * place[0] + along[0] * place[1] - s.fan_place_m) / s.fan_width_m
            force += s.fan_n * np.exp(-0.5 * across**2) * along
        torque += np.cross(arm, force)
        if s.magnet_n > 0.0:
            off = np.array([*s.magnet_place, -MAGNET_BELOW_M]) - place
            far = float(np.linalg.norm(off))
            force += s.magnet_n / (1.0 + (far / s.magnet_reach_m) ** 2) ** 2 * off / max(far, 1e-6)
        if s.sticky_kg_per_s > 0.0:
            arms = self._corners @ turn.T
            at = arms + place
            near = np.hypot(at[:, 0] - s.sticky_place[0], at[:, 1] - s.sticky_place[1]) < s.sticky_reach_m
            held = near & (at[:, 2] < TOUCHING_M)
            if np.any(held):
                pulls = -s.sticky_kg_per_s / held.sum() * (velocity + np.cross(spin, arms[held]))
                force += pulls.sum(axis=0)
                torque += np.cross(arms[held], pulls).sum(axis=0)
        return np.concatenate([torque, force])
