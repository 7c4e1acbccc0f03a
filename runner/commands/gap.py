"""Measure the gap between a recording and the model that its owner believes in, channel by channel.

`runner gap DIR` reads a case, or every case below a folder, replays the recorded commands through the nominal model,
and prints the RMS error of each channel, in physical units and in multiples of the noise: over windows of each
horizon, begun at regular times, and over whole episodes. `model=PATH` takes the corrected model that a diagnosis
wrote instead; of a single case it is then said, too, what the nominal one misses of whole episodes. The results
folder holds `gap.parquet`, and `gap_episodes.parquet` with the whole episodes one by one.

It is printed from start states that are fitted to each window, 1 noise for a perfect model. The tables have it from
start states as they were measured, too: those carry noise and what smoothing makes of jumps, which spread. A noise
that its owner does not know is estimated, and marked with ~.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from runner.api.case import read
from runner.api.corrected import Corrected
from runner.api.gap import gap
from runner.api.tables import GAP
from runner.commands import Command, Job
from runner.diagnosis.corrected import corrected_file
from runner.effects.wording import listed, number, small_unit
from runner.errors import ConfigError, check_range
from runner.progress import progress, waiting
from runner.recording import find_cases
from runner.recording.case import content_hash
from runner.recording.data import WARNING, introduced, warnings
from runner.settings import SETTINGS
from runner.simulate.gap import HORIZONS_S, WHOLE_EPISODE, Gap
from runner.storage.provenance import digest, files_digest
from runner.storage.writing import write_parquet
from runner.systems.base import AbstractSystem
from runner.systems.recorded import Recorded, in_parts

EPISODES_FILE = "gap_episodes.parquet"
GROWS = "growth of noise"
LEGEND = (
    (GROWS, "what one noise of where a window begins grows to; above {most:g}, what is missed says little"),
    ("missed", "each window begins where that suits the model best; 1{made} is a perfect model"),
)
AMPLIFIED = "Over whole episodes one noise of where they begin grows to {} noises: what is missed there says little."
FEW_MAKE_MOST = 1.5  # times what the window in the middle misses: of noise alone all are nearly alike
AT_NOISE = 1.1  # times the noise: up to here, what a model that is right leaves too
# An estimate of the noise from the median size of third differences of N values is off by 1.8 / sqrt(N) of itself
# (standard error: 1.17 for a median of what is independent, times 1.5 as neighbours share values); twice that counts.
OFF_TWICE = 3.6


@dataclass(frozen=True)
class GapConfig:
    """`recording` is a case, or a folder of cases.

    `model` is what a diagnosis wrote (None: the nominal one). `horizons_s` are the lengths of windows, beside whole
    episodes."""

    recording: Path
    model: Path | None = None
    horizons_s: tuple[float, ...] = field(default=HORIZONS_S)

    def __post_init__(self) -> None:
        if not self.horizons_s:
            raise ConfigError("horizons_s: at least one horizon is needed, as in horizons_s=[0.1,0.5,1.0].")
        for i, horizon in enumerate(self.horizons_s):
            check_range(f"horizons_s[{i}]", horizon, 0.0, 3600.0, unit="s", lower_open=True)
        if len(set(self.horizons_s)) < len(self.horizons_s):
            raise ConfigError(f"horizons_s: each once only, got {list(self.horizons_s)!r}.")


def main(config: GapConfig, job: Job) -> None:
    """Measure, print and write the gap of each case."""
    folder = job.results
    # read them all before the first is simulated: a broken one is found at once
    with waiting("Reading"):
        cases = [read(path) for path in find_cases(config.recording)]
        systems = [case.system for case in cases]
        models = [None if config.model is None else Corrected.read(config.model, case) for case in cases]
    console = Console()
    # of one case the model as believed stands beside the corrected one; whole episodes are the smaller part of the time
    beside = len(cases) == 1 and config.model is not None
    total = sum(len(config.horizons_s) + beside + len(s.recording.episodes) * (1 + beside) for s in systems)
    tables, episodes = [], []
    with progress("Replaying", total=total, unit="steps", minutes=True) as advance:
        for case, model in zip(cases, models, strict=True):
            found = gap(case, model=model, horizons_s=config.horizons_s, advance=advance)
            tables.append(found.table.assign(case=str(case.path)))
            episodes.append(found.episodes.assign(case=str(case.path)))
            if len(cases) == 1:
                of = [h for h in config.horizons_s if f"{h:g} s" == found.told]
                believed = gap(case, horizons_s=of, advance=advance) if beside else None
                _print(case.system, found, console, config.model, believed)
    table = _case_first(pd.concat(tables, ignore_index=True))
    write_parquet(folder / GAP, table.assign(**job.provenance))
    write_parquet(folder / EPISODES_FILE, _case_first(pd.concat(episodes, ignore_index=True)).assign(**job.provenance))
    if len(systems) > 1:
        _print_many(table, console)
        for system in systems:
            for note in (*warnings(system.recording.notes), *(f"{WARNING}{said}" for said in system.misread())):
                console.print(Text(f"{system.recording.path.name}: {note}"))
    console.print(f"{folder / GAP}", highlight=False, soft_wrap=True)


def _case_first(table: pd.DataFrame) -> pd.DataFrame:
    return table.loc[:, ["case", *(c for c in table.columns if c != "case")]]


def _print(system: AbstractSystem, found: Gap, console: Console, corrected: Path | None, believed: Gap | None) -> None:
    """Print what the model misses: in a sentence, then in a table, then what the table's words mean."""
    recording = system.recording
    by = "" if corrected is None else f", with the corrected model of {corrected}"
    console.print(Text(f"{recording.path}{by}: {in_short(found, recording, found.told)}", style="bold"))
    if believed is not None:
        console.print(Text(f"As believed, without the correction: {in_short(believed, recording, found.told)}"))
    if found.told != WHOLE_EPISODE:
        console.print(Text(AMPLIFIED.format(number(found.growth[WHOLE_EPISODE]))))
    for note in (*recording.notes, *(f"{WARNING}{said}" for said in system.misread())):
        console.print(Text(introduced(note)))
    table = _table(system, found, " = ")
    if console.measure(table, options=console.options.update(max_width=1000)).maximum > console.width:
        table = _table(system, found, "=")  # narrower by what is not needed
    _print_whole(table, console)
    made = ", or what noise of the force makes," if system.has_noisy_drive else ""
    for term, meaning in LEGEND:
        said = meaning.format(most=SETTINGS.pieces.most_growth, made=made)
        console.print(Padding(Text.assemble((term, "italic"), f": {said}"), (0, 0, 0, 1)))
    if not found.table["stated"].to_numpy().all():
        said = (
            "~: not stated but estimated from how samples differ; what is in noises rests on it. A diagnosis estimates "
            "it anew, from what its best model leaves."
        )
        console.print(Padding(Text(said), (0, 0, 0, 1)))


def _table(system: AbstractSystem, found: Gap, equals: str) -> Table:
    """Return the gap of each channel from fitted starts, and what noise of a measured force makes of it."""
    horizons = list(dict.fromkeys(found.table["horizon"]))
    table = Table(
        title="RMS = in noises", title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False,
        collapse_padding=True,
    )  # fmt: skip
    table.add_column("channel", no_wrap=True)
    for name in ("noise", *("episodes" if h == WHOLE_EPISODE else h for h in horizons)):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_row(f"[italic]{GROWS}[/]", "", *(_noises(found.growth[h]) for h in horizons), end_section=True)
    at = {(r["starts"], r["channel"], r["horizon"]): r for r in found.table.to_dict("records")}
    # noise of a measured force is left by a perfect model too
    for by_force in (False, True) if system.has_noisy_drive else (False,):
        table.add_row(f"[italic]{'noise of the force' if by_force else 'missed'}[/]")
        for c, channel in enumerate(system.channels):
            unit, factor = small_unit(channel.unit)
            rows = [at["fitted", channel.name, horizon] for horizon in horizons]
            mark = "" if rows[0]["stated"] else "~"
            if by_force:
                # where any difference grows as large as the motion, what is made by one is no measure of another
                told = [found.growth[h] <= SETTINGS.pieces.most_growth for h in horizons]
                cells = [_noises(r["noises_expected"]) if t else "-" for r, t in zip(rows, told, strict=True)]
            else:
                cells = [f"{number(row['rms'] * factor)}{equals}{_noises(row['noises'])}" for row in rows]
            cells = ["-" if math.isnan(row["rms"]) else cell for row, cell in zip(rows, cells, strict=True)]
            noise = f"{mark}{number(rows[0]['noise'] * factor)}"
            last = c == len(system.channels) - 1
            table.add_row(Text(f" {channel.name}, {unit}"), noise, *cells, end_section=last)
    return table


def _noises(value: float) -> str:
    """Return a multiple of the noise with three digits, of large ones only how large they are."""
    return number(value) if value < 1e5 else f"{value:.0e}"


def _print_whole(table: Table, console: Console) -> None:
    """Print a table as wide as it is: in a narrow terminal a number on the next line is better than none."""
    needed = console.measure(table, options=console.options.update(max_width=1000)).maximum
    Console(width=max(console.width, needed)).print(table, soft_wrap=True)


def _over(row: Mapping[str, Any]) -> bool:
    """Whether a model misses more than the noise, by more than an estimate of the noise may be off."""
    off = 0.0 if row["stated"] else OFF_TWICE / math.sqrt(max(row["values"], 1.0))
    return bool(row["noises"] > (AT_NOISE + off) * row["noises_expected"])


def in_short(found: Gap, recording: Recorded, horizon: str) -> str:
    """Say in a sentence which channels stand out over a horizon."""
    of = (found.table["starts"] == "fitted") & (found.table["horizon"] == horizon) & found.table["noises"].notna()
    rows = found.table.loc[of].to_dict("records")
    over = sorted(filter(_over, rows), key=lambda r: -r["noises"])
    count = len(recording.episodes)
    where = "over the whole episode" if count == 1 else f"over all {count} episodes"
    if in_parts(recording):
        where = f"over the {count} parts of the one episode"
    if horizon != WHOLE_EPISODE:
        where = f"in windows of {horizon}"
    made = max((r["noises_expected"] for r in rows), default=1.0)
    driven = made >= AT_NOISE
    alone = f"; noise of the measured force alone makes up to {number(made)}" if driven else ""
    if not over and driven:
        most = number(max((r["noises"] for r in rows), default=1.0))
        made_by = "the noise and what that of the measured force makes"
        return f"{where} the model misses no more than {made_by}: {most} times the noise at most."
    if not over:
        return f"{where} the model misses nothing but the noise."
    named = [f"{r['channel']} by {number(r['noises'])} times the noise{_in_most(r)}" for r in over]
    within = [r["noises"] for r in rows if not _over(r)]
    others = f"up to {number(max(within))} times" if within and max(within) > AT_NOISE else "no more than it"
    rest = f", the others by {others}" if within else ""
    return f"{where} the model misses {listed(named)}{rest}{alone}."


def _in_most(row: Mapping[str, Any]) -> str:
    """Say what half of the windows miss, where few of them make most of what all do."""
    few = row["windows"] > 1 and row["noises"] > FEW_MAKE_MOST * row["noises_median"]
    half = "episodes" if row["horizon"] == WHOLE_EPISODE else "windows"
    return f" ({number(row['noises_median'], 2)} at most in half of the {half})" if few else ""


def _print_many(rows: pd.DataFrame, console: Console) -> None:
    horizons = list(dict.fromkeys(rows["horizon"]))
    table = Table(title="Gap in noises, fitted starts: worst channel", title_justify="left")
    table.add_column("case")
    for horizon in horizons:
        table.add_column("whole episodes" if horizon == WHOLE_EPISODE else horizon, justify="right")
    fitted = [r for r in rows.to_dict("records") if r["starts"] == "fitted"]
    for case in dict.fromkeys(r["case"] for r in fitted):
        cells = []
        for horizon in horizons:
            at = [r for r in fitted if r["case"] == case and r["horizon"] == horizon]
            worst = max(at, key=lambda r: r["noises"])
            cells.append(f"{'' if worst['stated'] else '~'}{worst['noises']:.2f} {worst['channel']}")
        table.add_row(Path(str(case)).name, *cells)
    _print_whole(table, console)
    if not rows["stated"].to_numpy().all():
        console.print("~: noise estimated.", highlight=False)


def inputs(config: GapConfig) -> dict[str, str]:
    """Return hashes of the recordings, and of the model."""
    cases = find_cases(config.recording)
    hashes = {"recording": digest([content_hash(c) for c in cases]) if len(cases) > 1 else content_hash(cases[0])}
    if config.model is not None:
        hashes["model"] = files_digest([("", corrected_file(config.model))])
    return hashes


COMMAND = Command(
    config=GapConfig,
    main=main,
    keeps="gap",
    positional="recording",
    inputs=inputs,
    aside=("recording", "model"),
    again="Begin again with",
)
