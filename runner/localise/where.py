"""Where the model misses: per channel, over time as a missing force, and shared among what went on and where.

The recording is cut into short windows, and the model is restarted in each from a locally smoothed measured state.
Start states are unknowns of every window and projected out, so that a window tells of its own time alone. What is
left, in units of the noise, is reduced to its slow part (polynomials of `DEGREE` in time, per channel): noise has
little of it, and a missing force has hardly anything else. Its sum of squares less what noise makes of it is the
window's *excess*. Noise that is slow itself shows where the body rests, and is allowed for everywhere.

The *missing force* of a window is the constant generalised force that, added to the command, makes the model follow the
measurement best. Where friction holds the object, no such force can be seen, and it is NaN.

Cells of the map are tested by permutation: the excess is shifted in circles within each episode, which keeps its
correlation in time (for cells that are whole episodes: blocks of windows change places). Apart from the regimes
themselves, the test is of what the regimes leave: a place stands out only if it is worse than what was done there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control, norm

from runner.effects.base import Effects
from runner.errors import RecordingError
from runner.noise.measured import Measured
from runner.simulate.gap import HORIZONS_S, WHOLE_EPISODE
from runner.simulate.shooting import PRIOR_SIGMAS, WINDOWS_AT_ONCE, whiten, windows_of
from runner.systems.base import AbstractSimulator, AbstractSystem, Labels, Run, Windows

WINDOWS_S = (0.25, 0.5, 1.0)  # a longer one is less local, and sees smaller effects: taken where a shorter sees none
DEGREE = 3
PERMUTATIONS = 3999
FEWEST = 8  # windows
SURE = 0.01
LEVEL = 0.05  # of the false discovery rate
NOISE_SHARE = 0.06  # the noise may be this much larger (in variance) than stated before it counts as a gap
BLOCK = 4  # windows that change places together where whole episodes are compared
REST_FREEDOM = 30  # values that the noise at rest must rest on
WEAK = 0.25  # a force known no better than this share of its prior is not known


@dataclass(frozen=True)
class Where:
    """Where the model misses.

    Args:
        gap: Per channel and horizon, start states fitted: `channel`, `unit`, `horizon`, `rms`, `noise`, `noises`.
        windows: One row per window: `episode`, `t_s` (its middle), what the system's labels say of it (a column for
            each factor of `cells` but the channel), `excess`, `excess_<channel>`, `freedom`.
        missing_force: One row per window of the shortest length: its labels, the numbers that the system's disturbance
            names and the system's further views of them, each with `_se`; NaN: not to be seen.
        cells: One row per cell: `factor`, `cell`, `n` (windows), `excess`, `share` (of all excess), `lift` (share over
            share of the windows), `p` (one-sided, that it is as large by chance), `q` (Benjamini-Hochberg), and for
            places `x_m`, `y_m`.
        excess: Of all windows, in squared noises; `freedom` of which noise makes, and the `p` of that.
        window_s: Length of the windows.
        sentence: All of it in one sentence.
    """

    gap: pd.DataFrame
    windows: pd.DataFrame
    missing_force: pd.DataFrame
    cells: pd.DataFrame
    window_s: float
    excess: float
    freedom: float
    p: float
    sentence: str

    @property
    def exceeds(self) -> bool:
        """Whether there is a gap beyond the noise at all."""
        return self.p < SURE


def localise(
    system: AbstractSystem, measured: Measured, starts_by_episode: Mapping[int, np.ndarray], effects: Effects = ()
) -> Where:
    """Tell where a model misses a recording.

    Args:
        system: What was recorded.
        measured: Its channels and their noise.
        starts_by_episode: Start state of each episode that counts, by its position, (S,): for whole episodes.
        effects: What the model holds beyond the nominal one.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    episodes = sorted(starts_by_episode)
    lengths = [len(e) for e in system.recording.episodes]
    simulator, rate = system.simulator(), system.rate_hz
    model = _Model(system, simulator, effects)
    rows = []
    for horizon in HORIZONS_S:
        windows = windows_of(lengths, max(1, round(horizon * rate)), episodes)
        if len(windows):
            smoothed = system.initial.guess_windows(measured, windows, smooth=True)
            one = _linearised(model, windows, measured, smoothed)
            rows += _gap_rows(system, f"{horizon:g} s", *one.left(), measured)
    whole = [simulator.predict(e, [Run(effects, starts_by_episode[e])])[0] - measured.values[e] for e in episodes]
    valid = np.concatenate([measured.valid[e] for e in episodes])
    squares = np.where(valid, np.concatenate(whole) ** 2, 0.0).sum(axis=0)
    rows += _gap_rows(system, WHOLE_EPISODE, squares, valid.sum(axis=0) - len(episodes), measured)

    check_length(system, episodes)
    windows = _windows(system, WINDOWS_S[0], episodes)
    shortest = look = _look(model, windows, measured, np.ones(len(system.channels)))
    noise = look.noise
    for window_s in WINDOWS_S[1:]:
        windows = _windows(system, window_s, episodes)
        if look.p < SURE or len(windows) < FEWEST:
            break
        longer = _look(model, windows, measured, noise)
        noise = longer.noise
        look = longer if longer.p < SURE else look
    table = look.labels.table.assign(
        excess=look.excess.sum(axis=1),
        freedom=look.freedom.sum(axis=1),
        **{f"excess_{c.name}": look.excess[:, i] for i, c in enumerate(system.channels)},
    )
    cells = _cells(system, table, look.excess, look.freedom, look.labels.places)
    missing = _missing_force(system, shortest, float(shortest.noise.max()))
    return Where(
        gap=pd.DataFrame(rows),
        windows=table,
        missing_force=pd.concat([shortest.labels.table, missing], axis=1),
        cells=cells,
        window_s=(look.local.raw.shape[1] - 1) / rate,
        excess=float(look.excess.sum()),
        freedom=float(look.freedom.sum()),
        p=look.p,
        sentence=_sentence(system, cells, look.p),
    )


def check_length(system: AbstractSystem, episodes: Sequence[int] | None = None) -> None:
    """Refuse a recording, or these episodes of it, that is too short to tell anything.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    count = len(_windows(system, WINDOWS_S[0], range(len(system.recording.episodes)) if episodes is None else episodes))
    if count < FEWEST:
        raise RecordingError(
            f"{system.recording.path}: {count} windows of {WINDOWS_S[0]:g} s, at least {FEWEST} are needed."
        )


def closure_by_regime(
    system: AbstractSystem, measured: Measured, episodes: Sequence[int], effects: Effects, window_s: float
) -> pd.DataFrame:
    """Return what a model misses in each regime before and after effects are added to it.

    Args:
        system: What was recorded.
        measured: Its channels and their noise.
        episodes: Those that count, by their position.
        effects: What is added.
        window_s: Length of the windows.

    Returns:
        `regime`, `windows`, and `before` and `after`: mean square of the slow residual over what noise makes of it
        (1: nothing but noise), as in `Where`. Of regimes that occur only.
    """
    windows = _windows(system, window_s, sorted(episodes))
    if not len(windows):
        return pd.DataFrame(columns=["regime", "windows", "before", "after"])
    simulator = system.simulator()
    looks = [
        _look(_Model(system, simulator, e), windows, measured, np.ones(len(system.channels))) for e in ((), effects)
    ]
    regime = looks[0].labels.table["regime"].to_numpy()
    rows = []
    for name in system.regimes:
        here = regime == name
        if here.any():
            ratios = [1.0 + float(k.excess[here].sum()) / max(float(k.freedom[here].sum()), 1e-9) for k in looks]
            rows.append({"regime": name, "windows": int(here.sum()), "before": ratios[0], "after": ratios[1]})
    return pd.DataFrame(rows)


def _windows(system: AbstractSystem, window_s: float, episodes: Sequence[int]) -> Windows:
    lengths = [len(e) for e in system.recording.episodes]
    samples = max(DEGREE + 1, round(window_s * system.rate_hz))
    return windows_of(lengths, samples, episodes)


@dataclass(frozen=True)
class _Model:
    """A system with effects in its model, ready for windows."""

    system: AbstractSystem
    simulator: AbstractSimulator
    effects: Effects

    def predict(self, windows: Windows, starts: np.ndarray, disturbance: np.ndarray | None = None) -> np.ndarray:
        return self.simulator.predict_windows(self.effects, windows, starts, disturbance)


@dataclass(frozen=True)
class _Look:
    """Windows of one length, and what they show."""

    local: _Linearised
    labels: Labels
    excess: np.ndarray  # (W, C)
    freedom: np.ndarray  # (W, C)
    noise: np.ndarray  # (C,), see `_noise_at_rest`

    @property
    def p(self) -> float:
        """Probability of so much excess by noise."""
        free = float(self.freedom.sum())
        return float(norm.sf((float(self.excess.sum()) - NOISE_SHARE * free) / np.sqrt(2 * max(free, 1e-9))))


def _look(model: _Model, windows: Windows, measured: Measured, shorter: np.ndarray) -> _Look:
    system = model.system
    first = _linearised(model, windows, measured, system.initial.guess_windows(measured, windows, smooth=True))
    local = _linearised(model, windows, measured, first.fitted(), np.diag(system.disturbance.steps))
    labels = system.label(measured, windows)
    slow, freedom = local.slow()
    noise = _noise_at_rest(slow, freedom, labels.table["regime"].to_numpy() == system.regimes[0], shorter)
    return _Look(local, labels, slow / noise - freedom, freedom, noise)


@dataclass(frozen=True)
class _Linearised:
    """Windows around their start states: everything in units of the noise.

    `starts` (W, S), `scale` of them (S,); `residual` whitened (W, n, C); `raw` the same in physical units; `jacobian`
    by the starts, per scale, whitened (W, n, C, S), and `change` the same not whitened; `by_force` per step, whitened
    (W, n, C, D).
    """

    measured: Measured
    scale: np.ndarray
    starts: np.ndarray
    valid: np.ndarray
    raw: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    jacobian: np.ndarray
    by_force: np.ndarray

    def _solve(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse of the normal equations, (W, S, S), and the step of the starts, (W, S), per scale."""
        w, size = self.starts.shape
        matrix = self.jacobian.reshape(w, -1, size)
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + np.eye(size) / PRIOR_SIGMAS**2)
        right = matrix.transpose(0, 2, 1) @ self.residual.reshape(w, -1, 1)
        return inverse, -(inverse @ right)[..., 0]

    def fitted(self) -> np.ndarray:
        """Return start states one step closer to the measurement."""
        return self.starts + self._solve()[1] * self.scale

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares per channel, the start states fitted, physical units, and their freedom, (C,) each."""
        inverse, step = self._solve()
        left = self.raw + (self.change @ step[:, None, :, None])[..., 0] * self.measured.sigma
        followed = ((self.change @ inverse[:, None]) * self.change).sum(axis=-1)
        freedom = np.where(self.valid, 1.0 - followed, 0.0)
        return np.where(self.valid, left**2, 0.0).sum(axis=(0, 1)), freedom.sum(axis=(0, 1))

    def slow(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares of the slow residual, and what noise makes of them, per window and channel, (W, C)."""
        w, n, c, p = self.jacobian.shape
        basis = np.linalg.qr(np.polynomial.legendre.legvander(np.linspace(-1, 1, n), min(DEGREE, n - 1)))[0]
        d = basis.shape[1]
        part = np.einsum("nd,wnc->wcd", basis, self.residual).reshape(w, c * d)
        starts = np.einsum("nd,wncp->wcdp", basis, self.jacobian, optimize=True).reshape(w, c * d, p)
        normal = starts.transpose(0, 2, 1) @ starts + np.eye(p) / PRIOR_SIGMAS**2
        out = np.eye(c * d) - starts @ np.linalg.solve(normal, starts.transpose(0, 2, 1))
        # what doesn't count has no noise either
        noise = np.zeros((w, c, d, c, d))
        gram = np.einsum("nd,wnc,ne->wcde", basis, self.valid, basis, optimize=True)
        noise[:, np.arange(c), :, np.arange(c), :] = gram.transpose(1, 0, 2, 3)
        spread = out @ noise.reshape(w, c * d, c * d)
        freedom = (spread * out).sum(axis=2).reshape(w, c, d).sum(axis=2)
        left = (out @ part[..., None])[..., 0].reshape(w, c, d)
        return (left**2).sum(axis=2), freedom

    def missing_force(self, prior_steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the missing force in steps, (W, D), and its covariance, (W, D, D), inflated where the fit is bad."""
        w, n, c, s = self.jacobian.shape
        d = len(prior_steps)
        matrix = np.concatenate([self.jacobian, self.by_force], axis=-1).reshape(w, n * c, s + d)
        weak = np.diag([PRIOR_SIGMAS**-2] * s + list(prior_steps**-2.0))
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + weak)
        flat = self.residual.reshape(w, n * c, 1)
        solution = -(inverse @ (matrix.transpose(0, 2, 1) @ flat))
        left = flat + matrix @ solution
        misfit = (left[..., 0] ** 2).sum(axis=1) / np.maximum(self.valid.sum(axis=(1, 2)) - s - d, 1)
        return solution[:, s:, 0], inverse[:, s:, s:] * np.maximum(misfit, 1.0)[:, None, None]


def _linearised(
    model: _Model, windows: Windows, measured: Measured, starts: np.ndarray, forces: np.ndarray | None = None
) -> _Linearised:
    steps, scale = model.system.initial.steps, model.system.initial.scale(measured.sigma)
    size, d = len(steps), len(model.system.disturbance.steps)
    extra = np.zeros((0, d)) if forces is None else forces
    offsets = np.vstack([np.zeros(size), np.diag(steps), np.zeros((len(extra), size))])
    push = np.vstack([np.zeros((1 + size, d)), extra]) if len(extra) else None
    rows = np.concatenate(
        [model.predict(some, starts[part, None] + offsets, push) for part, some in windows.chunks(WINDOWS_AT_ONCE)]
    )
    values, valid = windows.of(measured.values), windows.of(measured.valid)
    raw = rows[:, 0] - values
    moved = (rows[:, 1 : 1 + size] - rows[:, :1]) / steps[:, None, None] * scale[:, None, None]
    return _Linearised(
        measured=measured,
        scale=scale,
        starts=starts,
        valid=valid,
        raw=raw,
        residual=whiten(raw, valid, measured),
        change=np.moveaxis(moved / measured.sigma, 1, -1),
        jacobian=np.moveaxis(whiten(moved, valid[:, None], measured), 1, -1),
        by_force=np.moveaxis(whiten(rows[:, 1 + size :] - rows[:, :1], valid[:, None], measured), 1, -1),
    )


def _noise_at_rest(slow: np.ndarray, freedom: np.ndarray, rest: np.ndarray, shorter: np.ndarray) -> np.ndarray:
    """Return how much more slow noise each channel has at rest than it should, at least 1, (C,).

    Where there is too little rest to tell, noise that was slow in `shorter` windows of half the length is taken for
    slower still: its ratio squared.
    """
    free = freedom[rest].sum(axis=0)
    ratio = slow[rest].sum(axis=0) / np.maximum(free, 1e-9)
    sure = ratio > 1 + 2 * np.sqrt(2 / np.maximum(free, 1e-9))
    return np.where(free >= REST_FREEDOM, np.where(sure, ratio, 1.0), shorter**2)


def _gap_rows(
    system: AbstractSystem, horizon: str, squares: np.ndarray, count: np.ndarray, measured: Measured
) -> list[dict[str, object]]:
    rms = np.sqrt(squares / np.maximum(count, 1e-9))
    return [
        {
            "channel": channel.name,
            "unit": channel.unit,
            "horizon": horizon,
            "rms": float(rms[c]),
            "noise": float(measured.sigma[c]),
            "noises": float(rms[c] / measured.sigma[c]),
        }
        for c, channel in enumerate(system.channels)
    ]


def _missing_force(system: AbstractSystem, look: _Look, inflation: float) -> pd.DataFrame:
    step, prior = system.disturbance.steps, system.disturbance.prior
    steps, covariance = look.local.missing_force(prior / step)
    value, spread = steps * step, covariance * inflation * step[:, None] * step
    error = np.sqrt(np.einsum("wdd->wd", spread))
    known = error < WEAK * prior
    out = {}
    for i, name in enumerate(system.disturbance.names):
        out[name] = np.where(known[:, i], value[:, i], np.nan)
        out[f"{name}_se"] = np.where(known[:, i], error[:, i], np.nan)
    views = system.missing_force_views(
        np.where(known, value, np.nan), np.where((known[:, :, None] & known[:, None, :]), spread, np.nan), look.labels
    )
    return pd.DataFrame(out | views)


def _cells(
    system: AbstractSystem,
    table: pd.DataFrame,
    excess: np.ndarray,
    freedom: np.ndarray,
    places: Mapping[str, tuple[float, float]],
) -> pd.DataFrame:
    """Return share, lift and significance of every cell with windows in it."""
    total = float(excess.sum())
    amount = excess.sum(axis=1)
    size = np.sign(amount) * np.sqrt(np.abs(amount))  # so that no window outweighs all others
    regime = table["regime"].to_numpy()
    beyond = size - pd.Series(size).groupby(regime).transform("mean").to_numpy()
    rng = np.random.default_rng(0)
    episode = table["episode"].to_numpy()
    shifts, blocks = _shifts(episode, rng), _blocks(len(table), rng)
    rows = []
    for c, channel in enumerate(system.channels):
        free = float(freedom[:, c].sum())
        score = (float(excess[:, c].sum()) - NOISE_SHARE * free) / np.sqrt(2 * max(free, 1e-9))
        rows.append(
            _row("channel", channel.name, len(table), float(excess[:, c].sum()), total, 1.0 / len(system.channels))
        )
        rows[-1]["p"] = float(norm.sf(score))
    for factor in system.factors:
        labels = table[factor].to_numpy(dtype=object)
        names = sorted({label for label in labels if isinstance(label, str)})
        inside = np.stack([labels == name for name in names], axis=1) if names else np.zeros((len(table), 0), bool)
        values = size if factor == "regime" else beyond
        order = blocks if factor == "episode" else shifts
        by_chance = values[order] @ inside
        found = values @ inside
        p = (1 + (by_chance >= found - 1e-9).sum(axis=0)) / (1 + len(order))
        for i, name in enumerate(names):
            which = inside[:, i]
            row = _row(factor, name, int(which.sum()), float(amount[which].sum()), total, float(which.mean()))
            x, y = places.get(name, (np.nan, np.nan)) if factor == "place" else (np.nan, np.nan)
            # a cell without excess is none that stands out, and all windows in one cell stand out from nothing
            fine = float(amount[which].sum()) > 0 and not which.all()
            rows.append(row | {"p": float(p[i]) if fine else 1.0, "x_m": x, "y_m": y})
    cells = pd.DataFrame(rows)
    cells["q"] = 1.0
    for chosen in (cells["factor"] == "channel", cells["factor"] != "channel"):
        cells.loc[chosen, "q"] = false_discovery_control(cells.loc[chosen, "p"].to_numpy())
    return cells


def _row(factor: str, cell: str, n: int, excess: float, total: float, part: float) -> dict[str, object]:
    share = excess / total if total > 0 else np.nan
    return {
        "factor": factor,
        "cell": cell,
        "n": n,
        "excess": excess,
        "share": share,
        "lift": share / part,
        "p": 1.0,
        "x_m": np.nan,
        "y_m": np.nan,
    }


def _shifts(episode: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return orders of windows, shifted in circles within each episode, (P, W)."""
    out = np.empty((PERMUTATIONS, len(episode)), dtype=int)
    for name in dict.fromkeys(episode):
        index = np.flatnonzero(episode == name)
        start = rng.integers(len(index), size=(PERMUTATIONS, 1))
        out[:, index] = index[(np.arange(len(index)) + start) % len(index)]
    return out


def _blocks(count: int, rng: np.random.Generator) -> np.ndarray:
    """Return orders of windows in which blocks of neighbours have changed places, (P, W)."""
    blocks = np.array_split(np.arange(count), max(1, count // BLOCK))
    return np.array(
        [np.concatenate([blocks[b] for b in rng.permutation(len(blocks))]) for _ in range(PERMUTATIONS)]
    ).reshape(PERMUTATIONS, count)


def _sentence(system: AbstractSystem, cells: pd.DataFrame, p: float) -> str:
    """Say where the gap is, in one sentence."""
    if not p < SURE:
        return "nothing exceeds chance"
    rows = cells.to_dict("records")
    channels = [r for r in rows if r["factor"] == "channel" and r["q"] < LEVEL and r["share"] > 0]
    channel = max(channels, key=lambda r: r["share"]) if channels else None
    parts = [f"{channel['cell']}" if channel else "all channels"]
    found = [r for r in rows if r["factor"] != "channel" and r["q"] < LEVEL and r["lift"] > 1]
    # what is rarer by chance comes first, and of equals what has more of the excess
    for regime in (True, False):
        these = [r for r in found if (r["factor"] in system.activities) is regime]
        if these:
            best = min(these, key=lambda r: (r["p"], -r["share"]))
            parts.append(f"{system.phrase(best['factor'], best['cell'])} ({best['share']:+.0%} of the excess)")
    if len(parts) == 1:
        return f"{parts[0]}, wherever and whenever the {system.noun} moves"
    return ", ".join(parts)


__all__ = ["Where", "check_length", "closure_by_regime", "localise"]
