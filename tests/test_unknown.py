"""What is left where nothing explains more: by how much, and by how few values."""

from __future__ import annotations

import numpy as np
import pytest

from runner.inference.probability import error_of_excess, unknown_by_excess


@pytest.mark.parametrize("values", [200, 800, 20_000])
def test_what_few_values_leave_by_chance_is_not_unknown(values: int) -> None:
    """White noise that is known to be what it is leaves an excess of its own: seldom one that has to have a cause."""
    rng = np.random.default_rng(values)
    left = np.array([np.mean(rng.standard_normal(values) ** 2) - 1.0 for _ in range(2000)])
    assert left.std() == pytest.approx(error_of_excess(values), rel=0.1)
    told = np.array([unknown_by_excess(excess, 0.0, 0.05, error_of_excess(values)) for excess in left])
    assert np.mean(told > 0.5) < 0.02


def test_many_values_tell_what_few_do_not() -> None:
    """The same excess is chance in two hundred values, and has a cause in twenty thousand."""
    few, many = (unknown_by_excess(0.25, 0.0, 0.05, error_of_excess(n)) for n in (200, 20_000))
    assert few < 0.6
    assert many > 0.8
