"""The gap between a case and a model of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from runner.api.case import Case
from runner.api.corrected import Corrected
from runner.noise.measured import measure
from runner.simulate.gap import HORIZONS_S, Gap, measure_gap


def gap(
    case: Case,
    *,
    model: Corrected | str | Path | None = None,
    horizons_s: Sequence[float] = HORIZONS_S,
    advance: Callable[..., None] = lambda steps=1: None,
) -> Gap:
    """Measure how far a recording and its model drift apart, open loop; `table` and `episodes` of the result say it.

    Args:
        case: What was recorded.
        model: A corrected model, or the folder or file that holds one; None: the model as it is believed.
        horizons_s: Lengths of windows, s, or none; whole episodes are measured in any case.
        advance: Called after each horizon and each episode.

    Raises:
        RunnerError: If a horizon is shorter than a sample, or no episode is as long as that.
    """
    corrected = Corrected.read(model, case) if isinstance(model, str | Path) else model
    system = case.system if corrected is None else corrected.system
    return measure_gap(
        system,
        measure(system),
        effects=() if corrected is None else corrected.effects,
        horizons_s=horizons_s,
        advance=advance,
    )
