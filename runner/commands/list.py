"""List what there is: effects, forces, estimators, experiments, systems, formats of logs, numbers of a diagnosis.

`runner list effects` names each with what it is; `runner show NAME` says all of one.
"""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console

from runner.commands import Command, Job
from runner.commands._catalogue import Kind, listed
from runner.commands._print import print_table

USES = {
    Kind.effects: "`runner show NAME` says more. Of a box: `runner run 'effect=[NAME]'` plants it.",
    Kind.forces: "`runner run forces=NAME`; `runner show NAME` says more.",
    Kind.estimators: "`runner run estimator=NAME`; `runner show NAME` says more.",
    Kind.experiments: "`runner run experiment=NAME`; `runner show NAME` says more.",
    Kind.systems: "A folder whose `nominal.yaml` names a model is a mechanism, every other one a box.",
    Kind.formats: "`runner import LOG model=MJCF`; docs/importing.md says more.",
    Kind.numbers: "They are in runner/settings and runner/systems/mechanism/settings.py, and no command changes them.",
}


@dataclass(frozen=True)
class ListConfig:
    """`what` is to be listed."""

    what: Kind


def main(config: ListConfig, job: Job) -> None:
    """Print the names."""
    console = Console()
    print_table(console, config.what.value, listed(config.what, job.config_dirs))
    console.print(USES[config.what], highlight=False, markup=False)


COMMAND = Command(config=ListConfig, main=main, positional="what")
