"""Bases of any outline: their points against closed forms, their motion against another integrator."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from reference import Box
from scipy.spatial import ConvexHull

from runner.numerics.polygon import Polygon
from runner.physics import dry_friction
from runner.physics.dry_friction.load import EDGE, _onto_hull
from runner.recording import Episode, Form, Nominal, Recording
from runner.report.record_shapes import kinds, shapes
from runner.systems.planar_box.simulator import Simulator
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

G, RATE_HZ = 9.81, 250.0
HEX = Polygon.of(0.0605 * np.array([[math.cos(a), math.sin(a)] for a in np.arange(6) * math.pi / 3]))
DISC = Polygon.ellipse(0.05, 0.05)
WEDGE = Polygon.of(np.array([[-0.04, -0.03], [0.08, -0.03], [-0.04, 0.06]]))  # its centroid is at the origin
BENT = Polygon.of(np.array([[0, 0], [0.06, 0], [0.06, 0.03], [0.03, 0.03], [0.03, 0.1], [0, 0.1]]) - (0.022, 0.041))
OUTLINES = {"hex": HEX, "disc": DISC, "wedge": WEDGE, "bent": BENT}


def plate(outline: Polygon | None, half_size_m: tuple[float, float, float], friction: float = 0.25) -> Nominal:
    return Nominal(half_size_m, 1.0, friction, G, RATE_HZ, outline=outline)


def around(outline: Polygon, half_height_m: float) -> tuple[float, float, float]:
    low, high = outline.bounds_m
    return float(high[0] - low[0]) / 2, float(high[1] - low[1]) / 2, half_height_m


def moved(nominal: Nominal, force: np.ndarray, point: np.ndarray, start: np.ndarray, step_rate_hz: float = 1000.0):
    """Return the motion (T, 6) under forces (T, 3) at points (T, 3)."""
    nothing = np.zeros((len(force), 3))
    episode = Episode(0, np.arange(len(force)) / RATE_HZ, nothing, nothing, force, point)
    recording = Recording(Path("made"), Form.PLANAR, nominal, (episode,))
    return Simulator(recording, step_rate_hz=step_rate_hz, threads=1).predict(0, [Run((), start)])[0]


def fine(outline: Polygon, n: int = 120) -> np.ndarray:
    """Return the middles of small squares that lie in an outline, (m, 2), by going round it from each."""
    low, high = outline.bounds_m
    x, y = (low[i] + (np.arange(n) + 0.5) / n * (high[i] - low[i]) for i in (0, 1))
    places = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    way = outline.corners[None] - places[:, None]
    angle = np.arctan2(way[..., 1], way[..., 0])
    turn = np.diff(np.concatenate([angle, angle[:, :1]], 1), axis=1)
    return places[np.abs(((turn + np.pi) % (2 * np.pi) - np.pi).sum(1)) > np.pi]


@pytest.mark.parametrize("name", OUTLINES)
def test_base_points_have_the_moments_of_the_outline(name: str) -> None:
    """Weights are equal and sum to 1; first and second moments are the outline's; pressures have mean 0."""
    outline = OUTLINES[name]
    x, y, w, shape = dry_friction.outline_points(outline).T
    assert w.sum() == pytest.approx(1)
    assert np.ptp(w) == 0
    off = np.column_stack([x, y]) - outline.centroid_m
    np.testing.assert_allclose(w @ off, 0, atol=1e-12)
    np.testing.assert_allclose(off.T @ (off * w[:, None]), outline.spread_m2, rtol=1e-9, atol=1e-15)
    assert w @ shape == pytest.approx(0, abs=1e-12)
    assert shape.min() < -0.8
    assert shape.max() > 0.5


@pytest.mark.parametrize(
    ("outline", "lever_m"),
    [
        (Polygon.ellipse(0.05, 0.05), 2 / 3 * 0.05),
        # rectangle 2a x 2b, d half its diagonal: (2 a b d + a^3 asinh(b/a) + b^3 asinh(a/b)) / (6 a b)
        (
            Polygon.of(np.array([[-0.06, -0.02], [0.06, -0.02], [0.06, 0.02], [-0.06, 0.02]])),
            (
                2 * 0.06 * 0.02 * math.hypot(0.06, 0.02)
                + 0.06**3 * math.asinh(0.02 / 0.06)
                + 0.02**3 * math.asinh(0.06 / 0.02)
            )
            / (6 * 0.06 * 0.02),
        ),
        # regular hexagon whose edges are p from its middle: p (2/3 + ln 3 / 2) / sqrt(3)
        (HEX, 0.0605 * math.sqrt(3) / 2 * (2 / 3 + math.log(3) / 2) / math.sqrt(3)),
    ],
    ids=["disc", "rectangle", "hexagon"],
)
def test_turning_on_the_spot_takes_the_torque_of_the_closed_form(outline: Polygon, lever_m: float) -> None:
    """The mean distance from the middle, by which friction resists turning, is that of the closed form."""
    x, y, w, _ = dry_friction.outline_points(outline).T
    assert w @ np.hypot(x, y) == pytest.approx(lever_m, rel=1e-4)  # a disc is a polygon


@pytest.mark.parametrize("name", OUTLINES)
def test_turning_about_any_place_takes_the_torque_of_the_outline(name: str) -> None:
    """The mean distance from places inside and outside is right to 0.3 %."""
    outline = OUTLINES[name]
    x, y, w, _ = dry_friction.outline_points(outline).T
    for share in (0.2, 0.7, 1.5):
        for angle in np.arange(8) * math.pi / 4:
            far = share * math.sqrt(np.trace(outline.spread_m2))
            px, py = outline.centroid_m + far * np.array([math.cos(angle), math.sin(angle)])
            exact = outline.mean_distance_m(np.array([px, py]))
            assert w @ np.hypot(x - px, y - py) == pytest.approx(exact, rel=3e-3)


def test_a_spinning_disc_stops_in_time() -> None:
    """Torque 2/3 mu m g R against m R^2 / 2: the rate falls by 4/3 mu g / R until nothing turns."""
    radius, friction, rate = 0.05, 0.25, 20.0
    stops_s = rate / (4 / 3 * friction * G / radius)
    count = round(1.2 * stops_s * RATE_HZ)
    nothing = np.zeros((count, 3))
    motion = moved(plate(DISC, (radius, radius, 0.006)), nothing, nothing, np.array([0, 0, 0, 0, 0, rate]))
    t = np.arange(count) / RATE_HZ
    np.testing.assert_allclose(motion[:, 5], np.maximum(rate * (1 - t / stops_s), 0), atol=0.005 * rate)
    assert motion[-1, 5] == pytest.approx(0, abs=1e-3)


def test_an_outline_of_a_box_moves_as_the_box() -> None:
    """A rectangle by its corners and by its edges slide alike, to a thousandth of the way."""
    half = (0.06, 0.04, 0.02)
    corners = Polygon.of(np.array([[-0.06, -0.04], [0.06, -0.04], [0.06, 0.04], [-0.06, 0.04]]))
    force = np.tile([4.0, 1.0, 0.0], (100, 1))
    force[50:] = 0
    point = np.tile([-0.06, 0.02, 0.0], (100, 1))
    box, plain = (moved(plate(o, half), force, point, np.zeros(6)) for o in (None, corners))
    assert np.linalg.norm(box[-1, :2]) > 0.02
    np.testing.assert_allclose(plain[:, :2], box[:, :2], atol=2e-3 * float(np.hypot(*box[-1, :2])))
    np.testing.assert_allclose(plain[:, 2], box[:, 2], atol=3e-3 * abs(box[-1, 2]))


@pytest.mark.parametrize("name", OUTLINES)
@pytest.mark.parametrize("half_height_m", [0.0065, 0.03])
def test_motion_agrees_with_another_integrator(name: str, half_height_m: float) -> None:
    """Pushed off its middle and let go: the way agrees to 0.1 %, the turn to 1.5 % of its range."""
    outline = OUTLINES[name]
    half = around(outline, half_height_m)
    nominal = plate(outline, half)
    places = fine(outline)
    inertia = nominal.yaw_inertia_kg_m2
    com = nominal.centre_of_mass_m
    box = Box(1.0, 0.25, inertia, half, com, points=places)
    count, until = 101, 0.2
    t = np.arange(count) / RATE_HZ
    force = np.where((t < until)[:, None], [3.5, 1.0, 0.0], 0.0)
    point = np.tile([-0.02, 0.01, 0.0], (count, 1))
    start = np.array([0, 0, 0.4, 0.2, -0.1, 3.0])
    expected = box.run(t, lambda at: (force[0] if at < until else np.zeros(3), point[0]), start, (until,))
    found = moved(nominal, force, point, start)
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-3 * np.ptp(expected[:, :2], axis=0).max())
    np.testing.assert_allclose(found[:, 2], expected[:, 2], atol=0.015 * np.ptp(expected[:, 2]))


@given(st.integers(0, 10_000), st.floats(-2, 2), st.floats(-2, 2))
def test_the_load_stays_on_the_hull_of_the_base(seed: int, x: float, y: float) -> None:
    """What lies on the hull of the points stays; what does not comes to its nearest place, and follows along edges."""
    rng = np.random.default_rng(seed)
    points, w = rng.normal(size=(12, 2)) * [0.6, 0.3], np.full(12, 1 / 12)
    w[0] = 0.0  # bears nothing
    bearing = points[1:]
    middle = bearing.mean(axis=0)
    shrunk = middle + EDGE * (bearing - middle)
    hull = ConvexHull(shrunk)
    y0 = np.array([x, y])
    place, follow = _onto_hull((x, y), 12, points[:, 0].copy(), points[:, 1].copy(), w)
    inside = (hull.equations[:, :2] @ y0 + hull.equations[:, 2] <= 0).all()
    if inside:
        assert place == (x, y)
        assert follow == (1.0, 0.0, 1.0)
        return
    best = min(
        (float(np.linalg.norm(a + min(max(((y0 - a) @ (b - a)) / ((b - a) @ (b - a)), 0), 1) * (b - a) - y0)))
        for a, b in shrunk[hull.simplices]
    )
    assert np.linalg.norm(np.array(place) - y0) == pytest.approx(best, abs=1e-9)
    step = 1e-6 * rng.normal(size=2)
    moved_place, _ = _onto_hull(tuple(y0 + step), 12, points[:, 0].copy(), points[:, 1].copy(), w)
    a, b, c = follow
    np.testing.assert_allclose(np.array(moved_place) - place, np.array([[a, b], [b, c]]) @ step, atol=1e-6)


def test_a_plate_is_drawn_from_its_outline() -> None:
    """A closed mesh, corners outwards, that holds the volume of the plate, also where it is bent inwards."""
    for outline in OUTLINES.values():
        half = around(outline, 0.0065)
        nothing = np.zeros((3, 3))
        episode = Episode(0, np.arange(3) / RATE_HZ, nothing, nothing, nothing, nothing)
        system = PlanarBox(Recording(Path("made"), Form.PLANAR, plate(outline, half), (episode,)))
        (body,) = system.drawn()
        assert kinds(body) == ["prism", "box"]
        mesh = shapes(body, "prism", solid=True, colour=(1, 2, 3), grown=1.0, line_m=1e-3)
        parts = {b.component_descriptor().component.split(":")[-1]: b for b in mesh.as_component_batches()}
        corners = np.array(parts["vertex_positions"].as_arrow_array().to_pylist())
        faces = np.array(parts["triangle_indices"].as_arrow_array().to_pylist())
        a, b, c = (corners[faces[:, k]] for k in range(3))
        volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
        assert volume == pytest.approx(system.recording.nominal.volume_m3, rel=1e-5)
