"""Headless experiments on simulated and recorded objects, and a diagnosis of the gap between the two.

    import runner
    diagnosis = runner.diagnose(runner.read("folder"))
    diagnosis.ranked                    # which effects explain the gap, as a pandas table

What is in `runner.__all__` is what other programs may rely on; docs/python.md shows how. It is imported when it is
first used, so that `import runner` takes no time.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runner.api.arrays import case_from_arrays
    from runner.api.case import Case, read
    from runner.api.corrected import Corrected
    from runner.api.diagnosis import CaseDiagnosis, diagnose
    from runner.api.gap import gap
    from runner.api.tables import read_table
    from runner.errors import RunnerError
    from runner.localise.where import Where
    from runner.simulate.gap import Gap

__all__ = [
    "Case",
    "CaseDiagnosis",
    "Corrected",
    "Gap",
    "RunnerError",
    "Where",
    "case_from_arrays",
    "diagnose",
    "gap",
    "read",
    "read_table",
]
_FROM = {
    "Case": "api.case",
    "CaseDiagnosis": "api.diagnosis",
    "Corrected": "api.corrected",
    "Gap": "simulate.gap",
    "RunnerError": "errors",
    "Where": "localise.where",
    "case_from_arrays": "api.arrays",
    "diagnose": "api.diagnosis",
    "gap": "api.gap",
    "read": "api.case",
    "read_table": "api.tables",
}


def __getattr__(name: str) -> Any:
    if name not in _FROM:
        raise AttributeError(f"module 'runner' has no attribute '{name}'")
    value = getattr(importlib.import_module(f"runner.{_FROM[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
