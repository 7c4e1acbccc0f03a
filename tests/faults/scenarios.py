"""What is made to fail: a command, what lies there before it, and what may lie there after it."""

from __future__ import annotations

import re
import shutil
from abc import ABC, abstractmethod
from pathlib import Path
from unittest.mock import patch

import pyarrow.parquet as pq

from runner.__main__ import main
from runner.api.tables import read_table
from runner.storage.reading import read_json
from runner.storage.yaml_text import read_yaml
from runner.teleop import tables

SHORT = ("forces.pushes=1", "forces.push_s=0.1", "forces.rest_s=0.1", "forces.lead_s=0.1")
TIMES = ["wall_s", "steps_per_s", "log_s", "host"]
PART = re.compile(r"\..*\.[0-9a-f]{8}(\..*)?")  # a file under its temporary name


class Scenario(ABC):
    """A command that writes. What a scenario alone needs is imported by it: a slice begins sooner.

    Args:
        folder: Where it writes; faults are counted below it.
        apart: Where it may keep what it needs.
    """

    def __init__(self, folder: Path, apart: Path) -> None:
        self.folder, self.apart = folder, apart

    def prepare(self) -> None:
        """Find what is to be written, if that takes long; called once. Writes nothing by Rerun, which can't fork."""

    def before(self) -> None:
        """Write what is there before; called once, in a process of its own."""

    @abstractmethod
    def act(self) -> int:
        """Do it, and return the exit code."""

    @abstractmethod
    def check(self, *, done: bool) -> None:
        """Assert that what is there is old or new; `done`: the command said that it went well."""


class Run(Scenario):
    """A run into a new folder, with frames, steps and `.rrd`."""

    def act(self) -> int:
        return main(["run", *SHORT, "log.frames=steps", f"out={self.folder / 'r'}"])

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        folder = self.folder / "r"
        if done or (folder / tables.SUMMARY).is_file():
            row = read_table(folder).iloc[0]
            assert row["status"] == "done"
            assert {"frames.parquet", "steps.parquet", "run.rrd"} <= {f.name for f in folder.iterdir()}
        elif (folder / "run.yaml").is_file():
            assert read_table(folder).iloc[0]["status"] in ("failed", "killed", "running")


class RunAgain(Run):
    """The same into a folder that holds the results of the same settings."""

    def before(self) -> None:
        assert self.act() == 0

    def check(self, *, done: bool) -> None:
        super().check(done=done)
        assert (self.folder / "r" / "run.yaml").is_file()


class Sweep(Scenario):
    """A sweep of three; what was noted before is not lost, and it resumes to the same table."""

    def act(self) -> int:
        return main(["run", "-m", "start.mass_kg=1,2,3", *SHORT, "log.rrd=off", f"out={self.folder / 's'}"])

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        folder = self.folder / "s"
        if not (folder / tables.SWEEP).is_file():
            assert not done
            return
        if not done:
            assert main(["run", f"resume={folder}"]) == 0
        table = read_table(folder)
        assert table["status"].tolist() == ["done"] * 3
        assert table["start.mass_kg"].tolist() == [1, 2, 3]
        assert all((folder / str(k) / "frames.parquet").is_file() for k in range(3))


class Table(Scenario):
    """A table over one that is there."""

    OLD = "the table of before\n" * 1000

    def before(self) -> None:
        assert main(["run", *SHORT, "log.rrd=off", f"out={self.apart / 'r'}"]) == 0
        (self.folder / "t.csv").write_text(self.OLD)
        assert main(["table", str(self.apart / "r"), f"out={self.apart / 'new.csv'}"]) == 0

    def act(self) -> int:
        return main(["table", str(self.apart / "r"), f"out={self.folder / 't.csv'}"])

    def check(self, *, done: bool) -> None:
        new = (self.apart / "new.csv").read_text()
        assert (self.folder / "t.csv").read_text() in ((new,) if done else (self.OLD, new))


class Case(Scenario):
    """A recording, as the API writes it."""

    def act(self) -> int:
        from runner.recording import write_case
        from tests.cases import made

        write_case(made(episodes=1, seconds=0.5)[0], self.folder / "c")
        return 0

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        if done:
            from runner.systems.case import open_case

            open_case(self.folder / "c")


class Diagnosis(Scenario):
    """What a diagnosis leaves, over what one of another recording left.

    It is found and its page drawn once, neither of which writes: each fault is that of writing it anew.
    """

    def prepare(self) -> None:
        from runner.recording import write_case
        from tests.cases import made

        for name, seed in (("old", 1), ("new", 2)):
            write_case(made(episodes=2, seconds=1.0, seed=seed)[0], self.apart / name)

    def before(self) -> None:
        from runner.diagnosis.pipeline import diagnose
        from runner.report.html import render
        from runner.systems.case import open_case
        from tests.faults.kept import keep

        for name in ("old", "new"):
            found = diagnose(open_case(self.apart / name), threads=1)
            keep((found, render(found)), self.apart / f"{name}.found")
        self._write("old")

    def _write(self, name: str) -> None:
        import runner.report.html
        from runner.api.case import read
        from runner.outputs.one import write_all
        from tests.faults.kept import kept

        belongs = {"recording_hash": read(self.apart / name).recording_hash}
        found, page = kept(self.apart / f"{name}.found")
        with patch.object(runner.report.html, "render", return_value=page):
            write_all(found, self.folder / "d", report=True, provenance=belongs)

    def act(self) -> int:
        self._write("new")
        return 0

    def check(self, *, done: bool) -> None:
        from runner.outputs.many import has_verdict

        whole(self.folder)
        old, new = (has_verdict(self.folder / "d", self.apart / name) for name in ("old", "new"))
        assert new or not done
        names = {f.name for f in (self.folder / "d").iterdir()}
        if old or new:
            assert {
                "closure.parquet",
                "report.html",
                "diagnosis.rrd",
                "where_gap.parquet",
                "corrected.yaml",
            } - names == set()


def whole(folder: Path) -> None:
    """Assert that every file below a folder is one, save for those under temporary names and lines of notes."""
    for file in folder.rglob("*"):
        if PART.fullmatch(file.name) or not file.is_file():
            continue
        if file.suffix == ".parquet":
            pq.read_table(file)
        elif file.suffix == ".rrd":
            from rerun.chunk import RrdReader  # not above: with it come threads, of which a fork keeps none

            assert list(RrdReader(file).stream())
        elif file.suffix == ".yaml":
            assert read_yaml(file) is not None
        elif file.suffix == ".json":
            read_json(file)
        elif file.suffix == ".html":
            assert file.read_text().rstrip().endswith("</html>")


def warm() -> None:
    """Import and compose what commands do, but for Rerun: each fault is a fork, which had to do so again."""
    import runner.api.case
    import runner.commands.table
    import runner.outputs.one
    import runner.report.html  # noqa: F401
    from runner.commands._execute import shown

    shown("run", [])


def reset(folder: Path, before: Path) -> None:
    """Put back what was there before."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(before, folder)


SCENARIOS: dict[str, type[Scenario]] = {
    "run": Run, "run_again": RunAgain, "sweep": Sweep, "table": Table, "case": Case, "diagnosis": Diagnosis,
}  # fmt: skip
