"""Which of the episodes that were not fitted an explanation foretells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.inference.least_squares import Fit, Fitter
from runner.numerics.arrays import FloatArray

PLAIN, LEAVES = 1.0, 0.5  # squared noises; share of them
TOLD = 0.1  # of what is plain: less than that is as good as nothing
FEW = 0.2  # of all episodes, fitted ones too: so many may go astray


def _excesses(fit: Fit, fitter: Fitter) -> FloatArray:
    """Return what a fit leaves of each episode, in squared noises, (E,)."""
    return np.array([fitter.measured.excess(float(loss), [e]) for e, loss in zip(fit.episodes, fit.loss, strict=True)])


def astray(before: Fit, after: Sequence[Fit], fitter: Fitter, fitted: int) -> tuple[int, ...]:
    """Return the unseen episodes that none of the explanations foretells while one of them foretells the others.

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
    gap, left = _excesses(before, fitter), np.array([_excesses(f, fitter) for f in after])
    plain = np.maximum(gap, left) > PLAIN
    off = np.flatnonzero((plain & (left > LEAVES * gap)).all(axis=0))
    told = [k for k in range(len(gap)) if k not in off]
    if not len(off) or len(off) > min(len(told), FEW * (fitted + len(gap))):
        return ()
    best = min((f.of(told) for f in after), key=lambda f: f.total)
    return tuple(before.episodes[k] for k in off) if usually_left(before.of(told), best, fitter) <= LEAVES else ()


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
    gap, left = _excesses(before, fitter), _excesses(after, fitter)
    plain = np.maximum(gap, left) > PLAIN
    least = TOLD * PLAIN
    share = np.log(np.maximum(left, least) / np.maximum(gap, least))[plain]
    return float(np.exp(share.mean())) if len(share) else 0.0
