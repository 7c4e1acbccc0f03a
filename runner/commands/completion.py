"""Print what lets bash or zsh complete commands, settings and names.

    runner completion bash > ~/.local/share/bash-completion/completions/runner
    runner completion zsh > ~/.runner-completion      and in ~/.zshrc, after compinit: source ~/.runner-completion

It is a file, because making it takes seconds. Files and folders are completed where a command takes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from hydra.core.global_hydra import GlobalHydra

from runner import commands
from runner.commands import Command, Job
from runner.commands._catalogue import Kind
from runner.commands._catalogue import names as things
from runner.commands._compose import composer
from runner.commands._help import settings_of

OPTIONS = ("--help", "--multirun", "--config-dir", "--config", "--traceback", "--version")
BASH = """\
_runner() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" first="${{COMP_WORDS[1]}}" words key="" value="" whole="" files
  local two="$first ${{COMP_WORDS[2]}}"
  if [[ $COMP_CWORD -gt 2 && " {pairs} " == *" $two "* ]]; then first="$two"; fi
  # bash parts words at "=", zsh does not
  if [[ "$word" == "=" ]]; then key="${{COMP_WORDS[COMP_CWORD-1]}}"
  elif [[ "${{COMP_WORDS[COMP_CWORD-1]}}" == "=" ]]; then key="${{COMP_WORDS[COMP_CWORD-2]}}" value="$word"
  elif [[ "$word" == *=* ]]; then key="${{word%%=*}}" value="${{word#*=}}" whole="$key="; fi
  if [[ -n "$key" ]]; then
    case "$key" in
{values}
      *) words="";;
    esac
    COMPREPLY=($(compgen -W "$words" -P "$whole" -- "$value"))
    if [[ ${{#COMPREPLY[@]}} -eq 0 ]]; then
      COMPREPLY=($(compgen -f -P "$whole" -- "$value"))
      compopt -o filenames
    fi
    return
  fi
  if [[ $COMP_CWORD -eq 1 ]]; then words="{commands} {run}"; else
    case "$first" in
{cases}
      *) words="{run}";;
    esac
  fi
  COMPREPLY=($(compgen -W "$words {options}" -- "$word")) files=($(compgen -f -- "$word"))
  # as names of files settings would have their "=" escaped
  [[ ${{#COMPREPLY[@]}} -eq 0 ]] && compopt -o filenames
  COMPREPLY+=("${{files[@]}}")
  [[ ${{#COMPREPLY[@]}} -eq 1 && "${{COMPREPLY[0]}}" == *= ]] && compopt -o nospace
}}
complete -F _runner runner
"""


class Shell(Enum):
    """What completes."""

    bash = "bash"
    zsh = "zsh"


@dataclass(frozen=True)
class CompletionConfig:
    """`shell` is the one that completes."""

    shell: Shell


def main(config: CompletionConfig, job: Job) -> None:
    """Print the script."""
    print(("autoload -U +X bashcompinit && bashcompinit\n" if config.shell is Shell.zsh else "") + script(), end="")


def script() -> str:
    """Return the script; zsh reads that of bash by its `bashcompinit`."""
    names = commands.names()
    words, values = {}, dict[str, tuple[str, ...]]()
    for name in names:
        words[name], groups = _words(name)
        values |= groups
    for name in names:  # `blind` is followed by `make`, `run`, `score`
        first, _, second = name.partition(" ")
        if second:
            words[first] = f"{words.get(first, '')} {second}".strip()
    cases = "\n".join(f'      "{name}") words="{text}";;' for name, text in sorted(words.items()))
    leading = " ".join(dict.fromkeys(name.split()[0] for name in names))
    return BASH.format(
        pairs=" ".join(n for n in names if " " in n),
        commands=leading,
        cases=cases,
        values="\n".join(f'      "{group}") words="{" ".join(some)}";;' for group, some in sorted(values.items())),
        run=words[commands.DEFAULT],
        options=" ".join(OPTIONS),
    )


def _words(name: str) -> tuple[str, dict[str, tuple[str, ...]]]:
    """Return what may follow a command, settings and the names that it takes, and what its groups may be."""
    command = commands.load(name)
    GlobalHydra.instance().clear()  # this command's own settings are read already
    with composer(name, command) as hydra:
        groups = hydra.groups()
        keys = [*groups, *(key for key, _, _ in settings_of(hydra.compose([])))]
    if command.keeps is not None:
        keys.append("out")
    named = {"show": things(), "list": [kind.name for kind in Kind], "completion": [shell.name for shell in Shell]}
    return " ".join([*named.get(name, ()), *(f"{key}=" for key in dict.fromkeys(keys))]), groups


COMMAND = Command(config=CompletionConfig, main=main, positional="shell")
