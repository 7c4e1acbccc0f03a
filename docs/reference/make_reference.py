"""Write the reference: settings, effects, numbers, columns, from schemas, docstrings and two tables of words.

`make reference` writes the pages; a test says if they are not what this makes. A range is that of the check in the
`__post_init__` of a class, a default that of the file in `conf/`, or else of the class.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import sys
import textwrap
import typing
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

import runner.settings
from runner import commands, config
from runner.commands._catalogue import names
from runner.commands._compose import config_dir
from runner.commands._described import BOX, Described, described
from runner.effects.wording import number
from runner.settings import SETTINGS
from runner.settings.declared import declared
from runner.systems.mechanism import settings as mechanism_settings
from runner.systems.mechanism.settings import MECHANISM

HERE = Path(__file__).parent
WRITTEN = "<!-- written by `make reference`; do not edit -->\n"
UNITS = {
    "_n_s_per_m": "N s/m", "_n_s2_per_m2": "N s²/m²", "_n_per_m": "N/m", "_n_m_s": "N m s", "_kg_m2": "kg m²",
    "_m_s2": "m/s²", "_m_s": "m/s", "_rad_s": "rad/s", "_per_s": "1/s", "_n_s": "N/s", "_hz": "Hz", "_kg": "kg",
    "_rad": "rad", "_nm": "N m", "_deg": "°", "_m": "m", "_s": "s", "_n": "N",
}  # fmt: skip
NUMBERS = (int, float)


def settings() -> str:
    """Return the page of every setting: of commands, then of the parts that are chosen by name."""
    out = [
        WRITTEN,
        "# Settings",
        "Every key of every command: type, unit, what is allowed, default. `key=value` on the command line sets one, "
        "`runner COMMAND --help` shows what it is now. Keys of a part stand below its name: `link.delay_s=0.1`. "
        "`???`: has to be given. `null`: none.",
    ]
    first: dict[str, list[Row]] = {}  # the parts of the first command, of which others have some
    for name in commands.names():
        command = commands.load(name)
        values = _chosen(commands.module(name))
        out += [f"## runner {name}", _first(commands.description(name))]
        out += [_typed(_prose(command.config)), *_table(_own(command.config, values=values))]
        parts = {key: (cls, _own(cls, f"{key}.", _below(values, key))) for key, cls in _sections(command.config)}
        if known := [key for key, (_, rows) in parts.items() if rows in first.values()]:
            out += [f"{', '.join(f'`{key}.*`' for key in known)}: as of `runner {commands.DEFAULT}`."]
        for key, (cls, rows) in parts.items():
            if key not in known:
                out += [f"### {name}: {key}", _typed(_prose(cls)), *_table(rows)]
        if name == commands.DEFAULT:
            first = {key: rows for key, (_, rows) in parts.items()}
    own = {k: c for k, c in sorted(config._REGISTERED.items()) if c.__module__.startswith("runner.")}
    conf = Path(__file__).parents[2] / "conf"
    for group in dict.fromkeys(g for g, _ in own if (conf / g).is_dir()):
        out += [f"## {group}"]
        chosen = f"{group}=NAME" if group != "effect" else "effect=[NAME,...]"
        out.append(f"`runner run {chosen}`; the files stand in `conf/{group}/`.")
        for (of, name), cls in own.items():
            if of == group:
                out += [f"### {group}: {name}", _typed(_prose(cls)), *_table(_own(cls, values=_values(group, name)))]
    return "\n\n".join(out) + "\n"


def _chosen(command: str) -> dict[str, Any]:
    """Return the values of a command's file in `conf/`: of its keys, and the options of its parts."""
    file = config_dir() / f"{command}.yaml"
    values = yaml.safe_load(file.read_text(encoding="utf-8")) or {} if file.is_file() else {}
    parts = [entry for entry in values.get("defaults", ()) if isinstance(entry, dict)]
    return {k.removeprefix("override ").partition("@")[0]: v for part in parts for k, v in part.items()} | values


def _below(values: dict[str, Any], key: str) -> dict[str, Any]:
    """Return the values of a part, none where it is chosen by name."""
    for word in key.split("."):
        part = values.get(word)
        values = part if isinstance(part, dict) else {}
    return values


def _values(group: str, name: str) -> dict[str, Any]:
    file = config_dir() / group / f"{name}.yaml"
    return yaml.safe_load(file.read_text(encoding="utf-8")) or {} if file.is_file() else {}


def _sections(cls: type, prefix: str = "") -> Iterator[tuple[str, type]]:
    """Yield the parts of a command's settings that are dataclasses by themselves, with their keys."""
    for field in dataclasses.fields(cls):
        hint = typing.get_type_hints(cls)[field.name]
        if inspect.isclass(hint) and dataclasses.is_dataclass(hint) and not config._is_abstract(hint):
            yield prefix + field.name, hint
            yield from _sections(hint, f"{prefix}{field.name}.")


Row = tuple[str, str, str, str, str]


def _own(cls: type, prefix: str = "", values: dict[str, Any] | None = None) -> list[Row]:
    """Return key, type, unit, what is allowed and default of the fields of a class that are values."""
    assert dataclasses.is_dataclass(cls)
    hints, ranges, rows = typing.get_type_hints(cls), _ranges(cls), []
    for field in dataclasses.fields(cls):
        hint = hints[field.name]
        part = inspect.isclass(hint) and dataclasses.is_dataclass(hint) and not config._is_abstract(hint)
        if not field.init or part:
            continue
        allowed, unit = ranges.get(field.name, ("", ""))
        for one in (hint, *typing.get_args(hint)):
            if inspect.isclass(one) and issubclass(one, config.Enum):
                allowed = ", ".join(m.name for m in one)
        unit = unit or next((u for end, u in UNITS.items() if field.name.endswith(end)), "")
        default = _text(values[field.name]) if values and field.name in values else _default(field)
        rows.append((f"`{prefix}{field.name}`", _type(hint), unit, allowed, f"`{default}`" if default != "" else ""))
    return rows


def _default(field: dataclasses.Field[Any]) -> str:
    if field.default is not dataclasses.MISSING:
        value = field.default
    elif field.default_factory is not dataclasses.MISSING:
        value = field.default_factory()
    else:
        return "???"
    return "" if dataclasses.is_dataclass(value) else _text(value)


def _text(value: Any) -> str:
    """Return a value as it is typed."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, tuple | list):
        return "[" + ", ".join(f"{v:g}" if isinstance(v, NUMBERS) else str(v) for v in value) + "]"
    return str(getattr(value, "name", value)) if not isinstance(value, float) else f"{value:.6g}"


def _type(hint: Any) -> str:
    known = {float: "number", int: "whole number", bool: "true or false", str: "text", Path: "path", type(None): "null"}
    if hint in known:
        return known[hint]
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        count = "" if Ellipsis in args else f"{len(args)} "
        return f"{count}× {_type(args[0])}".strip()
    if origin is dict:
        return "by name"
    if args:
        return " or ".join(_type(a) for a in args)
    return "one of" if inspect.isclass(hint) and issubclass(hint, config.Enum) else "by name"


def _ranges(cls: type) -> dict[str, tuple[str, str]]:
    """Return what is allowed and the unit by field, from the checks in `__post_init__` of a class and its bases."""
    out: dict[str, tuple[str, str]] = {}
    if isinstance(body := vars(cls).get("body"), property):  # it is checked by what is made of it
        out |= _ranges(typing.get_type_hints(body.fget)["return"])
    for base in reversed(cls.__mro__):
        check = vars(base).get("__post_init__")
        source = textwrap.dedent(inspect.getsource(check)) if inspect.isfunction(check) and check.__module__ else ""
        if not source.startswith("def __post_init__"):
            continue
        space = vars(sys.modules[base.__module__])
        for call in (n for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Call)):
            if ast.unparse(call.func) == "check_range" and isinstance(call.args[0], ast.Constant):
                out[str(call.args[0].value).rpartition(".")[2]] = _allowed(call, space)
            if ast.unparse(call.func) == "check_vector" and isinstance(call.args[0], ast.Constant):
                limit, unit = ({k.arg: k.value for k in call.keywords}.get(k) for k in ("limit", "unit"))
                each = f"each within ±{ast.literal_eval(limit):g}" if isinstance(limit, ast.Constant) else ""
                out[str(call.args[0].value)] = (each, ast.literal_eval(unit) if isinstance(unit, ast.Constant) else "")
            if ast.unparse(call.func) == "check_workers":
                out["workers"] = ("1 to 1024", "")
    return out


def _allowed(call: ast.Call, space: dict[str, Any]) -> tuple[str, str]:
    def read(node: ast.expr) -> Any:
        try:
            return eval(compile(ast.Expression(node), "", "eval"), dict(space))
        except NameError:
            return None

    options = {k.arg: read(k.value) for k in call.keywords}
    low, high = (read(a) for a in [*call.args[2:4], *[ast.Constant(None)] * 2][:2])
    low, high = options.get("lower", low), options.get("upper", high)
    above = "above" if options.get("lower_open") else "from"
    parts = [f"{above} {low:g}"] if low is not None and abs(low) < 1e300 else []
    parts += [f"up to {high:g}"] if high is not None and abs(high) < 1e300 else []
    return " ".join(parts).replace("-", "−"), str(options.get("unit") or "")


def effects() -> str:
    """Return the page of every effect."""
    laws = yaml.safe_load((HERE / "equations.yaml").read_text(encoding="utf-8"))
    out = [
        WRITTEN,
        "# Effects",
        "Whatever a verdict may name, by kind of system: its law, the numbers that are fitted with the standard "
        "deviation of their prior and their bounds, and what no recording of such a thing tells from it. The prior's "
        "mean is that the effect is absent. `runner show NAME` says the same in a terminal, with what to change and "
        "how to check it by hand.",
    ]
    for system, heading in ((BOX, "A box on a floor"), ("mechanism", "Mechanisms and free bodies")):
        variants = [variant for name in names() for variant in described(name) if variant.system == system]
        usual = Counter(variant.example for variant in variants).most_common(1)[0][0]
        out += [f"## {heading}", f"Priors and bounds depend on the recording: here they are those of {usual}."]
        for variant in variants:
            out += _effect(variant, laws[system][variant.effect.__name__], usual)
    return "\n\n".join(out) + "\n"


def _effect(of: Described, law: str, usual: str) -> list[str]:
    target = f" of {'an' if of.target[0] in 'aeiou' else 'a'} {of.target}" if of.target else ""
    kind = "box" if of.system == BOX else "mechanism"
    out = [
        f"### {kind}: {of.named.replace('_', ' ')}, {of.effect.__name__}",
        f"`{of.named}`{target}: {of.effect.label}.",
    ]
    out += [f"    {law}", _prose(of.effect)]
    rows = [(f"`{p.name}`", p.unit, *(number(v) for v in (p.scale, p.lower, p.upper))) for p in of.parameters]
    out += _grid(("fitted", "unit", "prior s.d.", "from", "to"), rows)
    if of.example != usual:
        out.append(f"Here of {of.example}.")
    for other in of.effect.confounded:
        out.append(f"Confounded with `{other.name}`: {other.why}. {other.advice}")
    return out


def numbers() -> str:
    """Return the page of the numbers of a diagnosis."""
    out = [WRITTEN, "# Numbers of a diagnosis", _prose(runner.settings), *_stages(SETTINGS, "##")]
    out += ["## Mechanisms", _prose(mechanism_settings), *_stages(MECHANISM, "### mechanism:")]
    return "\n\n".join(out) + "\n"


def _stages(settings: Any, level: str) -> Iterator[str]:
    for stage in dataclasses.fields(settings):
        of = getattr(settings, stage.name)
        rows = [(f"`{one.name}`", one.text, one.unit, one.reason) for one in declared(of)]
        yield from (f"{level} {stage.name}", _prose(type(of)), *_grid(("number", "value", "unit", "reason"), rows))


def tables() -> str:
    """Return the page of every table's columns."""
    content = yaml.safe_load((HERE / "tables.yaml").read_text(encoding="utf-8"))
    out = [
        WRITTEN,
        "# Tables",
        "Every column of what is written as Parquet and what Python returns; [tables.md](../tables.md) shows how to "
        "read them. `*` stands for a word: the name of a body, an estimator, a channel.",
    ]
    for name, table in content.items():
        rows = [(f"`{column}`", unit, meaning) for column, (unit, meaning) in table["columns"].items()]
        out += [f"## {name}", table["about"], *_grid(("column", "unit", "what it is"), rows)]
    return "\n\n".join(out) + "\n"


def described_columns() -> dict[str, list[re.Pattern[str]]]:
    """Return patterns of the columns that are described, by table."""
    content = yaml.safe_load((HERE / "tables.yaml").read_text(encoding="utf-8"))
    words = {name: [w.strip() for c in table["columns"] for w in c.split(",")] for name, table in content.items()}
    return {name: [re.compile(re.escape(w).replace(r"\*", ".+")) for w in some] for name, some in words.items()}


def _table(rows: list[Row]) -> list[str]:
    return _grid(("key", "type", "unit", "allowed", "default"), rows)


def _grid(heading: tuple[str, ...], rows: list[Any]) -> list[str]:
    if not rows:
        return []
    lines = ["| " + " | ".join(heading) + " |", "|" + " --- |" * len(heading)]
    lines += ["| " + " | ".join(str(c).replace("|", "\\|") for c in row) + " |" for row in rows]
    return ["\n".join(re.sub(r" +\|", " |", line) for line in lines)]


def _first(text: str) -> str:
    return " ".join(text.strip().split("\n\n")[0].split())


def _prose(thing: Any) -> str:
    """Return a docstring as Markdown: paragraphs without line ends, without the part on arguments."""
    text = (inspect.getdoc(thing) or "").split("\nArgs:")[0].split("\nAttributes:")[0]
    prose = "\n\n".join(" ".join(p.split()) for p in text.split("\n\n") if p.strip())
    return re.sub(r"(?<![\\`])([*_<])(?=\w)(?![^`]*`(?:[^`]*`[^`]*`)*[^`]*$)", r"\\\1", prose)


def _typed(prose: str) -> str:
    """Return it with Python's word for nothing as it is typed."""
    return re.sub(r"\bNone\b", "`null`", re.sub(r"`(\w+)` None\b", r"`\1=null`", prose))


PAGES = {"settings.md": settings, "effects.md": effects, "numbers.md": numbers, "tables.md": tables}


def main() -> None:
    """Write the pages."""
    for name, page in PAGES.items():
        (HERE / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
