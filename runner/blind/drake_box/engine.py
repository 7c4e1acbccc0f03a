"""Drake, where it is installed: an extra that nothing else needs."""

from __future__ import annotations

import functools
import importlib
import logging
from typing import Any

from runner.errors import ConfigError


@functools.cache
def drake(module: str) -> Any:
    """Return a module of pydrake by its name below the package.

    Raises:
        ConfigError: If Drake is not installed, or does not load here.
    """
    try:
        found = importlib.import_module(f"pydrake.{module}")
    except ImportError as error:
        raise ConfigError(
            f"system: planar_box_drake needs Drake, which is not here: pip install 'runner[blind]' ({error})."
        ) from None
    # it says of every floor that is a half space that deformable bodies would not touch it
    logging.getLogger("drake").setLevel(logging.ERROR)
    return found


def available() -> bool:
    """Return whether Drake can be loaded."""
    try:
        drake("multibody.plant")
    except ConfigError:
        return False
    return True
