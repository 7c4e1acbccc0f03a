"""Effects: what may differ between a model and the world, one package for each kind of system."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules


def import_all(package: str, folders: Iterable[str]) -> None:
    """Import every file of a package, so that an effect is in the vocabulary because its file is in the folder."""
    for name in sorted(module.name for module in iter_modules(folders)):
        import_module(f"{package}.{name}")
