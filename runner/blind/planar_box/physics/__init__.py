"""A second physics: one rigid box on a dry floor, Newton-Euler, integrated by LSODA.

It shares nothing with the MuJoCo scene or the compiled friction that a diagnosis fits with, so that a recording made
here is other people's data to that diagnosis. State: position, yaw and twist of the *geometric centre*, world axes.

    m a_c = F,   I alpha = tau_c,   a_g = a_c - alpha z x r_c + omega^2 r_c,   r_c = R(yaw) com

Friction. The base is a grid of 16 x 16 points. At each, with slip u (body axes) and load N,

    f = -N mu D u / q,   q^2 = u^T Q u + eps^2

Isotropic: D = Q = 1. `associated` anisotropy (f on an ellipse, slip normal to it: Goyal, Ruina & Papadopoulos 1991):
D = Q = diag(r1^2, r2^2). `scaled`: D = diag(r1, r2), Q = 1. eps = `SLIP_EPS`: a body held at a share s of its
friction creeps at eps s / sqrt(1 - s^2).

Load. N_k = W w_k (a + b x_k + d y_k), with a, b, d from the balance of vertical force and of moments about the
horizontal axes: weight at the centre of mass, pushes at their height, inertia at the height of the centre of mass,
friction at the floor. Friction is linear in (a, b, d), hence the balance is one 3 x 3 system without iteration.
Where a corner would pull, the points that pull are left out and the system is solved again.

Commands are constant between samples, so a lag has a closed form within each interval, and LSODA (scipy's `odeint`:
Hindmarsh 1983, Petzold 1983) starts afresh at every change of the command. Where the command changes at every sample,
that would be all it does; there a one-step method (Dormand & Prince 1980, order 5(4)) is tried first, in one to four
steps from sample to sample, and LSODA takes over wherever its error estimate is not met, as near sticking.
"""

from __future__ import annotations

from runner.blind.planar_box.physics.actuator import carried_out
from runner.blind.planar_box.physics.bearing import base_load
from runner.blind.planar_box.physics.episode import Accuracy, IntegrationError, PlannedEpisode, simulate, simulate_all
from runner.blind.planar_box.physics.forces import wander_terms
from runner.blind.planar_box.physics.pack import SLIP_EPS
from runner.blind.planar_box.physics.surface import TEXTURE_CELL_M, base_points, floor_texture
from runner.blind.planar_box.physics.world import World

__all__ = [
    "SLIP_EPS",
    "TEXTURE_CELL_M",
    "Accuracy",
    "IntegrationError",
    "PlannedEpisode",
    "World",
    "base_load",
    "base_points",
    "carried_out",
    "floor_texture",
    "simulate",
    "simulate_all",
    "wander_terms",
]
