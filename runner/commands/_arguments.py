"""The command line taken apart: command, flags, and settings in Hydra's `key=value` form."""

from __future__ import annotations

import typing
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner import commands
from runner.errors import ConfigError, nearest

FLAGS = {
    "-h": "help", "--help": "help", "-m": "multirun", "--multirun": "multirun", "--config": "config",
    "--version": "version", "--traceback": "traceback",
}  # fmt: skip
CONFIG_DIR = "config-dir"
TRUTHS = ("true", "false", "yes", "no", "on", "off", "1", "0")


@dataclass(frozen=True)
class Arguments:
    """A command's name, the flags that were set, and what else was written, in order."""

    command: str
    named: bool  # whether the command was written or is the default
    flags: frozenset[str]
    rest: tuple[str, ...]


def split(argv: Sequence[str]) -> Arguments:
    """Take the command and the flags out of the arguments.

    Raises:
        ConfigError: If the first word is no command.
    """
    flags = frozenset(FLAGS[a] for a in argv if a in FLAGS)
    words = [a for a in argv if a not in FLAGS]
    names = commands.names()
    leading = []
    for word in words[:2]:
        if word.startswith(("-", "~", "+")) or "=" in word:
            break
        leading.append(word)
    for length in (2, 1):
        name = " ".join(leading[:length])
        if len(leading) >= length and name in names:
            return Arguments(name, True, flags, tuple(words[length:]))
    if leading and not (leading == words and "help" in flags and part_of(leading[0])):
        below = part_of(leading[0])
        if below:
            raise ConfigError(f"runner {leading[0]}: needs one of its commands. Valid: {', '.join(below)}.")
        raise ConfigError(f"runner: no command '{leading[0]}'. {nearest(leading[0], names)}")
    return Arguments(leading[0] if leading else commands.DEFAULT, bool(leading), flags, tuple(words[len(leading) :]))


def part_of(word: str) -> tuple[str, ...]:
    """Return the commands of two words that begin with this one."""
    return tuple(name for name in commands.names() if name.startswith(word + " "))


def overrides(name: str, command: commands.Command[Any], rest: Sequence[str]) -> list[str]:
    """Return the settings in Hydra's form: bare words go to the command's positional key, `--key v` is `key=v`.

    Raises:
        ConfigError: If a word is neither a setting nor wanted, or an option lacks its value.
    """
    found, bare = [], []
    words, switches = list(rest), switches_of(command)
    while words:
        word = words.pop(0)
        if word.startswith("--"):
            key, equals, value = word[2:].partition("=")
            if key == CONFIG_DIR:
                found.append(_searched(value if equals else words.pop(0) if words else ""))
                continue
            if not equals:
                if key.replace("-", "_") in switches and not (words and words[0].lower() in TRUTHS):
                    value = "true"
                elif not words:
                    raise ConfigError(f"{word}: needs a value, as in {word} VALUE or {key}=VALUE.")
                else:
                    value = words.pop(0)
            found.append(f"{key.replace('-', '_')}={quoted(value)}")
        elif word.startswith("-"):
            raise ConfigError(f"runner {name}: no option '{word}'. {nearest(word, FLAGS)}")
        elif word.startswith("="):
            raise ConfigError(f"'{word}': a key is missing before '='.")
        elif "=" in word or word.startswith("~"):
            found.append(word)
        else:
            bare.append(word)
    if not bare:
        return found
    key = command.positional
    if key is None:
        raise ConfigError(f"runner {name}: '{bare[0]}' is no setting; settings are written key=value.")
    if takes_many(command):
        return [f"{key}=[{','.join(map(quoted, bare))}]", *found]
    if len(bare) > 1:
        raise ConfigError(f"{key}: takes one value, got {', '.join(map(repr, bare))}.")
    return [f"{key}={quoted(bare[0])}", *found]


def _searched(folder: str) -> str:
    """Return the setting by which a folder of configs is searched beside `conf/`.

    Raises:
        ConfigError: If there is no such folder.
    """
    path = Path(folder).expanduser().absolute()
    if not folder or not path.is_dir():
        raise ConfigError(f"--{CONFIG_DIR}: needs a folder of configs as conf/ is one, got '{folder}'.")
    return f"hydra.searchpath=[{quoted(f'file://{path}')}]"


def takes_many(command: commands.Command[Any]) -> bool:
    """Tell whether the positional key of a command is a list."""
    hints = typing.get_type_hints(command.config)
    return typing.get_origin(hints.get(command.positional or "")) in (tuple, list)


def switches_of(command: commands.Command[Any]) -> set[str]:
    """Return the keys of a command that are true or false."""
    return {name for name, hint in typing.get_type_hints(command.config).items() if hint is bool}


def quoted(text: str) -> str:
    """Return text as Hydra's grammar takes it literally; null, numbers and true or false stay what they are."""
    plain = all(c.isalnum() or c in "_-./" for c in text) and text
    return text if plain else "'" + text.replace("\\'", "\\\\'").replace("'", "\\'") + "'"


def take(key: str, settings: Sequence[str]) -> tuple[str | None, list[str]]:
    """Return the last value given to a key, without Hydra's quotes, and the settings without it."""
    values = [s.partition("=")[2] for s in settings if s.partition("=")[0] == key]
    rest = [s for s in settings if s.partition("=")[0] != key]
    if not values or values[-1] in ("", "null"):
        return None, rest
    value = values[-1]
    if len(value) >= 2 and value[0] == value[-1] and value[0] in "'\"":
        value = value[1:-1].replace("\\" + value[0], value[0])
    return value, rest
