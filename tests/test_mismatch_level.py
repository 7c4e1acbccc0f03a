"""How large a simulator's own errors are is known no better than its levels are likely: standard errors hold that."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from runner.effects.base import Parameter
from runner.inference.evidence import NormalEquations, evidence
from runner.settings import SETTINGS

LEVELS = (1 / 16, 1 / 8, 1 / 4, 0.5, 1.0, 2.0, 4.0, 8.0)
SAMPLES, WAYS, TRUE = 400, 3, 0.3
LIKE = 0.5  # how much of a number's own pattern is in that of an error


def equations(level: float, rng: np.random.Generator) -> NormalEquations:
    """Return a fit of one number to white noise and errors of the simulator of this level, in a linear model."""
    own = rng.normal(size=SAMPLES)
    ways = rng.normal(size=(SAMPLES, WAYS)) + LIKE * own[:, None]
    errors = ways @ (0.3 * level * rng.normal(size=WAYS))
    seen = own * TRUE + errors + rng.normal(size=SAMPLES)
    x = own @ seen / (own @ own)
    whole = np.column_stack([own, ways, own * x - seen])
    parameter = Parameter("x", "", 10.0, -1e3, 1e3)
    candidate = SimpleNamespace(is_placed=lambda _: False, parameters=lambda _: (parameter,))
    explanation = SimpleNamespace(
        parameters=lambda _: (parameter,), parts=lambda _: ((candidate, slice(0, 1)),), candidates=(candidate,)
    )
    fit: Any = SimpleNamespace(x=np.array([x]), explanation=explanation, at_bound=np.array([False]))
    directions: Any = (SimpleNamespace(mismatch=0.3, asked=True),) * WAYS
    return NormalEquations(fit, directions, (whole.T @ whole)[None], 0.0, float(whole[:, -1] @ whole[:, -1]))


def told(level: float, seed: int) -> tuple[float, float]:
    """Return how far the number is off, and its standard error."""
    around = equations(level, np.random.default_rng(seed))
    system: Any = SimpleNamespace(context=None, mismatch_levels=LEVELS, episodes_differ=False)
    return around.fit.x[0] - TRUE, float(np.sqrt(evidence(around, system).covariance[0, 0]))


@pytest.mark.parametrize("level", [1 / 8, 1 / 4, 1 / 2, 1.0])
def test_errors_are_as_large_as_stated(level: float) -> None:
    """With three ways to be wrong a recording tells their size to a factor of two or four, and no better."""
    off, stated = np.array([told(level, seed) for seed in range(200)]).T
    z = off / (SETTINGS.probability.mismatch_error_factor * stated)
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.15
    assert np.mean(np.abs(z) > 2.0) < 0.08
