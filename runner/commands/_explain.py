"""What Hydra and OmegaConf refuse, as one line: the key, the value, what is allowed, the nearest valid name."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from omegaconf import (
    AnyNode,
    BooleanNode,
    BytesNode,
    DictConfig,
    EnumNode,
    FloatNode,
    IntegerNode,
    ListConfig,
    Node,
    OmegaConf,
    PathNode,
    StringNode,
    UnionNode,
)
from omegaconf.errors import (
    GrammarParseError,
    InterpolationResolutionError,
    MissingMandatoryValue,
    OmegaConfBaseException,
)

from runner import config
from runner.commands import Command
from runner.commands._compose import Composer
from runner.config import TARGET
from runner.errors import ConfigError, RunnerError, nearest

_KINDS = {
    FloatNode: "a number",
    IntegerNode: "a whole number",
    BooleanNode: "true or false",
    StringNode: "a text",
    PathNode: "a path",
    BytesNode: "bytes",
}
_LISTS: dict[Any, str] = {
    float: "a list of numbers, as in [1,2,3]",
    int: "a list of whole numbers, as in [1,2,3]",
    str: "a list of texts, as in [a,b]",
    Path: "a list of paths, as in [a,b]",
}


def explain(error: Exception, overrides: Sequence[str], composer: Composer) -> Exception:
    """Return the error to show for one that composing raised: a ConfigError of one line.

    An error that is not about the settings comes back as it is.
    """
    if isinstance(error, RunnerError):
        return error
    if isinstance(error, OverrideParseException):
        return _syntax(error.override)
    parser = OverridesParser.create(config_loader=composer.loader)
    groups = composer.groups()
    # folders of configs first, then the parts that are chosen, then what is set in them
    order = {"hydra.searchpath": 0} | dict.fromkeys(groups, 1)
    parsed = sorted(parser.parse_overrides(list(overrides)), key=lambda o: order.get(o.key_or_group, 2))
    kept: list[str] = []
    base: DictConfig | None = None
    try:
        base = composer.compose(kept)
        for override in parsed:
            if override.is_sweep_override():
                return ConfigError(
                    f"{override.get_key_element()}: several values ({override.get_value_string()}) make a sweep: "
                    "add -m, or quote the value if it is one."
                )
            kept.append(override.input_line or "")
            if kept == [*overrides]:
                raise error  # composing it once more would say the same
            composed = composer.compose(kept)
            base = composed
    except Exception as found:
        culprit = parsed[len(kept) - 1] if kept else None
        return _composition(found, culprit, base, groups)
    return ConfigError(_one_line(error)) if isinstance(error, (HydraException, OmegaConfBaseException)) else error


def explain_value(error: Exception, composed: DictConfig, groups: dict[str, tuple[str, ...]]) -> RunnerError:
    """Return the error to show for one that reading the composed config raised: a missing or circular value."""
    if isinstance(error, RunnerError):
        return error
    key = _full_key(error)
    if isinstance(error, MissingMandatoryValue):
        key = next(iter(sorted(OmegaConf.missing_keys(composed) - {"hydra"})), key)
        node = node_at(composed, key)
        if key in groups:
            return ConfigError(f"{key}: one must be chosen. {_names('', groups[key])}")
        return ConfigError(f"{key}: a value is needed ({describe(node) if node is not None else 'any'}).")
    if isinstance(error, (InterpolationResolutionError, GrammarParseError)):
        reason = _first_line(error)
        written = re.search(r"Interpolation key '([^']*)' not found", reason)
        if written:
            return ConfigError(f"{key}: no key '{written[1]}' to take the value of. {_near(written[1], composed)}")
        return ConfigError(f"{key}: {reason}")
    return ConfigError(f"{key}: {_first_line(error)}" if key else _one_line(error))


def _near(name: str, composed: DictConfig) -> str:
    """Return the nearest key to a full one, wherever it is in the config."""
    head, _, last = name.rpartition(".")
    node = node_at(composed, head) if head else composed
    if isinstance(node, DictConfig):
        return nearest(last, _keys(node))
    return nearest(head, _keys(composed))


def _composition(
    error: Exception, culprit: Override | None, base: DictConfig | None, groups: dict[str, tuple[str, ...]]
) -> ConfigError:
    if base is None or culprit is None:
        return ConfigError(_in_file(error) or _one_line(error))
    if culprit.is_delete():
        return _not_taken_out(culprit.key_or_group, base, groups)
    key, value = culprit.key_or_group, culprit.get_value_string()
    if isinstance(error, MissingConfigException) and (key in groups or error.options):
        missing = (error.missing_cfg_file or value).removeprefix(f"{key}/")
        extra = " It comes with the extra: pip install 'runner[cluster]'." * missing.startswith("submitit")
        return ConfigError(f"{key}: no '{missing}'.{extra} {_names(missing, groups.get(key, error.options or ()))}")
    node = node_at(base, key)
    if culprit.is_add() and node is not None:
        return ConfigError(f"{key}: is there already; write {key}={value} without '+'.")
    if key in groups and value.startswith("[") and key in base.hydra.runtime.choices:
        return ConfigError(f"{key}: takes one name, got {value}. {_names('', groups[key])}")
    in_file = _in_file(error, base)
    if in_file:
        return ConfigError(in_file)
    if key in groups and (node is None or key in base.hydra.runtime.choices):
        return ConfigError(f"{key}: must be a name, got {value}. {_names(value, groups[key])}")
    if node is None:
        return unknown_key(key, base, groups)
    return ConfigError(f"{key}: {refused(node, value)}")


def _not_taken_out(key: str, base: DictConfig, groups: dict[str, tuple[str, ...]]) -> ConfigError:
    node = node_at(base, key)
    if node is None:
        return unknown_key(key, base, groups)
    return ConfigError(f"{key}: can't be taken out, it must be {describe(node)}; set it to another value.")


EVERYWHERE = ("out", "resume")  # keys that every command takes, and that are in no config


def unknown_key(key: str, base: DictConfig, groups: dict[str, tuple[str, ...]]) -> ConfigError:
    """Return the error for a key that is not there, with what is there where it leaves the tree."""
    parent, path = base, ""
    names = key.split(".")
    for i, name in enumerate(names):
        node = node_at(parent, name)
        if isinstance(node, DictConfig) and not node._is_none() and not node._is_missing() and i < len(names) - 1:
            parent, path = node, f"{path}{name}."
            continue
        if node is not None and i < len(names) - 1:
            return ConfigError(f"{path}{name}: is {describe(node)} and has no keys below it, got '{key}'.")
        valid = set(_keys(parent))
        if not path:
            valid |= {*groups, *EVERYWHERE}
        return ConfigError(f"{path}{name}: no such key. {_names(name, valid)}")
    raise AssertionError(key)


def refused(node: Node, value: str) -> str:
    """Return what a value was refused for by the type of its key."""
    kind = _unwrapped(node)
    if isinstance(kind, EnumNode):
        names = list(kind.enum_type.__members__)
        return f"no '{value}'. {nearest(value, names)}"
    literal = re.fullmatch(r"[-+.\d][-+.\deE]*|[\[{].*", value)
    return f"must be {describe(node)}, got {value if literal else repr(value) if value else 'nothing'}."


def describe(node: Node) -> str:
    """Return what a key may hold, by its type."""
    end = " or null" if node._is_optional() and not isinstance(node, AnyNode) else ""
    kind = _unwrapped(node)
    for cls, text in _KINDS.items():
        if isinstance(kind, cls):
            return text + end
    if isinstance(kind, EnumNode):
        return "one of " + ", ".join(f"'{name}'" for name in kind.enum_type.__members__) + end
    if isinstance(kind, ListConfig):
        return _LISTS.get(kind._metadata.element_type, "a list, as in [a,b]") + end
    if isinstance(kind, DictConfig):
        keys = _keys(kind)
        return "a section" + (f" with {', '.join(keys)}" if keys else "") + end
    if isinstance(kind, UnionNode):
        return str(kind._metadata.ref_type).replace("typing.", "") + end
    return "a value"


def _unwrapped(node: Node) -> Node:
    inner = node._value() if isinstance(node, UnionNode) else node
    return inner if isinstance(inner, Node) else node


def _names(name: str, valid: Iterable[str]) -> str:
    names = list(valid)
    return nearest(name, names) if names else "There are none."


def node_at(config: DictConfig, key: str) -> Node | None:
    """Return the node at a dotted key, None if there is none.

    `OmegaConf.select` gives values; what a key may hold is known to its node alone, which has no public way to it.
    """
    node: Any = config
    for name in re.split(r"[.\[\]]+", key.rstrip("]")):
        if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
            return None
        node = node._get_node(name, validate_access=False)
        if node is None:
            return None
    return node


def _keys(config: DictConfig) -> list[str]:
    if config._is_none() or config._is_missing():
        return []
    return [str(k) for k in config if k not in (TARGET, "hydra")]


def _in_file(error: Exception, base: DictConfig | None = None) -> str | None:
    """Return the line for an error in a YAML file, None if it is not one."""
    text = str(error)
    place = re.match(r"In '([^']+)': (\w+) raised while composing config:\s*(.*)", text, re.DOTALL)
    if place:
        inner = place[3]
        key = re.search(r"full_key: (\S+)", inner)
        reason = inner.strip().splitlines()[0].rstrip(".")
        unknown = re.match(r"Key '([^']+)' (?:not in|is not in struct)", reason)
        if unknown and key and base is not None:
            return f"{place[1]}.yaml: {unknown_key(key[1], base, {})}"
        wrong = re.search(r"[Vv]alue '([^']*)'", reason)
        node = node_at(base, key[1]) if key and base is not None else None
        if wrong and node is not None:
            return f"{place[1]}.yaml: {key[1] if key else ''}: {refused(node, wrong[1])}"
        return f"{place[1]}.yaml: {key[1] + ': ' if key else ''}{reason}."
    if isinstance(error, MissingConfigException):
        wanted = re.search(r"Could not (?:find|load) '([^']+)'", text)
        return f"{_first_line(error)}" if not wanted else f"defaults: no file '{wanted[1]}.yaml' in the config folder."
    return None


def _syntax(override: str) -> ConfigError:
    key, equals, value = override.partition("=")
    if not equals:
        return ConfigError(f"'{override}': settings are written key=value.")
    return ConfigError(
        f"{key}: can't read {value!r}; allowed are a number, a word, [a,b], {{a:1}}, or a text in quotes: "
        f"\"{key}='{value}'\"."
    )


def _full_key(error: Exception) -> str:
    if isinstance(error, OmegaConfBaseException) and error.full_key:
        return error.full_key
    found = re.search(r"full_key: (\S+)", str(error))
    return found[1] if found else ""


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def built(command: Command[Any], own: Any, groups: Callable[[], dict[str, tuple[str, ...]]]) -> Any:
    """Return the dataclass of a composed config.

    Args:
        command: Whose config it is.
        own: The config, without Hydra's.
        groups: Returns the config groups and their options; called where something is wrong alone, as it takes long.

    Raises:
        ConfigError: If a value is missing or out of its range.
    """
    try:
        return config.build(own, command.config)
    except (RunnerError, OmegaConfBaseException) as error:
        raise explain_value(error, own, groups()) from error
