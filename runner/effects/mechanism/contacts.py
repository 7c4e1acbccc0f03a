"""Contacts of a body: what governs them in a compiled model, and how effects take hold of it.

MuJoCo makes the numbers of a contact from those of both geoms: the larger friction, solver parameters mixed, or those
of the geom of higher priority alone. An effect on the contacts of one body must not change those of others. So it gives
the body's own geoms the numbers that its contacts have, with a priority above all others', and changes them there. A
body that touches partners of different friction then has that of the static ones, the largest of them, with all.
Contacts that the MJCF lists as explicit pairs have their own numbers, and are changed as they are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
import scipy  # loads its parts when they are first used

from runner.effects.mechanism import parts

MIX_LEAST = 1e-15  # solmix below counts for nothing
NEAR_CRITICAL, MOST_DAMPED = 1e-6, 20.0  # damping ratios
PLANE, LEVEL = int(mujoco.mjtGeom.mjGEOM_PLANE), 1e-9
FREE = int(mujoco.mjtJoint.mjJNT_FREE)


@dataclass(frozen=True)
class Contact:
    """The numbers that govern contacts: views of a model where they are to be changed.

    Args:
        sliding: Friction along the surface: one number of a geom, two of a pair.
        solref: Time constant and damping ratio; negative: stiffness and damping.
        solimp: Impedance, (5,).
    """

    sliding: np.ndarray
    solref: np.ndarray
    solimp: np.ndarray


def geoms_of(model: mujoco.MjModel, body: str | None) -> list[int]:
    """Return the numbers of a body's geoms."""
    first, count = int(model.body(body).geomadr[0]), int(model.body(body).geomnum[0])
    return list(range(first, first + count)) if count else []


def pairs_of(model: mujoco.MjModel, body: str | None) -> list[int]:
    """Return the numbers of the explicit contact pairs with a geom of a body."""
    own = set(geoms_of(model, body))
    return [p for p in range(model.npair) if own & {int(model.pair_geom1[p]), int(model.pair_geom2[p])}]


def partners_of(model: mujoco.MjModel, geom: int) -> list[int]:
    """Return the geoms of other bodies that a geom may touch without being listed for it, static ones first."""
    weld = model.body_weldid[model.geom_bodyid]
    kind, may = np.asarray(model.geom_contype), np.asarray(model.geom_conaffinity)
    touching = ((kind & may[geom]) | (kind[geom] & may) != 0) & (weld != weld[geom])
    found = np.flatnonzero(touching)
    return found[np.argsort(weld[found] != 0, kind="stable")].tolist()


def touches(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether a body moves and may touch anything."""
    if int(model.body_weldid[model.body(body).id]) == 0:
        return False
    return bool(pairs_of(model, body)) or any(partners_of(model, g) for g in geoms_of(model, body))


def believed(model: mujoco.MjModel, body: str | None) -> Contact:
    """Return the numbers of a body's contacts, of the first that is found."""
    pairs = pairs_of(model, body)
    if pairs:
        return _pair(model, pairs[0])
    geom = next(g for g in geoms_of(model, body) if partners_of(model, g))
    return _combined(model, geom)


def governing(model: mujoco.MjModel, body: str) -> list[Contact]:
    """Return what governs the contacts of a body in a compiled model, to be written to."""
    out = [_pair(model, p) for p in pairs_of(model, body)]
    for geom in geoms_of(model, body):
        partners = partners_of(model, geom)
        if not partners:
            continue
        highest = int(model.geom_priority[partners].max())
        if int(model.geom_priority[geom]) <= highest:
            combined = _combined(model, geom)
            model.geom_friction[geom] = _friction(model, geom)
            model.geom_solref[geom], model.geom_solimp[geom] = combined.solref, combined.solimp
            model.geom_condim[geom] = max(int(model.geom_condim[g]) for g in (geom, partners[0]))
            model.geom_priority[geom] = highest + 1
        out.append(Contact(model.geom_friction[geom, :1], model.geom_solref[geom], model.geom_solimp[geom]))
    return out


def _pair(model: mujoco.MjModel, pair: int) -> Contact:
    return Contact(model.pair_friction[pair, :2], model.pair_solref[pair], model.pair_solimp[pair])


def _combined(model: mujoco.MjModel, geom: int) -> Contact:
    """Return what MuJoCo makes of a geom and the first of those that it may touch."""
    other = partners_of(model, geom)[0]
    ranks = int(model.geom_priority[geom]), int(model.geom_priority[other])
    if ranks[0] != ranks[1]:
        chosen = geom if ranks[0] > ranks[1] else other
        return Contact(
            np.array(model.geom_friction[chosen, :1]),
            np.array(model.geom_solref[chosen]),
            np.array(model.geom_solimp[chosen]),
        )
    share = _share(float(model.geom_solmix[geom]), float(model.geom_solmix[other]))
    one, two = np.array(model.geom_solref[geom]), np.array(model.geom_solref[other])
    solref = share * one + (1 - share) * two if one[0] > 0 and two[0] > 0 else np.minimum(one, two)
    solimp = share * model.geom_solimp[geom] + (1 - share) * model.geom_solimp[other]
    return Contact(_friction(model, geom)[:1], solref, solimp)


def _friction(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the friction of contacts of a geom with what it may touch of the first kind: sliding, turning, rolling."""
    partners = partners_of(model, geom)
    static = [g for g in partners if int(model.body_weldid[model.geom_bodyid[g]]) == 0] or partners
    own, found = int(model.geom_priority[geom]), []
    for other in static:
        rank = int(model.geom_priority[other])
        one, two = np.array(model.geom_friction[geom]), np.array(model.geom_friction[other])
        found.append(one if own > rank else two if rank > own else np.maximum(one, two))
    return np.max(found, axis=0)


def _share(one: float, two: float) -> float:
    """Return how much a geom's own solver parameters count beside the other's."""
    if one >= MIX_LEAST and two >= MIX_LEAST:
        return one / (one + two)
    return 0.5 if one < MIX_LEAST and two < MIX_LEAST else float(one >= MIX_LEAST)


def damping_ratio(contact: Contact) -> float:
    """Return the damping ratio of a contact, 1: critical."""
    time, ratio = float(contact.solref[0]), float(contact.solref[1])
    if time > 0:
        return ratio
    # -stiffness, -damping: b = 2 ratio sqrt(k)
    return -ratio / (2.0 * math.sqrt(-time)) if time < 0 else 0.0


def rebound(ratio: float) -> float:
    """Return the rebound speed over the impact speed of a damped spring that pushes but does not pull.

    exp(-2 z acos(z) / sqrt(1 - z^2)) for a damping ratio z, 1 without damping, exp(-2) = 0.135 at the critical one, and
    with the hyperbolic functions beyond (after Schwager & Poeschel 2007: the contact ends where its force does).
    """
    if abs(ratio - 1.0) < NEAR_CRITICAL:
        return math.exp(-2.0)
    if ratio < 1.0:
        return math.exp(-2.0 * ratio * math.acos(ratio) / math.sqrt(1.0 - ratio**2))
    return math.exp(-2.0 * ratio * math.acosh(ratio) / math.sqrt(ratio**2 - 1.0))


def damping_for(rebound_ratio: float) -> float:
    """Return the damping ratio that leaves such a rebound (inverse of `rebound`), at most `MOST_DAMPED`; NaN of NaN."""
    if math.isnan(rebound_ratio):
        return math.nan
    if rebound_ratio <= rebound(MOST_DAMPED):
        return MOST_DAMPED
    if rebound_ratio >= 1.0:
        return 0.0
    return float(scipy.optimize.brentq(lambda z: rebound(z) - rebound_ratio, 0.0, MOST_DAMPED, xtol=1e-13))


def is_first_in_contact(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether a body is the first that may touch anything: what is set for all contacts is named for it."""
    names = (model.body(b).name for b in range(1, model.nbody))
    return next((n for n in names if touches(model, n)), None) == body


def is_even(model: mujoco.MjModel, axis: int) -> bool:
    """Whether all that stands still is the same everywhere along an axis of the world: planes that it lies in."""
    for geom in np.flatnonzero(np.asarray(model.body_weldid)[model.geom_bodyid] == 0):
        normal = np.empty(3)
        mujoco.mju_rotVecQuat(normal, np.array([0.0, 0.0, 1.0]), model.geom_quat[geom])
        on_world = int(model.geom_bodyid[geom]) == 0
        if int(model.geom_type[geom]) != PLANE or not on_world or abs(normal[axis]) > LEVEL:
            return False
    return True


def is_free(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether a body has a free joint of its own."""
    joints = range(int(model.body(body).jntadr[0]), int(model.body(body).jntadr[0]) + int(model.body(body).jntnum[0]))
    return any(int(model.jnt_type[j]) == FREE for j in joints)


def is_alone(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether a body moves freely, and is all that moves: no actuator, and no other body, acts on it."""
    return is_free(model, body) and moving_bodies(model) == [body] and model.nu == 0


def moving_bodies(model: mujoco.MjModel) -> list[str]:
    """Return the bodies with mass that some joint moves, without what the air acts on."""
    names = {b: model.body(b).name for b in range(1, model.nbody) if int(model.body_weldid[b]) != 0}
    return [n for b, n in names.items() if float(model.body_mass[b]) > 0.0 and not parts.is_of_air(n)]


def carries(model: mujoco.MjModel, body: str | None) -> bool:
    """Whether other bodies hang on one, or are fixed to it."""
    own = model.body(body).id
    below = [b for b in range(1, model.nbody) if int(model.body_parentid[b]) == own]
    return any(not parts.is_of_air(model.body(b).name) for b in below)
