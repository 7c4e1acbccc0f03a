"""Make a case of somebody's log: signals, units, clocks and episodes as a map says, ready for `gap` and `diagnose`.

`runner import LOG model=arm.xml` reads a log, says what it understood, and proposes a map: which signal is which
command or channel of the MJCF, in which unit, by which clock. With the map, edited where it was left open,

    runner import LOG --map map.yaml model=arm.xml out=CASE

writes the case in model form: `recording.parquet`, `nominal.yaml`, the MJCF with its files, and `import.yaml` with how
the clocks ran and what was done. Several files, or a folder of them, are episodes one by one.

Formats: CSV and TSV (also of PlotJuggler), Parquet, MCAP (ROS 2, protobuf, JSON), rerun's .rrd, LeRobot data sets of
version 2 and 3, .npz; with the extra `runner[import]` also bags of ROS 1 and 2 (.bag, .db3) and HDF5. docs/importing.md
shows every key of a map.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from runner.commands import Command, Job
from runner.commands._print import print_table
from runner.effects.wording import counted
from runner.errors import ConfigError, check_range
from runner.importing.build import Built, build
from runner.importing.case import check_out, write_case
from runner.importing.clocks import ClockReport
from runner.importing.map_file import FILE
from runner.importing.readers import read_log
from runner.importing.record import RECORD
from runner.importing.signals import ReadOptions
from runner.importing.target import target_of
from runner.progress import waiting
from runner.recording.data import WARNING, introduced
from runner.storage.writing import write_text
from runner.systems.case import open_case

NEVER = {"twice": "0.0%", "unordered": "0"}  # what columns of the table of clocks hold where it did not happen


@dataclass(frozen=True)
class ImportConfig:
    """`logs` are files or folders, `model` is the MJCF, or what is believed of a box; the case goes to `out`.

    Without `map` one is proposed, and written to `propose`. `rate_hz` is for logs without any time; a map says it
    itself.
    """

    logs: tuple[Path, ...]
    model: Path
    map: Path | None = None
    out: Path | None = None
    propose: Path = Path(FILE)
    rate_hz: float | None = None

    def __post_init__(self) -> None:
        if not self.logs:
            raise ConfigError("logs: at least one file or folder is needed.")
        if self.rate_hz is not None:
            check_range("rate_hz", self.rate_hz, 0.0, 1e6, unit="Hz", lower_open=True)


def main(config: ImportConfig, job: Job) -> None:
    """Propose a map, or make the case."""
    console = Console()
    if not config.model.is_file():
        raise ConfigError(f"model: no file '{config.model}'.")
    if config.map is None:
        _propose(config, console)
    else:
        _import(config, config.map, console)


def _propose(config: ImportConfig, console: Console) -> None:
    """Read the log, say what it seems to be, and write a map to be edited."""
    target = target_of(config.model)
    with waiting("Reading the log"):
        log = read_log(config.logs, ReadOptions(rate_hz=config.rate_hz))
    if config.propose.exists():
        raise ConfigError(
            f"propose: '{config.propose}' is there already: if it is of this log, go on with map={config.propose}; "
            f"else name another, as in propose={config.logs[0].stem}_map.yaml."
        )
    with waiting("Telling signals apart"):
        proposal = target.propose(log, config.rate_hz)
    heading, rows = ("signal", "is", "unit", "why"), proposal.table
    held = [counted(len(log.parts[0].signals), "signal")]
    if len(log.parts) > 1:
        held.append(counted(len(log.parts), "part"))
    if rows:
        print_table(console, f"{log.format}: {', '.join(held)}", (heading, rows))
    else:
        _say(console, f"{log.format}: {', '.join(held)}, of which none was recognised.")
    for line in (*log.notes, *proposal.notes):
        _say(console, introduced(line))
    for line in proposal.missing:
        _say(console, f"Missing: {line}.")
    write_text(config.propose, proposal.text)
    logs = " ".join(map(str, config.logs))
    out = config.out if config.out is not None else "CASE"
    following = "Fill in what is missing, then:" if proposal.missing else "Look through it, then:"
    _say(console, f"Wrote {config.propose}. {following}")
    _say_whole(console, f"  runner import {logs} --map {config.propose} model={config.model} out={out}")


def _built(config: ImportConfig, map_file: Path) -> Built:
    """Return the case that the map makes of the log."""
    wanted, planned = target_of(config.model).plan(map_file)
    if config.rate_hz is not None:
        raise ConfigError(f"rate_hz: stands in the map, as `log: {{rate_hz: {config.rate_hz:g}}}` in {map_file}.")
    log = read_log(config.logs, ReadOptions(decimal=wanted.log.decimal, rate_hz=wanted.log.rate_hz))
    return build(log, map_file, wanted, planned)


def _import(config: ImportConfig, map_file: Path, console: Console) -> None:
    """Write the case, and say how its clocks ran and what was done."""
    if config.out is None:
        raise ConfigError("out: a folder for the case is needed, as in out=CASE.")
    check_out(config.out, config.logs)
    with waiting("Making the case"):
        built = _built(config, map_file)
    with waiting("Checking it against the model"):
        read = write_case(built, config.out, model=config.model, log=config.logs, map_file=map_file)
        misread = [f"{WARNING}{said}" for said in open_case(config.out).misread()]
    clocks = _clocks(built.clocks)
    print_table(console, "Clocks", clocks, right=range(2, len(clocks[0])))
    conversions = [
        (e.column, e.formula, f"{e.unit or '-'}" + (f" -> {e.si_unit}" if e.unit != e.si_unit and e.si_unit else ""))
        for e in built.plan.entries
    ]
    print_table(console, "Columns", (("column", "signal", "unit"), conversions))
    for note in (*built.notes, *read, *misread):
        _say(console, introduced(note))
    episodes = counted(len(built.table["episode"].unique()), "episode")
    _say(console, f"{episodes}, {counted(len(built.table), 'row')}: {config.out}")
    if len(set(built.sources.values())) > 1:
        (first, *_, last) = built.sources.items()
        rest = f"; the others stand in {RECORD}" if len(built.sources) > 2 else ""
        _say(console, f"Episode {first[0]} is {first[1]}, {last[0]} is {last[1]}{rest}.")
    _say_whole(console, f"  runner gap {config.out}")


def _say(console: Console, sentence: str) -> None:
    """Print a sentence, broken where the terminal ends."""
    console.print(sentence, highlight=False, markup=False)


def _say_whole(console: Console, command: str) -> None:
    """Print a command in one line, however long, so that it can be copied."""
    console.print(command, highlight=False, markup=False, soft_wrap=True)


def _clocks(reports: tuple[ClockReport, ...]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    heading = ("stream", "clock", "samples", "Hz", "jitter ms (95 %)", "gap s", "twice", "unordered")
    rows: list[tuple[str, ...]] = [
        (
            r.stream, r.clock, str(r.samples), f"{r.rate_hz:.5g}", f"{r.jitter_ms:.3g}", f"{r.longest_gap_s:.3g}",
            f"{r.duplicates:.1%}", str(r.out_of_order),
        )
        for r in reports
    ]  # fmt: skip
    # what never happened takes room that a name needs
    shown = [i for i, name in enumerate(heading) if name not in NEVER or any(row[i] != NEVER[name] for row in rows)]
    return tuple(heading[i] for i in shown), [tuple(row[i] for i in shown) for row in rows]


COMMAND = Command(config=ImportConfig, main=main, positional="logs")
