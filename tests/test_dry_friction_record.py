"""The record of dry friction in a model, and the base points in it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from drive import make, play
from friction_cases import CUBE, ODD, weave
from hypothesis import given
from hypothesis import strategies as st

from runner.physics import dry_friction


def test_neutral_record_leaves_the_bits_alone() -> None:
    """Each option at its neutral value gives the same bits, whatever its other parameters are."""
    plain = play(make(CUBE), 1.0, weave, (0, 0, 0, 1, 0, 2)).raw
    off: dict[str, Any] = {
        "aniso_angle": 0.7,
        "stribeck_speed": 0.3,
        "stiction_speed": 0.01,
        "patch_x": 1.0,
        "patch_radius": 0.2,
    }
    np.testing.assert_array_equal(play(make(CUBE, **off), 1.0, weave, (0, 0, 0, 1, 0, 2)).raw, plain)


def test_record_is_read_and_written_by_name() -> None:
    """The record of a compiled body holds the body's friction and base; a name that it lacks is refused."""
    view = make(ODD).friction("b0")
    assert [view[n] for n in ("mu", "base_z", "half_x", "half_y", "points")] == [0.4, -0.3, 0.5, 0.4, 64]
    view["film"] = 2.5
    assert view["film"] == 2.5
    with pytest.raises(KeyError, match="frction"):
        view["frction"] = 1.0


@given(st.floats(0.01, 5), st.floats(0.01, 5), st.integers(2, 16))
def test_base_points_have_the_moments_of_the_base(half_x: float, half_y: float, n: int) -> None:
    """Weights sum to 1, first moments vanish, second moments are those of the rectangle; pressures have mean 0."""
    x, y, w, shape = dry_friction.base_points(half_x, half_y, n).T
    assert w.sum() == pytest.approx(1)
    np.testing.assert_allclose([w @ x, w @ y, w @ (x * y), w @ shape], 0, atol=1e-12)
    np.testing.assert_allclose([w @ x**2, w @ y**2], [half_x**2 / 3, half_y**2 / 3])
