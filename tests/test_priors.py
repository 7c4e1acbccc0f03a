"""How likely a size is before anything was recorded."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from runner.inference.evidence import log_densities
from runner.inference.least_squares import Explanation
from tests.mechanism_cases import slide_case, system_of


@pytest.mark.parametrize("size", [0.0, 0.5, 3.0, 8.0])
def test_a_clock_is_never_off_by_ten_times_what_is_usual_and_an_inertia_may_be(tmp_path: Path, size: float) -> None:
    """Closed forms: a normal for what quartz or a nominal rate keeps, Student's t for what somebody has guessed."""
    system = system_of(slide_case(tmp_path, command=np.sin))
    for name, prior in (("clock_scale", stats.norm), ("armature[slide]", stats.t(3))):
        (candidate,) = system.vocabulary.by_name[name]
        (parameter,) = candidate.parameters(system.context)
        explanation: Any = Explanation((candidate,))
        fit: Any = SimpleNamespace(explanation=explanation, x=np.array([size * parameter.scale]))
        (found,) = log_densities(fit, system.context)
        sides = 2.0 if parameter.lower == 0.0 else 1.0
        assert found == pytest.approx(prior.logpdf(size) + np.log(sides / parameter.scale), abs=1e-9)
