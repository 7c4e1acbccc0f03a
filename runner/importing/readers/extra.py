"""Libraries of the extra `[import]`, which not everybody has."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

from runner.errors import RecordingError


def needed(module: str, path: Path) -> ModuleType:
    """Import a library of the extra.

    Raises:
        RecordingError: If it is not installed, naming the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        library = module.partition(".")[0]
        raise RecordingError(
            f"{path}: needs {library}, which is not installed; it comes with the extra: pip install 'runner[import]'."
        ) from None
