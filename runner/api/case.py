"""A case: a recording, and what its owner believes of the object."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.effects.wording import counted
from runner.importing.record import episode_sources
from runner.recording.case import content_hash
from runner.systems.base import AbstractSystem
from runner.systems.case import open_case


@dataclass(frozen=True, eq=False)
class Case:
    """A recording, checked, and what its owner believes; made by `runner.read` and `runner.case_from_arrays`.

    Args:
        system: All that the diagnosis knows of the object.
        recording_hash: Of what the case held when it was read.
    """

    system: AbstractSystem
    recording_hash: str

    @property
    def path(self) -> Path:
        """Where it was read from."""
        return self.system.recording.path

    @property
    def name(self) -> str:
        """Name of its folder."""
        return self.path.name

    @property
    def notes(self) -> tuple[str, ...]:
        """What was odd about the files, yet no error."""
        return tuple(self.system.recording.notes)

    @property
    def channels(self) -> pd.DataFrame:
        """What is measured, a row for each: `channel`, `label`, `unit`, `noise` (as stated, SI; NaN: not known)."""
        rows = [(c.name, c.label, c.unit) for c in self.system.channels]
        table = pd.DataFrame(rows, columns=["channel", "label", "unit"])
        return table.assign(noise=self.system.noise_by_owner())

    @property
    def episodes(self) -> pd.DataFrame:
        """A row for each: `episode`, `samples`, `start_s`, `length_s`, `source` (its file, if an import kept it)."""
        sources = episode_sources(self.path)
        rows = [
            (e.index, len(e), float(e.t_s[0]), float(e.t_s[-1] - e.t_s[0]), sources.get(e.index, ""))
            for e in self.system.recording.episodes
        ]
        return pd.DataFrame(rows, columns=["episode", "samples", "start_s", "length_s", "source"])

    @property
    def data(self) -> pd.DataFrame:
        """What was measured, a row for each sample: `episode`, `t` (s), every channel in SI units.

        An orientation is the rotation vector of the body against the world, rad.
        """
        episodes: Sequence[Any] = self.system.recording.episodes
        table = pd.DataFrame(np.concatenate(self.system.readable()), columns=[c.name for c in self.system.channels])
        table.insert(0, "t", np.concatenate([e.t_s for e in episodes]))
        table.insert(0, "episode", np.repeat([e.index for e in episodes], [len(e) for e in episodes]))
        return table

    @property
    def effects(self) -> pd.DataFrame:
        """What may differ from the model, a row for each: `effect`, as a verdict would name it, and its `label`."""
        named = self.system.vocabulary.by_name
        rows = [(c.name, c.effect.label) for c in self.system.vocabulary if c is named[c.name][0]]
        return pd.DataFrame(rows, columns=["effect", "label"])

    def __repr__(self) -> str:
        """Its folder, and how much of what is in it."""
        episodes, channels = self.system.recording.episodes, [c.name for c in self.system.channels]
        held = f"{counted(len(episodes), 'episode')}, {counted(sum(map(len, episodes)), 'sample')}"
        return f"Case('{self.path}': {held} of {', '.join(channels)})"

    def _repr_html_(self) -> str:
        told = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return f"<p><b>{html.escape(self.name)}</b></p>{self.episodes.to_html(index=False)}{told}"


def read(path: str | Path) -> Case:
    """Return a case, checked.

    Args:
        path: A folder with `recording.parquet` (or `.csv`) and `nominal.yaml`, or the table in it.

    Raises:
        RunnerError: With the file, the row or key, what was wrong, and what is allowed.
    """
    found = content_hash(path)  # before it is read: what changes meanwhile is another recording
    return Case(open_case(path), found)
