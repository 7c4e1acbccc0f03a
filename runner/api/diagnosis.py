"""A diagnosis, as tables, a figure, files and a corrected model."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from runner.api.case import Case
from runner.api.corrected import Corrected
from runner.api.tables import verdict_table
from runner.diagnosis import pipeline
from runner.diagnosis.result import Diagnosis
from runner.diagnosis.verdict import FILE, verdict
from runner.localise.where import Where
from runner.progress import UNOBSERVED, ProgressObserver, Spoken
from runner.report import words
from runner.report.before_after import of_whole_episodes
from runner.report.statement import caveats, doubts, state
from runner.storage.provenance import program

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = "report.html"
SHOWN = 5  # explanations in a figure


@dataclass(frozen=True, eq=False)
class CaseDiagnosis:
    """What was found in a case; made by `runner.diagnose`.

    Args:
        case: What was diagnosed.
        result: All that was found, as the program itself has it; not among the names that stay the same.
    """

    case: Case
    result: Diagnosis

    @property
    def sentence(self) -> str:
        """What was found, in a sentence or two."""
        return words.verdict(self.result)

    @property
    def effects(self) -> tuple[str, ...]:
        """The likeliest explanation: names of effects, ("none",) or ("unknown",)."""
        return self.result.ranked[0].effects

    @property
    def probability(self) -> float:
        """Of that explanation."""
        return self.result.ranked[0].probability

    @property
    def gap_closed(self) -> float:
        """Share of what is missed on the episodes left out that the corrected model misses no more."""
        return self.result.gap_closed

    @property
    def wall_s(self) -> float:
        """How long it took by the clock, s, without report."""
        return self.result.wall_s

    @property
    def cpu_s(self) -> float:
        """How long it took of the processor, s, all threads together: more than `wall_s` where several were at work."""
        return self.result.cpu_s

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know before believing it."""
        return (*doubts(self.result), *caveats(self.result))

    @cached_property
    def ranked(self) -> pd.DataFrame:
        """The explanations, likeliest first: `effects`, `probability`, `amount`, `gap_closed`, `log_evidence`,
        `equivalent`.

        `effects` are joined by " + "; "none" and "unknown" are explanations too. `amount` is in words, with standard
        errors. `log_evidence` is NaN for what is so far behind that it was not held against the episodes left out.
        `equivalent` is what these data can't tell from it: the probability is that of all together.
        """
        rows = [
            {
                "effects": " + ".join(r.effects),
                "probability": r.probability,
                "amount": "; ".join(words.amounts(self.case.system, r)),
                "gap_closed": r.gap_closed,
                "log_evidence": r.log_evidence,
                "equivalent": ", ".join(" + ".join(e) for e in r.equivalent),
            }
            for r in self.result.ranked
        ]
        return pd.DataFrame(rows).astype({"gap_closed": float, "log_evidence": float})

    @property
    def where(self) -> Where:
        """Where the model misses: `sentence`, and the tables `gap`, `windows`, `missing_force` and `cells`."""
        return self.result.where

    @cached_property
    def disturbances(self) -> pd.DataFrame:
        """What pushed once and is in no log: `episode`, `what`, `force`, `from_s`, `until_s`, their errors as `_se`."""
        names = ("force", "from_s", "until_s")
        columns = ["episode", "what", *names, *(f"{n}_se" for n in names)]
        rows = [
            (d.episode, d.label, *(getattr(d, n)[0] for n in names), *(getattr(d, n)[1] for n in names))
            for d in self.result.disturbances
        ]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def closure(self) -> pd.DataFrame:
        """What is missed of each channel on the episodes left out, root mean square, SI units.

        A row for each: `channel`, `unit`, `before`, `after` (with the corrected model), `noise`.
        """
        table = self.result.closure.table
        rows = []
        for channel in self.case.system.channels:
            part = table.loc[lambda t, name=channel.name: t["channel"] == name]
            if len(part):
                squares = {k: np.nanmean(part[k].to_numpy(float) ** 2) for k in ("before", "after", "noise")}
                rows.append({"channel": channel.name, "unit": channel.unit} | {k: v**0.5 for k, v in squares.items()})
        return pd.DataFrame(rows, columns=["channel", "unit", "before", "after", "noise"])

    @property
    def corrected(self) -> Corrected:
        """The model with the effects found; `save` writes it."""
        return Corrected(self.case, self.result.effects, self.result.system)

    def verdict(self) -> dict[str, Any]:
        """Return it as plain data, as it stands in `verdict.json`."""
        return {"sentence": self.sentence, **verdict(self.result)}

    def table(self) -> pd.DataFrame:
        """Return every number of every explanation, as `runner.read_table` does of results.

        `case`, `effects`, `probability`, `gap_closed`, and a row for each `effect` and `parameter` with `value` and
        `standard_error`, SI units.
        """
        return verdict_table(self.case.name, verdict(self.result)["ranked"])

    def plot(self) -> Figure:
        """Return a figure: the likeliest explanations, and what is missed before and after, channel by channel."""
        import matplotlib as mpl
        from matplotlib.figure import Figure

        from runner.report.figures import ORANGE, STYLE
        from runner.report.motion_figures import draw_bars

        said, found = state(self.result), of_whole_episodes(self.result)
        order = said.order[:SHOWN]
        with mpl.rc_context(STYLE):
            figure = Figure(figsize=(11.0, 0.9 + 0.28 * max(len(order), len(found))), layout="constrained")
            left, right = figure.subplots(1, 2)
            left.barh([words.title(r.effects) for r in order], [r.probability for r in order], color=ORANGE, height=0.6)
            left.invert_yaxis()
            left.set(xlim=(0, 1), xlabel="probability", title=self.case.name)
            draw_bars(right, found)
            right.set_title("before (grey) and after")
        return figure

    def report(self, folder: str | Path, *, figures: bool = True, config_hash: str | None = None) -> Path:
        """Write what `runner diagnose` writes: `report.html`, `diagnosis.rrd`, `verdict.json`, tables, corrected model.

        Args:
            folder: Where to; made if it is not there.
            figures: Whether to write more than the verdict and the corrected model.
            config_hash: Of the settings, for the verdict.

        Returns:
            The path of the report, or of the verdict where there is none.

        Raises:
            RunnerError: If the folder holds a recording, or can't be written to.
        """
        from runner.outputs.many import check_results
        from runner.outputs.one import write_all

        folder = Path(folder)
        check_results(folder)
        made = {**program(), "config_hash": config_hash, "recording_hash": self.case.recording_hash}
        write_all(self.result, folder, report=figures, provenance=made)
        return folder / (PAGE if figures else FILE)

    def _repr_html_(self) -> str:
        ranked = self.ranked[["effects", "probability", "amount", "gap_closed", "equivalent"]]
        tables = [t.to_html(index=False, float_format="{:.3g}".format, na_rep="") for t in (ranked, self.closure)]
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        found = f"<p><b>{html.escape(self.sentence)}</b></p>"
        return f"{found}{tables[0]}<p>Missed on episodes not fitted:</p>{tables[1]}{notes}"


def diagnose(
    case: Case,
    *,
    threads: int | None = None,
    advise: bool = True,
    progress: Callable[[str], object] | ProgressObserver | None = None,
) -> CaseDiagnosis:
    """Diagnose a case: where its model misses, which effect explains that, how far the gap shrinks.

    Takes from half a minute to many minutes.

    Args:
        case: What was recorded, and what its owner believes.
        threads: For the simulations; None: one per core.
        advise: Whether to look for what could be taken for the answer, and for the next experiment.
        progress: Is called with a line whenever there is something new to say, `print` for one; or an observer.

    Raises:
        RunnerError: If there are fewer than two episodes (in model form: if one is too short), or too little in them.
    """
    observer = Spoken(progress) if callable(progress) else progress or UNOBSERVED
    return CaseDiagnosis(case, pipeline.diagnose(case.system, threads=threads, advise=advise, observer=observer))
