"""YAML of strangers: safe, of bounded depth and size once its aliases are written out, no key twice."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from runner.storage.limits import check_size

DEPTH, NODES = 32, 20_000  # a nominal.yaml with a hundred channels has 3 levels and 700 values
WORST = (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError)  # as of `!!int ""`


class YamlError(ValueError):
    """What is wrong with a file as YAML: in words, after the file's name."""


# what a plain word stands for, as in YAML 1.2; in 1.1, which PyYAML reads, 4:00 is 240, 010 is 8, no is false
FLOAT = r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
WORDS = {
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?(0|[1-9][0-9]*)", "-+0123456789"),
    "float": (FLOAT, "-+.0123456789"),
    "null": (r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    "merge": (r"<<", "<"),
}


class _Loader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice, of which plain YAML silently takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for k, (key_node, _) in enumerate(node.value):
            if keys[k] in keys[:k]:
                raise yaml.MarkedYAMLError(problem=f"key '{keys[k]}' is given twice", problem_mark=key_node.start_mark)
        return super().construct_mapping(node, deep=deep)


_Loader.yaml_implicit_resolvers = {}  # none of those of YAML 1.1
for _kind, (_pattern, _first) in WORDS.items():
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(rf"^(?:{_pattern})$"), list(_first))


def read_yaml(path: Path) -> Any:
    """Return what a YAML file holds.

    Raises:
        YamlError: If it can't be read, is no YAML, is nested too deep or has too many values: with line and column.
        LimitError: If it is too large.
    """
    check_size(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        check_yaml(text)
        return yaml.load(text, _Loader)
    except YamlError:
        raise
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" line {mark.line + 1}, column {mark.column + 1}:" if mark else ""
        # a list in brackets of names that have some, as the effects of a mechanism do
        hint = (
            " A name with brackets needs quotes there: ['mass[link]']." if "but got '['" in str(error.problem) else ""
        )
        raise YamlError(f"{place} not valid YAML: {error.problem}.{hint}") from None
    except UnicodeDecodeError as error:
        raise YamlError(f" not valid YAML: {error}.") from None
    except yaml.YAMLError as error:
        raise YamlError(f" not valid YAML: {' '.join(str(error).split())}.") from None
    except OSError as error:
        raise YamlError(f" can't be read: {error.strerror}.") from None
    except WORST as error:
        raise YamlError(f" not valid YAML: a value is not what its form promises ({error}).") from None


def check_yaml(text: str) -> None:
    """Refuse YAML that is nested too deep, or holds too many values once its aliases are written out.

    Looked at event by event, before anything is built: of 100,000 brackets no more are read than may be.

    Raises:
        YamlError: Naming the limit, with line and column.
        yaml.YAMLError: If it is no YAML.
    """
    sizes: dict[str, int] = {}
    open_anchors: list[tuple[str | None, int]] = []  # name, values before it
    values = 0
    for event in yaml.parse(text, yaml.SafeLoader):
        mark = event.start_mark
        place = f" line {mark.line + 1}, column {mark.column + 1}:"
        if isinstance(event, yaml.AliasEvent):
            if any(name == event.anchor for name, _ in open_anchors):
                raise YamlError(f"{place} alias '*{event.anchor}' stands within what it names, so it has no end.")
            values += sizes.get(event.anchor, 1)
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            open_anchors.append((event.anchor, values))
            values += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            name, before = open_anchors.pop()
            if name is not None:
                sizes[name] = values - before
        if len(open_anchors) > DEPTH:
            raise YamlError(f"{place} nested deeper than {DEPTH} levels, which no file here needs.")
        if values > NODES:
            raise YamlError(f"{place} more than {NODES:,} values, aliases written out; no file here needs so many.")
