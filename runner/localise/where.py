"""Where the model misses: per channel, over time as a missing wrench, and shared among what went on and where.

The recording is cut into short windows, and the model is restarted in each from a locally smoothed measured state.
Start states are unknowns of every window and projected out, so that a window tells of its own time alone. What is
left, in units of the noise, is reduced to its slow part (polynomials of `DEGREE` in time, per channel): noise has
little of it, and a missing force has hardly anything else. Its sum of squares less what noise makes of it is the
window's *excess*. Noise that is slow itself shows where the body rests, and is allowed for everywhere.

The *missing wrench* of a window is the constant force and moment that, added to the command, make the model follow the
measurement best. Where friction holds the body, no such wrench can be seen, and it is NaN.

Cells of the map are tested by permutation: the excess is shifted in circles within each episode, which keeps its
correlation in time (for cells that are whole episodes: blocks of windows change places). Apart from the regimes
themselves, the test is of what the regimes leave: a place stands out only if it is worse than what was done there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control, norm

from runner.errors import RecordingError
from runner.simulate.gap import CHANNELS, HORIZONS_S, UNITS, WHOLE_EPISODE
from runner.simulate.shooting import PRIOR_SIGMAS, START_STEP, Restarts, Signals, Windows, whiten, windows_of
from runner.systems.planar_box.simulator import Effects, Run, Simulator, context_of

WINDOWS_S = (0.25, 0.5, 1.0)  # a longer one is less local, and sees smaller effects: taken where a shorter sees none
SMOOTH_S = 0.1  # half width of the local smoother
AFTER_S = 0.1  # so long a change of command is "just" past
DEGREE = 3
PLACES = 5  # cells along each side of the floor map
SECTORS = 8
PERMUTATIONS = 3999
FEWEST = 8  # windows
SURE = 0.01
LEVEL = 0.05  # of the false discovery rate
NOISE_SHARE = 0.06  # the noise may be this much larger (in variance) than stated before it counts as a gap
BLOCK = 4  # windows that change places together where whole episodes are compared
REST_FREEDOM = 30  # values that the noise at rest must rest on
WEAK = 0.25  # a wrench known no better than this share of its prior is not known

REGIMES = (
    "at rest",
    "stuck under load",
    "pushed straight",
    "pushed turning",
    "coasting",
    "spinning",
    "just after a change of command",
)
PHRASES = {
    "regime": "{}",
    "push": "under {}",
    "place": "around {}",
    "heading in the world": "when moving towards {} in the world",
    "heading in the body": "when moving towards {} in the body",
    "speed": "at {}",
    "time": "in {} of an episode",
    "episode": "in {}",
}


@dataclass(frozen=True)
class Where:
    """Where the model misses.

    Args:
        gap: Per channel and horizon, start states fitted: `channel`, `unit`, `horizon`, `rms`, `noise`, `noises`.
        windows: One row per window: `episode`, `t_s` (its middle), `x_m`, `y_m`, `yaw_rad`, `speed_m_s`, `rate_rad_s`,
            a column for each factor of `cells` but the channel, `excess`, `excess_<channel>`, `freedom`.
        wrench: The missing wrench, one row per window of the shortest length: `fx_n`, `fy_n`, `mz_n_m` (world; moment
            about the vertical through the geometric centre), `fx_body_n`, `fy_body_n`, each with `_se`; NaN: not to be
            seen.
        cells: One row per cell: `factor`, `cell`, `n` (windows), `excess`, `share` (of all excess), `lift` (share over
            share of the windows), `p` (one-sided, that it is as large by chance), `q` (Benjamini-Hochberg), and for
            places `x_m`, `y_m`.
        excess: Of all windows, in squared noises; `freedom` of which noise makes, and the `p` of that.
        window_s: Length of the windows.
        sentence: All of it in one sentence.
    """

    gap: pd.DataFrame
    windows: pd.DataFrame
    wrench: pd.DataFrame
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
    simulator: Simulator, measured: Signals, starts_by_episode: Mapping[int, np.ndarray], effects: Effects = ()
) -> Where:
    """Tell where a model misses a recording.

    Args:
        simulator: Of the recording.
        measured: Its channels and their noise.
        starts_by_episode: Start state of each episode that counts, by its position, (6,): for whole episodes.
        effects: What the model holds beyond the nominal one.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    recording = simulator.recording
    episodes = sorted(starts_by_episode)
    lengths = [len(e) for e in recording.episodes]
    restarts = Restarts(simulator, effects)
    rate = recording.nominal.rate_hz
    rows = []
    for horizon in HORIZONS_S:
        windows = windows_of(lengths, max(1, round(horizon * rate)), episodes)
        if len(windows):
            one = _linearised(restarts, windows, measured, smoothed_states(windows, measured, rate))
            rows += _gap_rows(f"{horizon:g} s", *one.left(), measured)
    whole = [simulator.predict(e, [Run(effects, starts_by_episode[e])])[0] - measured.values[e] for e in episodes]
    valid = np.concatenate([measured.valid[e] for e in episodes])
    squares = np.where(valid, np.concatenate(whole) ** 2, 0.0).sum(axis=0)
    rows += _gap_rows(WHOLE_EPISODE, squares, valid.sum(axis=0) - len(episodes), measured)

    check_length(simulator, episodes)
    windows = _windows(simulator, WINDOWS_S[0], episodes)
    shortest = look = _look(restarts, windows, measured, np.ones(len(CHANNELS)))
    noise = look.noise
    for window_s in WINDOWS_S[1:]:
        windows = _windows(simulator, window_s, episodes)
        if look.p < SURE or len(windows) < FEWEST:
            break
        longer = _look(restarts, windows, measured, noise)
        noise = longer.noise
        look = longer if longer.p < SURE else look
    table = look.tags.assign(
        excess=look.excess.sum(axis=1),
        freedom=look.freedom.sum(axis=1),
        **{f"excess_{c}": look.excess[:, i] for i, c in enumerate(CHANNELS)},
    )
    cells = _cells(table, look.excess, look.freedom, look.places)
    keys = shortest.tags[["episode", "t_s", "x_m", "y_m", "yaw_rad", "regime", "heading in the world"]]
    wrench = _wrench(shortest.local, shortest.tags["yaw_rad"].to_numpy(), simulator, float(shortest.noise.max()))
    return Where(
        gap=pd.DataFrame(rows),
        windows=table,
        wrench=pd.concat([keys, wrench], axis=1),
        cells=cells,
        window_s=(look.local.raw.shape[1] - 1) / rate,
        excess=float(look.excess.sum()),
        freedom=float(look.freedom.sum()),
        p=look.p,
        sentence=_sentence(cells, look.p),
    )


def check_length(simulator: Simulator, episodes: Sequence[int] | None = None) -> None:
    """Refuse a recording, or these episodes of it, that is too short to tell anything.

    Raises:
        RecordingError: If there are not even a few windows.
    """
    count = len(
        _windows(simulator, WINDOWS_S[0], range(len(simulator.recording.episodes)) if episodes is None else episodes)
    )
    if count < FEWEST:
        raise RecordingError(
            f"{simulator.recording.path}: {count} windows of {WINDOWS_S[0]:g} s, at least {FEWEST} are needed."
        )


def closure_by_regime(
    simulator: Simulator, measured: Signals, episodes: Sequence[int], effects: Effects, window_s: float
) -> pd.DataFrame:
    """Return what a model misses in each regime before and after effects are added to it.

    Args:
        simulator: Of the recording.
        measured: Its channels and their noise.
        episodes: Those that count, by their position.
        effects: What is added.
        window_s: Length of the windows.

    Returns:
        `regime`, `windows`, and `before` and `after`: mean square of the slow residual over what noise makes of it
        (1: nothing but noise), as in `Where`. Of regimes that occur only.
    """
    windows = _windows(simulator, window_s, sorted(episodes))
    if not len(windows):
        return pd.DataFrame(columns=["regime", "windows", "before", "after"])
    looks = [_look(Restarts(simulator, e), windows, measured, np.ones(len(CHANNELS))) for e in ((), effects)]
    regime = looks[0].tags["regime"].to_numpy()
    rows = []
    for name in REGIMES:
        here = regime == name
        if here.any():
            ratios = [1.0 + float(k.excess[here].sum()) / max(float(k.freedom[here].sum()), 1e-9) for k in looks]
            rows.append({"regime": name, "windows": int(here.sum()), "before": ratios[0], "after": ratios[1]})
    return pd.DataFrame(rows)


def _windows(simulator: Simulator, window_s: float, episodes: Sequence[int]) -> Windows:
    lengths = [len(e) for e in simulator.recording.episodes]
    samples = max(DEGREE + 1, round(window_s * simulator.recording.nominal.rate_hz))
    return windows_of(lengths, samples, episodes)


@dataclass(frozen=True)
class _Look:
    """Windows of one length, and what they show."""

    local: _Linearised
    tags: pd.DataFrame
    places: dict[str, tuple[float, float]]
    excess: np.ndarray  # (W, 6)
    freedom: np.ndarray  # (W, 6)
    noise: np.ndarray  # (6,), see `_noise_at_rest`

    @property
    def p(self) -> float:
        """Probability of so much excess by noise."""
        free = float(self.freedom.sum())
        return float(norm.sf((float(self.excess.sum()) - NOISE_SHARE * free) / np.sqrt(2 * max(free, 1e-9))))


def _look(restarts: Restarts, windows: Windows, measured: Signals, shorter: np.ndarray) -> _Look:
    simulator = restarts.simulator
    rate = simulator.recording.nominal.rate_hz
    first = _linearised(restarts, windows, measured, smoothed_states(windows, measured, rate))
    local = _linearised(restarts, windows, measured, first.fitted(), wrench_steps(simulator))
    tags, places = _tags(simulator, measured, windows)
    slow, freedom = local.slow()
    noise = _noise_at_rest(slow, freedom, tags["regime"].to_numpy() == REGIMES[0], shorter)
    return _Look(local, tags, places, slow / noise - freedom, freedom, noise)


def smoothed_states(windows: Windows, signals: Signals, rate_hz: float) -> np.ndarray:
    """Return states at the starts of windows from local cubics through poses and velocities, (W, 6)."""
    reach = max(2, round(SMOOTH_S * rate_hz))
    out = np.empty((len(windows), 6))
    for w, (e, f) in enumerate(zip(windows.episode, windows.first, strict=True)):
        span = np.arange(max(0, f - reach), min(len(signals.values[e]), f + reach + 1))
        t = (span - f) / rate_hz
        pose = np.stack([np.ones_like(t), t, t**2 / 2, t**3 / 6], axis=1)
        rate = np.stack([np.zeros_like(t), np.ones_like(t), t, t**2 / 2], axis=1)
        for c in range(3):
            weight = signals.valid[e][span][:, [c, c + 3]] / signals.sigma[[c, c + 3]]
            matrix = np.vstack([pose * weight[:, :1], rate * weight[:, 1:]])
            right = (signals.values[e][span][:, [c, c + 3]] * weight).T.ravel()
            out[w, [c, c + 3]] = np.linalg.lstsq(matrix, right, rcond=None)[0][:2]
    return out


def wrench_steps(simulator: Simulator) -> np.ndarray:
    """Return small wrenches for differences, (3, 3): N, N, N m."""
    context = context_of(simulator.recording)
    force = 0.03 * context.friction_n
    return np.diag([force, force, force * context.size_m])


@dataclass(frozen=True)
class _Linearised:
    """Windows around their start states: everything in units of the noise.

    `starts` (W, 6); `residual` whitened (W, n, 6); `raw` the same in physical units; `jacobian` by the start states,
    per noise, whitened (W, n, 6, 6), and `change` the same not whitened; `by_wrench` per step, whitened (W, n, 6, 3).
    """

    measured: Signals
    starts: np.ndarray
    valid: np.ndarray
    raw: np.ndarray
    residual: np.ndarray
    change: np.ndarray
    jacobian: np.ndarray
    by_wrench: np.ndarray

    def _solve(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the inverse of the normal equations, (W, 6, 6), and the step of the start states, (W, 6), noises."""
        w = len(self.starts)
        matrix = self.jacobian.reshape(w, -1, 6)
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + np.eye(6) / PRIOR_SIGMAS**2)
        right = matrix.transpose(0, 2, 1) @ self.residual.reshape(w, -1, 1)
        return inverse, -(inverse @ right)[..., 0]

    def fitted(self) -> np.ndarray:
        """Return start states one step closer to the measurement."""
        return self.starts + self._solve()[1] * self.measured.sigma

    def left(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares per channel, the start states fitted, physical units, and their freedom, (6,) each."""
        inverse, step = self._solve()
        left = self.raw + (self.change @ step[:, None, :, None])[..., 0] * self.measured.sigma
        followed = ((self.change @ inverse[:, None]) * self.change).sum(axis=-1)
        freedom = np.where(self.valid, 1.0 - followed, 0.0)
        return np.where(self.valid, left**2, 0.0).sum(axis=(0, 1)), freedom.sum(axis=(0, 1))

    def slow(self) -> tuple[np.ndarray, np.ndarray]:
        """Return sums of squares of the slow residual, and what noise makes of them, per window and channel, (W, 6)."""
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

    def wrench(self, prior_steps: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the missing wrench in steps, (W, 3), and its covariance, (W, 3, 3), inflated where the fit is bad."""
        w, n, c, _ = self.jacobian.shape
        matrix = np.concatenate([self.jacobian, self.by_wrench], axis=-1).reshape(w, n * c, 9)
        weak = np.diag([PRIOR_SIGMAS**-2] * 6 + [prior_steps**-2] * 3)
        inverse = np.linalg.inv(matrix.transpose(0, 2, 1) @ matrix + weak)
        flat = self.residual.reshape(w, n * c, 1)
        solution = -(inverse @ (matrix.transpose(0, 2, 1) @ flat))
        left = flat + matrix @ solution
        misfit = (left[..., 0] ** 2).sum(axis=1) / np.maximum(self.valid.sum(axis=(1, 2)) - 9, 1)
        return solution[:, 6:, 0], inverse[:, 6:, 6:] * np.maximum(misfit, 1.0)[:, None, None]


def _linearised(
    restarts: Restarts, windows: Windows, measured: Signals, starts: np.ndarray, wrenches: np.ndarray | None = None
) -> _Linearised:
    extra = np.zeros((0, 3)) if wrenches is None else wrenches
    offsets = np.vstack([np.zeros(6), np.diag(START_STEP), np.zeros((len(extra), 6))])
    push = np.vstack([np.zeros((7, 3)), extra]) if len(extra) else None
    rows = restarts.predict(windows, starts[:, None] + offsets, push)
    values, valid = windows.of(measured.values), windows.of(measured.valid)
    raw = rows[:, 0] - values
    moved = (rows[:, 1:7] - rows[:, :1]) / START_STEP[:, None, None] * measured.sigma[:, None, None]
    return _Linearised(
        measured=measured,
        starts=starts,
        valid=valid,
        raw=raw,
        residual=whiten(raw, valid, measured),
        change=np.moveaxis(moved / measured.sigma, 1, -1),
        jacobian=np.moveaxis(whiten(moved, valid[:, None], measured), 1, -1),
        by_wrench=np.moveaxis(whiten(rows[:, 7:] - rows[:, :1], valid[:, None], measured), 1, -1),
    )


def _noise_at_rest(slow: np.ndarray, freedom: np.ndarray, rest: np.ndarray, shorter: np.ndarray) -> np.ndarray:
    """Return how much more slow noise each channel has at rest than it should, at least 1, (6,).

    Where there is too little rest to tell, noise that was slow in `shorter` windows of half the length is taken for
    slower still: its ratio squared.
    """
    free = freedom[rest].sum(axis=0)
    ratio = slow[rest].sum(axis=0) / np.maximum(free, 1e-9)
    sure = ratio > 1 + 2 * np.sqrt(2 / np.maximum(free, 1e-9))
    return np.where(free >= REST_FREEDOM, np.where(sure, ratio, 1.0), shorter**2)


def _gap_rows(horizon: str, squares: np.ndarray, count: np.ndarray, measured: Signals) -> list[dict[str, object]]:
    rms = np.sqrt(squares / np.maximum(count, 1e-9))
    return [
        {
            "channel": channel,
            "unit": UNITS[c],
            "horizon": horizon,
            "rms": float(rms[c]),
            "noise": float(measured.sigma[c]),
            "noises": float(rms[c] / measured.sigma[c]),
        }
        for c, channel in enumerate(CHANNELS)
    ]


def _wrench(local: _Linearised, yaw: np.ndarray, simulator: Simulator, inflation: float) -> pd.DataFrame:
    step = np.diag(wrench_steps(simulator))
    context = context_of(simulator.recording)
    prior_steps = 3 * max(context.friction_n, context.force_n) / step[0]
    steps, covariance = local.wrench(prior_steps)
    covariance = covariance * inflation
    value, spread = steps * step, covariance * step[:, None] * step
    turn = np.zeros((len(yaw), 3, 3))  # world to body
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(yaw)
    turn[:, 0, 1], turn[:, 1, 0], turn[:, 2, 2] = np.sin(yaw), -np.sin(yaw), 1.0
    body = (turn @ value[..., None])[..., 0]
    body_spread = turn @ spread @ turn.transpose(0, 2, 1)
    out: dict[str, np.ndarray] = {}
    for values, covariances, names in (
        (value, spread, ("fx_n", "fy_n", "mz_n_m")),
        (body, body_spread, ("fx_body_n", "fy_body_n")),
    ):
        for i, name in enumerate(names):
            error = np.sqrt(covariances[:, i, i])
            known = error < WEAK * prior_steps * step[i]
            out[name] = np.where(known, values[:, i], np.nan)
            out[f"{name}_se"] = np.where(known, error, np.nan)
    return pd.DataFrame(out)


def _tags(
    simulator: Simulator, measured: Signals, windows: Windows
) -> tuple[pd.DataFrame, dict[str, tuple[float, float]]]:
    """Return what went on in each window, from commands and measurements alone, and where the places are."""
    recording = simulator.recording
    context = context_of(recording)
    size, rate = context.size_m, recording.nominal.rate_hz
    mean = windows.of(measured.values).mean(axis=1)
    velocity, turning = mean[:, 3:5], mean[:, 5]
    speed, surface = np.linalg.norm(velocity, axis=1), np.abs(turning) * size
    slow = 0.01 * np.sqrt(recording.nominal.gravity_m_s2 * size)
    error = measured.sigma[3:] / np.sqrt(windows.samples)
    moves, turns = speed > max(slow, 4 * error[0]), surface > max(slow, 4 * error[2] * size)

    force, arm, changed = [], [], []
    for episode in recording.episodes:
        f, (c, s) = np.nan_to_num(episode.force_n), (np.cos(episode.pose[:, 2]), np.sin(episode.pose[:, 2]))
        point = np.nan_to_num(episode.point_m)
        px, py = c * point[:, 0] - s * point[:, 1], s * point[:, 0] + c * point[:, 1]
        moment = px * f[:, 1] - py * f[:, 0]
        size_n = np.linalg.norm(f, axis=1)
        force.append(size_n)
        arm.append(np.divide(moment, size_n * size, out=np.zeros_like(moment), where=size_n > 0))
        # the moment turns with the body: a change of point is one of the command
        jump = np.linalg.norm(np.diff(f, axis=0, prepend=f[:1]), axis=1)
        shift = np.linalg.norm(np.diff(point * size_n[:, None], axis=0, prepend=(point * size_n[:, None])[:1]), axis=1)
        changed.append(np.maximum(jump, shift / size) > 0.2 * context.force_n)
    steps = windows.samples - 1
    held, arms = windows.of(force)[:, :-1], windows.of(arm)[:, :-1]
    pushed = (held > 1e-9 * context.force_n).mean(axis=1) > 0.5
    lever = (arms * held).sum(axis=1) / np.maximum(held.sum(axis=1), 1e-300)
    back = round(AFTER_S * rate)
    after = np.array(
        [changed[e][max(0, f - back) : f + steps].any() for e, f in zip(windows.episode, windows.first, strict=True)],
        bool,
    )
    still = ~moves & ~turns
    regime = np.select(
        [after, still & pushed, still, pushed & (surface > 0.3 * speed), pushed, surface > speed],
        [REGIMES[i] for i in (6, 1, 0, 3, 2, 5)],
        REGIMES[4],
    )
    push = np.select(
        [~pushed, np.abs(lever) < 0.1, lever > 0],
        ["no push", "a central push", "an off-centre push (counter-clockwise)"],
        "an off-centre push (clockwise)",
    )
    sector = np.arctan2(velocity[:, 1], velocity[:, 0])
    place, places = _places(mean[:, :2])
    middle = windows.first + steps / 2
    part = middle / np.array([len(recording.episodes[e]) for e in windows.episode])
    tags = pd.DataFrame(
        {
            "episode": [f"episode {recording.episodes[e].index}" for e in windows.episode],
            "t_s": [recording.episodes[e].t_s[0] + m / rate for e, m in zip(windows.episode, middle, strict=True)],
            "x_m": mean[:, 0],
            "y_m": mean[:, 1],
            "yaw_rad": mean[:, 2],
            "speed_m_s": speed,
            "rate_rad_s": turning,
            "regime": regime,
            "push": push,
            "place": place,
            "heading in the world": _sector(sector, moves),
            "heading in the body": _sector(sector - mean[:, 2], moves),
            "speed": _speeds(speed, moves),
            "time": np.array([f"the {q} quarter" for q in ("first", "second", "third", "last")])[
                np.minimum(4 * part, 3).astype(int)
            ],
        }
    )
    return tags, places


def _sector(angle: np.ndarray, moves: np.ndarray) -> np.ndarray:
    step = 360 // SECTORS
    degrees = (np.round(np.degrees(angle) / step).astype(int) * step + 179) % 360 - 179
    return np.array([f"{d:d}°" if m else None for d, m in zip(degrees, moves, strict=True)], dtype=object)


def _speeds(speed: np.ndarray, moves: np.ndarray) -> np.ndarray:
    out = np.full(len(speed), None, dtype=object)
    if moves.sum() >= 8:
        edges = np.quantile(speed[moves], [0, 0.25, 0.5, 0.75, 1])
        k = np.clip(np.searchsorted(edges, speed, side="right") - 1, 0, 3)
        out[moves] = np.array([f"{a:.2f} to {b:.2f} m/s" for a, b in pairwise(edges)])[k[moves]]
    return out


def _places(xy: np.ndarray) -> tuple[np.ndarray, dict[str, tuple[float, float]]]:
    """Return a label of the floor's cell for each position (W, 2), and the cells' centres; the cells are square."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    side = max(float((high - low).max()) / PLACES, 1e-9)
    cell = np.minimum((xy - low) // side, np.ceil((high - low) / side) - 1).clip(0).astype(int)
    centre = low + (cell + 0.5) * side
    labels = [f"x {x:.2f} m, y {y:.2f} m" for x, y in centre]
    return np.array(labels, dtype=object), {
        label: (float(x), float(y)) for label, (x, y) in zip(labels, centre, strict=True)
    }


def _cells(
    table: pd.DataFrame, excess: np.ndarray, freedom: np.ndarray, places: Mapping[str, tuple[float, float]]
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
    for c, channel in enumerate(CHANNELS):
        free = float(freedom[:, c].sum())
        score = (float(excess[:, c].sum()) - NOISE_SHARE * free) / np.sqrt(2 * max(free, 1e-9))
        rows.append(_row("channel", channel, len(table), float(excess[:, c].sum()), total, 1.0 / len(CHANNELS)))
        rows[-1]["p"] = float(norm.sf(score))
    for factor in PHRASES:
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


def _sentence(cells: pd.DataFrame, p: float) -> str:
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
        these = [r for r in found if (r["factor"] in ("regime", "push")) is regime]
        if these:
            best = min(these, key=lambda r: (r["p"], -r["share"]))
            parts.append(f"{_phrase(best)} ({best['share']:+.0%} of the excess)")
    if len(parts) == 1:
        return f"{parts[0]}, wherever and whenever the body moves"
    return ", ".join(parts)


def _phrase(row: Mapping[str, object]) -> str:
    phrase = PHRASES[str(row["factor"])].format(row["cell"])
    return f"when {phrase}" if phrase.startswith(("pushed", "coasting", "spinning", "stuck")) else phrase


__all__ = ["Where", "localise", "smoothed_states"]
