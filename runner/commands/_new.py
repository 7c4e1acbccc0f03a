"""Files to begin with, from templates: what `runner new effect` and `runner new system` write."""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from runner.commands._compose import config_dir
from runner.errors import ConfigError
from runner.storage.writing import write_text

NAME = re.compile(r"[a-z][a-z0-9_]*")


def check_name(name: str) -> None:
    """Refuse what is no name of a file, a class and a key at once.

    Raises:
        ConfigError: Naming what is allowed.
    """
    if not NAME.fullmatch(name):
        raise ConfigError(f"name: must be lower case letters, digits and _, beginning with a letter, got '{name}'.")


def checkout() -> Path:
    """Return the folder of the project.

    Raises:
        ConfigError: If the program was installed from a wheel: there is nothing to add a file to.
    """
    root = config_dir().parent
    if not (root / "runner" / "effects").is_dir() or not (root / "tests").is_dir():
        raise ConfigError(
            "new effect: adds files to a clone of the project, and this is an installed one; from Python a class of "
            "your own is enough, see docs/own_effect.md."
        )
    return root


def write(templates: Mapping[Path, str], words: Mapping[str, str]) -> None:
    """Write each file from its template, `@KEY@` replaced by words; none over one that is there.

    Raises:
        ConfigError: If one is there.
    """
    for path in templates:
        if path.exists():
            raise ConfigError(f"name: '{path}' is there already; choose another name.")
    for path, template in templates.items():
        text = files("runner.commands").joinpath("templates", template).read_text(encoding="utf-8")
        for key, word in words.items():
            text = text.replace(f"@{key}@", word)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
        print(path)
