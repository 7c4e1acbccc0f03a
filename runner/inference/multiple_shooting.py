"""A first look at episodes cut into pieces, each with a start state of its own (as in multiple shooting, Bock 1983).

Where the nominal model goes far astray, descents from it end in hollows. In half a second to a second no explanation
goes astray, and what is found there is where the fits to whole episodes begin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runner.inference.breakaway import hanging
from runner.inference.flown import Flown
from runner.inference.least_squares import NONE, Explanation, Fit, Fitter
from runner.inference.parameters import is_possible
from runner.inference.rounds import likeliest
from runner.inference.search import Search, search, singles
from runner.inference.warm_start import Beginning, Key, WarmStart, key_of
from runner.recording import Span
from runner.settings import SETTINGS


@dataclass(frozen=True)
class Look:
    """What pieces of the episodes show.

    Args:
        beginning: Where fits begin.
        hung: From which sample on an episode hangs on a breakaway.
        cut_s: How long the pieces are, where even in them nothing explains the recording and the best explains less of
            it over longer times: what no explanation has piles up, and drowns what they have. None: longer times tell
            more.
        flown: What flights until the first hit say by themselves; None: nothing is hit.
    """

    beginning: Beginning
    hung: dict[int, int]
    cut_s: float | None = None
    flown: Flown | None = None


def look(fitter: Fitter, nominal: Fit) -> Look | None:
    """Search the episodes of a nominal fit in pieces, if it goes astray; else None.

    What is too short to be cut is looked at as far as its first half. What hits something is looked at until it does,
    however near the model comes: one that is wrong in the air meets the ground elsewhere, and a descent through that
    ends anywhere.

    What is left for the whole are the single effects that are near the likeliest, and the likeliest several. If one of
    those explains the whole, no other single effect is worth a fit of its own.
    """
    episodes = nominal.episodes
    count = fitter.measured.count(episodes)
    # by the noise of this fitter, which may have been told from that fit
    whole_loss = fitter.loss(NONE, nominal.x, nominal.starts, episodes)
    limits = SETTINGS.pieces
    flown = fitter.until_hit(episodes)
    if not flown and whole_loss <= limits.far_mean_square * count:
        return None
    longest_s = fitter.longest_s(episodes)
    piece_s = max(longest_s / limits.count, limits.min_length_s)
    cuttable = not flown and longest_s >= 2 * piece_s
    if cuttable:
        spans = fitter.pieces(piece_s, episodes)
    else:
        spans = flown or fitter.beginnings(limits.beginning * longest_s, episodes)
    if not spans:
        return None
    while True:
        cut = fitter.parts(spans)
        rough = cut.fit(NONE, range(len(spans)), iterations=SETTINGS.fit.nominal_steps)
        shorter = fitter.pieces(piece_s / 2, episodes) if cuttable and piece_s / 2 >= limits.min_length_s else []
        if not shorter or rough.total < limits.far_mean_square * cut.measured.count(rough.episodes):
            break
        spans, piece_s = shorter, piece_s / 2
    cut_mean_square = rough.total / cut.measured.count(rough.episodes)
    if not flown and cut_mean_square > limits.max_mean_square_ratio * whole_loss / count:
        fitter.simulator.simulated_s += cut.simulator.simulated_s
        return None
    # where the nominal model is good, little is to be learnt about what it lacks
    lacks = rough.loss - [cut.measured.count([i]) for i in rough.episodes]
    ended = not fitter.measured.hits(episodes)  # flights too short to be looked at have ended in a hit, too
    if flown:
        cut = replace(cut, part="flights" if ended else "flights until the first hit")
    elif cuttable:
        cut = replace(cut, part=f"stretches of {piece_s:.2g} s")
    first = np.array([s.begin == 0 for s in spans])
    chosen = np.flatnonzero(first | (lacks > np.quantile(lacks, 1.0 - limits.searched_share)))
    found = search(cut, chosen.tolist(), starts=rough.starts[chosen], pieces=True)
    flown_alone = Flown(cut, *likeliest(found.contenders, found.nominal, cut), ended) if flown else None
    hung = hanging(cut, found.best.fit)
    cut = replace(cut, measured=cut.measured.without(hung))
    fitter.simulator.simulated_s += cut.simulator.simulated_s
    late = _earliest(hung, spans)
    whole = replace(fitter, measured=fitter.measured.without(late))

    def seed(fit: Fit) -> WarmStart:
        return _seed(whole, fit.explanation, fit.x, begun(fit, spans, nominal), episodes)

    short = _fall_short(found, cut) if flown else frozenset[Key]()
    seeds, near = {}, found.best.log_posterior - SETTINGS.search.expansion_log_odds
    for c in found.contenders:
        candidates = c.fit.explanation.candidates
        few = len(candidates) == 1 or sum(len(k) == len(candidates) for k in seeds) < SETTINGS.search.beam_width
        if candidates and few and c.log_posterior > near and key_of(c.fit.explanation) not in short:
            seeds[key_of(c.fit.explanation)] = seed(c.fit)
    best, there = found.best.fit, set[Key]()
    little = cut.measured.excess(best.total, best.episodes) < fitter.system.cut_from
    if cuttable and not little and key_of(best.explanation) in seeds:
        # over longer times what is lacking may pile up, or what is there may come to show: whichever leaves less tells
        longer = carried(whole, seeds[key_of(best.explanation)], episodes, longest_s)
        if longer.total / whole_loss > best.total / found.nominal.total:
            return Look(Beginning(seeds, answered=True), late, piece_s)
        seeds[key_of(best.explanation)] = longer
        there = {key_of(best.explanation)}
    for c in found.contenders[: SETTINGS.search.beam_width]:
        key = key_of(c.fit.explanation)
        if key in seeds and key not in there:
            seeds[key] = min(carried(whole, seeds[key], episodes, longest_s), seeds[key], key=lambda s: s.total)
    if flown:
        return Look(Beginning(seeds, ruled_out=short, short=short, answered=True), late, flown=flown_alone)
    explained = any(explains(s, whole, episodes) for s in seeds.values())
    ruled_out = singles(fitter.system.vocabulary) - set(seeds) if explained else frozenset[Key]()
    return Look(Beginning(seeds, ruled_out, answered=True), late)


def _fall_short(found: Search, flown: Fitter) -> frozenset[Key]:
    """Return explanations of one effect that leave much of a flight that others explain.

    None where nothing is to be explained in the air: there a flight tells nothing of what shows after a hit alone. What
    shows there beside what a flight tells is a further effect, and may turn out to be the only one. Those that were
    compared leave least of all, so that the others leave more than the last of them; where even that explains the
    flights, so may others.
    """
    singly = {key_of(c.fit.explanation): c.fit for c in found.contenders if len(c.fit.explanation.candidates) == 1}
    near = {key for key, f in singly.items() if _is_near(f, flown)}
    if _is_near(found.nominal, flown) or not near or len(near) == len(singly):
        return frozenset()
    return singles(flown.system.vocabulary) - near


def _is_near(fit: Fit, fitter: Fitter) -> bool:
    """Whether a fit leaves so little that nothing plain is left to be explained."""
    left = fitter.measured.excess(fit.total, fit.episodes)
    return is_possible(fit, fitter.context) and left < SETTINGS.search.near_excess


def recut(beginning: Beginning, fitter: Fitter, nominal: Fit) -> Beginning:
    """Return a beginning for other stretches of the episodes, from the start states that suit the nominal model."""
    return replace(
        beginning,
        seeds={
            key: _seed(fitter, seed.explanation, seed.x, nominal.starts, nominal.episodes)
            for key, seed in beginning.seeds.items()
        },
    )


def carried_over(beginning: Beginning, fitter: Fitter, episodes: Sequence[int]) -> Beginning:
    """Return a beginning for stretches that begin elsewhere than what was looked at, and may be longer.

    What was likeliest there is fitted to longer and longer parts of them.
    """
    starts, longest_s = fitter.first_starts(episodes), fitter.longest_s(episodes)
    seeds = {k: _seed(fitter, s.explanation, s.x, starts, episodes) for k, s in beginning.seeds.items()}
    for key in list(seeds)[: SETTINGS.search.beam_width]:
        seeds[key] = min(carried(fitter, seeds[key], episodes, longest_s), seeds[key], key=lambda s: s.total)
    return replace(beginning, seeds=seeds)


def explains(seed: WarmStart, fitter: Fitter, episodes: Sequence[int]) -> bool:
    """Whether a seed explains these episodes so well that no other single effect is worth a fit.

    Out of its range an effect does another's work, as the Stribeck effect at no speed does that of static friction.
    """
    near = seed.total < (1.0 + SETTINGS.search.near_excess) * fitter.measured.count(episodes)
    return bool(near and is_possible(seed, fitter.context))


def begun(fit: Fit, spans: Sequence[Span], whole: Fit) -> np.ndarray:
    """Return start states of whole episodes, (E, S): of their first pieces where those were fitted, else of a fit."""
    starts = whole.starts.copy()
    for piece, start in zip(fit.episodes, fit.starts, strict=True):
        if spans[piece].begin == 0:
            starts[whole.episodes.index(spans[piece].episode)] = start
    return starts


def _earliest(hung: dict[int, int], spans: Sequence[Span]) -> dict[int, int]:
    """Return the first sample of each episode that hangs on a breakaway, from those of its pieces."""
    out: dict[int, int] = {}
    for piece, sample in hung.items():
        span = spans[piece]
        if span.begin + sample < span.end:
            out[span.episode] = min(out.get(span.episode, span.end), span.begin + sample)
    return out


def _seed(
    fitter: Fitter, explanation: Explanation, x: np.ndarray, starts: np.ndarray, episodes: Sequence[int]
) -> WarmStart:
    return WarmStart(explanation, x, starts, fitter.loss(explanation, x, starts, episodes))


def carried(fitter: Fitter, seed: WarmStart, episodes: Sequence[int], longest_s: float) -> WarmStart:
    """Fit what was found in pieces of the episodes to longer parts, as long as it goes astray, and to the whole."""
    count = fitter.measured.count(episodes)
    plain = 1.0 + SETTINGS.held_out.plain_excess  # mean square from which on it goes astray
    for share in SETTINGS.pieces.growing_shares:
        if seed.total < plain * count:
            break
        longer = fitter.up_to(longest_s * share)
        steps = SETTINGS.fit.warm_steps
        fit = longer.fit(seed.explanation, episodes, x=seed.x, starts=seed.starts, iterations=steps, polish=False)
        fitter.simulator.simulated_s += longer.simulator.simulated_s
        seed = _seed(fitter, fit.explanation, fit.x, fit.starts, episodes)
    steps = SETTINGS.pieces.whole_steps
    fit = fitter.fit(seed.explanation, episodes, x=seed.x, starts=seed.starts, iterations=steps, polish=False)
    return WarmStart(fit.explanation, fit.x, fit.starts, fit.total)
