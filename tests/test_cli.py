"""The command line: what is right runs and keeps its results, what is wrong is one line and exit code 2."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from itertools import zip_longest
from pathlib import Path

import pytest
from demo import CONF, PLAIN, SOURCE
from filelock import lock_descriptor

from runner import commands
from runner.__main__ import main
from runner.commands import _compose
from runner.commands._execute import composed_for
from runner.commands._explain import built
from runner.errors import ConfigError
from runner.teleop import tables

Cli = Callable[..., tuple[int, str, str]]


@pytest.fixture
def demo_files(tmp_path: Path) -> Path:
    """Write two commands and a config tree beside the package's own."""
    folder = tmp_path / "plugin"
    for name, text in {"commands/demo.py": SOURCE, "commands/say.py": PLAIN}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    for name, text in CONF.items():
        (folder / "conf" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "conf" / name).write_text(text)
    return folder


@pytest.fixture
def cli(demo_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Cli:
    """Return a function that runs a command line in an empty folder: exit code, stdout, stderr."""
    monkeypatch.setattr(commands, "__path__", [*commands.__path__, str(demo_files / "commands")])
    monkeypatch.setattr(_compose, "config_dir", lambda: demo_files / "conf")
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = main(arguments)
        out, err = capsys.readouterr()
        return code, out, err

    return call


REFUSED = {
    "outt=3": "Did you mean 'out'?",
    "scenery=3": "scenery: no such key. Valid: 'act', 'cart', ",
    "car.mass_kg=3": "Did you mean 'cart'?",
    "cart.mas_kg=3": "cart.mas_kg: no such key. Valid: 'floor', 'loads', 'mass_kg', 'size_m', 'wheels'. "
    "Did you mean 'mass_kg'?",
    "cart.mass_kg.x=3": "cart.mass_kg: is a number and has no keys below it, got 'cart.mass_kg.x'.",
    "cart.mass_kg=heavy": "cart.mass_kg: must be a number, got 'heavy'.",
    "cart.mass_kg=[1]": "cart.mass_kg: must be a number, got [1].",
    "cart.mass_kg=null": "cart.mass_kg: must be a number, got 'null'.",
    "cart.mass_kg=nan": "cart.mass_kg: must be a finite number in ]0, 1000] kg, got nan.",
    "cart.mass_kg=-2": "cart.mass_kg: must be a finite number in ]0, 1000] kg, got -2.0.",
    "pull.force_n=1e9": "pull.force_n: must be a finite number in [0, 100] N, got 1000000000.0.",
    "cart.wheels=4.5": "cart.wheels: must be a whole number, got 4.5.",
    "cart.wheels=true": "cart.wheels: must be a whole number, got 'true'.",
    "cart.floor=carpt": "cart.floor: no 'carpt'. Valid: 'carpet', 'ice'. Did you mean 'carpet'?",
    "cart.size_m=[1,x]": "cart.size_m: must be a list of numbers, as in [1,2,3] or null, got [1,x].",
    "cart.size_m=[1,2,3]": "cart.size_m: must be a list of 2 values, got [1.0, 2.0, 3.0].",
    "cart=3": "cart: must be a section with mass_kg, floor, size_m, wheels, loads, got 3.",
    "pull=stedy": "pull: no 'stedy'. Valid: 'rising_slowly', 'steady'. Did you mean 'steady'?",
    "pull=[steady,rising_slowly]": "pull: takes one name, got [steady,rising_slowly].",
    "pull.slope_n_s=1": "pull.slope_n_s: no such key. Valid: 'force_n'.",
    "load=[brik]": "load: no 'brik'. Valid: 'brick'. Did you mean 'brick'?",
    "experiment=hevy": "experiment: no 'hevy'. Valid: 'both', 'heavy', 'text', 'typo'. Did you mean 'heavy'?",
    "experiment=typo": "experiment/typo.yaml: cart.mas_kg: no such key. ",
    "experiment=text": "experiment/text.yaml: cart.mass_kg: must be a number, got 'heavy'.",
    "seed=???": "seed: a value is needed (a whole number).",
    "seed=": "seed: must be a whole number, got nothing.",
    "~seed": "seed: a value is needed.",
    "~pull": "pull: one must be chosen. Valid: 'rising_slowly', 'steady'.",
    "+seed=3": "seed: is there already; write seed=3 without '+'.",
    "++sed=3": "sed: no such key. Valid: 'act', 'cart', 'names', 'pull', 'seed'. Did you mean 'seed'?",
    "seed=1,2": "seed: several values (1,2) make a sweep: add -m",
    "seed=(": "seed: can't read '('; allowed are a number",
    "seed=${cart.wheel}": "seed: no key 'cart.wheel' to take the value of. Valid: ",
    "seed=${seed}": "seed: ",
    "=3": "'=3': a key is missing before '='.",
    "--seed": "--seed: needs a value",
    "-q": "runner demo: no option '-q'.",
    "hydra/launcher=joblip": "hydra/launcher: no 'joblip'. Valid: ",
    "resume=nowhere": "resume: 'nowhere' is no sweep",
}


@pytest.mark.parametrize("setting", REFUSED)
def test_wrong_setting_is_one_line(cli: Cli, setting: str, tmp_path: Path) -> None:
    """Every wrong setting: exit code 2, one line that names key, value and what is allowed; nothing is written."""
    code, out, err = cli("demo", setting)
    assert code == 2
    assert out == ""
    assert err.count("\n") == 1
    assert REFUSED[setting] in err
    assert not (tmp_path / "results").exists()


def test_wrong_command_names_the_nearest(cli: Cli) -> None:
    """`runner dmo` names `demo`."""
    code, _, err = cli("dmo", "seed=3")
    assert code == 2
    assert "no command 'dmo'." in err
    assert "Did you mean 'demo'?" in err


def test_run_keeps_config_and_results(cli: Cli, tmp_path: Path) -> None:
    """A run writes to results/<experiment>/<time>, with the resolved config, and nothing else of Hydra's."""
    code, out, err = cli("demo", "experiment=heavy", "load=[brick]")
    assert (code, out, err) == (0, "pulled\n", "")
    (folder,) = (tmp_path / "results/heavy").iterdir()
    assert sorted(p.name for p in folder.iterdir()) == ["config.yaml", "result.txt", "run.yaml"]
    text = (folder / "config.yaml").read_text()
    assert text.startswith("# runner demo experiment=heavy 'load=[brick]'\n")
    assert "mass_kg: 50.0" in text
    assert "hydra" not in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["plugin", "results"]


def test_out_names_the_folder(cli: Cli, tmp_path: Path) -> None:
    """`out=PATH` is taken literally, with spaces, equals signs and quotes."""
    name = "an odd = place's"
    assert cli("demo", f"out={name}")[0] == 0
    assert (tmp_path / name / "result.txt").exists()
    assert not (tmp_path / "results").exists()


def test_two_runs_in_one_second_have_two_folders(cli: Cli, tmp_path: Path) -> None:
    """No run writes over another."""
    for _ in range(3):
        assert cli("demo")[0] == 0
    assert len(list((tmp_path / "results/demo").iterdir())) == 3


def test_folder_in_use_is_refused(cli: Cli, tmp_path: Path) -> None:
    """A folder that another process holds is left alone."""
    (tmp_path / "busy").mkdir()
    handle = os.open(tmp_path / "busy", os.O_RDONLY)
    assert lock_descriptor(handle, blocking=False)
    try:
        code, _, err = cli("demo", "out=busy")
    finally:
        os.close(handle)
    assert code == 2
    assert "another run is writing to 'busy'" in err
    assert cli("demo", "out=busy")[0] == 0


def test_bare_words_and_options(cli: Cli, tmp_path: Path) -> None:
    """Bare words go to the positional key; `--key value` and `--key=value` are `key=value`."""
    assert cli("say", "plain/path") == (0, "plain/path\n", "")
    assert cli("say", "--loud", "true", "odd (1), name")[:2] == (0, "ODD (1), NAME\n")
    assert cli("say", "--path=x y", "--loud=false")[:2] == (0, "x y\n")
    assert cli("say", "three")[0] == 3
    code, _, err = cli("say", "a", "b")
    assert (code, err) == (2, "path: takes one value, got 'a', 'b'.\n")
    code, _, err = cli("say")
    assert (code, err) == (2, "path: a value is needed (a text).\n")
    assert cli("demo", "one", "two three", "out=o")[0] == 0
    assert "- two three" in (tmp_path / "o/config.yaml").read_text()


def test_errors_of_a_run(cli: Cli) -> None:
    """What a user can put right is one line and 2, a bug one line and 1, an interrupt one line and 130."""
    assert cli("demo", "act=refuse") == (2, "", "recording.csv row 3: t goes back.\n")
    code, _, err = cli("demo", "act=break")
    assert (code, err.count("\n")) == (1, 1)
    assert "a bug: ZeroDivisionError: in the middle" in err
    assert cli("demo", "act=interrupt") == (130, "", "Interrupted.\n")
    code, _, err = cli("demo", "act=break", "--traceback")
    assert "Traceback" in err


def test_config_is_shown(cli: Cli) -> None:
    """`--config` prints the resolved values and runs nothing."""
    code, out, _ = cli("demo", "pull=rising_slowly", "seed=${cart.wheels}", "--config")
    assert code == 0
    assert "seed: 4\npull:\n  slope_n_s: 2.0\n" in out
    assert "_target_" not in out


def test_help(cli: Cli) -> None:
    """Help lists the commands; of a command, its groups with their options and its settings with their kinds."""
    code, out, _ = cli("--help")
    assert code == 0
    assert "  demo " in out
    assert "Pull a cart." in out
    code, out, _ = cli("demo", "--help")
    assert code == 0
    for text in (
        "The longer text.", "pull=steady", "rising_slowly, steady", "load=[]", "brick", "experiment=null",
        "cart.floor=ice", "one of 'ice', 'carpet'", "seed=1", "a whole number",
    ):  # fmt: skip
        assert text in out
    assert "schema_" not in out
    assert "mujoco 3.17.0" in cli("--version")[1]


def test_sweep_runs_every_combination(cli: Cli, tmp_path: Path) -> None:
    """`-m` makes a numbered folder for each combination, in order, with what was swept."""
    code, out, err = cli("demo", "-m", "pull=steady,rising_slowly", "seed=1,2", "out=s")
    assert (code, err) == (0, "")
    assert out.endswith("4 runs in s\n")
    got = [(tmp_path / f"s/{i}/result.txt").read_text() for i in range(4)]
    assert got == [
        f"{seed} {force} {{'pull': '{pull}', 'seed': {seed}}}"
        for pull, force in (("steady", 1.0), ("rising_slowly", 2.0))
        for seed in (1, 2)
    ]
    assert sorted(p.name for p in (tmp_path / "s").iterdir()) == [
        "0",
        "1",
        "2",
        "3",
        "run.yaml",
        "summary.parquet",
        "sweep.txt",
    ]
    code, _, err = cli("demo", "-m", "seed=1,2", "out=s")
    assert code == 2
    assert "out: 's' is not empty" in err


def test_experiment_that_is_a_sweep(cli: Cli, tmp_path: Path) -> None:
    """An experiment may ask for its own sweep, without -m, and gives the folder its name."""
    assert cli("demo", "experiment=both")[0] == 0
    (folder,) = (tmp_path / "results/both").iterdir()
    assert (folder / "0/result.txt").read_text().startswith("7 2.0")
    assert (folder / "1/result.txt").read_text().startswith("7 1.0")


def test_failed_run_of_a_sweep_leaves_a_row(cli: Cli, tmp_path: Path) -> None:
    """One run out of range does not stop the others; it leaves its row, and the exit code is 1."""
    code, out, err = cli("demo", "-m", "pull.force_n=1,-1,2", "out=s")
    assert code == 1
    assert "3 runs in s, 1 of them failed" in out
    assert "job 1: pull.force_n: must be a finite number" in err
    rows = tables.sweep_rows(tmp_path / "s")
    assert [row["status"] for row in rows] == ["done", "failed", "done"]
    assert rows[1]["reason"].startswith("pull.force_n: must be a finite number")
    assert (tmp_path / "s/2/result.txt").read_text().startswith("1 2.0")


def test_sweep_that_cannot_be_composed_runs_nothing(cli: Cli, tmp_path: Path) -> None:
    """A wrong type or name anywhere in a sweep is refused before the first run."""
    for wrong, told in (
        ("seed=1,x", "seed: must be a whole number, got 'x'."),
        ("pull=steady,stedy", "pull: no 'stedy'."),
    ):
        code, out, err = cli("demo", "-m", wrong, "out=s" + wrong[:4])
        assert (code, out) == (2, "")
        assert told in err
        assert not (tmp_path / ("s" + wrong[:4]) / "0").exists()


def _process(demo_files: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as a process of its own, whose workers know the two commands too."""
    (demo_files / "sitecustomize.py").write_text(
        "from pathlib import Path\nfrom runner import commands\n"
        f"commands.__path__.append({str(demo_files / 'commands')!r})\n"
        "from runner.commands import _compose\n"
        f"_compose.config_dir = lambda: Path({str(demo_files / 'conf')!r})\n"
    )
    root = str(Path(commands.__file__).parents[2])
    paths = os.pathsep.join([str(demo_files), root])
    return subprocess.run(
        [sys.executable, "-m", "runner", *arguments],
        env={**os.environ, "PYTHONPATH": paths}, cwd=demo_files.parent, text=True, capture_output=True, timeout=120,
        check=False,
    )  # fmt: skip


def test_killed_sweep_resumes_to_the_same_result(cli: Cli, demo_files: Path, tmp_path: Path) -> None:
    """After kill -9 in the middle, `resume=` runs what is missing, only that, and ends as if never killed."""
    settings = ["demo", "-m", "seed=1,2,3", f"act=die:{tmp_path / 'flag'}"]
    assert _process(demo_files, *settings, "out=killed").returncode == -9
    assert [row["job"] for row in tables.sweep_rows(tmp_path / "killed")] == [0]
    before = (tmp_path / "killed/0/result.txt").stat().st_mtime_ns
    assert cli("demo", "resume=killed") == (0, "pulled\npulled\n3 runs in killed\n", "")
    assert (tmp_path / "killed/0/result.txt").stat().st_mtime_ns == before
    assert cli(*settings, "out=whole")[0] == 0
    _assert_same_sweeps(tmp_path / "killed", tmp_path / "whole")


def _assert_same_sweeps(one: Path, other: Path) -> None:
    """The folders of two sweeps hold the same, byte for byte."""
    files = [
        p.relative_to(one) for p in sorted(one.rglob("*")) if p.is_file() and p.name not in ("sweep.txt", "run.yaml")
    ]
    assert {p.name for p in files} >= {"summary.parquet", "config.yaml", "result.txt"}
    for file in files:
        assert (one / file).read_bytes() == (other / file).read_bytes(), file


@pytest.mark.parametrize("name", commands.names())
def test_own_commands_say_what_they_are(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every command of the package has a line in the help, a help of its own, and refuses a key it has not."""
    assert commands.description(name).splitlines()[0].endswith(".")
    assert main([*name.split(), "--help"]) == 0
    assert f"Usage: runner {name}" in capsys.readouterr().out
    assert main([*name.split(), "no_such_key=1"]) == 2
    assert "no_such_key: no such key." in capsys.readouterr().err


CONF_FOLDER = _compose.config_dir()
NOT_IN_A_RUN = {  # what these need is said
    "forces=csv": "a value is needed",
    "effect=[observation_delay]": "changes a measurement after the fact",
    "effect=[sensor_scale]": "changes a measurement after the fact",
}


def test_every_option_of_every_group_is_usable() -> None:
    """Each file in `conf/` makes a config that passes all checks, or says what it needs or where it belongs.

    An option of each group and all effects at a time: an error names the key. An experiment sets many, so it is alone.
    """
    command = commands.load("run")
    said: dict[str, str] = {}
    with _compose.composer("run", command) as hydra:

        def build(*choices: str) -> None:
            built(command, _compose.without_hydra(composed_for(hydra, choices)), dict)

        beside, alone = [], [*NOT_IN_A_RUN]
        for group, names in hydra.groups().items():
            assert set(names) == {p.stem for p in (CONF_FOLDER / group).glob("*.yaml")}
            if group == "effect":
                fine = [name for name in names if f"effect=[{name}]" not in NOT_IN_A_RUN]
                beside.append([f"effect=[{','.join(fine)}]"])
            elif group == "experiment":
                alone += [f"{group}={name}" for name in names]
            else:
                beside.append([c for name in names if (c := f"{group}={name}") not in NOT_IN_A_RUN])
        for together in zip_longest(*beside):
            build(*filter(None, together))
        for choice in alone:
            try:
                build(choice)
            except ConfigError as error:
                said[choice] = str(error)
    assert said.keys() == NOT_IN_A_RUN.keys(), said
    assert all(NOT_IN_A_RUN[choice] in text for choice, text in said.items())


# parts of one's own that a page shows how to write, and what stands for a name
ONES_OWN = re.compile(r"sawtooth|halfway|--config-dir|NAME|\.\.\.")


def typed_lines() -> list[str]:
    """Return what the README and all other pages say to type: blocks of shell code, and commands with settings in text.

    Of what is to be swept over the first value stands for all. The page on reliability names faults, which have tests
    of their own.
    """
    root = CONF_FOLDER.parent
    pages = [root / "README.md", root / "examples" / "README.md", *sorted((root / "docs").rglob("*.md"))]
    lines = []
    for text in (page.read_text(encoding="utf-8") for page in pages if page.name != "reliability.md"):
        lines += [line for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL) for line in block.splitlines()]
        prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
        lines += [" ".join(line.split()) for line in re.findall(r"`(runner [^`]*=[^`]*)`", prose)]
        lines += re.findall(r"^    (runner .+)$", prose, re.MULTILINE)
    plain = (line.partition("#")[0].partition(" > ")[0].strip() for line in lines)
    found = dict.fromkeys(line for line in plain if line.startswith("runner ") and not ONES_OWN.search(line))
    return [re.sub(r"=(?:range\()?([\w.]+),[^\[\]' ]+", r"=\1", line.replace(" -m ", " ")) for line in found]


@pytest.mark.parametrize("line", [line for line in typed_lines() if not re.search("resume=|forces.path=", line)])
def test_what_pages_say_to_type_is_accepted(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Commands, keys, names of parts and their values are known."""
    assert main([*shlex.split(line)[1:], "--config"]) == 0, capsys.readouterr().err


@pytest.mark.parametrize(("own", "threads"), [(None, "1"), ("3", "3")])
def test_linear_algebra_keeps_to_one_thread(own: str | None, threads: str) -> None:
    """It is told before it is loaded; who sets another number has it."""
    name = "OPENBLAS_NUM_THREADS"
    said = f"import os, sys; import runner.__main__; print(os.environ['{name}'], 'numpy' in sys.modules)"
    env = {k: v for k, v in os.environ.items() if k != name} | ({name: own} if own else {})
    found = subprocess.run([sys.executable, "-c", said], env=env, capture_output=True, text=True, check=True)
    assert found.stdout.split() == [threads, "False"]
