"""From a folder to a system: which kind of case it is, read and checked."""

from __future__ import annotations

from pathlib import Path

from runner.recording import read_case
from runner.recording.model_form import is_model_form
from runner.systems.base import AbstractSystem
from runner.systems.mechanism.system import read_mechanism
from runner.systems.planar_box.system import PlanarBox


def open_case(path: str | Path) -> AbstractSystem:
    """Return what a case is about, ready to be diagnosed.

    Args:
        path: A folder with a recording and `nominal.yaml` (and, in model form, an MJCF), or the table in it.

    Raises:
        RecordingError: With the file, the row or key, what was wrong, and what is allowed.
    """
    return read_mechanism(path) if is_model_form(path) else PlanarBox(read_case(path))
