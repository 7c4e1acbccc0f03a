"""Frozen dataclasses as schemas: what is composed is checked, built, and comes out as it went in."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import hypothesis.strategies as st
import pytest
from hypothesis import given
from omegaconf import OmegaConf, ValidationError

from runner.config import TARGET, build, registered, schema, snake_case, target_of, with_key
from runner.errors import ConfigError, check_range


class Side(Enum):
    """A choice."""

    left = "left"
    right = "right"


class AbstractPart(ABC):
    """Something with several forms."""

    @abstractmethod
    def size(self) -> float:
        """Return its size."""


@registered("part")
@dataclass(frozen=True)
class Rod(AbstractPart):
    """A form with a mandatory value."""

    length_m: float

    def __post_init__(self) -> None:
        check_range("length_m", self.length_m, 0.0, 10.0, unit="m")

    def size(self) -> float:
        """Return its length."""
        return self.length_m


@registered("part")
@dataclass(frozen=True)
class Disc(AbstractPart):
    """A form with defaults."""

    radius_m: float = 1.0
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def size(self) -> float:
        """Return its radius."""
        return self.radius_m


@dataclass(frozen=True)
class Box:
    """A section of fixed type."""

    mass_kg: float = 1.0
    side: Side = Side.left
    corner_m: tuple[float, float] | None = None
    tags: tuple[str, ...] = ("a",)

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 5.0, unit="kg")


@dataclass(frozen=True)
class Whole:
    """All kinds of fields."""

    seed: int
    part: AbstractPart
    box: Box
    spare: Box = Box(mass_kg=2.0)
    parts: dict[str, AbstractPart] = field(default_factory=dict)
    boxes: tuple[Box, ...] = ()
    place: Path | None = None
    share: float | None = 0.5
    either: int | str = 3


ROD = {TARGET: target_of(Rod), "length_m": 2.0}


def composed(**changes: Any) -> Any:
    """Return a typed config with its mandatory values."""
    base = OmegaConf.structured(schema(Whole))
    return OmegaConf.merge(base, {"seed": 3, "part": ROD}, changes)


def test_builds_nested_dataclasses() -> None:
    """Sections, choices, tuples, enums and paths come out as the dataclass says."""
    config = composed(
        box={"mass_kg": 4, "side": "right", "corner_m": [1, 2]},
        parts={"wheel": {TARGET: target_of(Disc), "axis": [1, 0, 0]}},
        boxes=[{"mass_kg": 0.5}, {}],
        place="/tmp/x",
        either="three",
    )
    assert build(config, Whole) == Whole(
        seed=3,
        part=Rod(2.0),
        box=Box(4.0, Side.right, (1.0, 2.0)),
        parts={"wheel": Disc(axis=(1, 0, 0))},
        boxes=(Box(0.5), Box()),
        place=Path("/tmp/x"),
        either="three",
    )


def test_defaults_are_the_dataclass_own() -> None:
    """What is not set is what the dataclass would be without configuration."""
    assert build(composed(), Whole) == Whole(seed=3, part=Rod(2.0), box=Box())


def test_schema_is_typed_and_mutable() -> None:
    """The schema refuses a wrong type at once, and its instances share no default."""
    first, second = schema(Whole)(), schema(Whole)()
    first.boxes.append(1)
    assert second.boxes == []
    config = OmegaConf.structured(schema(Whole))
    with pytest.raises(ValidationError, match="could not be converted to Float"):
        config.box.mass_kg = "heavy"
    with pytest.raises(ValidationError, match="could not be converted to Integer"):
        config.seed = 1.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"box": {"mass_kg": 6}}, r"^box\.mass_kg: must be a finite number in \[0, 5\] kg, got 6\.0\.$"),
        ({"spare": {"mass_kg": float("nan")}}, r"^spare\.mass_kg: .* got nan\.$"),
        ({"part": {"length_m": -1}}, r"^part\.length_m: must be a finite number in \[0, 10\] m, got -1\.$"),
        ({"parts": {"x": {**ROD, "length_m": 11}}}, r"^parts\.x\.length_m: .* got 11\.$"),
        ({"boxes": [{}, {"mass_kg": 7}]}, r"^boxes\[1\]\.mass_kg: .* got 7\.0\.$"),
        ({"box": {"corner_m": [1, 2, 3]}}, r"^box\.corner_m: must be a list of 2 values, got \[1\.0, 2\.0, 3\.0\]\.$"),
        ({"parts": {"x": {TARGET: "os.system", "command": "ls"}}}, r"^parts\.x\._target_: no class 'os\.system'"),
        ({"parts": {"x": {TARGET: target_of(Rod)}}}, r"^parts\.x\.length_m: a value is needed\.$"),
        ({"parts": {"x": {**ROD, "lenth_m": 1}}}, r"^parts\.x\.lenth_m: no such key\. Valid: 'length_m'\. Did you"),
    ],
)
def test_wrong_value_names_its_full_key(changes: dict[str, Any], message: str) -> None:
    """The error begins with the key from the top of the config, wherever the check was made."""
    with pytest.raises(ConfigError, match=message):
        build(composed(**changes), Whole)


def test_key_is_not_named_twice() -> None:
    """A check that names its section itself stays as it is."""
    assert with_key("scene", "scene.grid: must be ...") == "scene.grid: must be ..."
    assert with_key("remote.effects.drag", "coefficient: must be ...") == "remote.effects.drag.coefficient: must be ..."
    assert with_key("", "seed: must be ...") == "seed: must be ..."


def test_literal_is_refused_with_the_way_out() -> None:
    """A type that OmegaConf would not check can't become a schema."""

    @dataclass(frozen=True)
    class Wrong:
        mode: Literal["a", "b"] = "a"

    # the annotation is local to this test, where `get_type_hints` can't resolve names
    Wrong.__annotations__["mode"] = Literal["a", "b"]
    with pytest.raises(TypeError, match=r"Wrong\.mode: use an Enum"):
        schema(Wrong)


def test_names_in_yaml() -> None:
    """A class's name in YAML is in snake case."""
    assert snake_case("HalfCosine") == "half_cosine"
    assert snake_case("Rod2D") == "rod2_d"
    assert snake_case("Csv") == "csv"


@given(
    mass=st.floats(0, 5),
    side=st.sampled_from(Side),
    corner=st.none() | st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
    tags=st.lists(st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="$\\"), max_size=8)).map(
        tuple
    ),
    seed=st.integers(-(2**63), 2**63 - 1),
    share=st.none() | st.floats(allow_nan=False),
)
def test_written_and_read_back(
    mass: float, side: Side, corner: tuple[float, float] | None, tags: tuple[str, ...], seed: int, share: float | None
) -> None:
    """What is built, written as YAML, and read again builds the same, bit for bit."""
    whole = Whole(seed=seed, part=Rod(mass), box=Box(mass, side, corner, tags), share=share)
    config = composed(
        seed=seed,
        part={"length_m": mass},
        box={"mass_kg": mass, "side": side, "corner_m": corner and list(corner), "tags": list(tags)},
        share=share,
    )
    again = OmegaConf.merge(OmegaConf.structured(schema(Whole)), OmegaConf.create(OmegaConf.to_yaml(config)))
    assert build(config, Whole) == build(again, Whole) == whole


def test_built_is_frozen() -> None:
    """What comes out can't be changed by accident."""
    whole = build(composed(), Whole)
    with pytest.raises(dataclasses.FrozenInstanceError):
        whole.seed = 4  # ty: ignore[invalid-assignment]  # it is tested
