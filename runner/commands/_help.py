"""The texts of `--help`: all commands, or one command with its settings and the options of its config groups."""

from __future__ import annotations

import re
import textwrap
from typing import Any

from omegaconf import DictConfig, OmegaConf

from runner import commands
from runner.commands._arguments import part_of, takes_many
from runner.commands._compose import composer
from runner.commands._explain import describe, node_at
from runner.config import TARGET

WIDTH = 80
OPTIONS = """Options:
  --KEY VALUE      the same as KEY=VALUE, for every setting
  -h, --help       this text; after a command, its settings and what they may be
  -m, --multirun   sweep: every combination of key=a,b,c or 'key=range(0,5)', each a run of its own
  --config-dir D   look in folder D, laid out as conf/, too: forces=NAME, experiment=NAME, ...
  --config         print the config that the settings make, and stop
  --traceback      show where in the program an error arose
  --version        versions of runner and of what it stands on"""


def overview() -> str:
    """Return the text of `runner --help`."""
    width = max(map(len, commands.names())) + 2
    lines = [f"  {name:{width}} {commands.description(name).splitlines()[0]}" for name in commands.names()]
    return _folded(
        "Usage: runner [COMMAND] [key=value ...] [-m]        also: python -m runner\n\n"
        "Headless experiments on simulated and recorded objects, and a diagnosis of the gap between the two.\n\n"
        f"Commands ('{commands.DEFAULT}' if none is named; runner COMMAND --help says more):\n"
        + "\n".join(lines)
        + f"\n\n{OPTIONS}\n\nout=PATH names the folder for results (default: results/NAME/TIME/)."
    )


def of_command(name: str) -> str:
    """Return the text of `runner COMMAND --help`."""
    if name not in commands.names():
        below = part_of(name)
        return "\n".join(f"  runner {n:20} {commands.description(n).splitlines()[0]}" for n in below)
    command = commands.load(name)
    many = "..." if takes_many(command) else ""
    bare = f" [{command.positional.upper()}{many}]" if command.positional else ""
    parts = [f"Usage: runner {name}{bare} [key=value ...]", _flowing(commands.description(name).strip())]
    with composer(name, command) as hydra:
        composed = hydra.compose([])
        groups = hydra.groups()
        choices = composed.hydra.runtime.choices
        chosen = {g: choices.get(g, []) for g in groups}
        if chosen:
            lines = [f"  {g}={'null' if c is None else c}".ljust(30) + ", ".join(groups[g]) for g, c in chosen.items()]
            parts.append("Config groups (choice now, then all options):\n" + "\n".join(lines))
        lines = [f"  {key}={value}".ljust(44) + kind for key, value, kind in settings_of(composed)]
    if lines:
        parts.append("Settings (value now, then what is allowed):\n" + "\n".join(lines))
    if command.keeps is not None:
        parts.append("out=PATH names the folder for results; resume=PATH goes on with a sweep that was stopped.")
    return _folded("\n\n".join([*parts, OPTIONS]))


def _flowing(text: str) -> str:
    """Return text with one line for each paragraph; what is indented stays as it is."""
    parts = (part if re.search(r"^\s", part, re.MULTILINE) else " ".join(part.split()) for part in text.split("\n\n"))
    return "\n\n".join(parts)


def _folded(text: str) -> str:
    """Fold what is wider than a terminal; of a list of two columns the second stays one."""
    lines = []
    for line in text.splitlines():
        indent = len(line) - len(line.lstrip())
        column = re.match(r"  \S.*?\s{2,}(?=\S)", line)
        below = " " * (min(len(column[0]), WIDTH // 2) if column else indent)
        lines += textwrap.wrap(line, WIDTH, subsequent_indent=below, break_on_hyphens=False) or [""]
    return "\n".join(lines)


def settings_of(config: DictConfig, prefix: str = "") -> list[tuple[str, str, str]]:
    """Return key, value and kind of every setting, in the schema's order."""
    found = []
    for name in config:
        if name in (TARGET, "hydra"):
            continue
        node = node_at(config, str(name))
        key = f"{prefix}{name}"
        if isinstance(node, DictConfig) and not node._is_none() and not node._is_missing() and len(node):
            found += settings_of(node, key + ".")
        elif node is not None:
            found.append((key, _text(node), describe(node)))
    return found


def _text(node: Any) -> str:
    if node._is_missing():
        return "(needed)"
    if OmegaConf.is_config(node):
        value = OmegaConf.to_container(node, resolve=False)
        return "null" if value is None else str(value).replace(" ", "")
    value = node._value()
    if isinstance(value, float):
        return f"{value:.6g}"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return str(getattr(value, "name", value))
