"""Small numerics that are done here as their import from scipy takes a second: the same numbers as scipy has."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy.signal import lfilter, savgol_filter
from scipy.stats import false_discovery_control

from runner.localise.cells import false_discovery
from runner.numerics.arrays import over_gaps
from runner.numerics.differences import rounding_noise, smooth_derivative
from runner.numerics.recursive_filter import filtered


@pytest.mark.parametrize("shape", [(50,), (3, 50), (2, 3, 50), (3, 1), (0, 50)])
def test_a_filter_is_that_of_scipy(shape: tuple[int, ...]) -> None:
    """Bit for bit, from any start, along the last axis, of arrays in any order in memory; the input stays."""
    rng = np.random.default_rng(0)
    x, start = rng.normal(size=shape), rng.normal(size=shape[:-1])
    for values in (x, np.asfortranarray(x), np.repeat(x, 2, axis=-1)[..., ::2]):
        kept = values.copy()
        wanted, _ = lfilter([0.3, 0.2], [1.0, -0.6], values, axis=-1, zi=start[..., None])
        np.testing.assert_array_equal(filtered(values, 0.3, 0.2, 0.6, start), wanted)
        np.testing.assert_array_equal(values, kept)
    np.testing.assert_array_equal(filtered(x, 0.4, 0.0, 0.6), lfilter([0.4], [1.0, -0.6], x, axis=-1))


@pytest.mark.parametrize("count", [1, 2, 7, 200])
def test_false_discoveries_are_those_of_scipy(count: int) -> None:
    """With ties, ones and zeros among the probabilities."""
    p = np.round(np.random.default_rng(count).random(count), 1)
    np.testing.assert_allclose(false_discovery(p), false_discovery_control(p), rtol=1e-15)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_smooth_derivatives_are_those_of_scipy(order: int) -> None:
    """Half a window away from either end."""
    values = np.cumsum(np.random.default_rng(order).normal(size=(60, 2)), axis=0)
    wanted = np.asarray(savgol_filter(values, 11, 3, deriv=order, delta=0.02, axis=0), dtype=np.float64)
    inside = slice(5, -5)
    scale = np.abs(wanted[inside]).max()
    np.testing.assert_allclose(
        smooth_derivative(values, 11, 3, order, 0.02)[inside], wanted[inside], atol=1e-12 * scale
    )


def test_no_command_waits_for_the_statistics_of_scipy() -> None:
    """Which takes two seconds, and comes with scipy.signal as well."""
    asked = "import sys, runner.commands.diagnose; print({'scipy.stats', 'scipy.signal'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_rounding_is_told_by_what_counts() -> None:
    """A twelfth of the square of its count; what moves on by much in every sample has none."""
    t = np.linspace(0.0, 6.0, 400)
    assert rounding_noise([0.25 * np.round(4.0 * np.sin(t)), np.array([0.5, 0.5])]) == pytest.approx(0.25 / 12**0.5)
    assert rounding_noise([3.0 * t + np.random.default_rng(0).normal(scale=1e-6, size=len(t))]) == 0.0
    assert rounding_noise([]) == 0.0


def test_lines_over_gaps_go_by_where_rows_stand() -> None:
    nan = np.nan
    columns = np.array([[nan, 1.0, nan], [2.0, nan, nan], [nan, nan, nan], [8.0, 3.0, nan]])
    at = np.array([0.0, 1.0, 2.0, 5.0])
    np.testing.assert_allclose(over_gaps(columns, at), [[2, 1, 0], [2, 1.4, 0], [3.5, 1.8, 0], [8, 3, 0]])
    np.testing.assert_allclose(over_gaps(columns)[:, 0], [2, 2, 5, 8])
    assert np.isnan(columns[0, 0])
