"""What a sink is: it writes a finished run into a folder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from runner.teleop.frames import RunResult

NOTHING: Mapping[str, Any] = MappingProxyType({})


class AbstractSink(ABC):
    """Writes a finished run into a folder."""

    @abstractmethod
    def write(
        self, result: RunResult, folder: Path, config: Mapping[str, Any], overrides: Mapping[str, Any] = NOTHING
    ) -> None:
        """Write the run.

        Args:
            result: The run.
            folder: Where to.
            config: The resolved config as plain containers.
            overrides: What of it was set for this run.
        """
