"""A fit amid everything that may be slightly wrong: the inner products that its evidence is made of.

Derivatives by its own parameters, what every other effect would do beside it, and what it leaves, with the start states
projected out; and the same once a force that nothing foretells is integrated out (see
`runner.inference.process_noise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from runner.effects.vocabulary import Candidate
from runner.inference.directions import Direction, Sensitivities
from runner.inference.least_squares import Fit
from runner.settings import SETTINGS


@dataclass(frozen=True)
class AmidProcess:
    """Normal equations of all episodes with process noise of one scale integrated out.

    Args:
        scale: Standard deviation of the force, in units of the usual one.
        gram: As in `NormalEquations`, summed over episodes, (p + d + 1, p + d + 1).
        cost: Half the logarithm of the determinant.
        scores: Covariance that it gives to the slopes of the loss by the own parameters, (p, p).
    """

    scale: float
    gram: np.ndarray
    cost: float
    scores: np.ndarray


@dataclass(frozen=True)
class NormalEquations:
    """A fit amid the directions of a survey.

    `gram` holds, per fitted episode, the inner products of [own derivatives (p) | directions (d) | residual (1)],
    (E, p + d + 1, p + d + 1), with the start states projected out, in units of what residuals scatter by; `volume` is
    what that costs, see `Spread`. `amid_process` is the sum of the same over episodes with process noise of each scale
    integrated out, what that costs, and what it does to the own derivatives; none where it is not known what a force
    does.
    """

    fit: Fit
    directions: tuple[Direction, ...]
    gram: np.ndarray
    volume: float
    amid_process: tuple[AmidProcess, ...] = ()

    @property
    def by_candidate(self) -> dict[Candidate, list[int]]:
        """The positions of each effect's directions among `directions`, in order, of those that may be named."""
        out: dict[Candidate, list[int]] = {}
        for i, direction in enumerate(self.directions):
            if direction.asked:
                out.setdefault(direction.candidate, []).append(i)
        return out

    @property
    def ways(self) -> dict[Candidate, list[list[int]]]:
        """The same, in groups of what moves together: the derivatives of an effect, or an amount of the whole of it."""
        out = {}
        for candidate, members in self.by_candidate.items():
            derivatives = [m for m in members if not self.directions[m].whole]
            out[candidate] = [*([derivatives] if derivatives else []), *([m] for m in members if m not in derivatives)]
        return out


def normal_equations(fit: Fit, *known: Sensitivities) -> NormalEquations:
    """Set a fit amid the directions of surveys made around it or near it; of each direction the first counts.

    Those of its own effects are left out, save for the texture of the workspace.
    """
    chosen: dict[tuple[Candidate, bytes], tuple[Sensitivities, int]] = {}
    for one in known:
        for i, d in enumerate(one.directions):
            if d.texture or d.candidate not in fit.explanation.candidates:
                chosen.setdefault(d.key, (one, i))
    answers = next((one.pushed for one in known if one.pushed), ())
    gram, amid = [], tuple[AmidProcess, ...]()
    episodes = zip(fit.jacobian, fit.residual, fit.basis.q, fit.spread.dispersion, strict=True)
    for k, (jacobian, residual, q, dispersion) in enumerate(episodes):
        columns = [one.columns[k][:, i] for one, i in chosen.values()]
        whole = np.column_stack([jacobian, *columns, residual]) / np.sqrt(dispersion)
        whole = whole - q @ (q.T @ whole)
        gram.append(whole.T @ whole)
        if answers:
            free = (answers[k] - q @ (q.T @ answers[k])) / np.sqrt(dispersion)
            own = amid_process(whole, free, len(fit.x))
            amid = added(amid, own) if amid else own
    every = tuple(one.directions[i] for one, i in chosen.values())
    return NormalEquations(fit, every, np.array(gram), float(fit.spread.volume.sum()), amid)


def amid_process(whole: np.ndarray, answers: np.ndarray, own: int) -> tuple[AmidProcess, ...]:
    """Return the inner products of columns (n, k) with process noise integrated out, at each of its scales.

    A^T (1 + s^2 K K^T)^-1 A for answers K (n, m) to a unit force; the first `own` columns are the own derivatives.
    """
    size, axes = np.linalg.eigh(answers.T @ answers)
    size, along, plain = np.maximum(size, 0.0), axes.T @ (answers.T @ whole), whole.T @ whole
    out = []
    for scale in SETTINGS.process.scales:
        taken = along.T * (scale**2 / (1.0 + scale**2 * size))
        cost = 0.5 * float(np.log1p(scale**2 * size).sum())
        out.append(AmidProcess(scale, plain - taken @ along, cost, scale**2 * along[:, :own].T @ along[:, :own]))
    return tuple(out)


def without_process(fit: Fit, answers: Sequence[np.ndarray], scale: int) -> Fit:
    """Return a fit with its residuals whitened by process noise of one of the scales: (1 + s^2 K K^T)^-1/2 r."""
    residual, s = [], SETTINGS.process.scales[scale]
    for r, k, q in zip(fit.residual, answers, fit.basis.q, strict=True):
        free, left = k - q @ (q.T @ k), r - q @ (q.T @ r)
        axes, size, _ = np.linalg.svd(free, full_matrices=False)
        residual.append(left - axes @ ((1.0 - 1.0 / np.sqrt(1.0 + (s * size) ** 2)) * (axes.T @ left)))
    return replace(fit, residual=tuple(residual))


def added(first: Sequence[AmidProcess], second: Sequence[AmidProcess]) -> tuple[AmidProcess, ...]:
    """Return the sums of what two parts of the data say, at each scale."""
    return tuple(
        AmidProcess(a.scale, a.gram + b.gram, a.cost + b.cost, a.scores + b.scores)
        for a, b in zip(first, second, strict=True)
    )


def together(a: NormalEquations, b: NormalEquations) -> NormalEquations:
    """Set a fit amid what further episodes say as well, at the same parameters; only directions that both have."""
    p = len(a.fit.x)
    first = {d.key: i for i, d in enumerate(a.directions)}
    shared = [(first[d.key], j) for j, d in enumerate(b.directions) if d.key in first]
    gram, amid = [], list[tuple[AmidProcess, ...]]()
    for around, chosen in ((a, [i for i, _ in shared]), (b, [j for _, j in shared])):
        keep = np.array([*range(p), *(p + i for i in chosen), around.gram.shape[1] - 1])
        gram.append(around.gram[:, keep[:, None], keep])
        amid.append(tuple(replace(one, gram=one.gram[keep[:, None], keep]) for one in around.amid_process))
    every = tuple(a.directions[i] for i, _ in shared)
    return NormalEquations(a.fit, every, np.concatenate(gram), a.volume + b.volume, added(*amid))
