"""The corrected model: what was believed, with the effects that a diagnosis has found."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from runner.api.case import Case
from runner.diagnosis.corrected import read_corrected, write_corrected
from runner.effects.base import Effects
from runner.systems.base import AbstractSystem


@dataclass(frozen=True, eq=False)
class Corrected:
    """A model with effects in it.

    Args:
        case: The case that they were found in, or that they are for.
        effects: What is added to the nominal model; none: it is that.
        solved: The nominal model, solved as it was when they were found; None: as the case has it.
    """

    case: Case
    effects: Effects
    solved: AbstractSystem | None = None

    @property
    def system(self) -> AbstractSystem:
        """The nominal model."""
        return self.solved or self.case.system

    @classmethod
    def read(cls, path: str | Path, case: Case) -> Corrected:
        """Return the model that `save` wrote.

        Args:
            path: `corrected.yaml`, or the folder that holds it.
            case: What it is to be used for: any recording of the same kind of object.

        Raises:
            RunnerError: If there is no such file, or it is of something else.
        """
        return cls(case, *read_corrected(path, case.system))

    @property
    def values(self) -> pd.DataFrame:
        """A row for each number: `effect`, `parameter`, `value` (SI), `unit` ("" for a pure number)."""
        system = self.system
        units = {e.full_name: system.vocabulary.units(e.full_name, system.context) for e in self.effects}
        rows = [(e.full_name, k, v, units[e.full_name][k]) for e in self.effects for k, v in e.report().items()]
        return pd.DataFrame(rows, columns=["effect", "parameter", "value", "unit"])

    def save(self, folder: str | Path) -> Path:
        """Write the corrected MJCF and `corrected.yaml` into a folder, and return the latter's path.

        Raises:
            RunnerError: If the written model behaves otherwise than the simulated one, or can't be written.
        """
        return write_corrected(folder, self.effects, self.system)

    def _repr_html_(self) -> str:
        return self.values.to_html(index=False)
