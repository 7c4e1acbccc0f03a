"""Ways to spoil the table of a recording."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas as pd

DEGREES = 180 / np.pi
Edit = Callable[[pd.DataFrame], pd.DataFrame]


def scaled(factor: float, *names: str) -> Edit:
    """Return an edit that multiplies columns."""
    return lambda f: f.assign(**{n: f[n] * factor for n in names})


def exchanged(*pairs: tuple[str, str]) -> Edit:
    """Return an edit that exchanges columns."""
    return lambda f: f.assign(**{a: f[b] for a, b in pairs}, **{b: f[a] for a, b in pairs})


def constant(*names: str) -> Edit:
    """Return an edit that holds columns at their first value."""
    return lambda f: f.assign(**{n: f[n].iloc[0] for n in names})


def zero(*names: str) -> Edit:
    """Return an edit that sets columns to zero."""
    return lambda f: f.assign(**dict.fromkeys(names, 0.0))


def spike(name: str, by: float, row: int = 700) -> Edit:
    """Return an edit that moves one sample."""
    return lambda f: f.assign(**{name: f[name] + by * (np.arange(len(f)) == row)})


def late(samples: int, *names: str) -> Edit:
    """Return an edit that shifts columns within each episode, their ends held."""
    return lambda f: f.assign(**{n: f.groupby("episode")[n].shift(samples).bfill().ffill() for n in names})


def frozen(first: int, last: int, *names: str) -> Edit:
    """Return an edit that keeps one value for a while, everything else as it was."""
    return lambda f: f.assign(
        **{n: f[n].where((np.arange(len(f)) < first) | (np.arange(len(f)) >= last), f[n].iloc[first]) for n in names}
    )


def shifted(by: float, first: int, last: int | None, name: str) -> Edit:
    """Return an edit that adds to a stretch of a column."""
    return lambda f: f.assign(**{name: f[name] + by * np.isin(np.arange(len(f)), np.arange(len(f))[first:last])})


def noise(size: float, *names: str) -> Edit:
    """Return an edit that puts white noise in the place of columns."""
    return lambda f: f.assign(**{n: np.random.default_rng(0).normal(0, size, len(f)) for n in names})


def lacking(first: int, last: int | None, *names: str) -> Edit:
    """Return an edit that empties a stretch of columns."""
    return lambda f: f.assign(
        **{n: f[n].where((np.arange(len(f)) < first) | (np.arange(len(f)) >= (last or len(f)))) for n in names}
    )


def of_another_episode(*names: str) -> Edit:
    """Return an edit that gives each episode the columns of the next one, as far as both last."""

    def edit(f: pd.DataFrame) -> pd.DataFrame:
        parts = [part for _, part in f.groupby("episode")]
        out = []
        for part, other in zip(parts, parts[1:] + parts[:1], strict=True):
            count = min(len(part), len(other))
            columns = {n: np.concatenate([other[n].to_numpy()[:count], part[n].to_numpy()[count:]]) for n in names}
            out.append(part.assign(**columns))
        return pd.concat(out, ignore_index=True)

    return edit


def rows(choose: Callable[[int], np.ndarray]) -> Edit:
    """Return an edit that takes rows by their numbers, of which `choose` is told how many there are."""
    return lambda f: f.iloc[choose(len(f))].reset_index(drop=True)


def without(first: int, last: int) -> Edit:
    """Return an edit that loses a stretch of rows."""
    return rows(lambda n: np.r_[0:first, last:n])


def shuffled(seed: int = 0) -> Edit:
    """Return an edit that shuffles all rows."""
    return rows(lambda n: np.random.default_rng(seed).permutation(n))


def doubled(first: int, last: int) -> Edit:
    """Return an edit that has a stretch of rows twice."""
    return rows(lambda n: np.r_[0:last, first:n])


def rounded(step: float, *names: str) -> Edit:
    """Return an edit that rounds columns."""
    return lambda f: f.assign(**{n: np.round(f[n] / step) * step for n in names})


def at_other_times(change: Callable[[pd.DataFrame], object]) -> Edit:
    """Return an edit of the times alone."""
    return lambda f: f.assign(t=change(f))


def jitter(share: float) -> Callable[[pd.DataFrame], object]:
    """Return times that are off by up to a share of a step."""
    return lambda f: f["t"] + share * np.median(np.diff(f["t"])) * np.random.default_rng(0).uniform(-1, 1, len(f))


def rate_off_in_last(share: float) -> Callable[[pd.DataFrame], object]:
    """Return times of which those of the last episode run faster."""
    return lambda f: f["t"] * np.where(f["episode"] == f["episode"].max(), 1 + share, 1.0)


TIMES: dict[str, Edit] = {
    "`t` in ms": at_other_times(lambda f: f["t"] * 1000),
    "`t` x 60": at_other_times(lambda f: f["t"] * 60),
    "`t` twice as fast": at_other_times(lambda f: f["t"] / 2),
    "`t` from zero to zero": at_other_times(lambda f: 0.0 * f["t"]),
    "`t` backwards": at_other_times(lambda f: -f["t"]),
    "`t` off by up to half a step": at_other_times(jitter(0.5)),
    "`t` 5 % faster in the last episode": at_other_times(rate_off_in_last(0.05)),
    "`t` in seconds since 1970": at_other_times(lambda f: f["t"] + 1.7e9),
}
ROWS: dict[str, Edit] = {
    "10 rows lost": without(100, 110),
    "every other row lost": lambda f: f.iloc[::2].reset_index(drop=True),
    "10 rows twice": doubled(100, 110),
    "rows shuffled": shuffled(),
    "rows backwards": lambda f: f.iloc[::-1].reset_index(drop=True),
    "all rows one episode": lambda f: f.assign(episode=0),
    "two rows only": lambda f: f.head(2),
}
