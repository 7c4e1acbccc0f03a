"""Plane figures: moments, parts, triangles, and lines that cross themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runner.numerics.polygon import Polygon, area_and_centroid, below

BENT = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])  # an L
STAR = np.array([[np.cos(a) * (1 + k % 2), np.sin(a) * (1 + k % 2)] for k, a in enumerate(np.arange(10) * np.pi / 5)])
CORNERS = st.lists(st.floats(0.3, 2.0), min_size=3, max_size=40)


def around(radii: list[float]) -> Polygon:
    """A figure that all of its middle sees, bent in and out."""
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    return Polygon.of(np.array(radii)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def test_moments_of_a_rectangle() -> None:
    """Area, centre and spread have their closed forms, wherever it lies and whichever way its corners go."""
    corners = np.array([[1.0, 2.0], [5.0, 2.0], [5.0, 4.0], [1.0, 4.0]])
    for points in (corners, corners[::-1], np.vstack([corners, corners[:1]])):
        figure = Polygon.of(points)
        assert figure.area_m2 == pytest.approx(8)
        np.testing.assert_allclose(figure.centroid_m, (3, 3))
        np.testing.assert_allclose(figure.spread_m2, [[4 / 3, 0], [0, 1 / 3]], atol=1e-12)


def test_moments_of_an_ellipse() -> None:
    """A polygon for an ellipse has its area, and second moments a^2 / 4 and b^2 / 4 to 1e-4."""
    figure = Polygon.ellipse(2.0, 0.5)
    assert figure.area_m2 == pytest.approx(np.pi)
    np.testing.assert_allclose(figure.spread_m2, [[1, 0], [0, 1 / 16]], rtol=1e-4, atol=1e-12)


def test_distances_from_a_boundary() -> None:
    """Of a figure that is bent inwards, beside sides, corners and inside; and of a disc, of many places at once."""
    figure = Polygon.of(BENT)
    places = np.array([[3.0, 0.5], [5.0, -4.0], [0.5, 0.5], [1.5, 2.0], [0.7, 2.0], [1.0, 5.0], [2.0, 1.0]])
    np.testing.assert_allclose(figure.distance_m(places), [1.0, 5.0, -0.5, 0.5, -0.3, 2.0, 0.0], atol=1e-12)
    many = np.random.default_rng(2).uniform(-1, 1, (5000, 2))
    off = Polygon.ellipse(0.5, 0.5).distance_m(many)
    np.testing.assert_allclose(off, np.hypot(*many.T) - 0.5, atol=1e-4)
    assert Polygon.ellipse(0.5, 0.5).distance_m(np.empty((0, 2))).shape == (0,)


@given(CORNERS)
def test_triangles_fill_a_figure(radii: list[float]) -> None:
    """Ears add up to the area and its centre, and none is turned over."""
    figure = around(radii)
    parts = [area_and_centroid(figure.corners[list(t)]) for t in figure.triangles()]
    assert all(area > 0 for area, _ in parts)
    assert sum(area for area, _ in parts) == pytest.approx(figure.area_m2, rel=1e-9)
    np.testing.assert_allclose(sum(a * c for a, c in parts), figure.area_m2 * figure.centroid_m, atol=1e-9)


@given(CORNERS, st.floats(-1.5, 1.5), st.integers(0, 1))
def test_parts_of_a_figure_add_up(radii: list[float], limit: float, axis: int) -> None:
    """What lies below a limit and what lies beyond it have the area and the first moments of the whole."""
    figure = around(radii)
    mirror = np.ones(2)
    mirror[axis] = -1
    one, two = below(figure.corners, axis, limit), below(figure.corners * mirror, axis, -limit) * mirror
    parts = [(abs(a), c) for p in (one, two) if len(p) > 2 for a, c in [area_and_centroid(p)]]
    assert sum(a for a, _ in parts) == pytest.approx(figure.area_m2, rel=1e-9)
    np.testing.assert_allclose(sum(a * c for a, c in parts), figure.area_m2 * figure.centroid_m, atol=1e-9)


def test_mean_distance_from_a_place() -> None:
    """From its middle that of a disc is 2/3 of its radius; elsewhere it is that of many points."""
    assert Polygon.ellipse(1.0, 1.0).mean_distance_m(np.zeros(2)) == pytest.approx(2 / 3, rel=1e-4)
    middles = (np.arange(200) + 0.5) / 200
    x, y = (2 * middles, middles)
    square = Polygon.of(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]))
    for place in ([0.5, 0.2], [3.0, -1.0]):
        many = np.hypot(x[:, None] - place[0], y - place[1]).mean()
        assert square.mean_distance_m(np.array(place)) == pytest.approx(many, rel=1e-4)


def test_lines_that_cross_themselves_are_told() -> None:
    """A bow tie and a line that comes back to an edge cross; bent figures and stars do not."""
    assert Polygon.of(BENT).crossing() is None
    assert Polygon.of(STAR).crossing() is None
    assert Polygon(((0, 0), (1, 1), (1, 0), (0, 1))).crossing() is not None
    assert Polygon(((0, 0), (2, 0), (2, 1), (1, 0), (0, 1))).crossing() is not None


def test_reach_of_a_figure() -> None:
    """From the middle of a rectangle its edge is as far as it is, and of a bent figure its farthest edge counts."""
    square = Polygon.of(np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]))
    np.testing.assert_allclose(square.reach(np.array([[0.3, 0.0], [0.2, 0.2], [0.0, -5.0]])), (1, np.sqrt(2), 1))
    bent = Polygon.of(BENT)  # its middle is at (0.75, 1.25)
    np.testing.assert_allclose(bent.reach(bent.centroid_m + np.diag([0.1, 0.1])), (0.25, 1.75))
