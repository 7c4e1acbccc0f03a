"""Show what an effect is: its law, its parameters with priors, what it is confounded with, how to mend and check it.

`runner show backlash` says of every variant what differs, which numbers are fitted, with what prior standard deviation
and within what bounds, what such recordings can't tell from it, what to change in a simulator, and how to look for it
by hand. `runner show NAME` of forces, an estimator or an experiment prints its file in `conf/`. `runner list` names
them all.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from runner.commands import Command, Job
from runner.commands._catalogue import GROUPS, files, names
from runner.commands._compose import config_dir
from runner.commands._described import BOX, Described, described
from runner.commands._print import print_table
from runner.effects.wording import number
from runner.errors import ConfigError, nearest


@dataclass(frozen=True)
class ShowConfig:
    """`name` is one that `runner list` has, or as a verdict has it: `backlash[elbow]`."""

    name: str


def main(config: ShowConfig, job: Job) -> None:
    """Print it."""
    name, console = config.name.partition("[")[0], Console()
    variants = described(name)
    if "[" in config.name:  # as a verdict of a mechanism has it: a box has nothing to choose
        variants = [v for v in variants if v.target] or variants
    for variant in variants:
        _print(variant, console)
    found = [file for kind in GROUPS for file in files(kind, job.config_dirs) if file.stem == name]
    for file in found:
        group = file.parent.name
        console.print(Text(f"{group}={name}: {_place(file)}", style="bold"))
        console.print(Padding(Text(file.read_text(encoding="utf-8").rstrip()), (0, 0, 1, 2)))
    if not variants and not found:
        near = nearest(name, names(job.config_dirs), listed_by="runner list effects")
        raise ConfigError(f"name: nothing is called '{name}'. {near}")


def _place(file: Path) -> str:
    """Return where a file of settings is: within `conf/`, or all of its path."""
    return f"conf/{file.relative_to(config_dir())}" if file.is_relative_to(config_dir()) else str(file)


def _print(of: Described, console: Console) -> None:
    effect, phrase = of.effect, of.phrase
    where = "a box" if of.system == BOX else f"{'an' if of.target.startswith('a') else 'a'} {of.target or 'mechanism'}"
    console.print(Text(f"{of.named}, of {where}: {effect.label}", style="bold"))
    _section(console, "What differs", inspect.getdoc(effect) or "")
    console.print(Padding(Text("Parameters as they are fitted", style="italic"), (0, 0, 0, 2)))
    rows = [(p.name, p.unit, *(number(v) for v in (p.scale, p.lower, p.upper))) for p in of.parameters]
    print_table(console, "", (("parameter", "unit", "prior s.d.", "from", "to"), rows), right=(2, 3, 4))
    console.print(
        Padding(Text(f"These are for {of.example}; the prior's mean is that the effect is absent."), (0, 0, 1, 2))
    )
    for other in effect.confounded:
        _section(console, f"Confounded with {other.name}", f"{other.why[:1].upper()}{other.why[1:]}. {other.advice}")
    if not effect.confounded:
        _section(
            console,
            "Confounded with",
            "No effect in every recording. What yours does not tell from it, its diagnosis says.",
        )
    amount = f" ({phrase.amount})" if phrase.amount else ""
    _section(console, "What to change, for example" + amount, phrase.remedy)
    if phrase.check:
        _section(console, "How to check by hand", phrase.check)
    _section(console, "Source", effect.__module__)


def _section(console: Console, title: str, text: str) -> None:
    console.print(Padding(Text(title, style="italic"), (0, 0, 0, 2)))
    for paragraph in text.split("\n\n"):
        console.print(Padding(Text(" ".join(paragraph.split())), (0, 0, 0, 4)))
    console.print()


COMMAND = Command(config=ShowConfig, main=main, positional="name")
