"""What was measured, ready for fitting: one array per episode, the noise of each channel, and which samples count.

How noisy a channel is is estimated here: by `measure` from where the object rests or its counts are rounded, and by
`refine` from what the best model leaves, to which what the owner states is a prior. Nothing here knows what moved, or
how. A channel is a column of numbers with a noise level and a colour (`runner.noise.model`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import median_filter, minimum_filter

from runner.noise.model import NoiseModel, estimate
from runner.numerics.differences import rounding_noise, white_noise
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.channels import Scatter, Space


@dataclass(frozen=True)
class Measured:
    """The measured channels of all episodes.

    Args:
        spans: Where in the recording each episode lies.
        values: Per episode (T, C).
        sensor: Noise standard deviation of each channel, (C,).
        noise_model: Of each channel: which part of the noise is slow.
        valid: Per episode (T, C): False for outliers and what was not measured.
        stated: Noise that the owner states for each channel, (C,), NaN where none is: `sensor` is what it is.
        scatter: What counts as noise at least once the object has hit something; None: it does not.
        hung: The first sample of an episode that hangs on a breakaway: from there on it says nothing to a fit.
        odd_from: An episode of which a model leaves more than such a mean square, in squared noises, is odd: it counts
            as noisier than the others, see `runner.inference.variable_projection.Spread`. Infinite: none is.
    """

    spans: tuple[Span, ...]
    values: tuple[np.ndarray, ...]
    sensor: np.ndarray
    noise_model: NoiseModel
    valid: tuple[np.ndarray, ...]
    stated: np.ndarray
    scatter: Scatter | None = None
    hung: Mapping[int, int] = field(default_factory=dict)
    odd_from: float = np.inf

    @property
    def sigma(self) -> np.ndarray:
        """Noise standard deviation of each channel, (C,), of what may have hit something."""
        return self.sensor if self.scatter is None else np.maximum(self.sensor, self.scatter.level)

    def counted(self, episode: int) -> np.ndarray:
        """Return what counts in a fit, (T, C)."""
        if episode not in self.hung:
            return self.valid[episode]
        return self.valid[episode] & (np.arange(len(self.valid[episode])) < self.hung[episode])[:, None]

    def whiten(self, episode: int, residual: np.ndarray) -> np.ndarray:
        """Return residuals (..., T, C) in units of the noise, its colour taken out; 0 where they don't count."""
        valid = self.counted(episode)
        scaled = np.where(valid, residual / self.scale(episode), 0.0)
        there = np.isfinite(self.values[episode])
        if there.all() or not self.noise_model.lag_one.any():
            return np.where(valid, self.noise_model.whiten(scaled), 0.0)
        # the colour is that from one reading to the next; rows of other streams are none
        white = np.zeros_like(scaled)
        for c in np.flatnonzero(there.any(axis=0)):
            own = NoiseModel(self.noise_model.share[[c]], self.noise_model.memory[[c]])
            white[..., there[:, c], c] = own.whiten(scaled[..., there[:, c], c, None])[..., 0]
        return np.where(valid, white, 0.0)

    def scale(self, episode: int) -> np.ndarray:
        """Return the standard deviation of what counts as noise in an episode, (C,), or (T, C) where it changes."""
        if self.scatter is None:
            return self.sensor
        return np.where(self.scatter.begun(episode)[:, None], self.sigma, self.sensor)

    def volume(self, episodes: Iterable[int]) -> float:
        """Return the sum of the log standard deviations of what is new in each value of these episodes that counts."""
        new = self.noise_model.innovation()
        return float(sum((self.counted(e) * np.log(self.scale(e) * new)).sum() for e in episodes))

    def parts(self, spans: Sequence[Span]) -> Measured:
        """Return parts of the episodes as episodes of their own; the noise is what it was."""
        values, valid = (tuple(v[s.episode][s.begin : s.end] for s in spans) for v in (self.values, self.valid))
        whole = [self.spans[s.episode] for s in spans]
        inside = tuple(Span(w.episode, w.begin + s.begin, w.begin + s.end) for w, s in zip(whole, spans, strict=True))
        hung = {i: max(self.hung[s.episode] - s.begin, 0) for i, s in enumerate(spans) if s.episode in self.hung}
        scatter = None if self.scatter is None else self.scatter.parts(spans)
        return replace(self, spans=inside, values=values, valid=valid, scatter=scatter, hung=hung)

    def joined(self, whole: Measured) -> Measured:
        """Return whole episodes with the noise that their parts have shown, and what of the parts does not count.

        Args:
            whole: The same recording, uncut.
        """
        valid, hung = [v.copy() for v in whole.valid], dict[int, int]()
        for i, s in enumerate(self.spans):
            valid[s.episode][s.begin : s.end] = self.valid[i]
            if i in self.hung:
                hung[s.episode] = min(hung.get(s.episode, s.end), s.begin + self.hung[i])
        return replace(
            whole,
            sensor=self.sensor,
            noise_model=self.noise_model,
            valid=tuple(valid),
            hung=hung,
            odd_from=self.odd_from,
        )

    def hits(self, episodes: Iterable[int]) -> bool:
        """Whether anything is hit in some of these episodes."""
        return self.scatter is not None and any(self.scatter.begun(e).any() for e in episodes)

    def is_scatter(self) -> np.ndarray:
        """Return which channels no model predicts to within the noise of their sensors after a hit, (C,)."""
        return self.sigma > self.sensor

    def without(self, hung: Mapping[int, int]) -> Measured:
        """Return the same less what hangs on a breakaway, from such a sample of an episode on."""
        earliest = {e: min(hung.get(e, s), self.hung.get(e, s)) for e, s in {**self.hung, **hung}.items()}
        return replace(self, hung=earliest)

    def count(self, episodes: Iterable[int]) -> int:
        """Number of values of these episodes that count."""
        return int(sum(self.counted(e).sum() for e in episodes))

    def excess(self, loss: float, episodes: Iterable[int]) -> float:
        """Return what a sum of squared whitened residuals of these episodes leaves beyond the noise, as a share."""
        return loss / self.count(episodes) - 1.0


def measure(system: AbstractSystem, *, scatter: Scatter | None = None) -> Measured:
    """Prepare a recording: the noise where it isn't stated, and its colour, from its rests; outliers.

    `scatter` is what counts as noise at least, once something is hit.
    """
    values = system.values()
    # an orientation is measured as a turn from itself, which is zero and shows no noise
    shown = np.array([np.nan if c.space is Space.ROTATION else 0.0 for c in system.channels])
    rests = [values[e][s] + shown for e, s in system.rests()]
    stated = system.stated_noise()
    groups = _groups(system)
    times = [e.t_s for e in system.recording.episodes]
    each = [[(t, c) for t, v in zip(times, values, strict=True) for c in v[:, columns].T] for columns in groups]
    white = np.array([white_noise(series) for series in each])
    # a sensor may be stiller at rest than in motion: what is stated holds until a fit shows what it is
    rounding = _rounding_noise(values, groups)
    sigma, noise_model = _noise(rests, system, stated, white, rounding, doubt=0.0)
    spans = tuple(Span(e, 0, len(v)) for e, v in enumerate(values))
    new = sigma * noise_model.innovation()
    calm = [None if scatter is None else scatter.calm[e] for e in range(len(values))]
    valid = tuple(_inliers(v, new, c, moving=True) for v, c in zip(values, calm, strict=True))
    return Measured(spans, values, sigma, noise_model, valid, system.noise_by_owner(), scatter)


def refine(measured: Measured, system: AbstractSystem, residuals: dict[int, np.ndarray]) -> Measured:
    """Look at the noise again in what a model leaves, which is far closer to noise than a motion is.

    What the owner states is a belief like any other: taken for the truth, noise of 1.3 times as much is a gap of 0.7
    squared noises that no explanation closes, and noise of less is taken for slow noise, in which slow effects hide.

    Args:
        measured: What is known so far.
        system: Where it comes from.
        residuals: Per episode (T, C), prediction less measurement in physical units.
    """
    stretches = []
    for e, residual in residuals.items():
        # an outlier must not pass for noise; the line between its neighbours does no harm
        filled = residual.copy()
        there = np.isfinite(measured.values[e])
        for c in range(filled.shape[1]):
            good = measured.valid[e][:, c]
            bad = there[:, c] & ~good
            if bad.any() and good.any():
                filled[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(good), filled[good, c])
        # what was not measured has no noise, and what an impact leaves is none: NaN, which `_noise` passes over
        if measured.scatter is not None:
            there = there & ~measured.scatter.begun(e)[:, None]
        stretches.append(np.where(there, np.nan_to_num(filled), np.nan)[: measured.hung.get(e, len(filled))])
    groups = _groups(system)
    otherwise = measured.sensor[[columns[0] for columns in groups]]
    rounding = _rounding_noise(system.values(), groups)
    # what the system made up for where nobody stated anything is no belief: in what a model leaves the noise shows
    sigma, noise_model = _noise(
        stretches,
        system,
        system.noise_by_owner(),
        otherwise,
        rounding,
        doubt=SETTINGS.noise.stated_log_error,
        shorten=True,
    )
    found = without_outliers(replace(measured, sensor=sigma, noise_model=noise_model), residuals)
    return _told_odd(found, residuals) if system.episodes_differ else found


def without_outliers(measured: Measured, residuals: Mapping[int, np.ndarray]) -> Measured:
    """Return the same less what sticks out of its neighbours in what a model leaves, where no motion hides it.

    Args:
        measured: What is known so far.
        residuals: Per episode (T, C), prediction less measurement in physical units; others stay as they are.
    """
    new = measured.sigma * measured.noise_model.innovation()
    valid = list(measured.valid)
    for e, residual in residuals.items():
        calm = None if measured.scatter is None else measured.scatter.calm[e]
        valid[e] = np.isfinite(measured.values[e]) & _inliers(residual, new, calm)
    return replace(measured, valid=tuple(valid))


def _told_odd(measured: Measured, residuals: Mapping[int, np.ndarray]) -> Measured:
    """Return the same with what is odd told from what a model leaves of most episodes, see `refine`."""
    left = [(measured.whiten(e, r) ** 2).sum() / max(measured.count([e]), 1) for e, r in residuals.items()]
    return replace(measured, odd_from=SETTINGS.noise.odd_episode_ratio * max(float(np.median(left)), 1.0))


def materially_different(a: Measured, b: Measured) -> bool:
    """Whether two accounts of the noise of a recording lead to other standard errors, or to other fits."""
    odd = b.odd_from < a.odd_from / SETTINGS.noise.odd_episode_ratio
    return bool(
        odd
        or np.any(np.abs(np.log(a.sensor / b.sensor)) > SETTINGS.noise.material_log_change)
        or np.any(np.abs(a.noise_model.lag_one - b.noise_model.lag_one) > 2 * SETTINGS.noise.material_log_change)
    )


def materially_slower(a: Measured, b: Measured) -> bool:
    """Whether one account of the noise of a recording has materially more slow noise than another."""
    slower = a.noise_model.lag_one - b.noise_model.lag_one
    return bool(np.any(slower > 2 * SETTINGS.noise.material_log_change))


def counting_alike(accounts: Sequence[Measured]) -> list[Measured]:
    """Return accounts of the noise of one recording of which the same values count: those that do by each of them.

    And the same mean square makes an episode odd, the largest of theirs: none weighs lightly what it leaves much of.
    """
    every, odd_from = range(len(accounts[0].valid)), max(a.odd_from for a in accounts)
    valid = tuple(np.logical_and.reduce([a.counted(e) for a in accounts]) for e in every)
    return [replace(a, valid=valid, hung={}, odd_from=odd_from) for a in accounts]


def off_from_stated(measured: Measured, system: AbstractSystem) -> dict[str, float]:
    """Return how many times as large as stated a sensor's noise is, where materially, by group of channels."""
    out = {}
    for columns in _groups(system):
        stated, found = measured.stated[columns[0]], measured.sensor[columns[0]]
        if np.isfinite(stated) and abs(np.log(found / stated)) > 2 * SETTINGS.noise.material_log_change:
            out[", ".join(system.channels[c].name for c in columns)] = float(found / stated)
    return out


def _groups(system: AbstractSystem) -> list[list[int]]:
    """Return the channels of each group, which share a noise level, in the order of their first."""
    groups = [c.group for c in system.channels]
    return [[i for i, g in enumerate(groups) if g == group] for group in dict.fromkeys(groups)]


def _step_s(system: AbstractSystem) -> float:
    return system.recording.episodes[0].step_s


def _noise(
    stretches: Sequence[np.ndarray],
    system: AbstractSystem,
    stated: np.ndarray,
    otherwise: np.ndarray,
    rounding: np.ndarray,
    *,
    doubt: float,
    shorten: bool = False,
) -> tuple[np.ndarray, NoiseModel]:
    """Return the noise of each channel, (C,), and its colour.

    `doubt` is that of what is stated, and `shorten` how short windows may be, see `estimate`; `otherwise` is taken per
    group where too little is there, and `rounding` where less was found. Rows of `stretches` in which a group was not
    measured are passed over: where topics have stamps of their own, each has only its share of the rows.
    """
    groups = _groups(system)
    known = stated[[columns[0] for columns in groups]]
    kinds = [[s[np.isfinite(s[:, c]).all(axis=1)][:, c] for s in stretches] for c in groups]
    counts = np.array([sum(map(len, kind)) for kind in kinds])
    levels = np.where(np.isfinite(known), known, otherwise)
    sigma, share, memory = np.empty(len(stated)), np.zeros(len(stated)), np.zeros(len(stated))
    instruments = [system.channels[columns[0]].instrument for columns in groups]
    for instrument in dict.fromkeys(instruments):
        showing = [k for k, own in enumerate(instruments) if own == instrument and counts[k]]
        if not showing:
            continue
        each_s = _step_s(system) * _rows_apart(stretches, groups[showing[0]])
        found = estimate([kinds[k] for k in showing], each_s, known[showing], doubt=doubt, shorten=shorten)
        if found is None:
            continue
        levels[showing] = found.level
        for k in showing:
            share[groups[k]], memory[groups[k]] = found.share, found.memory
    for c, level, believed, least in zip(groups, levels, known, rounding, strict=True):
        sigma[c] = level if level == believed else max(level, least)
    return sigma, NoiseModel(share, memory)


def _rows_apart(stretches: Sequence[np.ndarray], columns: Sequence[int]) -> float:
    """Return how many rows lie from one reading of some channels to the next, as a rule: not over a gap."""
    there = [np.flatnonzero(np.isfinite(s[:, columns]).all(axis=1)) for s in stretches]
    steps = np.concatenate([np.diff(rows) for rows in there])
    return float(np.median(steps)) if len(steps) else 1.0


def _rounding_noise(values: Sequence[np.ndarray], groups: Sequence[Sequence[int]]) -> np.ndarray:
    """Return what rounding alone leaves of noise in each group, (K,): a sensor that counts may show none at rest."""
    out = np.zeros(len(groups))
    for k, columns in enumerate(groups):
        out[k] = rounding_noise([c[np.isfinite(c)] for v in values for c in v[:, columns].T])
    return out


def _inliers(values: np.ndarray, new: np.ndarray, calm: np.ndarray | None, *, moving: bool = False) -> np.ndarray:
    """Mark values that don't stick out of their neighbours by many noise levels; what is NaN has none and is none.

    `new`, (C,), is the standard deviation of what is new in a sample: slow noise moves the neighbours as well, so that
    beside it an outlier of a few noise levels is as plain as one of many in white noise. Where something is hit, which
    is not `calm`, (T,), a motion has a kink, and what sticks out of its neighbours is what a hit has done. With
    `moving`, of a motion itself, what lies where the motion leads does not stick out: a servo whose target has stepped
    turns about from one sample to the next.
    """
    inliers, neighbours = np.isfinite(values), 5
    smooth = None if calm is None else minimum_filter(calm, size=neighbours, mode="nearest")
    for c, level in enumerate(new):
        there = np.flatnonzero(inliers[:, c])
        if len(there):
            own = values[there, c]
            distance = np.abs(own - median_filter(own, size=neighbours, mode="nearest"))
            far = SETTINGS.noise.outlier_sigmas * level + 3.0 * np.median(distance)
            near = (np.minimum(distance, _off_a_motion(own)) if moving else distance) < far
            inliers[there, c] = near if smooth is None else near | ~smooth[there]
    return inliers


def _off_a_motion(own: np.ndarray) -> np.ndarray:
    """Return how far each value is off the nearest of where the two before, the two after, and all four lead, (T,)."""
    led = np.full((3, len(own)), np.inf)
    led[0, 2:] = 2.0 * own[1:-1] - own[:-2]
    led[1, :-2] = 2.0 * own[1:-1] - own[2:]
    led[2, 2:-2] = (4.0 * (own[1:-3] + own[3:-1]) - own[:-4] - own[4:]) / 6.0
    return np.abs(own - led).min(axis=0)
