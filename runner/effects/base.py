"""What an effect is: a difference between the world and the model that somebody believes in.

One class serves three uses: planted in a simulated reality, fitted by the diagnosis, and left in the corrected model.
Its fields are physical values in SI units (and, in a mechanism, the `target` that it changes). Where it acts is told by
the methods of its kind of system, which has a base class of its own in a package below this one.

Everything about an effect stands in its one file: the class, its parameters with unit and prior, how it is put in
words, what to change and how to check it by hand, and what it is confounded with, and why.

For fitting, a class describes its parameters (`parameters`), and makes itself from a vector of them (`from_vector`).
The vector is zero, or at an end of its range, where the effect is absent, and about 1 times `scale` for a size that
one would not be surprised to meet.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from enum import IntEnum
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from runner.effects.wording import Values, listed, unit_of

Vector = Sequence[float] | np.ndarray
SIZES = np.geomspace(0.15, 4.0, 14)  # in prior widths: where a motion that jumps is looked at


class Scope(Protocol):
    """What may be known when effects describe themselves; each kind of system has its own."""

    def at(self, target: str | None) -> Any:
        """Return what is known of a target."""
        ...


@dataclass(frozen=True)
class Parameter:
    """One fitted number: its name and unit, its bounds, and the size `scale` (prior standard deviation) it has.

    `may_rest` says whether the effect is still itself with the number on a bound, as a tether without slack is. An
    amplitude there means that it is absent or out of range; a tether from far away is a constant force. What nature or
    its makers keep near nothing is `light_tailed`: it may be off by a few of its size, and is never off by ten.
    """

    name: str
    unit: str
    scale: float
    lower: float
    upper: float
    may_rest: bool = False
    light_tailed: bool = False


def longer_than_commands(constant: Parameter) -> np.ndarray:
    """Return time constants of a lag at which is looked what one does, (k, 1).

    What is longer than a command lasts takes most of it, where a small amount merely makes it late.
    """
    longer = constant.scale * np.array([4.0, 16.0])
    return longer[longer < constant.upper, None]


@dataclass(frozen=True)
class Phrase:
    """An effect in words.

    Args:
        what: What is the case, a clause without a capital letter and without numbers.
        amount: By how much, with standard errors; empty: there is nothing to add.
        remedy: What to change in a simulator, a sentence.
        check: How to confirm it without a simulator, a sentence.
        amount_of_all: By how much, where all targets have it and not the same is believed of each; empty: `amount`.
    """

    what: str
    amount: str
    remedy: str
    check: str
    amount_of_all: str = ""


@dataclass(frozen=True)
class Confounded:
    """Another effect that such recordings can't tell from this one, whatever the method.

    Args:
        name: The other's name.
        why: In which way both move the object alike.
        advice: What would tell them apart, a sentence.
    """

    name: str
    why: str
    advice: str


class Stage(IntEnum):
    """Where on the way of a signal an effect is: of several, each gets what those of earlier stages have made of it.

    A drive loses what its dead band takes, multiplies what is left, and exerts no more than its limit; that acts in
    some direction and at some place, and comes late. What else pushes is none of its doing. Effects of one stage may
    act in any order. What a mechanism's actuator multiplies and limits it does inside the engine, after all of this.
    What is attached to a body comes to whatever that weighs by itself.
    """

    DEAD_BAND = 0
    GAIN = 1
    LIMIT = 2
    APPLICATION = 3  # the direction and the place that it acts in, or the zero that it is counted from
    TIMING = 4
    BESIDES = 5
    ATTACHED = 6


class AbstractEffect(ABC):
    """A difference between world and model; see the module's docstring."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]  # every effect is a dataclass
    name: ClassVar[str]
    label: ClassVar[str]  # in words, for reports
    structural: ClassVar[bool] = False  # changes the MJCF, so that the model must be compiled anew
    of_sensor: ClassVar[bool] = False  # what moves is as believed, what is reported of it is not
    # one of many that span the workspace: at one place it leaves what the simulator has wrong at the others
    texture: ClassVar[bool] = False
    # a first parameter smaller than that is not told from the unevenness of everything
    detection_limit: ClassVar[float] = 0.0
    discontinuous: ClassVar[bool] = False  # at some values of its first parameter the motion jumps: a push fails
    amplitudes: ClassVar[int] = (
        1  # of what has a place or a range: so many first numbers are all zero where it is absent
    )
    switch: ClassVar[bool] = False  # is there or is not: no part of it means anything
    rough_form: ClassVar[bool] = False  # engines have other laws for it, none of which is the true one
    shared: ClassVar[bool] = False  # may be one thing on all targets of a kind, by the same numbers
    stage: ClassVar[Stage] = Stage.BESIDES  # of what is commanded, measured or weighed, if it changes that
    commonness: ClassVar[int] = 1  # among effects that can't be told apart the least of these stands for the rest
    confounded: ClassVar[tuple[Confounded, ...]] = ()
    # of several variants of a name: the entry of an answer's true values that speaks of this one
    spoken_of: ClassVar[tuple[str, str] | None] = None

    @classmethod
    @abstractmethod
    def parameters(cls, context: Any) -> tuple[Parameter, ...]:
        """Describe the fitted vector."""

    @classmethod
    @abstractmethod
    def from_vector(cls, x: Vector, context: Any) -> Self:
        """Make the effect from its fitted vector."""

    @classmethod
    def starts(cls, context: Any) -> np.ndarray:
        """Return vectors to start a fit from, (K, p); empty: zero will do, the effect is smooth there."""
        return np.empty((0, len(cls.parameters(context))))

    @classmethod
    def scan(cls, context: Any) -> np.ndarray:
        """Return values of the first parameter, (K,), ascending, that are looked at before a fit begins; empty: none.

        Where the motion jumps or resonates with that value, what is left has many valleys, each narrower than a linear
        model could tell: the fit begins at the value that leaves least.
        """
        scale = cls.parameters(context)[0].scale if cls.discontinuous else 0.0
        return SIZES * scale if scale else np.empty(0)

    @classmethod
    def sizes(cls, context: Any) -> np.ndarray:
        """Return vectors that tell what the effect does where its derivative at zero does not, (K, p); empty: it does.

        A command that is held from sample to sample and comes late by less than one hardly changes what is sampled.
        """
        return np.empty((0, len(cls.parameters(context))))

    @classmethod
    def elsewhere(cls, x: Vector, context: Any) -> np.ndarray:
        """Return vectors, (K, p), that do nearly the same as `x` and lie beyond what a descent from there may reach."""
        return np.empty((0, len(cls.parameters(context))))

    @classmethod
    def phrase(cls, of: Values, beliefs: Any, target: str | None = None) -> Phrase:
        """Put the effect with fitted values into words.

        Args:
            of: The values, with their standard errors.
            beliefs: What the owner believes of the object: `beliefs` of its system.
            target: What it changes, in a mechanism.
        """
        amount = listed([f"{name} {of.show(name)}" for name in of.values])
        at = f" of '{target}'" if target else ""
        added = f"{cls.label}{at}"
        return Phrase(added, amount, f"Add {added}: {amount}." if amount else f"Add {added}.", "")

    @classmethod
    def units(cls, context: Any) -> Mapping[str, str]:
        """Return the unit of each of its numbers, by name, "" for a pure one; by default what the name ends on."""
        return {f.name: unit_of(f.name) for f in fields(cls) if f.name != "target"}

    @property
    def full_name(self) -> str:
        """The word of a verdict for it: the name, with its target where it has one."""
        target = getattr(self, "target", None)
        return self.name if target is None else f"{self.name}[{target}]"

    def report(self) -> Mapping[str, float]:
        """The effect's values by name, SI units."""
        return {f.name: float(getattr(self, f.name)) for f in fields(self) if f.name != "target"}


Effects = tuple[AbstractEffect, ...]
E = TypeVar("E", bound=AbstractEffect)


def corrected_here(effects: Iterable[AbstractEffect]) -> list[str]:
    """Return in a sentence, for the first lines of a model, which effects it has in it; none: there are none.

    Some look like nothing that they are: drag of the air is the coefficients of a geom that nobody sees.
    """
    told = [
        f"{e.full_name} ({', '.join(f'{name} {value:.4g}' for name, value in e.report().items())})" for e in effects
    ]
    return [f"Corrected here, in SI units: {'; '.join(told)}."] if told else []


def in_stages(effects: Iterable[E]) -> tuple[E, ...]:
    """Return effects in the order in which a signal passes them, whatever the order in which they were named."""
    return tuple(sorted(effects, key=lambda e: e.stage))
