"""What a diagnosis says, as one value: headline, tiles, text, ranking and figures of a report are all made of it.

The sentences themselves are put together in `runner.report.words`.

A diagnosis holds several figures of what is left once the best explanation is in the model: how much of the gap closed
on episodes that were not fitted, what the residual has beyond the noise, whether it has a memory. Each alone may sound
like another answer; which of them decides is settled here, once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from runner.importing.record import called
from runner.systems.recorded import longest_part_s

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Ranked

NONE, UNKNOWN = "none", "unknown"
HALF = 0.5  # an explanation less likely than that is not an answer
OVER = 0.05  # squared noises that the nominal model leaves: less is not worth a word
TRACE = 0.25  # of the noise's mean square: 12 % in the root of it is as good as noise
NOISY = 3.0  # noise levels missed as believed: of less, a good part is noise, which nothing takes away


class Kind(Enum):
    """What sort of answer it is."""

    NONE = "none"
    UNKNOWN = "unknown"
    FOUND = "found"
    OPEN = "open"  # the likeliest explanation is less likely than all others together


class Left(Enum):
    """What the best model leaves of the gap."""

    NOISE = "noise"
    SMALL_ERRORS = "small errors"  # such as any simulator has: more than the noise, and nothing to act on
    DRIVE = "drive"  # the noise of a force that was measured, and is replayed with it
    SOMETHING = "something"  # that is not in the model


@dataclass(frozen=True)
class Statement:
    """What is said of a recording.

    Args:
        kind: The sort of answer.
        order: All explanations, likeliest first.
        corrected: Whether there is a corrected model, so that before and after differ.
        gap_closed: Share of what is missed that the named explanation takes away, where it is known, and where anything
            is missed beyond the noise.
        interval: The 95 % interval of that, where it is known.
        closable_closed: Share of what can be closed (what is missed less the noise, mean squares), where it is known.
        noises: What is missed of those episodes as believed and corrected, noise included, root mean squares in noise
            levels; None: not known.
        fitted_closed: As `closable_closed`, of the episodes that were fitted; None: they show no gap either.
        held_out: Whether all but the last are of episodes that were not fitted.
        stretch_s: Over how long the model is replayed; None: over whole episodes.
        left: What is left by the best model.
        over_noise: How much more than the noise that is on episodes that were not fitted, or on those that were where
            that is more: root mean squares, as a share of the noise's.
        in_fitted: Whether it is left of episodes that were fitted alone: those that were not leave the noise.
        mostly_in: The episode that leaves more than half of it, as it is told to a reader; None: there is none.
    """

    kind: Kind
    order: tuple[Ranked, ...]
    corrected: bool
    gap_closed: float | None
    interval: tuple[float, float] | None
    closable_closed: float | None
    noises: tuple[float, float] | None
    fitted_closed: float | None
    held_out: bool
    stretch_s: float | None
    left: Left
    over_noise: float
    in_fitted: bool
    mostly_in: str | None

    @property
    def top(self) -> Ranked:
        """The likeliest explanation."""
        return self.order[0]

    @property
    def named(self) -> tuple[Ranked, ...]:
        """The explanations that name effects, likeliest first."""
        return tuple(r for r in self.order if r.effects and r.effects[0] not in (NONE, UNKNOWN))

    def shown(self, most: int) -> tuple[tuple[Ranked, ...], tuple[Ranked, ...]]:
        """Return the likeliest explanations, and those that are summed up, which are two or more."""
        count = len(self.order) if len(self.order) == most + 1 else most
        return self.order[:count], self.order[count:]

    @property
    def closes_nothing_seen(self) -> bool:
        """Whether the episodes that were not fitted show no gap that could be closed.

        So it is of tosses that are replayed a third of a second at a time: most of that is flight.
        """
        return self.held_out and self.noises is not None and self.noises[0] ** 2 < 1.0 + TRACE

    @property
    def noisy(self) -> bool:
        """Whether what is missed of them as believed is in good part noise, so that its share says little by itself."""
        return self.noises is not None and self.noises[0] < NOISY

    @property
    def settled(self) -> bool:
        """Whether the likeliest explanation names effects that one can put into a simulator."""
        return self.kind in (Kind.FOUND, Kind.OPEN)

    def closed_by(self, ranked: Ranked) -> float | None:
        """Return the share of the gap that an explanation takes away; None: it is not known, or there is no model."""
        if tuple(ranked.effects) == (UNKNOWN,):
            return None
        return self.gap_closed if ranked is self.top and self.settled else _known(ranked.gap_closed)


def state(diagnosis: Diagnosis) -> Statement:
    """Return what a diagnosis says."""
    order = tuple(sorted(diagnosis.ranked, key=lambda r: -r.probability))
    kind = _kind(order[0])
    named = [r for r in order if r.effects and r.effects[0] not in (NONE, UNKNOWN)]
    closure = diagnosis.closure
    gap_closed = {
        Kind.NONE: None,
        Kind.UNKNOWN: _known(named[0].gap_closed) if named and diagnosis.effects else None,
    }.get(kind, _known(diagnosis.gap_closed))
    # the interval is that of the corrected model, which need not be what is named
    same = gap_closed is not None and gap_closed == diagnosis.gap_closed
    low, high = _known(closure.gap_closed_low), _known(closure.gap_closed_high)
    left, over_noise, in_fitted = _left(diagnosis, kind)
    found = Statement(
        kind=kind,
        order=order,
        corrected=bool(diagnosis.effects),
        gap_closed=gap_closed,
        interval=(low, high) if same and low is not None and high is not None else None,
        closable_closed=_share(closure.closable_closed) if same else None,
        noises=_noises(closure.table),
        fitted_closed=_fitted_closed(diagnosis),
        held_out=bool(diagnosis.held_out),
        stretch_s=longest_part_s(diagnosis.recording, diagnosis.stretches),
        left=left,
        over_noise=math.sqrt(1.0 + over_noise) - 1.0,
        in_fitted=in_fitted,
        mostly_in=_mostly(diagnosis) if left is Left.SOMETHING else None,
    )
    none = found.closes_nothing_seen
    return replace(found, gap_closed=None, interval=None, closable_closed=None) if none else found


def _share(value: float) -> float | None:
    """Return a share, at most all: what is left may by chance be less than the noise."""
    known = _known(value)
    return None if known is None else min(known, 1.0)


def _noises(table: pd.DataFrame) -> tuple[float, float] | None:
    """Return what is missed of all channels, as believed and corrected, in noise levels."""
    if not len(table):
        return None
    before, after = ((table[c].to_numpy(float) / table["noise"].to_numpy(float)) ** 2 for c in ("before", "after"))
    return math.sqrt(float(np.nanmean(before))), math.sqrt(float(np.nanmean(after)))


def _fitted_closed(diagnosis: Diagnosis) -> float | None:
    gap = diagnosis.nominal_excess
    return min(1.0 - diagnosis.excess / gap, 1.0) if gap > TRACE else None


def _kind(top: Ranked) -> Kind:
    if not top.effects or tuple(top.effects) == (NONE,):
        return Kind.NONE
    if tuple(top.effects) == (UNKNOWN,):
        return Kind.UNKNOWN
    return Kind.OPEN if top.probability < HALF else Kind.FOUND


def _left(diagnosis: Diagnosis, kind: Kind) -> tuple[Left, float, bool]:
    """Return what is left, how much beyond the noise's mean square, and whether of fitted episodes alone.

    `excess` decides whether it has a cause of its own: in it the small errors that any simulator makes are taken out.
    """
    if kind is Kind.NONE:
        over = diagnosis.nominal_excess
        small = Left.DRIVE if OVER < over <= diagnosis.drive_excess else Left.SMALL_ERRORS
        return (Left.NOISE if over < OVER else small), max(over, 0.0), False
    unseen = _unseen_excess(diagnosis)
    if kind is not Kind.UNKNOWN and TRACE < max(unseen, diagnosis.excess) <= diagnosis.drive_excess:
        return Left.DRIVE, max(unseen, diagnosis.excess), False
    if diagnosis.excess > TRACE or kind is Kind.UNKNOWN:
        in_fitted = bool(diagnosis.held_out) and unseen <= TRACE < diagnosis.excess
        return Left.SOMETHING, max(unseen, diagnosis.excess), in_fitted
    return (Left.NOISE if unseen <= TRACE else Left.SMALL_ERRORS), unseen, False


def _mostly(diagnosis: Diagnosis) -> str | None:
    """Return the episode that leaves more than half of what all leave beyond the noise, as it is told to a reader."""
    beyond = {e: max(of, 0.0) for e, of in diagnosis.left_by_episode.items()}
    most = max(beyond, key=beyond.__getitem__, default=None)
    if most is None or len(beyond) < 2 or not beyond[most] > HALF * sum(beyond.values()):
        return None
    return called(diagnosis.recording.path, most)


def _unseen_excess(diagnosis: Diagnosis) -> float:
    """Return the mean square of what is left of episodes that were not fitted, beyond the noise's, at least 0."""
    noises = _noises(diagnosis.closure.table)
    return max(diagnosis.excess, 0.0) if noises is None else max(noises[1] ** 2 - 1.0, 0.0)


def _known(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def doubts(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what speaks against the numbers of the answer, where it has any."""
    return diagnosis.doubts if state(diagnosis).settled else ()


def caveats(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what else a reader should know before believing the figures."""
    own = (*(() if doubts(diagnosis) else diagnosis.doubts), *diagnosis.notes, *diagnosis.recording.notes)
    return tuple(dict.fromkeys(f"{note.rstrip('.')}." for note in own))
