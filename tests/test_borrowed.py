"""Arrays without an owner hold what the owner's do."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from runner.physics.borrowed import borrowed


@njit
def _rows(array):
    view = borrowed(array)
    for k in range(view.shape[1]):  # whole rows take numba five times as long to compile
        view[1, k] *= 2.0
    return view[1, 0] + view[-1, -1]


@njit
def _of_its_own(n):
    own = np.arange(n) * 1.0
    total = borrowed(own)[1:].sum()
    own[0] = 0.0
    return total


@njit
def _not_an_array(x):
    return borrowed(x)


def test_a_borrowed_array_is_the_same_memory_with_the_same_strides():
    array = np.arange(24.0).reshape(4, 6)[:, ::2]
    assert _rows(array) == 2 * 6.0 + 22.0
    assert np.array_equal(array[1], [12.0, 16.0, 20.0])


def test_what_a_function_made_itself_can_be_borrowed_until_its_last_use():
    assert [_of_its_own(n) for n in (2, 10, 1000)] == [1.0, 45.0, 499_500.0]


def test_only_arrays_are_borrowed():
    with pytest.raises(TypingError, match="only arrays are borrowed"):
        _not_an_array(1.0)
