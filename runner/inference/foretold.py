"""Which of the episodes that were not fitted an explanation foretells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.inference.least_squares import Fit, Fitter
from runner.numerics.arrays import FloatArray
from runner.settings import SETTINGS


def excesses(fit: Fit, fitter: Fitter) -> FloatArray:
    """Return what a fit leaves of each episode, in squared noises, (E,)."""
    return np.array([fitter.measured.excess(float(loss), [e]) for e, loss in zip(fit.episodes, fit.loss, strict=True)])


def _failing(before: Fit, after: Fit, fitter: Fitter) -> list[int]:
    """Return in which episodes, by their place, an explanation leaves most of what is plain to see, or makes it."""
    gap, left = excesses(before, fitter), excesses(after, fitter)
    plain = np.maximum(gap, left) > SETTINGS.held_out.plain_excess
    return np.flatnonzero(plain & (left > SETTINGS.held_out.most * gap)).tolist()


def astray(before: Fit, after: Sequence[Fit], fitter: Fitter, fitted: int) -> tuple[int, ...]:
    """Return the unseen episodes in which the explanation that foretells the others fails, and no other foretells all.

    Where a push starts the body by a hair, or somebody touches the machine, an episode says nothing of what is wrong
    with the model everywhere else, and by its squares it would outweigh all that do. Such episodes are few, or it is
    the explanations that are wrong.

    Args:
        before: The unseen episodes with the nominal model.
        after: The same with each explanation that holds an effect.
        fitter: Of all.
        fitted: How many episodes were fitted.
    """
    if not after:
        return ()
    best = min(after, key=lambda f: usually_left(before, f, fitter))
    off = _failing(before, best, fitter)
    # an episode in which nothing is to be explained tells nothing of explanations
    told = [
        k for k, gap in enumerate(excesses(before, fitter)) if gap > SETTINGS.held_out.plain_excess and k not in off
    ]
    few = len(off) <= min(len(told), SETTINGS.held_out.max_astray_share * (fitted + len(before.episodes)))
    # what comes near the one part by chance, and is off in others, does not foretell it
    if not few or not all(_failing(before, f, fitter) for f in after):
        return ()
    return tuple(before.episodes[k] for k in off)


def usually_left(before: Fit, after: Fit, fitter: Fitter) -> float:
    """Return which share of the gap an explanation leaves of an unseen episode: the geometric mean over them.

    A push that is about as strong as friction starts a body or does not, and one off centre turns it either way: where
    that comes out otherwise, the best of models is as far away as any. By squares such an episode outweighs all that
    are foretold to within the noise; in the mean of logarithms each has one voice.

    Args:
        before: The unseen episodes with the nominal model.
        after: The same with the explanation.
        fitter: Of both.
    """
    gap, left = excesses(before, fitter), excesses(after, fitter)
    plain, least = np.maximum(gap, left) > SETTINGS.held_out.plain_excess, SETTINGS.search.negligible_excess
    share = np.log(np.maximum(left, least) / np.maximum(gap, least))[plain]
    return float(np.exp(share.mean())) if len(share) else 0.0
