"""A blind diagnosis can't read the answers: behind the fence no file of theirs opens, and they change no byte."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cases import made

from runner.__main__ import main
from runner.blind.kernel_fence import Kept, landlock_version
from runner.blind.make import HASH_FILE
from runner.blind.run import PROVENANCE, blind_run, copy_cases, read_hash
from runner.commands import blind_run as command
from runner.diagnosis.verdict import ALL, FILE
from runner.errors import ResultError
from runner.outputs.many import diagnose_many
from runner.recording import write_case
from tests.in_place_of_a_diagnosis import killed

ANSWERS = "cases.answers.json"  # beside `cases`, as `runner blind make` names it
FENCED = """
import os, subprocess, sys, tempfile
from pathlib import Path
from runner.blind.fence import enter_fence
inside, secret = Path(sys.argv[1]), Path(sys.argv[2])
(inside / "way").symlink_to(secret)
enter_fence([inside])
(inside / "own.txt").write_text("mine")
assert (inside / "own.txt").read_text() == "mine"
import zipapp, numpy  # Python's and the environment's own files still open
for attempt in (
    lambda: secret.read_text(),
    lambda: open(secret, "rb"),
    lambda: os.open(secret, os.O_RDONLY),
    lambda: open(os.fsencode(secret)),
    lambda: (inside / "way").read_text(),
    lambda: open(inside / ".." / secret.name),
    lambda: open("/proc/self/root" + str(secret)),
    lambda: os.link(secret, inside / "copy"),
    lambda: os.rename(secret, inside / "copy"),
    lambda: subprocess.run(["cat", str(secret)]),
    lambda: os.system("cat " + str(secret)),
):
    try:
        attempt()
    except PermissionError as error:
        assert "blind" in str(error), error
    else:
        sys.exit("went through")
print("kept in")
"""


KEPT_BY_THE_KERNEL = """
import ctypes, os, sys
from multiprocessing.util import spawnv_passfds
from pathlib import Path
from runner.blind.kernel_fence import Kept, enter, in_force
from runner.blind.fence import PACKAGE, PYTHON
inside, secret, means = Path(sys.argv[1]), Path(sys.argv[2]), Kept[sys.argv[3]]
if enter([inside], [*PYTHON, PACKAGE], [means]) is not means:
    sys.exit("the kernel has none")
assert in_force() is means
opened = os.open(inside, os.O_RDONLY)
import pyarrow.fs  # libraries still load
(inside / "own.txt").write_text("mine")
assert (inside / "own.txt").read_text() == "mine"
libc, path = ctypes.CDLL(None, use_errno=True), os.fsencode(secret)

def returned(value):
    if value < 0:
        raise OSError(ctypes.get_errno(), "libc")
    return os.read(value, 9)

def ended(program, *words):
    if os.waitstatus_to_exitcode(os.waitpid(spawnv_passfds(program, [program, *words], []), 0)[1]):
        raise OSError("it could not")

for attempt in (
    lambda: secret.read_text(),
    lambda: os.open(secret.name, os.O_RDONLY, dir_fd=os.open("..", os.O_PATH, dir_fd=opened)),
    lambda: open(f"/proc/{os.getppid()}/root{secret}"),
    lambda: ended(b"/bin/cat", path),
    lambda: ended(os.fsencode(sys.executable), b"-c", b"open(%r)" % path),
    lambda: pyarrow.fs.LocalFileSystem().open_input_file(str(secret)),
    lambda: pyarrow.memory_map(str(secret)),
    lambda: returned(libc.open(path, os.O_RDONLY)),
    lambda: returned(libc.openat(libc.openat(opened, b"..", os.O_PATH), os.fsencode(secret.name), os.O_RDONLY)),
    lambda: returned(libc.truncate(path, 0)),
    lambda: returned(libc.rename(path, os.fsencode(inside / "copy"))),
    lambda: returned(libc.link(path, os.fsencode(inside / "copy"))),
):
    try:
        attempt()
    except OSError:
        continue
    sys.exit("went through")
print("kept in")
"""


@pytest.mark.parametrize("means", [Kept.landlock, Kept.namespace], ids=lambda kept: kept.name)
def test_the_kernel_keeps_in_what_no_hook_sees(tmp_path: Path, means: Kept) -> None:
    """From an open folder, by another program, by a library or by the system's own functions: no answer opens."""
    (tmp_path / "inside").mkdir()
    secret = tmp_path / "answers.json"
    secret.write_text("{}")
    words = [sys.executable, "-c", KEPT_BY_THE_KERNEL, str(tmp_path / "inside"), str(secret), means.name]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if "the kernel has none" in done.stderr:
        pytest.skip(f"no {means} for this process")
    assert done.stdout == "kept in\n", done.stderr
    assert secret.read_text() == "{}"


def test_the_fence_refuses_whatever_lies_outside(tmp_path: Path) -> None:
    """Reading the answers fails, by any name or way round; own files and Python's open as ever."""
    (tmp_path / "inside").mkdir()
    secret = tmp_path / "answers.json"
    secret.write_text("{}")
    words = [sys.executable, "-c", FENCED, str(tmp_path / "inside"), str(secret)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.stdout == "kept in\n", done.stderr
    assert secret.read_text() == "{}"


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One short case whose answers lie beside it, and their hash with it."""
    folder = tmp_path_factory.mktemp("blind") / "cases"
    write_case(made(episodes=2, seconds=1.0)[0], folder / "strong_mass")
    text = json.dumps({"strong_mass": {"effects": [], "accept": ["none"]}})
    (folder.parent / ANSWERS).write_text(text)
    (folder / HASH_FILE).write_text(hashlib.sha256(text.encode()).hexdigest() + "\n")
    return folder


def test_answers_change_no_byte_of_a_verdict(cases: Path, tmp_path: Path) -> None:
    """Right answers beside the cases, or false ones in their place and in the case: the same, byte for byte."""
    lie = json.dumps({"effects": [{"name": "tether", "severity": "strong"}], "accept": ["tether"]})
    verdicts = []
    for kind, name in (("right", "strong_mass"), ("falsified", "weak_tether")):
        place, results = tmp_path / kind / "cases", tmp_path / kind / "results"
        shutil.copytree(cases, place)
        results.mkdir()
        if kind == "right":
            shutil.copy(cases.parent / ANSWERS, place.parent)
        if kind == "falsified":
            (place / "strong_mass").rename(place / name)
            (place.parent / ANSWERS).write_text(f'{{"{name}": {lie}}}')
            (place / name / "answers.json").write_text(lie)
        assert blind_run(place, results, workers=1) == (1, {})
        assert set(json.loads((results / ALL).read_text())) == {name}
        assert read_hash(results) == read_hash(cases)
        verdicts.append((results / name / FILE).read_bytes())
    kept = json.loads(verdicts[0])["provenance"]["fence"]
    assert kept == ("Landlock and audit hook" if landlock_version() else kept)
    assert kept.endswith("audit hook")
    assert verdicts[0] == verdicts[1]


class Peek:
    """In place of a diagnosis, told as text, as a worker behind the fence may not even load this file: read another."""

    def __init__(self, secret: Path) -> None:
        self.secret = secret

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return eval, (f"exec({PEEK!r}, names := {{'path': {str(self.secret)!r}}}) or names['peek']",)


PEEK = """
def peek(*_):
    import pyarrow
    found = []
    for read in (lambda: open(path).read(), lambda: pyarrow.OSFile(path).read().decode()):
        try:
            found.append(read())
        except OSError as error:
            found.append(str(error))
    return ' | '.join(found)
"""


def test_workers_of_a_blind_run_are_behind_the_fence(
    cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker that tries to read the answers can't, and could in a diagnosis that is not blind."""
    monkeypatch.setattr("runner.outputs.many._one", Peek(cases.parent / ANSWERS))
    (tmp_path / "blind").mkdir()
    _, refused = blind_run(cases, tmp_path / "blind", workers=1)
    by_python, _, by_library = refused["strong_mass"].partition(" | ")
    assert by_python.startswith("not while cases are diagnosed blind")
    if landlock_version():
        assert "Permission denied" in by_library
    (tmp_path / "open").mkdir()
    failed = diagnose_many({"strong_mass": cases / "strong_mass"}, tmp_path / "open", workers=1)
    text = (cases.parent / ANSWERS).read_text()
    assert failed["strong_mass"] == f"{text} | {text}"


def test_a_case_that_kills_its_process_takes_no_other_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is named as not diagnosed; all others are done."""
    monkeypatch.setattr("runner.outputs.many._one", killed)
    names = ["a", "heavy", "c", "d"]
    tmp_path.joinpath("out").mkdir()
    failed = diagnose_many({name: tmp_path / name for name in names}, tmp_path / "out", workers=2)
    assert failed.pop("heavy").startswith("its process was killed")
    assert failed == dict.fromkeys(["a", "c", "d"], "light")


def test_verdicts_from_before_the_hash_are_refused(
    cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder with verdicts whose answers had not been sealed is not made blind by running over it."""
    (tmp_path / "strong_mass").mkdir()
    (tmp_path / "strong_mass" / FILE).write_text("{}")
    assert main(["blind", "run", str(cases), f"out={tmp_path}"]) == 2
    assert "is of a diagnosis that was not blind; name a new folder" in capsys.readouterr().err
    assert not (tmp_path / HASH_FILE).exists()
    assert main(["blind", "run", str(cases / HASH_FILE), f"out={tmp_path / 'new'}"]) == 2
    assert "is no folder" in capsys.readouterr().err


def test_names_of_copies_follow_from_their_content(cases: Path, tmp_path: Path) -> None:
    """A copy holds the recording and the nominal model alone; what the case was called leaves no trace."""
    other = tmp_path / "another"
    shutil.copytree(cases / "strong_mass", other)
    (other / "answers.json").write_text("{}")
    first = copy_cases({"strong_mass": cases / "strong_mass"}, tmp_path / "a")
    second = copy_cases({"zzz": other, "another": other}, tmp_path / "b")
    assert first["strong_mass"].name == second["zzz"].name
    assert second["another"].name == second["zzz"].name + "-1"
    assert {f.name for folder in second.values() for f in folder.iterdir()} == {"nominal.yaml", "recording.parquet"}


def test_what_is_written_before_the_first_diagnosis(
    cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Hash, version and commit are in the results when the diagnosis begins; verdicts that are there are kept."""
    seen = []

    def diagnosed(hidden: dict[str, Path], results: Path, **_: object) -> dict[str, str]:
        entries = json.loads((results / PROVENANCE).read_text())
        seen.append((read_hash(results), len(entries), set(entries[0]), set(hidden)))
        assert all(not p.is_relative_to(cases) for p in hidden.values())
        return {}

    monkeypatch.setattr("runner.blind.run.diagnose_many", diagnosed)
    for time in (1, 2):
        blind_run(cases, tmp_path)
        assert seen[-1] == (read_hash(cases), time, {"runner", "commit", "changed", "begun"}, {"strong_mass"})
    (tmp_path / HASH_FILE).write_text("0" * 64)
    with pytest.raises(ResultError, match="holds verdicts for other answers"):
        blind_run(cases, tmp_path)


def test_refusals(cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Cases without the hash of their answers are not diagnosed; one line says so."""
    shutil.copytree(cases, tmp_path / "cases")
    (tmp_path / "cases" / HASH_FILE).unlink()
    assert main(["blind", "run", str(tmp_path / "cases"), f"out={tmp_path / 'out'}"]) == 2
    err = capsys.readouterr().err
    assert "answers.sha256: no such file" in err
    assert err.count("\n") == 1
    assert not list((tmp_path / "out").glob("*.json"))
    assert command.COMMAND.positional == "cases"


def test_made_with_a_seed_that_was_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a seed one is drawn and printed; the answers lie beside the cases, their hash is printed."""
    assert main(["blind", "make", "n=1", f"out={tmp_path / 'set'}", "workers=1"]) == 0
    out = capsys.readouterr().out
    digest = hashlib.sha256((tmp_path / "set.answers.json").read_bytes()).hexdigest()
    assert f"SHA-256 of the answers: {digest}" in out
    assert "drawn" in out
    assert main(["blind", "make", "n=1", "out=/"]) == 2
    assert "out: must be a new folder" in capsys.readouterr().err
    assert read_hash(tmp_path / "set") == digest
    assert main(["blind", "make", "n=1", f"out={tmp_path / 'set2'}", f"answers={tmp_path / 'set.answers.json'}"]) == 2
    assert "exists; name a new file" in capsys.readouterr().err
