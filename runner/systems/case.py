"""All kinds of systems there are: from a folder to one of them, and what none of their recordings can tell."""

from __future__ import annotations

from pathlib import Path

from runner.effects import mechanism, planar_box
from runner.recording import Form, read_case
from runner.recording.model_form import is_model_form
from runner.systems.base import AbstractSystem
from runner.systems.mechanism.box_form import free_box
from runner.systems.mechanism.system import read_mechanism
from runner.systems.planar_box.system import PlanarBox


def open_case(path: str | Path) -> AbstractSystem:
    """Return what a case is about, ready to be diagnosed.

    Args:
        path: A folder with a recording and `nominal.yaml` (and, in model form, an MJCF), or the table in it.

    Raises:
        RecordingError: With the file, the row or key, what was wrong, and what is allowed.
    """
    if is_model_form(path):
        return read_mechanism(path)
    recording = read_case(path)
    return PlanarBox(recording) if recording.form is Form.PLANAR else free_box(recording)


def always_confounded() -> frozenset[frozenset[str]]:
    """Return the pairs of names, without targets, that no recording tells apart, of all kinds of systems."""
    effects = [*(cls for variants in planar_box.EFFECTS.values() for cls in variants), *mechanism.EFFECTS]
    return frozenset(frozenset((cls.name, other.name)) for cls in effects for other in cls.confounded)
