"""From a recording to a verdict: where the gap lies, which effect explains it, how far it shrinks."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import expit, softmax

from runner.diagnosis.next_experiment import best_experiment
from runner.effects.base import Effects, Scope
from runner.effects.vocabulary import Vocabulary
from runner.errors import RecordingError
from runner.inference.breakaway import hanging
from runner.inference.confounding import Rival, rivals
from runner.inference.evidence import directions, normal_equations, sensitivities
from runner.inference.held_out import Confirmed, confirm, unseen
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.multiple_shooting import look
from runner.inference.outside import is_outside, said_of_outside, with_outside
from runner.inference.search import RESTED, Contender, Search, are_confounded, resumed, search
from runner.localise.where import Where, check_length, closure_by_regime, localise
from runner.noise.measured import Measured, materially_different, measure, refine
from runner.systems.base import AbstractSimulator, AbstractSystem, Recorded, Run

HELD_OUT = 2  # by the convention of the format, the last two episodes check the explanation
TEMPER = 2.0  # log odds are divided by it, against overconfidence; not yet calibrated
UNKNOWN_EXCESS = 0.12  # see `_unknown`; known effects of tuning and practice cases left up to 0.09
UNKNOWN_SHARE = 0.0025
UNKNOWN_WIDTH = 0.4
# see `strained`: level of mismatch (base 2 log), from which on, how sharply; what is left, of the noise and of the gap
STRAINED, STRAINED_WIDTH = 2.5, 0.25
STRAINED_LEFT, STRAINED_SHARE, STRAINED_LEFT_WIDTH = 0.05, 0.02, 0.3
SOMETHING, SOMETHING_WIDTH = 0.45, 0.15  # see `not_none`; in null cases of tuning sets the gap was 0.40 at most
FAILED = 0.7  # where the best explanation does not close half of a plain gap in episodes it has not seen
MOST_UNKNOWN = 0.97
LEAST_UNKNOWN = 0.03  # of unknown effects some look like known ones, as wear does like a patch
EQUAL = 0.05  # of the likeliest of a group: what is less likely is not its equal
# By the plain theory 97 % of 235 planted values of two sets lay within 1.96 standard errors and half within 0.2 of
# one: the mismatch is charged in full to every parameter. With so much of it, 95 % do.
CHARGED = 0.8
SURPRISE = 3.0  # times what is left of the fitted episodes: so much in those left out is something new


@dataclass(frozen=True)
class Ranked:
    """One explanation, with what these data can't tell from it.

    Args:
        effects: The vocabulary's names; ("none",) and ("unknown",) are explanations too.
        equivalent: Other sets of names that explain the recording as well; the probability is that of all together.
        probability: Of this explanation, or one of its equivalents; all sum to 1.
        values: The effects with their fitted values.
        parameters: Values by effect and parameter, SI units.
        errors: Their standard errors, the simulator's own inexactness included.
        gap_closed: 1 - error after / error before, on the held-out episodes; None: not computed.
        log_evidence: Natural log, relative to the best explanation; None: `unknown` has no model to weigh.
    """

    effects: tuple[str, ...]
    equivalent: tuple[tuple[str, ...], ...]
    probability: float
    values: Effects
    parameters: dict[str, dict[str, float]]
    errors: dict[str, dict[str, float]]
    gap_closed: float | None
    log_evidence: float | None


@dataclass(frozen=True)
class Closure:
    """How far the gap shrinks on the held-out episodes, start states fitted to them with either model.

    `table`: one row per episode and channel: root mean square before and after, in the channel's unit and in noises.
    `regimes`: the same by what went on, see `closure_by_regime`. The interval is over episodes and blocks of a second
    (percentile bootstrap).
    """

    table: pd.DataFrame
    regimes: pd.DataFrame
    gap_closed: float
    gap_closed_low: float
    gap_closed_high: float
    closable_closed: float


@dataclass(frozen=True)
class Diagnosis:
    """All that `runner diagnose` says of a case; arrays and tables are not to be written to."""

    case: str
    system: AbstractSystem
    ranked: tuple[Ranked, ...]
    abstain: bool
    gap_closed: float
    effects: Effects
    fitted: tuple[int, ...]
    held_out: tuple[int, ...]
    measured: Measured
    nominal_starts: dict[int, np.ndarray]
    corrected_starts: dict[int, np.ndarray]
    where: Where
    closure: Closure
    excess: float
    nominal_excess: float
    seconds: float
    simulated_s: float
    next_push: str | None
    notes: tuple[str, ...]
    rivals: tuple[Rival, ...] = ()

    @property
    def recording(self) -> Any:
        """What was diagnosed."""
        return self.system.recording


def split(numbers: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the positions of the episodes that are fitted, and of those held out: the last by their numbers.

    Raises:
        RecordingError: If there are fewer than two.
    """
    count = len(numbers)
    if count < 2:
        raise RecordingError(
            f"a diagnosis needs at least 2 episodes, one of them to check the explanation, got {count}."
        )
    held = HELD_OUT if count > HELD_OUT + 1 else 1
    order = sorted(range(count), key=lambda i: numbers[i])
    return tuple(order[: count - held]), tuple(order[count - held :])


def diagnose(system: AbstractSystem, *, threads: int | None = None, advise: bool = True) -> Diagnosis:
    """Diagnose a recording.

    Args:
        system: What was commanded and measured, and what the owner believes.
        threads: For the simulations; None: one per core.
        advise: Whether to try what could be taken for the answer, and which push would tell; neither has a say in it.

    Raises:
        RecordingError: If it has fewer than two episodes, or too little in them.
    """
    began = time.perf_counter()
    simulator = system.simulator(threads=threads)
    recording: Recorded = system.recording
    fitted, held_out = split([e.index for e in recording.episodes])
    check_length(system)
    measured, found = _explained(system, simulator, fitted, held_out)
    fitter = Fitter(system, simulator, measured)
    confirmed = confirm(with_outside(found, fitter), fitter, held_out)
    nominal_excess = measured.excess(found.nominal.total, fitted)
    if turned := _unseen_only(confirmed, nominal_excess) and len(fitted) > len(held_out):
        fitted, held_out = (*fitted[len(held_out) :], *held_out), fitted[: len(held_out)]
        measured, found = _explained(system, simulator, fitted, held_out)
        fitter = replace(fitter, measured=measured)
        confirmed = confirm(with_outside(found, fitter), fitter, held_out)
        nominal_excess = measured.excess(found.nominal.total, fitted)
    found, before, excess = confirmed.search, confirmed.before, confirmed.excess
    if found.best.fit.x.size:
        unknown = max(_unknown(excess, nominal_excess), FAILED if confirmed.fails else 0.0)
    else:
        unknown = not_none(confirmed.gap)
    known = (1.0 - unknown) * (1.0 - strained(found.best, found.nominal, fitter))
    unknown = float(np.clip(1.0 - known, LEAST_UNKNOWN, MOST_UNKNOWN))
    ranked = rank(found, system, unknown)
    # what is named is what is put into the corrected model
    top = _contender(found, next(r for r in ranked if r.effects != ("unknown",)), fitter.context)
    after = confirmed.after.get(id(top.fit)) or unseen(top, fitter, held_out, before)
    effects = top.fit.explanation.make(top.fit.x, fitter.context)
    nominal_starts = dict(zip((*fitted, *held_out), (*found.nominal.starts, *before.starts), strict=True))
    corrected_starts = dict(zip((*fitted, *held_out), (*top.fit.starts, *after.starts), strict=True))
    where = localise(system, measured, nominal_starts)
    regimes = closure_by_regime(system, measured, held_out, effects, where.window_s)
    closure = close(before, after, measured, fitter, effects, regimes)
    abstain = ranked[0].effects == ("unknown",)
    ranked = tuple(
        Ranked(**{**vars(r), "gap_closed": closure.gap_closed if r.values == effects else r.gap_closed}) for r in ranked
    )
    return Diagnosis(
        case=recording.path.name,
        system=system,
        ranked=ranked,
        abstain=abstain,
        gap_closed=closure.gap_closed,
        effects=effects,
        fitted=fitted,
        held_out=held_out,
        measured=measured,
        nominal_starts=nominal_starts,
        corrected_starts=corrected_starts,
        where=where,
        closure=closure,
        excess=excess,
        nominal_excess=nominal_excess,
        seconds=time.perf_counter() - began,
        simulated_s=simulator.simulated_s,
        next_push=next_push(ranked, found, fitter, threads) if advise else None,
        rivals=found_rivals(top, fitter) if advise else (),
        notes=notes(recording, measured, top, excess, held_out, turned=turned, outside=said_of_outside(found, system)),
    )


def _explained(
    system: AbstractSystem, simulator: AbstractSimulator, fitted: Sequence[int], held_out: Sequence[int]
) -> tuple[Measured, Search]:
    """Search for the explanation; what noise there is shows in what the best one leaves, so look twice."""
    measured = measure(system)
    nominal = Fitter(system, simulator, measured).fit(NONE, fitted, iterations=RESTED)
    measured = refine(measured, system, _left(nominal, (), simulator, measured))
    fitter = Fitter(system, simulator, measured)
    seen = look(fitter, nominal)
    if seen is not None:
        fitter = replace(fitter, measured=measured.without(seen.hung))
    found = search(fitter, fitted, starts=nominal.starts, beginning=seen and seen.beginning)
    best = found.best.fit
    if best.explanation.discontinuous:
        measured = fitter.measured.without(hanging(fitter, best))
    # without static friction nothing hangs on a breakaway, whatever the pieces suggested
    effects = best.explanation.make(best.x, system.context)
    again = refine(measured, system, _left(best, effects, simulator, measured))
    if again.hung != fitter.measured.hung or materially_different(measured, again):
        fitter = replace(fitter, measured=again)
        found = search(fitter, fitted, starts=found.nominal.starts, beginning=resumed(found, fitter))
    if not found.best.fit.explanation.discontinuous:
        return fitter.measured, found
    there = hanging(fitter, unseen(found.best, fitter, held_out, None))
    return fitter.measured.without(there), found


def _unseen_only(confirmed: Confirmed, nominal_excess: float) -> bool:
    """Whether the episodes left out show something that those which were fitted do not, or hardly."""
    if confirmed.fails and confirmed.gap_unseen > SURPRISE * max(nominal_excess, 0.0):
        return True
    seen, unseen = (_unknown(e, nominal_excess) for e in (confirmed.excess_fitted, confirmed.excess_unseen))
    return seen < 0.5 < unseen and confirmed.excess_unseen > SURPRISE * max(confirmed.excess_fitted, 0.0)


def _left(fit: Fit, effects: Effects, simulator: AbstractSimulator, measured: Measured) -> dict[int, np.ndarray]:
    """Return what a fit leaves, per episode (T, C), physical units."""
    return {
        e: simulator.predict(e, [Run(effects, start)])[0] - measured.values[e]
        for e, start in zip(fit.episodes, fit.starts, strict=True)
    }


def rank(found: Search, system: AbstractSystem, unknown: float) -> tuple[Ranked, ...]:
    """Turn log posteriors into probabilities, explanations that can't be told apart taken together."""
    context = system.context
    contenders = [c for c in found.contenders if np.isfinite(c.log_posterior)]
    logs = np.array([c.log_posterior for c in contenders]) / TEMPER
    nameless = np.array([is_outside(c, system.vocabulary) for c in contenders])
    known = float(softmax(logs)[~nameless].sum())
    unknown = min(1.0 - (1.0 - unknown) * known, MOST_UNKNOWN)
    contenders = [c for c in contenders if not is_outside(c, system.vocabulary)]
    share = softmax(logs[~nameless])
    groups: list[list[int]] = []
    for i, contender in enumerate(contenders):
        same = [g for g in groups if contender.fit.x.size and are_confounded(contenders[g[0]].fit, contender.fit)]
        if same:
            same[0].append(i)
        else:
            groups.append([i])
    out = []
    for group in groups:
        # among equals the first name in the vocabulary's order of commonness stands for the rest
        lead = min(group, key=lambda i: (share[i] < EQUAL * share[group].max(), _commonness(contenders[i].fit)))
        contender = contenders[lead]
        names = contender.fit.explanation.names or ("none",)
        others = tuple(
            dict.fromkeys(
                n
                for i in group
                if (n := contenders[i].fit.explanation.names or ("none",)) != names
                and share[i] > EQUAL * share[group].max()
            )
        )
        parameters, errors = values_of(contender, context)
        out.append(
            Ranked(
                names,
                others,
                float(share[group].sum() * (1 - unknown)),
                contender.fit.explanation.make(contender.fit.x, context),
                parameters,
                errors,
                None if contender.fit.x.size else 0.0,
                float(contender.log_posterior - contenders[0].log_posterior),
            )
        )
    # variants of one effect are one explanation to the reader
    merged: dict[tuple[str, ...], Ranked] = {}
    for r in sorted(out, key=lambda r: -r.probability):
        if r.effects in merged:
            first = merged[r.effects]
            merged[r.effects] = Ranked(**{**vars(first), "probability": first.probability + r.probability})
        else:
            merged[r.effects] = r
    merged[("unknown",)] = Ranked(("unknown",), (), unknown, (), {}, {}, None, None)
    return tuple(sorted(merged.values(), key=lambda r: -r.probability))


def _commonness(fit: Fit) -> tuple[int, ...]:
    commonness = {c.name: c.effect.commonness for c in fit.explanation.candidates}
    return tuple(commonness[name] for name in fit.explanation.names)


def _unknown(excess: float, nominal_excess: float) -> float:
    """Probability that none of the explanations holds, from what the best one leaves behind.

    A logistic in the log of the residual's excess over the noise, which is held against a fixed share of the noise and
    a small share of the gap: the larger an effect, the more of it small errors of its model leave.
    """
    allowed = UNKNOWN_EXCESS + UNKNOWN_SHARE * max(nominal_excess, 0.0)
    score = (np.log(max(excess, 1e-4)) - np.log(allowed)) / UNKNOWN_WIDTH
    return float(np.clip(expit(score), LEAST_UNKNOWN, MOST_UNKNOWN))


def not_none(gap: float) -> float:
    """Probability that something is at work where no effect is named, from what the nominal model leaves.

    In squared noises, of all episodes. How much of that small errors of the simulator could do says little: they could
    do much of what anything does.
    """
    return float(expit(np.log(max(gap, 1e-4) / SOMETHING) / SOMETHING_WIDTH))


def strained(best: Contender, nominal: Fit, fitter: Fitter) -> float:
    """Probability that none of the explanations holds, from how far the simulator must be off for the best to do so.

    Mismatch of many times the usual size can make up for a wrong explanation, and leave no excess. So where the
    evidence asks for that much, and the explanation alone leaves more of the gap than effects of the vocabulary do,
    something else is going on.
    """
    if not best.fit.x.size:
        return 0.0  # nothing is claimed
    levels = fitter.system.mismatch_levels
    left, gap = (max(fitter.measured.excess(f.total, f.episodes), 1e-4) for f in (best.fit, nominal))
    asked = float(softmax(best.evidence.level) @ np.log2(levels))
    allowed = STRAINED_LEFT + STRAINED_SHARE * gap
    return float(expit((asked - STRAINED) / STRAINED_WIDTH) * expit(np.log(left / allowed) / STRAINED_LEFT_WIDTH))


def values_of(contender: Contender, context: Scope) -> tuple[dict[str, dict[str, float]], dict[str, dict[str, float]]]:
    """Return parameters and their standard errors by effect, in physical units (the delta method)."""
    x, covariance = contender.fit.x, contender.evidence.covariance
    parameters, errors = {}, {}
    for candidate, part in contender.fit.explanation.parts(context):
        value = candidate.make(x[part], context).report()
        slopes = []
        for step in np.diag([1e-4 * p.scale for p in candidate.parameters(context)]):
            moved = candidate.make(x[part] + step, context).report()
            slopes.append([_turn(name, moved[name] - value[name]) / step.sum() for name in value])
        slope = np.array(slopes).T
        spread = slope @ covariance[part, part] @ slope.T
        parameters[candidate.name] = dict(value)
        stated = CHARGED * np.sqrt(np.maximum(np.diag(spread), 0.0))
        errors[candidate.name] = dict(zip(value, stated.tolist(), strict=True))
    return parameters, errors


def _turn(name: str, difference: float) -> float:
    """An angle's change, taken the short way round."""
    return float((difference + np.pi) % (2 * np.pi) - np.pi) if name.endswith("_rad") else difference


def close(
    before: Fit, after: Fit, measured: Measured, fitter: Fitter, effects: Effects, regimes: pd.DataFrame
) -> Closure:
    """Compare residuals of the held-out episodes without and with the effects."""
    rows, pairs, episode = [], [], []
    for k, e in enumerate(before.episodes):
        truth = measured.values[e]
        old = fitter.simulator.predict(e, [Run((), before.starts[k])])[0] - truth
        new = fitter.simulator.predict(e, [Run(effects, after.starts[k])])[0] - truth
        old, new = (np.where(measured.valid[e], r, np.nan) for r in (old, new))
        rows += [
            {
                "episode": fitter.system.recording.episodes[e].index,
                "channel": channel.name,
                "unit": channel.unit,
                "before": float(np.sqrt(np.nanmean(old[:, i] ** 2))),
                "after": float(np.sqrt(np.nanmean(new[:, i] ** 2))),
                "noise": float(measured.sigma[i]),
            }
            for i, channel in enumerate(fitter.system.channels)
        ]
        block = max(int(1.0 / fitter.system.recording.episodes[e].step_s), 1)
        for begin in range(0, len(truth), block):
            square = [np.nanmean((r[begin : begin + block] / measured.sigma) ** 2) for r in (old, new)]
            pairs.append((*square, min(block, len(truth) - begin)))
            episode.append(k)
    squares, of = np.array(pairs), np.array(episode)
    total = _closed(squares)
    g, by_episode = np.random.default_rng(0), [squares[of == e] for e in np.unique(of)]
    closed = []
    for _ in range(400):
        drawn = [by_episode[k] for k in g.integers(len(by_episode), size=len(by_episode))]
        closed.append(_closed(np.concatenate([b[g.integers(len(b), size=len(b))] for b in drawn]))[0])
    low, high = np.quantile(closed, [0.025, 0.975])
    return Closure(pd.DataFrame(rows), regimes, total[0], float(low), float(high), total[1])


def _closed(squares: np.ndarray) -> tuple[float, float]:
    """Share of the error, and share of the closable mean square (before minus noise), that went."""
    before, after = np.average(squares[:, :2], axis=0, weights=squares[:, 2])
    closable = max(before - 1.0, 1e-9)
    return float(1 - np.sqrt(after / before)), float((before - after) / closable)


def found_rivals(best: Contender, fitter: Fitter) -> tuple[Rival, ...]:
    """Return what could be taken for the effects of the best explanation."""
    if not best.fit.explanation.candidates:
        return ()
    around = normal_equations(best.fit, sensitivities(fitter, best.fit, directions(fitter.system)))
    return rivals(around, best.evidence, fitter)


def next_push(ranked: Sequence[Ranked], found: Search, fitter: Fitter, threads: int | None) -> str | None:
    """Say which further push would tell the leading explanations apart, if they need to be."""
    named = [r for r in ranked if r.effects != ("unknown",)]
    lead = named[0]
    names = set(lead.effects) | {n for e in lead.equivalent for n in e}
    if advice := _advice(names, fitter.system.vocabulary):
        return advice
    if len(named) < 2 or named[1].probability < WORTH_TELLING:
        return None
    first, second = (_contender(found, r, fitter.context) for r in named[:2])
    push = best_experiment(
        fitter.system,
        fitter.measured,
        (first.fit.explanation, first.fit.x),
        (second.fit.explanation, second.fit.x),
        second.evidence.covariance,
        threads=threads,
    )
    rivals_named = f"{' and '.join(lead.effects)} from {' and '.join(named[1].effects)}".replace("_", " ")
    if push is None or push.log_odds < 1.0:
        system = fitter.system
        return f"No {system.experiment} within {system.reach} would tell {rivals_named}; {system.reach_further}."
    return (
        f"{push.sentence} To tell {rivals_named}, each such {fitter.system.experiment} is worth about "
        f"{push.log_odds:.1f} in natural log odds."
    )


def _contender(found: Search, ranked: Ranked, context: Scope) -> Contender:
    """Return the contender that an entry of the ranking speaks of."""
    finite = (c for c in found.contenders if np.isfinite(c.log_posterior))
    return next(c for c in finite if c.fit.explanation.make(c.fit.x, context) == ranked.values)


WORTH_TELLING = 0.02  # an explanation that is less likely needs no push against it


def _advice(names: set[str], vocabulary: Vocabulary) -> str | None:
    """Return what would tell apart two of these effects that no recording like this one can."""
    for candidate in vocabulary:
        for other in candidate.effect.confounded:
            if {candidate.effect.name, other.name} <= {name.partition("[")[0] for name in names}:
                return other.advice
    return None


def notes(
    recording: Recorded,
    measured: Measured,
    top: Contender,
    excess: float,
    held_out: Sequence[int],
    *,
    turned: bool = False,
    outside: Sequence[str] = (),
) -> tuple[str, ...]:
    """Say what a reader should know before believing the figures."""
    out = [*recording.notes, *outside]
    if not measured.stated.all():
        out.append("The noise was not stated for every channel and was estimated from the recording.")
    for e, sample in measured.hung.items():
        episode = recording.episodes[e]
        out.append(
            f"What episode {episode.index} shows from {episode.t_s[sample]:.2f} s on counts for the closure alone: "
            "whether a push there starts the body hangs on less friction than surfaces are even in."
        )
    if measured.noise_model.lag_one.any():
        out.append("The noise is correlated from sample to sample; this was taken into account.")
    dropped = int(sum((~v).sum() for v in measured.valid))
    if dropped:
        out.append(f"{dropped} values stick out of their neighbours and were left out.")
    if not top.fit.converged:
        out.append("The fit of the best explanation had not fully come to rest; its errors may be too small.")
    if turned:
        out.append(
            "What the last episodes show the others do not, or hardly: they were fitted, and the first ones held out."
        )
    if len(held_out) < HELD_OUT:
        out.append("Only one episode was left to check the explanation.")
    if excess > UNKNOWN_EXCESS / 2:
        out.append(
            f"The best explanation leaves {100 * excess:.0f} % more than the noise: something else is at work too."
        )
    return tuple(out)
