"""Sentences for the case that no known effect explains a recording: what comes near, what is left, how that looks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from runner.effects.wording import listed, number, percent
from runner.report import words
from runner.report.statement import HALF, state

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Nearest
    from runner.localise.likeness import Likeness

STANDS_OUT = 1.5  # times an even share of what is left: a channel with less is like the others
PLAIN = 0.5  # share of the gap: who leaves more of it on unseen episodes does not hold there
LEAST_BEHIND = 1.0  # natural log odds that are worth a word
LOOKS = 3  # forces whose looks are told


def lines(diagnosis: Diagnosis) -> list[str]:
    """Return all of it, a line each; none where something else is the answer."""
    near, looking = nearest(diagnosis), looks(diagnosis)
    said = [f"Near it comes: {text}" for text in near] + [left(diagnosis)]
    return [text for text in (*said, *(f"Missing beside it: {text}" for text in looking)) if text]


def nearest(diagnosis: Diagnosis) -> list[str]:
    """Return for each explanation that comes near what it would be, what it closes, and what speaks against it."""
    found = diagnosis.abstention
    return [] if found is None else [_nearest(diagnosis, one) for one in found.nearest]


def _nearest(diagnosis: Diagnosis, one: Nearest) -> str:
    # told as the gap that closes is; whether it holds is told by what is left beyond the noise
    against = [f"it leaves {percent(1.0 - one.fitted_closed)} of what is missed where it was fitted"]
    if one.left_unseen > max(PLAIN, 1.5 * one.left_fitted):
        left = f"{percent(1.0 - one.gap_closed)} is left there"
        worse = "more is missed there than without it" if one.gap_closed < 0.0 else left
        against.append(f"it does not hold on episodes that were not fitted: {worse}")
    if one.behind > LEAST_BEHIND:
        against.append(f"it is {number(one.behind, 2)} natural log units less likely than the first")
    if one.unsure:
        verb = "does not stand out of its own error" if len(one.unsure) == 1 else "do not stand out of their own errors"
        against.append(f"{words.title(one.unsure)} {verb}")
    text = words.explanation(diagnosis.system, one.ranked)
    closed = "does not come closer" if one.gap_closed < words.LEAST_SHARE else f"misses {percent(one.gap_closed)} less"
    return (
        f"{text[0].upper()}{text[1:]}. With that the simulator {closed} on episodes that were not fitted. "
        f"Against it: {listed(against)}."
    )


def left(diagnosis: Diagnosis) -> str:
    """Return how much the nearest explanation leaves of unseen episodes, and where; empty: nothing."""
    said = state(diagnosis)
    if diagnosis.abstention is None or not said.corrected or said.over_noise < words.LEAST_SHARE:
        return ""
    return f"With the nearest, what is left is {words.beyond(said)}{_most_left(diagnosis)}."


def _most_left(diagnosis: Diagnosis) -> str:
    """Return which channel has most of what is left on unseen episodes, and its share; empty: none stands out."""
    table = diagnosis.closure.table
    channels = diagnosis.system.channels
    if len(channels) < 2 or not len(table):
        return ""
    left = (table["after"].to_numpy(float) / table["noise"].to_numpy(float)) ** 2 - 1.0
    of = table["channel"].to_numpy()
    over = {c.label: float(np.maximum(left[of == c.name], 0.0).mean()) for c in channels if (of == c.name).any()}
    if not sum(over.values()) > 0:
        return ""
    label = max(over, key=over.__getitem__)
    share = over[label] / sum(over.values())
    if share < STANDS_OUT / len(over):
        return ""
    return f", {'most' if share > HALF else 'the largest part'} of it in the {label} ({percent(share)})"


def looks(diagnosis: Diagnosis) -> list[str]:
    """Return what the forces look like that are missing beside the nearest explanation, the largest first."""
    found = diagnosis.abstention
    return [] if found is None else [_look(one) for one in found.looks[:LOOKS]]


def _look(one: Likeness) -> str:
    what, _, unit = one.label.removesuffix("]").partition(" [")
    size = f"{what[0].upper()}{what[1:]}: {number(one.rms, 2)} {unit} is missing (root mean square)".replace("  ", " ")
    if not one.alike:
        return f"{size}, and goes along with nothing that was looked at."
    parts = listed([f"{words_of} ({percent(share)})" for words_of, share in one.alike])
    return f"{size}. It goes along with {parts}."
