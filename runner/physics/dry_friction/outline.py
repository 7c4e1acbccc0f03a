"""Base points of a base of any outline under even load.

The outline is cut into strips of equal area across its longer side, each strip into pieces of equal area. A point
stands for each piece, at its centre: weights are equal, and the first moments of an even load are exact. Points at the
centres of pieces lack the second moments of the pieces themselves. The points are therefore moved apart, by the one
symmetric map that gives them the second moments of the outline. A load that is affine over the base, as moments shift
it, then has its sum and its centre exactly. A last map, by the distance from the middle, gives them the mean distance
too, so that friction has its torque when the base turns on the spot; about other places it is right to 0.3 %.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy  # loads its parts when they are first used

from runner.numerics.arrays import FloatArray
from runner.numerics.polygon import Polygon, area_and_centroid, below
from runner.physics.dry_friction.record import with_pressure_shape

BENT = 0.2  # how much farther out the farthest points may move than those in the middle
CUT = 1e-12  # of the extent: how exactly cuts are placed, so that rounding is all that is left of unequal areas


@lru_cache(maxsize=64)
def outline_points(outline: Polygon, n: int = 8) -> FloatArray:
    """Return about n * n base points of an outline under even load, columns as `base_points` has them, read-only.

    The shape of a rim-heavy pressure goes with the square of the way from the centroid to the edge, as on a rectangle.
    """
    long = int(np.argmax(np.ptp(outline.corners, axis=0)))
    extent = np.ptp(outline.corners, axis=0)
    strips = max(2, round(n * np.sqrt(extent[long] / extent[1 - long])))
    pieces = max(2, round(n * n / strips))
    centres = [
        area_and_centroid(piece)[1]
        for strip in _equal_parts(outline.corners, long, strips)
        for piece in _equal_parts(strip, 1 - long, pieces)
    ]
    points = _with_mean_distance(_with_second_moments(np.array(centres), outline), outline)
    way = np.linalg.norm(points - outline.centroid_m, axis=1)
    weights = np.full(len(points), 1.0 / len(points))
    out = with_pressure_shape(points[:, 0], points[:, 1], weights, way / outline.reach(points))
    out.setflags(write=False)
    return out


def bearing_radius(points: FloatArray) -> float:
    """Return the radius of the disc about the centre of base points (n, 4) that their convex hull holds, m."""
    hull = scipy.spatial.ConvexHull(points[:, :2])
    centre = np.average(points[:, :2], axis=0, weights=points[:, 2])
    return float(-(hull.equations[:, :2] @ centre + hull.equations[:, 2]).max())


def _equal_parts(figure: FloatArray, axis: int, count: int) -> list[FloatArray]:
    """Cut a figure (m, 2) across an axis into parts of equal area."""
    whole, _ = area_and_centroid(figure)
    low, high = float(figure[:, axis].min()), float(figure[:, axis].max())
    mirror = np.ones(2)
    mirror[axis] = -1.0
    parts, rest = [], figure
    for k in range(1, count):

        def missing(limit: float, wanted: float = whole * k / count) -> float:
            return area_and_centroid(below(figure, axis, limit))[0] - wanted if limit > low else -wanted

        limit = float(scipy.optimize.brentq(missing, low, high, xtol=CUT * (high - low)))
        parts.append(below(rest, axis, limit))
        # what lies beyond is what lies below in the mirror
        rest = below(rest * mirror, axis, -limit) * mirror
    return [*parts, rest]


def _with_second_moments(centres: FloatArray, outline: Polygon) -> FloatArray:
    """Return points (n, 2) of equal weight, moved by a symmetric map so that they have an outline's moments."""
    off = centres - centres.mean(axis=0)
    root = np.real(scipy.linalg.sqrtm(off.T @ off / len(off)))
    inverse = np.linalg.inv(root)
    apart = inverse @ np.real(scipy.linalg.sqrtm(root @ outline.spread_m2 @ root)) @ inverse
    return outline.centroid_m + off @ apart.T


def _with_mean_distance(points: FloatArray, outline: Polygon) -> FloatArray:
    """Return points (n, 2) that keep their second moments and have an outline's mean distance from its centre."""
    off = points - outline.centroid_m
    far_2 = np.einsum("ni,ij,nj->n", off, np.linalg.inv(outline.spread_m2), off) / 2

    wanted = outline.mean_distance_m(outline.centroid_m)

    def bent(share: float) -> FloatArray:
        return _with_second_moments(outline.centroid_m + off * (1 + share * far_2)[:, None], outline)

    def beyond(share: float) -> float:
        return float(np.linalg.norm(bent(share) - outline.centroid_m, axis=1).mean()) - wanted

    return bent(float(scipy.optimize.brentq(beyond, -BENT, BENT))) if beyond(-BENT) * beyond(BENT) < 0 else points
