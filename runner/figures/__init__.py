"""Figures of experiments, drawn from stored tables alone.

A figure is a function in a module of this package, registered under the name of the experiment whose runs it draws.
All modules whose names do not begin with `_` are imported by `load()`, so that a new figure is a new function (or a
new module) and nothing else:

    @figure("start_mass", "final_error")        # experiment, name of the file
    def final_error(runs: Runs) -> Drawn:
        page, ax = canvas(xlabel="start mass [kg]", ylabel="relative error of the mass")
        errors = np.abs(runs.values("mass_final_error"))
        ax.plot(runs.values("mass_start_kg"), size(errors), "o")
        log_error(ax)
        stated(ax, 2e-4, "paper: 0.02 %")
        worst = errors.max()
        return Drawn(
            page,
            claim="Start masses above 50 % of the true mass end within 0.02 % of it (fig. 13).",
            seen=f"They end {within(worst)}.",
            holds=bool(worst < 2e-4),
        )

`runs.table` has a row for each run that went well, in run order, with the columns of `runner table`; `runs.values(key)`
is one of them as an array; `runs.frames(i)` is the run's `frames.parquet`, `runs.parquet(i, "other.parquet")` any other
table in its folder. A command other than `run` takes part if the rows of its `summary.parquet` have the columns
`experiment` and `status` ("done" or "not converged" for a run to be drawn). `claim` is empty where the paper says
nothing; `holds` is None where there is nothing to hold. `seen` becomes the title of the figure. `runner figures
PATH...` writes PNG, SVG, `index.html` and `index.md`.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from runner.errors import ResultError
from runner.figures._look import STYLE


@dataclass(frozen=True)
class Runs:
    """The runs of one experiment.

    Attributes:
        experiment: Its name.
        table: A row for each run that went well, in run order; `run` is its folder, `job` its place in the sweep.
        failed: The rows of the others, with `status` and `reason`.
    """

    experiment: str
    table: pd.DataFrame
    failed: pd.DataFrame

    def values(self, key: str) -> np.ndarray:
        """Return a column of the table, one value for each run.

        Raises:
            ResultError: If the runs have no such column.
        """
        if key not in self.table:
            raise ResultError(f"paths: the runs of '{self.experiment}' have no '{key}', which a figure needs.")
        return self.table[key].to_numpy()

    def at(self, key: str, value: float) -> Runs:
        """Return the runs in which a column has a value.

        Raises:
            ResultError: If there are none.
        """
        found = self.table.loc[self.values(key) == value, :]
        if found.empty:
            raise ResultError(f"paths: no run of '{self.experiment}' at {key}={value:g}, which a figure needs.")
        return Runs(self.experiment, found.reset_index(drop=True), self.failed)

    def parquet(self, i: int, name: str) -> pd.DataFrame:
        """Return a table from the folder of the i-th run.

        Raises:
            ResultError: If the run left no such table.
        """
        file = Path(str(self.table["run"].iloc[i])) / name
        if not file.is_file():
            raise ResultError(f"paths: no '{file}', which a figure of '{self.experiment}' needs.")
        return pd.read_parquet(file)

    def frames(self, i: int) -> pd.DataFrame:
        """Return the frames of the i-th run, a row for each update."""
        return self.parquet(i, "frames.parquet")


@dataclass(frozen=True)
class Drawn:
    """A figure and what it says.

    Attributes:
        figure: The drawing; its title is put on top of it later.
        seen: What is seen here, one sentence with its numbers.
        claim: What the paper says, with the number of its figure; empty: nothing.
        holds: Whether the claim holds here; None: there is no claim, or no telling.
    """

    figure: Figure
    seen: str
    claim: str = ""
    holds: bool | None = None


Draw = Callable[[Runs], Drawn]
_REGISTERED: dict[tuple[str, str], Draw] = {}


def figure(experiment: str, name: str) -> Callable[[Draw], Draw]:
    """Return a decorator that registers a function as a figure of an experiment.

    Args:
        experiment: Name of the experiment, as in `conf/experiment`.
        name: Name of the figure; its files are `<experiment>_<name>.png` and `.svg`.
    """

    def decorate(draw: Draw) -> Draw:
        @functools.wraps(draw)
        def styled(runs: Runs) -> Drawn:
            with mpl.rc_context(STYLE):
                return draw(runs)

        _REGISTERED[experiment, name] = styled
        return styled

    return decorate


def load() -> dict[str, dict[str, Draw]]:
    """Import all modules of figures and return the figures by experiment and name, in the order of their modules."""
    for module in sorted(m.name for m in pkgutil.iter_modules(__path__)):
        if not module.startswith("_"):
            importlib.import_module(f"{__name__}.{module}")
    found: dict[str, dict[str, Draw]] = {}
    for (experiment, name), draw in _REGISTERED.items():
        found.setdefault(experiment, {})[name] = draw
    return found
