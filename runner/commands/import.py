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
from runner.errors import ConfigError, check_range
from runner.importing.box import SUFFIXES, believed, plan_box
from runner.importing.build import Built, build
from runner.importing.case import check_out, model_name, write_case
from runner.importing.clocks import ClockReport
from runner.importing.entries import plan
from runner.importing.map_file import FILE, BoxMap, Map, read_map
from runner.importing.propose import Proposal, propose, propose_box
from runner.importing.readers import read_log
from runner.importing.signals import Log, ReadOptions
from runner.recording.model_form_mjcf import read_mjcf
from runner.storage.writing import write_text

UNKNOWN_RATE_HZ = 1.0  # until the clock of the log has told; nothing of a proposal rests on it


@dataclass(frozen=True)
class ImportConfig:
    """Which log, by which map, with which MJCF, to which folder.

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
    if config.propose.exists():
        raise ConfigError(
            f"propose: '{config.propose}' is there already; go on with map={config.propose}, or name another."
        )
    proposal, log = _proposal(config)
    heading, rows = ("signal", "is", "unit", "why"), proposal.table
    signals = len(log.parts[0].signals)
    print_table(console, f"{log.format}: {signals} signals, {len(log.parts)} part(s)", (heading, rows))
    for line in (*log.notes, *proposal.notes):
        console.print(f"Note: {line}.", highlight=False, markup=False, soft_wrap=True)
    for line in proposal.missing:
        console.print(f"Missing: {line}.", highlight=False, markup=False, soft_wrap=True)
    write_text(config.propose, proposal.text)
    logs = " ".join(map(str, config.logs))
    out = config.out if config.out is not None else "CASE"
    command = f"runner import {logs} --map {config.propose} model={config.model} out={out}"
    first = f"Wrote {config.propose}. " + (
        "Fill in what is missing, then:" if proposal.missing else "Look through it, then:"
    )
    console.print(first, highlight=False, markup=False, soft_wrap=True)
    console.print(f"  {command}", highlight=False, markup=False, soft_wrap=True)


def _proposal(config: ImportConfig) -> tuple[Proposal, Log]:
    options = ReadOptions(rate_hz=config.rate_hz)
    if config.model.suffix in SUFFIXES:
        nominal, _ = believed(config.model, UNKNOWN_RATE_HZ if config.rate_hz is None else config.rate_hz)
        log = read_log(config.logs, options)
        return propose_box(log, nominal, rate_hz=config.rate_hz), log
    model = read_mjcf(config.model).compile()
    log = read_log(config.logs, options)
    return propose(log, model, rate_hz=config.rate_hz), log


def _built(config: ImportConfig, map_file: Path) -> Built:
    """Return the case that the map makes of the log, of a mechanism or of a box."""
    box = config.model.suffix in SUFFIXES
    wanted = read_map(map_file, BoxMap) if box else read_map(map_file, Map)
    if config.rate_hz is not None:
        raise ConfigError(f"rate_hz: stands in the map, as `log: {{rate_hz: {config.rate_hz:g}}}` in {map_file}.")
    model = None if box else read_mjcf(config.model).compile()
    if isinstance(wanted, BoxMap):
        planned = plan_box(map_file, wanted, config.model)
    else:
        assert model is not None
        planned = plan(map_file, wanted, model, model_name(config.model))
    log = read_log(config.logs, ReadOptions(decimal=wanted.log.decimal, rate_hz=wanted.log.rate_hz))
    return build(log, map_file, wanted, planned, model)


def _import(config: ImportConfig, map_file: Path, console: Console) -> None:
    """Write the case, and say how its clocks ran and what was done."""
    if config.out is None:
        raise ConfigError("out: a folder for the case is needed, as in out=CASE.")
    check_out(config.out)
    built = _built(config, map_file)
    read = write_case(built, config.out, model=config.model, log=config.logs, map_file=map_file)
    print_table(console, "Clocks", _clocks(built.clocks), right=(2, 3, 4, 5, 6, 7))
    conversions = [
        (e.column, e.signal, f"{e.unit or '-'}" + (f" -> {e.si_unit}" if e.unit != e.si_unit and e.si_unit else ""))
        for e in built.plan.entries
    ]
    print_table(console, "Columns", (("column", "signal", "unit"), conversions))
    for note in (*built.notes, *read):
        console.print(f"Note: {note}.", highlight=False, markup=False, soft_wrap=True)
    episodes = built.table["episode"].nunique()
    console.print(f"{episodes} episodes, {len(built.table)} rows: {config.out}", highlight=False, soft_wrap=True)
    console.print(f"  runner gap {config.out}", highlight=False, soft_wrap=True)


def _clocks(reports: tuple[ClockReport, ...]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    heading = ("stream", "clock", "samples", "Hz", "jitter ms", "gap s", "twice", "unordered")
    rows = [
        (
            r.stream, r.clock, str(r.samples), f"{r.rate_hz:.5g}", f"{r.jitter_ms:.3g}", f"{r.longest_gap_s:.3g}",
            f"{r.duplicates:.1%}", str(r.out_of_order),
        )
        for r in reports
    ]  # fmt: skip
    return heading, rows


COMMAND = Command(config=ImportConfig, main=main, positional="logs")
