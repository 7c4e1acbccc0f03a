"""The vocabulary of a system: every effect that may be at work in it, bound to what it changes.

A *candidate* is an effect class and, in a mechanism, its target: `joint_friction[elbow]`. It is what the diagnosis
fits, compares and names. Several candidates may share a name: variants of one effect, one explanation to a reader.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from runner.effects.base import AbstractEffect, Effects, Parameter, Scope, Vector
from runner.errors import RecordingError, nearest

ALL = "*"  # in the place of a target: all of a kind


@dataclass(frozen=True)
class Candidate:
    """An effect that may be at work: its class, and what it would change (None: there is nothing to choose).

    With `targets` it changes all of those by the same numbers: one cause, as the supply of all servos. `target` is then
    the first of them, by whose measure the numbers are. `sole` says that there is no other target of that kind.
    """

    effect: type[AbstractEffect]
    target: str | None = None
    targets: tuple[str, ...] = ()
    sole: bool = field(default=False, compare=False)

    @property
    def name(self) -> str:
        """The word of a verdict: `friction`, `joint_friction[elbow]`, `servo_gain[*]`."""
        shown = ALL if self.targets else self.target
        return self.effect.name if shown is None else f"{self.effect.name}[{shown}]"

    @property
    def each(self) -> tuple[Candidate, ...]:
        """The same effect on each target by itself."""
        return tuple(Candidate(self.effect, target) for target in self.targets) or (self,)

    @property
    def part(self) -> str | None:
        """What it changes of all that there is of its kind; None: all of it."""
        return None if self.targets or self.sole else self.target

    @property
    def like(self) -> frozenset[str]:
        """The names of the effect and of those that no recording tells from it."""
        return frozenset({self.effect.name, *(o.name for o in self.effect.confounded)})

    def may_join(self, held: Iterable[Candidate]) -> bool:
        """Whether it may stand beside others: it is none of them, nor one that can't be told from them."""
        for other in held:
            alike = self.effect.name in other.like or other.effect.name in self.like
            if alike and (self._shares_a_target_with(other) or self.part == other.part):
                return False
        return True

    def overlaps(self, other: Candidate) -> bool:
        """Whether both are the same effect, and on a target that is the same."""
        return self.effect is other.effect and self._shares_a_target_with(other)

    def _shares_a_target_with(self, other: Candidate) -> bool:
        return not {c.target for c in self.each}.isdisjoint(c.target for c in other.each)

    @property
    def key(self) -> tuple[str, str]:
        """What candidates are sorted by where their order must not matter."""
        return self.effect.__name__, ALL if self.targets else self.target or ""

    def parameters(self, context: Scope) -> tuple[Parameter, ...]:
        """Describe the fitted vector, in a system of which this is known."""
        return self.effect.parameters(context.at(self.target))

    def units(self, context: Scope) -> dict[str, str]:
        """Return the unit of each of its numbers, by name; "" for a pure one."""
        return dict(self.effect.units(context.at(self.target)))

    def make(self, x: Vector, context: Scope) -> Effects:
        """Make the effect from its fitted vector: one on each target."""
        return tuple(self.effect.from_vector(x, context.at(c.target)) for c in self.each)

    def with_values(self, values: Mapping[str, float]) -> AbstractEffect:
        """Make the effect from its physical values, by name."""
        target = {} if self.target is None else {"target": self.target}
        return self.effect(**target, **values)

    def starts(self, context: Scope) -> np.ndarray:
        """Return vectors to start a fit from, (K, p); empty: zero will do."""
        return self.effect.starts(context.at(self.target))

    def is_placed(self, context: Scope) -> bool:
        """Whether it has a place or a range that a fit may begin beside: it then starts from several vectors."""
        return len(self.starts(context)) > 0

    def scan(self, context: Scope) -> np.ndarray:
        """Return values of the first parameter, (K,), that are looked at before a fit begins; empty: none."""
        return self.effect.scan(context.at(self.target))

    def sizes(self, context: Scope) -> np.ndarray:
        """Return vectors that tell what the effect does, (K, p), beside its derivatives; empty: those tell."""
        return self.effect.sizes(context.at(self.target))

    def elsewhere(self, x: np.ndarray, context: Scope) -> np.ndarray:
        """Return vectors, (K, p), that do nearly the same and lie beyond what a descent from `x` may reach."""
        return self.effect.elsewhere(x, context.at(self.target))


@dataclass(frozen=True)
class Vocabulary:
    """All candidates of a system, in a fixed order.

    Args:
        candidates: What a verdict may name.
        outside: What it has no word for, yet is weighed lest it be taken for what has one: then it is `unknown`.
        uncertain: What every owner has slightly wrong and nobody asks for: never fitted, part of any mismatch.
        ruled_out: What the owner knows not to be the case: it has a word, and is never fitted.
    """

    candidates: tuple[Candidate, ...]
    outside: tuple[Candidate, ...] = ()
    uncertain: tuple[Candidate, ...] = ()
    ruled_out: tuple[Candidate, ...] = ()

    def __iter__(self) -> Iterator[Candidate]:
        return iter(self.candidates)

    def __len__(self) -> int:
        return len(self.candidates)

    @cached_property
    def by_name(self) -> dict[str, tuple[Candidate, ...]]:
        """The variants of each name, in order."""
        out: dict[str, tuple[Candidate, ...]] = {}
        for candidate in (*self.candidates, *self.outside, *self.ruled_out):
            out[candidate.name] = (*out.get(candidate.name, ()), candidate)
        return out

    @cached_property
    def each_by_name(self) -> dict[str, tuple[Candidate, ...]]:
        """The same of effects as a model holds them: of what all of a kind share, one for each of its targets."""
        out = dict(self.by_name)
        for candidate in (*self.candidates, *self.outside, *self.ruled_out):
            for one in candidate.each if candidate.targets else ():
                if one not in out.get(one.name, ()):
                    out[one.name] = (*out.get(one.name, ()), one)
        return out

    def without(self, names: Iterable[str], where: Path | None) -> Vocabulary:
        """Return it without effects that the owner knows not to be the case.

        A name without its target is that of all of them. Where one target is known, the same number on all of a kind is
        ruled out, too.

        Args:
            names: As a verdict has them.
            where: The file that names them; None: there is none.

        Raises:
            RecordingError: If a name is none of a verdict: the file, its key, the name, what is allowed.
        """
        out = set[Candidate]()
        for name in names:
            meant = {c for c in self.candidates if name in (c.name, c.effect.name)}
            if not meant:
                file, kind = "" if where is None else f"{where}: ", name.partition("[")[0]
                # of a kind that there is, its targets; else the kinds, each of which is short for all of its targets
                valid = {c.name for c in self if c.effect.name == kind} or {c.effect.name for c in self}
                raise RecordingError(f"{file}known: no effect '{name}' here. {nearest(name, valid)}")
            out |= {c for c in self.candidates if any(c.overlaps(other) for other in meant)}
        return replace(
            self,
            candidates=tuple(c for c in self.candidates if c not in out),
            ruled_out=(*self.ruled_out, *(c for c in self.candidates if c in out)),
        )

    def units(self, name: str, context: Scope) -> dict[str, str]:
        """Return the unit of each number that an effect of this name may have; "" for a pure one."""
        return {number: unit for c in self.each_by_name[name] for number, unit in c.units(context).items()}

    def of(self, effect: AbstractEffect) -> Candidate:
        """Return the candidate that an effect was made from."""
        target = getattr(effect, "target", None)
        variants = self.each_by_name[effect.full_name]
        return next(c for c in variants if c.effect is type(effect) and c.target == target and not c.targets)


def spoken(effect: str) -> str:
    """Return the name of an effect as it is read: `joint friction of elbow`, and `joint friction of all`."""
    name, bracket, target = effect.partition("[")
    # the name of a target is the owner's own, underscores and all
    if target == f"{ALL}]":
        return f"{name.replace('_', ' ')} of all"
    return name.replace("_", " ") + (f" of {target.removesuffix(']')}" if bracket else "")
