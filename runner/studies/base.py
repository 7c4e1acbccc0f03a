"""Studies: experiments whose result is a table of many runs, or of something else than a run of the closed loop.

A study is an option of the config group `study`, chosen by an experiment (`override /study: plumb_line`). `runner run`
calls its `rows` in place of running the loop, and stores what they return as the summary of the folder, so that
`runner table` and `runner figures` treat them like other runs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from runner.teleop.experiment import Experiment

Rows = list[dict[str, Any]]


class AbstractStudy(ABC):
    """Something that makes a table of an experiment."""

    @abstractmethod
    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        """Return the rows of the table; further files may be written into the folder.

        Args:
            experiment: All other sections of the config: scene, remote, start, forces, link, seed.
            folder: Of the results, exists.
        """
