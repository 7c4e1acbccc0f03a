"""Dry friction: pushes at body-fixed points and friction spread over a base, compiled, inside MuJoCo's step.

A numba function is MuJoCo's `mjcb_passive`. It runs in `mj_step`, `mujoco.rollout` and `mujoco.batch.Batch`
alike, without Python and without the interpreter lock. It holds no state: everything it needs stands in the
`user` data of each body (see `FrictionRecord`) and in `mjData.userdata`, so that several models can live in one process
and be stepped by several threads. Bodies without such a record, and models without any, are left alone.

Push. `userdata[push_adr : push_adr + 12]` holds a force F (3, N, world axes) and the first moment S = p x F^T
(3 x 3, row-major, S[i, j] = p_i F_j, N m) of its point of application p (body axes, relative to the body frame).
Both are linear in the command, so a mean over a step, a delay or a lag of the command keeps its impulse and its
angular impulse. The moment about the body frame is sum_ij (R e_i) x e_j S_ij.

Friction. The base is a set of points with load w_k. Friction is dry (Coulomb), and it is solved implicitly: the
velocity z at a fraction theta of the step h minimises

    1/2 (z - z_free)^T M (z - z_free) + theta h sum_k mu_k N_k |u_k(z)|

with u_k the slip at point k (the theta method on the friction potential: Moreau 1988; Acary & Brogliato 2008), and
the velocity at the end is v + (z - v) / theta. While the body slides, theta is 1/2, which is of second order. Where it
may come to rest within the step, theta is 1 (backward Euler): stick is then a true minimum, and the only creep is that
of the regularising speed `SLIP_EPS`. Where the motion turns within a step, as when a push reverses it, the step is
taken in parts. MuJoCo adds h times the velocity at the end to the position, so positions lead by
h (v - v_start) / 2, which a reader may subtract; angles that lead by half a step are right for the midpoint rule.

Load. N_k = w_k (a + b x_k + c y_k), clipped at zero, with a, b, c from the balance of the vertical force and of
the moments about the horizontal axes: the pushes at their height, inertia at the height of the centre of mass,
friction at the floor. It is solved together with the friction. A body under dry friction can't tip: where the moments
ask for more than its base can give, the load rests on the edge, and the centre that was asked for is reported.

Pin. A body may be touched by a round pin that moves as it is told, whatever the force: then the force follows. The
contact is a spring and a damper along the normal, which push and never pull, and dry friction across it; all implicit,
in the same minimum as the friction under the base, and the step is then one of backward Euler, so that a body that is
struck keeps the pin's speed. The pin acts at the height of the body frame.

Modules, in the order of their imports:

    record        layout of the numbers of a body, and its base points
    matrix3       vectors of three and symmetric matrices
    kernel        sums over the base points: potential, its derivatives
    coefficients  friction coefficient of each point
    load          how the load spreads over the base
    outline       base points of a base that is no rectangle
    pin           where a pin touches, and its part in the balance of momentum
    points        base points in the axes of friction, and the direction of the slip
    settle        velocity and load at the end of an implicit step, together
    step          one implicit step, in parts where the motion turns round
    planar, push  from MuJoCo's numbers to a step and back; pushes on bodies that MuJoCo's contacts carry
    rollout       many motions at once, where nothing else acts
    binding       the callback itself
"""

from __future__ import annotations

from runner.physics.dry_friction.binding import install
from runner.physics.dry_friction.kernel import SLIP_EPS
from runner.physics.dry_friction.outline import bearing_radius, outline_points
from runner.physics.dry_friction.record import (
    COLUMN,
    FREE,
    OUT_COP,
    OUT_FORCE,
    OUT_LIFTED,
    OUT_LOAD,
    OUT_PIN,
    OUT_POWER,
    OUT_SIZE,
    OUT_SLIP,
    OUT_TORQUE,
    OUT_TURN,
    PIN_ADR,
    PIN_SIZE,
    PLANAR,
    POINT_STRIDE,
    PUSH_SIZE,
    STRIDE,
    UPRIGHT,
    USERDATA_SIZE,
    FrictionRecord,
    FrictionView,
    base_points,
    corner_points,
    pack,
    size_of,
)
from runner.physics.dry_friction.rollout import STATE, STATE_AND_PIN, is_all_that_acts, rollout

__all__ = [
    "COLUMN",
    "FREE",
    "OUT_COP",
    "OUT_FORCE",
    "OUT_LIFTED",
    "OUT_LOAD",
    "OUT_PIN",
    "OUT_POWER",
    "OUT_SIZE",
    "OUT_SLIP",
    "OUT_TORQUE",
    "OUT_TURN",
    "PIN_ADR",
    "PIN_SIZE",
    "PLANAR",
    "POINT_STRIDE",
    "PUSH_SIZE",
    "SLIP_EPS",
    "STATE",
    "STATE_AND_PIN",
    "STRIDE",
    "UPRIGHT",
    "USERDATA_SIZE",
    "FrictionRecord",
    "FrictionView",
    "base_points",
    "bearing_radius",
    "corner_points",
    "install",
    "is_all_that_acts",
    "outline_points",
    "pack",
    "rollout",
    "size_of",
]
