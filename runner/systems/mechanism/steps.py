"""How long physics steps may be: so long that their error is nothing to what a recording can tell.

A step's error is the same in every sample that is like another, so that thousands of readings tell what is far below
the noise of one: an error e, in noises, moves no number that is fitted by more than |e| of its standard errors, the
root of the sum of squares over all readings (Cauchy and Schwarz). That is what is kept small. Over which parts of a
recording readings may be compared is told by a step that will do for each of them alone.

Steps that divide the sample period put every sample on the grid; where the clock is uneven, channels are interpolated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.numerics.arrays import FloatArray, spread_over
from runner.recording import Span
from runner.recording.model_form import MechanismRecording
from runner.systems.mechanism.models import Models, can_touch
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.simulator import SHORTEST_STEP_S, MechanismSimulator, Stretch
from runner.systems.stretches import Sensitive
from runner.systems.windows import Windows


def choose_step(
    recording: MechanismRecording, models: Models, starts: list[FloatArray], sigma: FloatArray, threads: int
) -> float:
    """Return the longest step whose prediction differs from that of the file's by little of the noise of one reading.

    Args:
        recording: The case.
        models: Its compiled models.
        starts: A start of each episode, (S,).
        sigma: Noise of each channel, (C,), where need be a rough one.
        threads: For the rollouts.
    """
    candidates = _candidates(recording, models.file_step_s)
    order = np.argsort([-len(e) for e in recording.episodes])[: MECHANISM.replay.compared_episodes]

    def predicted(step_s: float) -> list[FloatArray]:
        simulator = MechanismSimulator(recording, models, step_s, threads)
        return simulator.simulate([Stretch(int(e), 0, len(recording.episodes[e]), (), starts[e]) for e in order])

    exact, allowed = predicted(candidates[-1]), MECHANISM.replay.step_change_noises

    def error(step_s: float) -> float:
        """Return how far one reading is off as a rule, in noises, in the channel where that is most."""
        differences = np.concatenate([a - b for a, b in zip(predicted(step_s), exact, strict=True)])
        return float(np.max(np.sqrt(np.mean(differences**2, axis=0)) / sigma))

    between = 0.0
    for step_s in candidates:
        off = error(step_s) if step_s != candidates[-1] else 0.0
        if off < allowed:
            # the error is of second order
            if between > step_s * (1 + 1e-9) and error(between) < allowed:
                return between
            return step_s
        between = _fitting(recording, step_s * float(np.sqrt(allowed / off)) if np.isfinite(off) else 0.0)
    return candidates[-1]


def _fitting(recording: MechanismRecording, longest_s: float) -> float:
    """Return a step that is no longer, and of which samples on an even clock are whole ones apart; 0: there is none."""
    if not _even(recording) or longest_s <= 0.0:
        return longest_s
    return recording.step_s / int(np.ceil(recording.step_s / longest_s - 1e-9))


def _even(recording: MechanismRecording) -> bool:
    """Whether the samples of all episodes are as far from each other."""
    period = recording.step_s
    tolerance = MECHANISM.replay.even_clock * period
    return all(np.abs(e.t_s - e.t_s[0] - period * np.arange(len(e))).max() < tolerance for e in recording.episodes)


def _candidates(recording: MechanismRecording, file_step_s: float) -> list[float]:
    """Return steps to try, the longest first, the last about the file's own."""
    period, limits = recording.step_s, MECHANISM.replay
    longest = max(min(limits.max_step_s, period / limits.min_steps_per_sample), file_step_s)
    if not _even(recording):
        doublings = int(np.floor(np.log2(max(longest / file_step_s, 1.0)) + 1e-9))
        return [file_step_s * 2.0**k for k in range(doublings, -1, -1)]
    counts = [int(np.ceil(period / longest - 1e-9))]
    while period / counts[-1] > file_step_s * (1 + 1e-9):
        counts.append(counts[-1] * 2)
    if len(counts) > 1:
        counts[-1] = int(np.ceil(period / file_step_s - 1e-9))
    return [period / n for n in counts]


def settled_step(
    known: Sensitive[MechanismSimulator], spans: Sequence[Span], searched_s: float, dispersion: float = 1.0
) -> float:
    """Return the longest step, of a simulator's own and shorter ones, whose error no fit would notice.

    Where contacts are as hard as the steps of the model file make them it is not shorter than those; nor where halving
    it does not help, as where joints stick.

    Args:
        known: The recording, by a simulator whose step will do for a single reading.
        spans: What is fitted, and compared.
        searched_s: So much of that at most.
        dispersion: How many times as uncertain as noise residuals are, as a variance: standard errors are longer by its
            root, and so may an error of the step be.
    """
    simulator, limits = known.simulator, MECHANISM.replay
    allowed = limits.step_error_noises * float(np.sqrt(dispersion))
    recording, models = simulator.recording, simulator.models
    samples = min(s.end - s.begin for s in spans)
    enough = max(1, round(searched_s / (samples * recording.step_s)))
    chosen = [spans[i] for i in spread_over(len(spans), min(enough, len(spans)))]
    windows = Windows(np.array([s.episode for s in chosen]), np.array([s.begin for s in chosen]), samples)
    starts = known.initial.guess_windows(known.signals, windows, smooth=True)[:, None]
    readings = np.array([v.mean(axis=0) for v in known.signals.valid]).mean(axis=0) * samples * len(chosen)

    def shown(parts: int) -> FloatArray:
        """Return what is shown in noises where each of the simulator's steps is so many, (W, n, C)."""
        with np.errstate(invalid="ignore", over="ignore"):
            stepping = simulator.stepping(simulator.step_s * before / parts)
            return stepping.predict_windows((), windows, starts)[:, 0] / known.signals.sigma

    def error(parts: int) -> float:
        """Return the error over all readings, in noises: of second order, so that half the step leaves a quarter."""
        squares = (shown(parts) - shown(2 * parts)) ** 2
        return 4.0 / 3.0 * float(np.sqrt(np.nan_to_num(squares.mean(axis=(0, 1)) @ readings, nan=np.inf)))

    # the steps of a sample period, so that those of an even clock end with it
    before = max(1, round(recording.step_s / simulator.step_s))
    least_s = models.file_step_s if can_touch(models.compiled(()).model) else min(models.file_step_s, SHORTEST_STEP_S)
    most = max(before, int(before * simulator.step_s / least_s + 1e-9))
    parts, off, too_few = before, error(before), before - 1
    while off > allowed and parts < most:
        more = min(max(_enough(parts, off / allowed), parts + 1), 2 * parts, most)
        less = error(more)
        if not less < off * parts / more:
            break
        parts, off, too_few = more, less, parts
    while off < allowed and too_few < (fewer := max(_enough(parts, off / allowed), too_few + 1)) < parts:
        if (more := error(fewer)) < allowed:
            parts, off = fewer, more
        else:
            too_few = fewer
    return simulator.step_s * before / parts


def _enough(parts: int, off: float) -> int:
    """Return into how many parts a period is to be cut, from how far off so many are, of what may be: second order."""
    return int(min(np.ceil(parts * np.sqrt(off)), 1e6))
