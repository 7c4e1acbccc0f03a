"""Plane figures that are bounded by one closed line: area, moments, parts, triangles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runner.numerics.arrays import FloatArray

ROUND_CORNERS = 360  # of a disc or an ellipse as a polygon: its second moments are then right to 1e-4
AT_ONCE = 4096  # places whose distances are found together: some tens of MB with a disc of 360 corners
FLAT = 1e-12  # of the square of the extent: a triangle below it has no area


@dataclass(frozen=True)
class Polygon:
    """A figure by its corners in order, m; counter-clockwise, not closed, no corner twice in a row.

    It may be bent inwards; its boundary must not cross itself (`crossing`).
    """

    points: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, points: FloatArray) -> Polygon:
        """Return the polygon with these corners (n, 2), in either order, closed or not."""
        kept = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
        if len(kept) > 2 and _moments(kept)[0] < 0:
            kept = kept[::-1]
        return cls(tuple((float(x), float(y)) for x, y in kept))

    @classmethod
    def ellipse(cls, half_x: float, half_y: float) -> Polygon:
        """Return an ellipse about the origin, with its area."""
        angle = 2 * np.pi * np.arange(ROUND_CORNERS) / ROUND_CORNERS
        wider = np.sqrt(2 * np.pi / ROUND_CORNERS / np.sin(2 * np.pi / ROUND_CORNERS))
        return cls.of(wider * np.column_stack([half_x * np.cos(angle), half_y * np.sin(angle)]))

    @cached_property
    def corners(self) -> FloatArray:
        """The corners, (n, 2)."""
        return np.array(self.points).reshape(-1, 2)

    @property
    def area_m2(self) -> float:
        """Area."""
        return self._moments[0]

    @property
    def centroid_m(self) -> FloatArray:
        """Centre of the area, (2,)."""
        return self._moments[1]

    @property
    def spread_m2(self) -> FloatArray:
        """Second moments of the area about its centre, per area, (2, 2)."""
        return self._moments[2]

    def mean_distance_m(self, place: FloatArray) -> float:
        """Return the mean distance of the area from a place (2,): the lever of dry friction that turns about it.

        The sum over the sides of a third of the integral of the cubed distance over the angle, which is closed.
        """
        start, end = self.corners - place, np.roll(self.corners, -1, axis=0) - place
        along = (end - start) / np.linalg.norm(end - start, axis=1)[:, None]
        height = start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]  # of the triangle, from the place
        far = np.where(height == 0, 1.0, np.abs(height))
        parts = [
            height / 6 * (s * np.hypot(s, height) + height**2 * np.arcsinh(s / far))
            for s in ((p * along).sum(axis=1) for p in (start, end))
        ]
        return float((parts[1] - parts[0]).sum() / self.area_m2)

    @property
    def bounds_m(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest coordinates, (2,) each."""
        return self.corners.min(axis=0), self.corners.max(axis=0)

    @cached_property
    def _moments(self) -> tuple[float, FloatArray, FloatArray]:
        return _moments(self.corners)

    def crossing(self) -> tuple[int, int] | None:
        """Return two sides, by the corners where they begin, that cross or touch though they are not neighbours."""
        a, b = self.corners, np.roll(self.corners, -1, axis=0)
        n = len(a)
        for i in range(n):
            others = np.arange(i + 2, n - (i == 0))
            if not len(others):
                continue
            c, d = a[others], b[others]
            one = _side(a[i], b[i], c) * _side(a[i], b[i], d) <= 0
            two = _side(c, d, a[i]) * _side(c, d, b[i]) <= 0
            apart = (np.maximum(c, d) < np.minimum(a[i], b[i])) | (np.minimum(c, d) > np.maximum(a[i], b[i]))
            hit = one & two & ~apart.any(axis=1)
            if hit.any():
                return i, int(others[np.argmax(hit)])
        return None

    def reach(self, places: FloatArray) -> FloatArray:
        """Return how far the figure goes from its centroid towards each of these places (k, 2), m, (k,)."""
        start, way = self.corners - self.centroid_m, np.roll(self.corners, -1, axis=0) - self.corners
        out = np.empty(len(places))
        for k, place in enumerate(places - self.centroid_m):
            ahead = place / max(float(np.hypot(*place)), np.finfo(float).tiny)
            across = ahead[0] * way[:, 1] - ahead[1] * way[:, 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                along = (start[:, 0] * way[:, 1] - start[:, 1] * way[:, 0]) / across
                part = (start[:, 0] * ahead[1] - start[:, 1] * ahead[0]) / across
            meets = (across != 0) & (part >= 0) & (part <= 1) & (along > 0)
            out[k] = along[meets].max(initial=0.0)
        return out

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Return how far places (k, 2) are from the boundary, negative inside, m, (k,)."""
        blocks = range(0, len(places), AT_ONCE)
        return np.concatenate([np.empty(0), *(self._distance_m(places[k : k + AT_ONCE]) for k in blocks)])

    def _distance_m(self, places: FloatArray) -> FloatArray:
        start, way = self.corners, np.roll(self.corners, -1, axis=0) - self.corners
        off = places[:, None] - start
        along = np.clip((off * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
        far = np.linalg.norm(off - along[:, :, None] * way, axis=2).min(axis=1)
        # a ray towards greater x leaves the figure through an odd number of sides
        above = self.corners[:, 1] > places[:, 1, None]
        crosses = above != np.roll(above, -1, axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = start[:, 0] + way[:, 0] * (places[:, 1, None] - start[:, 1]) / way[:, 1]
        inside = (crosses & (at > places[:, 0, None])).sum(axis=1) % 2 == 1
        return np.where(inside, -far, far)

    def triangles(self) -> list[tuple[int, int, int]]:
        """Return triangles that fill the figure, as corners by number, by cutting off ears (Meisters 1975)."""
        return list(_ears(self.corners))


def below(points: FloatArray, axis: int, limit: float) -> FloatArray:
    """Return the corners (m, 2) of the part of a figure (n, 2) where a coordinate is at most `limit`.

    Parts that hang together nowhere are joined by lines along the limit, which have no area.
    """
    onward = np.roll(points, -1, axis=0)
    inside, inside_onward = points[:, axis] <= limit, onward[:, axis] <= limit
    step = onward[:, axis] - points[:, axis]
    part = np.divide(limit - points[:, axis], step, out=np.zeros(len(points)), where=step != 0)
    crossings = points + part[:, None] * (onward - points)
    crossings[:, axis] = limit
    both = np.stack([points, crossings], axis=1).reshape(-1, 2)
    return both[np.stack([inside, inside != inside_onward], axis=1).ravel()]


def area_and_centroid(points: FloatArray) -> tuple[float, FloatArray]:
    """Return area and centroid (2,) of a figure (n, 2)."""
    area, centre, _ = _moments(points)
    return area, centre


def _moments(points: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return area, centroid (2,) and second moments per area about it (2, 2), by Green's theorem."""
    about = points.mean(axis=0)
    a = points - about
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = float(cross.sum()) / 2
    if area == 0:
        return 0.0, about, np.zeros((2, 2))
    centre = (cross[:, None] * (a + b)).sum(axis=0) / (6 * area)
    ends = np.einsum("n,ni,nj->ij", cross, a, a) + np.einsum("n,ni,nj->ij", cross, b, b)
    mixed = np.einsum("n,ni,nj->ij", cross, a, b)
    second = (2 * ends + mixed + mixed.T) / (24 * area)
    return area, about + centre, second - np.outer(centre, centre)


def _side(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return twice the area of triangles, above zero where c lies left of the way from a to b."""
    ab, ac = b - a, c - a
    return ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]


def _ears(corners: FloatArray) -> Iterator[tuple[int, int, int]]:
    left = list(range(len(corners)))
    flat = FLAT * float(np.ptp(corners, axis=0).max()) ** 2
    k = tried = 0
    while len(left) > 3 and tried <= len(left):
        i, j, m = (left[(k + s) % len(left)] for s in (-1, 0, 1))
        a, b, c = corners[i], corners[j], corners[m]
        turn = float(_side(a, b, c))
        rest = corners[[p for p in left if p not in (i, j, m)]]
        held = (_side(a, b, rest) >= 0) & (_side(b, c, rest) >= 0) & (_side(c, a, rest) >= 0)
        if turn < -flat or (turn > flat and held.any()):
            k, tried = (k + 1) % len(left), tried + 1
            continue
        if turn > flat:
            yield i, j, m
        del left[k]
        k, tried = k % len(left), 0
    if len(left) == 3:
        yield left[0], left[1], left[2]
