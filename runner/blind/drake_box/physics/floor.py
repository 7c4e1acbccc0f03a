"""The coefficient of friction at each point of the base, where it is not the same everywhere and always."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import map_coordinates

from runner.blind.drake_box.physics.base import Base
from runner.blind.drake_box.physics.scene import Scene
from runner.blind.planar_box.physics import TEXTURE_CELL_M, floor_texture


class Floor:
    """Friction that depends on place, slip and time; its law is ours, what it does to the motion is Drake's solver's.

    Drake knows one coefficient for each point, so that it is told anew whenever it has changed: a law of the slip is
    behind by one step.
    """

    def __init__(self, scene: Scene, base: Base) -> None:
        self._scene, self._base = scene, base
        self._texture = floor_texture(scene.world) if scene.world.texture > 0.0 else None
        self._worked_j = 0.0

    @property
    def uniform(self) -> bool:
        """Whether friction is the same everywhere and always."""
        w, s = self._scene.world, self._scene.strange
        return not any((w.texture, w.patch, w.stribeck, w.stiction, s.nap, s.vibration, s.warming))

    @property
    def restless(self) -> bool:
        """Whether friction changes under a box that is at rest."""
        return self._scene.strange.vibration != 0.0 or self._scene.strange.warming != 0.0

    @property
    def every(self) -> int:
        """In how many steps once friction is looked up: what depends on the place alone changes slowly."""
        w, s = self._scene.world, self._scene.strange
        return 1 if any((w.stribeck, w.stiction, s.nap, s.vibration, s.warming)) else 2

    def begin(self) -> None:
        """Forget the heat of another episode."""
        self._worked_j = 0.0

    def coefficients(
        self, place: tuple[float, float, float], twist: tuple[float, float, float], t: float, step_s: float
    ) -> np.ndarray:
        """Return the coefficient at each point, shape (n,); called once for each step.

        Args:
            place: x, y, yaw of the geometric centre.
            twist: vx, vy, wz, world axes.
            t: Time in use, all episodes together, s.
            step_s: Length of the step.
        """
        w, s = self._scene.world, self._scene.strange
        (x, y, yaw), (vx, vy, wz) = place, twist
        c, n = math.cos(yaw), math.sin(yaw)
        rx, ry = c * self._base.x - n * self._base.y, n * self._base.x + c * self._base.y
        ux, uy = vx - wz * ry, vy + wz * rx
        factor = np.ones(len(rx))
        if self._texture is not None:
            at = np.stack([x + rx, y + ry]) / TEXTURE_CELL_M
            factor += w.texture * map_coordinates(self._texture, at, order=1, mode="grid-wrap")
        if w.patch != 0.0:
            away = np.hypot(x + rx - w.patch_place[0], y + ry - w.patch_place[1]) / w.patch_radius
            factor *= 1.0 + w.patch * (away < 1.0 if w.patch_shape == "disc" else np.exp(-0.5 * away**2))
        if w.stribeck != 0.0 or w.stiction != 0.0 or s.nap != 0.0:
            slip = np.hypot(ux, uy)
            fall = np.exp(-((slip / w.stribeck_speed) ** w.stribeck_exponent))
            factor *= 1.0 + w.stribeck * (fall - w.stribeck_reference)
            factor *= 1.0 + w.stiction * np.exp(-((slip / w.stiction_speed) ** 2))
            factor *= 1.0 + s.nap * np.cos(np.arctan2(uy, ux) - s.nap_direction) * (slip > 1e-4)
        if s.vibration != 0.0:
            factor *= 1.0 + s.vibration * math.sin(2.0 * math.pi * s.vibration_hz * t + s.vibration_phase)
        if s.warming > 0.0:
            power = w.friction * w.mass * w.gravity * float(self._base.share @ np.hypot(ux, uy))
            self._worked_j += step_s * (power - self._worked_j / s.cooling_s)
            factor *= math.exp(-s.warming * self._worked_j)
        return w.friction * np.maximum(factor, 0.02)
