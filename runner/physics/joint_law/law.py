"""What the law of joints says of one joint, in compiled functions: its friction's limit, and the force that it adds."""

from __future__ import annotations

import math

from numba import njit

from runner.physics.joint_law.record import COLUMN

OFFSET, EXCESS, EXCESS_SPEED, EXCESS_POWER = (COLUMN[n] for n in ("offset", "excess", "excess_speed", "excess_power"))
DRY_DIFFERENCE, VISCOUS_DIFFERENCE = COLUMN["dry_difference"], COLUMN["viscous_difference"]
RIPPLE_SIN, RIPPLE_COS, RIPPLE_RATE = COLUMN["ripple_sin"], COLUMN["ripple_cos"], COLUMN["ripple_rate"]
PUSH, PUSH_FROM, PUSH_UNTIL = COLUMN["push"], COLUMN["push_from"], COLUMN["push_until"]
SLIDING = 0.99  # a joint whose constraints bear this share of its dry friction slides


@njit(error_model="numpy")
def limit_at(record, dry, v):
    """Return the limit of dry friction at a velocity, without what the load adds."""
    if record[EXCESS] == 0.0:
        return dry
    return dry * (1.0 + record[EXCESS] * math.exp(-((abs(v) / record[EXCESS_SPEED]) ** record[EXCESS_POWER])))


@njit(error_model="numpy")
def added(record, dry, damping, q, v, time, step):
    """Return the force that acts besides."""
    force = record[OFFSET] - 0.5 * record[DRY_DIFFERENCE] * dry
    force -= 0.5 * record[VISCOUS_DIFFERENCE] * damping * abs(v)
    if record[RIPPLE_RATE] != 0.0:
        angle = record[RIPPLE_RATE] * q
        force += record[RIPPLE_SIN] * math.sin(angle) + record[RIPPLE_COS] * math.cos(angle)
    if record[PUSH] != 0.0:
        # the mean over the step: a push need not begin with one
        share = (min(record[PUSH_UNTIL], time + step) - max(record[PUSH_FROM], time)) / step
        force += record[PUSH] * max(share, 0.0)
    return force


@njit(error_model="numpy")
def turns(constraint, v, a, step):
    """Whether a joint that constraints brake turns round, or stops, within the step."""
    return constraint * v < 0.0 and a * v < 0.0 and abs(v) < step * abs(a)


@njit(error_model="numpy")
def turning(dry, limit, constraint, v, a, step):
    """Return what the friction of a joint that turns round within a step is off by, of the mean over that step.

    Args:
        dry: The model's friction; `limit`, what the law makes of it in this step.
        constraint: Force of all constraints on the joint in the step before, at another speed.
        v: Velocity at the start.
        a: Acceleration of the step before.
        step: s.
    """
    # the constraint's force may have been anything between the two
    if dry > 0.0 and turns(constraint, v, a, step) and abs(constraint) >= SLIDING * min(dry, limit):
        return -2.0 * limit * v / (step * abs(a))
    return 0.0
