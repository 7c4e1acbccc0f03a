"""What a log is imported for: a mechanism by its MJCF, or a box that is pushed by what its owner believes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

from runner.importing.box import SUFFIXES, believed, plan_box
from runner.importing.case import model_name
from runner.importing.entries import Plan, plan
from runner.importing.map_file import AnyMap, BoxMap, Map, read_map
from runner.importing.propose import Proposal, propose, propose_box
from runner.importing.signals import Log
from runner.recording.model_form_mjcf import read_mjcf

UNKNOWN_RATE_HZ = 1.0  # until the clock of the log has told; nothing of a proposal rests on it


class AbstractTarget(ABC):
    """What the owner of a log believes in; reading it is the first thing that is done, so that errors come at once."""

    @abstractmethod
    def propose(self, log: Log, rate_hz: float | None) -> Proposal:
        """Return a map for a log; `rate_hz` is that of samples without a time, where it was given."""

    @abstractmethod
    def plan(self, map_file: Path) -> tuple[AnyMap, Plan]:
        """Return what a map says, and what that makes.

        Raises:
            RecordingError: Naming the key, its value and what is allowed.
        """


class MechanismTarget(AbstractTarget):
    """A mechanism, by its MJCF."""

    def __init__(self, path: Path) -> None:
        self._path, self._model = path, read_mjcf(path).compile()

    def propose(self, log: Log, rate_hz: float | None) -> Proposal:
        """Return a map for a log."""
        return propose(log, self._model, rate_hz=rate_hz)

    def plan(self, map_file: Path) -> tuple[AnyMap, Plan]:
        """Return what a map says, and what that makes."""
        wanted = read_map(map_file, Map)
        return wanted, plan(map_file, wanted, self._model, model_name(self._path))


class BoxTarget(AbstractTarget):
    """A box that is pushed, by a file with what is believed of it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        believed(path, UNKNOWN_RATE_HZ)

    def propose(self, log: Log, rate_hz: float | None) -> Proposal:
        """Return a map for a log."""
        nominal, _ = believed(self._path, UNKNOWN_RATE_HZ if rate_hz is None else rate_hz)
        return propose_box(log, nominal, rate_hz=rate_hz)

    def plan(self, map_file: Path) -> tuple[AnyMap, Plan]:
        """Return what a map says, and what that makes."""
        wanted = read_map(map_file, BoxMap)
        return wanted, plan_box(map_file, wanted, self._path)


def target_of(model: Path) -> AbstractTarget:
    """Return what a file describes: a box if it is YAML, else a mechanism.

    Raises:
        RecordingError: If it can't be read as that.
    """
    return BoxTarget(model) if model.suffix in SUFFIXES else MechanismTarget(model)
