"""What helps where no explanation holds: the nearest, what speaks against each, and what is left by the first."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from runner.diagnosis.closure import close
from runner.diagnosis.ranking import contender_of
from runner.diagnosis.result import Abstention, Nearest, Ranked
from runner.effects.base import Effects
from runner.inference.doubts import unsure_effects
from runner.inference.held_out import Confirmed
from runner.inference.least_squares import Fitter
from runner.inference.unseen import unseen
from runner.localise.likeness import likenesses
from runner.localise.where import Where, localise
from runner.noise.measured import Measured
from runner.recording import Span

NEAREST_SHOWN = 2


def abstention(
    ranked: Sequence[Ranked],
    confirmed: Confirmed,
    fitter: Fitter,
    where: Where,
    corrected: tuple[Effects, Measured, Mapping[int, np.ndarray], Sequence[Span]],
) -> Abstention | None:
    """Return what helps where the first answer is `unknown`; None: it is another.

    Args:
        ranked: All explanations, likeliest first.
        confirmed: The search, held against the episodes left out.
        fitter: Of the stretches that were searched.
        where: Where the nominal model misses.
        corrected: What the corrected model holds, channels and noise of whole episodes, the start states of stretches
            with it, by position, and the stretches.
    """
    if ranked[0].effects != ("unknown",):
        return None
    named = [r for r in ranked if r.effects not in (("unknown",), ("none",))]
    effects, measured, starts, stretches = corrected
    after = localise(fitter.system, measured, starts, effects, stretches=stretches) if effects else where
    looks = likenesses(fitter.system, after.missing_force)
    return Abstention(tuple(_nearest(r, named[0], confirmed, fitter) for r in named[:NEAREST_SHOWN]), after, looks)


def _nearest(ranked: Ranked, first: Ranked, confirmed: Confirmed, fitter: Fitter) -> Nearest:
    """Return what an explanation closes, what it leaves, and what else speaks against it."""
    found, before = confirmed.search, confirmed.before
    contender = contender_of(found, ranked, fitter.context)
    there = confirmed.after.get(id(contender.fit)) or unseen(contender, fitter, before.episodes, before)
    # of what no explanation comes near, no figure tells
    told = [k for k, e in enumerate(before.episodes) if e not in confirmed.astray]
    starts = {before.episodes[k]: (before.starts[k], there.starts[k]) for k in told}
    closed = close(
        starts, fitter.measured, fitter, contender.fit.explanation.make(contender.fit.x, fitter.context), pd.DataFrame()
    )
    excess = fitter.measured.excess
    gap, left = (excess(f.total, f.episodes) for f in (found.nominal, contender.fit))
    gap_unseen, left_unseen = (excess(float(f.loss[told].sum()), list(starts)) for f in (before, there))
    return Nearest(
        ranked,
        closed.gap_closed,
        1.0 - math.sqrt(contender.fit.total / found.nominal.total),
        max(left, 0.0) / max(gap, 1e-9),
        max(left_unseen, 0.0) / max(gap_unseen, 1e-9),
        contender_of(found, first, fitter.context).log_posterior - contender.log_posterior,
        unsure_effects(contender, found.contenders, fitter.context),
    )
