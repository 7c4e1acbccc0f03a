"""How long physics steps may be: as long as the prediction stays the one of the model file's own step.

Steps that divide the sample period put every sample on the grid; where the clock is uneven, channels are interpolated.
"""

from __future__ import annotations

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismRecording
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.simulator import MechanismSimulator, Stretch


def choose_step(
    recording: MechanismRecording, models: Models, starts: list[FloatArray], sigma: FloatArray, threads: int
) -> float:
    """Return the longest step whose prediction differs from that of the file's step by little of the noise.

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
        return [simulator.simulate([Stretch(int(e), 0, len(recording.episodes[e]), (), starts[e])])[0] for e in order]

    exact = predicted(candidates[-1])
    for step_s in candidates[:-1]:
        differences = np.concatenate([a - b for a, b in zip(predicted(step_s), exact, strict=True)])
        if np.all(np.sqrt(np.mean(differences**2, axis=0)) < MECHANISM.replay.step_change_noises * sigma):
            return step_s
    return candidates[-1]


def _candidates(recording: MechanismRecording, file_step_s: float) -> list[float]:
    """Return steps to try, the longest first, the last about the file's own."""
    period, limits = recording.step_s, MECHANISM.replay
    tolerance = limits.even_clock * period
    even = all(np.abs(e.t_s - e.t_s[0] - period * np.arange(len(e))).max() < tolerance for e in recording.episodes)
    longest = max(min(limits.max_step_s, period / limits.min_steps_per_sample), file_step_s)
    if not even:
        doublings = int(np.floor(np.log2(max(longest / file_step_s, 1.0)) + 1e-9))
        return [file_step_s * 2.0**k for k in range(doublings, -1, -1)]
    counts = [int(np.ceil(period / longest - 1e-9))]
    while period / counts[-1] > file_step_s * (1 + 1e-9):
        counts.append(counts[-1] * 2)
    if len(counts) > 1:
        counts[-1] = int(np.ceil(period / file_step_s - 1e-9))
    return [period / n for n in counts]
