"""Forces on the box but friction, weight and whatever it touches."""

from __future__ import annotations

import math
from collections.abc import Sequence

from runner.blind.drake_box.physics.scene import Scene

KICK_S = 0.02


class Surroundings:
    """The wrench about the geometric centre of pushes and of what surrounds the box."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        hx, hy, self._hz = scene.world.half_size
        self._spread = (hx * hx + hy * hy) / 3.0

    def wrench(
        self,
        push: Sequence[float],
        place: tuple[float, float, float],
        twist: tuple[float, float, float],
        t: float,
        duration_s: float,
    ) -> tuple[float, float, float, float, float]:
        """Return torque (3, world axes, N m) and force (x, y, world axes, N).

        Args:
            push: As `carried_out` has it.
            place: x, y, yaw of the geometric centre, in the middle of the step.
            twist: vx, vy, wz, world axes.
            t: Time in the episode, s.
            duration_s: Length of the episode.
        """
        w, s = self._scene.world, self._scene.strange
        (x, y, yaw), (vx, vy, wz) = place, twist
        c, n = math.cos(yaw), math.sin(yaw)
        fx, fy = push[0] + w.wind[0], push[1] + w.wind[1]
        turn = c * (push[3] - push[4]) - n * (push[2] + push[5])  # (R p) x F
        roll, pitch = -push[7], push[6]
        speed = math.hypot(vx, vy)
        drag = w.viscous_drag + w.air_drag * speed
        if s.root_drag > 0.0:
            drag += s.root_drag / math.sqrt(max(speed, 1e-2))
        fx, fy = fx - drag * vx, fy - drag * vy
        turn -= (w.rotational_damping + w.film * self._spread) * wz
        if w.film > 0.0:
            fx, fy = fx - w.film * vx, fy - w.film * vy
            # at the floor, below the centre: (0, 0, -hz) x F
            roll, pitch = roll - self._hz * w.film * vy, pitch + self._hz * w.film * vx
        if w.tether > 0.0:
            dx, dy = w.tether_place[0] - x, w.tether_place[1] - y
            length = math.hypot(dx, dy)
            pull = w.tether * max(length - w.tether_rest, 0.0) / max(length, 1e-9)
            fx, fy = fx + pull * dx, fy + pull * dy
        if s.magnet > 0.0:
            dx, dy = (s.magnet_place[0] - x) / s.magnet_reach, (s.magnet_place[1] - y) / s.magnet_reach
            pull = 4.0 * s.magnet / (1.0 + dx * dx + dy * dy) ** 2
            fx, fy = fx + pull * dx, fy + pull * dy
        if s.caster > 0.0:
            px, py = s.caster_place
            rx, ry = c * px - n * py, n * px + c * py
            ax, ay = -math.sin(yaw + s.caster_angle), math.cos(yaw + s.caster_angle)  # of the axle
            across = s.caster * ((vx - wz * ry) * ax + (vy + wz * rx) * ay)
            fx, fy, turn = fx - across * ax, fy - across * ay, turn - across * (rx * ay - ry * ax)
        begin = s.kick_at * duration_s
        if s.kick > 0.0 and begin <= t < begin + KICK_S:
            fx += s.kick / KICK_S * math.cos(s.kick_direction)
            fy += s.kick / KICK_S * math.sin(s.kick_direction)
        return roll, pitch, turn, fx, fy
