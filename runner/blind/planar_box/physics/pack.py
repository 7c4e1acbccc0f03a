"""A world as the flat array that the compiled functions read."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.planar_box.physics import layout as at
from runner.blind.planar_box.physics.layout import POINTS_AT, TEXTURE_CELLS
from runner.blind.planar_box.physics.surface import BASE_POINTS, TEXTURE_CELL_M, base_points, floor_texture
from runner.blind.planar_box.physics.world import World

SLIP_EPS = 5e-6  # m/s


def pack(world: World, *, points: int = BASE_POINTS, slip_eps: float = SLIP_EPS) -> np.ndarray:
    """Return the flat array that the right-hand side reads, everything but what changes within an episode."""
    x, y, w, area = base_points(world, points)
    p = np.zeros(POINTS_AT + 3 * len(x) + TEXTURE_CELLS**2)

    def put(**values: float) -> None:
        for name, value in values.items():
            p[getattr(at, name.upper())] = value

    hx, hy, hz = world.half_size
    r1, r2 = world.anisotropy
    c, s = math.cos(world.anisotropy_angle), math.sin(world.anisotropy_angle)
    turn = np.array([[c, -s], [s, c]])
    square = turn @ np.diag([r1 * r1, r2 * r2]) @ turn.T
    flow, norm = (
        (square, square) if world.anisotropy_flow == "associated" else (turn @ np.diag([r1, r2]) @ turn.T, np.eye(2))
    )
    by_point = world.stribeck != 0.0 or world.stiction != 0.0 or world.patch != 0.0 or world.texture != 0.0
    put(
        mass=world.mass, inertia=world.yaw_inertia, comx=world.com[0], comy=world.com[1], height=hz,
        weight_g=world.mass * world.gravity * math.cos(world.tilt), friction=world.friction, points=len(x),
        eps=slip_eps, by_point=float(by_point), hx=hx, hy=hy,
        d11=flow[0, 0], d12=flow[0, 1], d22=flow[1, 1], q11=norm[0, 0], q12=norm[0, 1], q22=norm[1, 1],
        stribeck=world.stribeck, stribeck_v=world.stribeck_speed, stribeck_d=world.stribeck_exponent,
        stribeck_0=world.stribeck_reference,
        stiction=world.stiction, stiction_v=world.stiction_speed,
        patch=world.patch, patch_x=world.patch_place[0], patch_y=world.patch_place[1], patch_r=world.patch_radius,
        patch_disc=float(world.patch_shape == "disc"), texture=world.texture, cell=TEXTURE_CELL_M,
        drag=world.viscous_drag, film=world.film, film_xx=float(area @ (x * x + y * y)), air=world.air_drag,
        spin=world.rotational_damping, fx=world.wind[0], fy=world.wind[1],
        gx=world.gravity * math.sin(world.tilt) * math.cos(world.downhill),
        gy=world.gravity * math.sin(world.tilt) * math.sin(world.downhill),
        tether=world.tether, tether_x=world.tether_place[0], tether_y=world.tether_place[1],
        tether_rest=world.tether_rest, leak=world.mass_leak,
        lag_rate=1.0 / world.lag if world.lag > 0.0 else 0.0,
        periodic_x=world.periodic * math.cos(world.periodic_direction),
        periodic_y=world.periodic * math.sin(world.periodic_direction),
        periodic_w=2.0 * math.pi * world.periodic_hz, periodic_p=world.periodic_phase,
        cogging=world.cogging, teeth=world.cogging_teeth, cogging_p=world.cogging_phase, deflection=world.deflection,
        wear=world.wear, wander=world.wander,
        barrier=world.barrier, barrier_x=math.cos(world.barrier_direction), barrier_y=math.sin(world.barrier_direction),
        barrier_d=world.barrier_distance, barrier_c=world.barrier_damping,
        vortex=world.vortex, vortex_x=world.vortex_place[0], vortex_y=world.vortex_place[1],
        vortex_r=world.vortex_radius,
    )  # fmt: skip
    n = len(x)
    p[POINTS_AT : POINTS_AT + 3 * n] = np.concatenate([x, y, w])
    if world.texture != 0.0:
        p[POINTS_AT + 3 * n :] = floor_texture(world).ravel()
    return p
