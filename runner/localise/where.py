"""Where the model misses: per channel, over time as a missing force, and shared among what went on and where.

The recording is cut into short windows, and the model is restarted in each from a locally smoothed measured state.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from runner.effects.base import Effects
from runner.localise.cells import tested_cells
from runner.localise.excess import shortest_that_tells
from runner.localise.gap_by_horizon import gap_by_horizon
from runner.localise.linearised import Model
from runner.localise.missing_force import missing_force_table
from runner.localise.sentence import sentence_of
from runner.localise.windows import check_length
from runner.noise.measured import Measured
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem


@dataclass(frozen=True)
class Where:
    """Where the model misses.

    Args:
        gap: Per channel and horizon, start states fitted: `channel`, `unit`, `horizon`, `rms`, `noise`, `noises`.
        windows: One row per window: `episode`, `t_s` (its middle), what the system's labels say of it (a column for
            each factor of `cells` but the channel), `excess`, `excess_<channel>`, `freedom`.
        missing_force: One row per window of the shortest length: its labels, the numbers that the system's disturbance
            names and the system's further views of them, each with `_se`; NaN: not to be seen.
        cells: One row per cell: `factor`, `cell`, `n` (windows), `excess`, `share` (of the excess of all cells of its
            factor that show any), `lift` (share over share of the windows, or of the channels), `p` (one-sided, that it
            is as large by chance), `q` (Benjamini-Hochberg), and for places `x_m`, `y_m`.
        excess: Of all windows, in squared noises; `freedom` of which noise makes, and the `p` of that.
        window_s: Length of the windows.
        sentence: All of it in one sentence.
    """

    gap: pd.DataFrame
    windows: pd.DataFrame
    missing_force: pd.DataFrame
    cells: pd.DataFrame
    window_s: float
    excess: float
    freedom: float
    p: float
    sentence: str

    @property
    def exceeds(self) -> bool:
        """Whether there is a gap beyond the noise at all."""
        return self.p < SETTINGS.where.significance

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.sentence)}</p>{self.cells.to_html(index=False, float_format='{:.3g}'.format)}"


def localise(
    system: AbstractSystem,
    measured: Measured,
    starts: Mapping[int, np.ndarray],
    effects: Effects = (),
    *,
    stretches: Sequence[Span] | None = None,
) -> Where:
    """Tell where a model misses a recording.

    Args:
        system: What was recorded.
        measured: Its channels and their noise.
        starts: Start state of each stretch that counts, by its position, (S,): for the gap over the longest time.
        effects: What the model holds beyond the nominal one.
        stretches: What is replayed from such a start; None: whole episodes.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    whole = [Span(e, 0, len(x)) for e, x in enumerate(system.recording.episodes)]
    spans = whole if stretches is None else list(stretches)
    episodes = sorted({spans[i].episode for i in starts})
    model = Model(system, system.simulator(), effects)
    gap = gap_by_horizon(model, measured, starts, spans)
    check_length(system, episodes)
    shortest, telling = shortest_that_tells(model, measured, episodes)
    table = telling.labels.table.assign(
        excess=telling.excess.sum(axis=1),
        freedom=telling.freedom.sum(axis=1),
        **{f"excess_{c.name}": telling.excess[:, i] for i, c in enumerate(system.channels)},
    )
    cells = tested_cells(system, telling)
    return Where(
        gap=gap,
        windows=table,
        missing_force=pd.concat([shortest.labels.table, missing_force_table(system, shortest)], axis=1),
        cells=cells,
        window_s=(telling.samples - 1) / system.rate_hz,
        excess=float(telling.excess.sum()),
        freedom=float(telling.freedom.sum()),
        p=telling.p,
        sentence=sentence_of(system, cells, telling.p),
    )
