"""Descents side by side end in their minima, and none of them is disturbed by the others."""

from __future__ import annotations

import numpy as np
import pytest

from runner.numerics.levenberg_marquardt import Schedule, Trial, damped, descend

SCHEDULE = Schedule(1e-3, most=1e12)
STARTS = np.array([[-1.2, 1.0], [4.0, -7.0], [0.9, 0.8], [1.0, 1.0]])


def residual(x: np.ndarray) -> np.ndarray:
    """Rosenbrock's valley, (n, 2); its minimum is 0 at (1, 1)."""
    return np.stack([10 * (x[:, 1] - x[:, 0] ** 2), 1 - x[:, 0]], axis=1)


def jacobian(x: np.ndarray) -> np.ndarray:
    """Its derivatives, (n, 2, 2)."""
    one = np.ones(len(x))
    return np.stack([np.stack([-20 * x[:, 0], 10 * one], axis=1), np.stack([-one, 0 * one], axis=1)], axis=1)


class Valley:
    """Steps down it, and what was attempted on the way."""

    def __init__(self) -> None:
        self.going: list[list[int]] = []
        self.loss: list[np.ndarray] = []

    def step(self, iteration: int, point: np.ndarray, blocks: np.ndarray, damping: np.ndarray) -> Trial[np.ndarray]:
        assert iteration == len(self.going)
        self.going.append(blocks.tolist())
        x, j = point[blocks], jacobian(point[blocks])
        right = j.transpose(0, 2, 1) @ residual(x)[..., None]
        move = -np.linalg.solve(damped(j.transpose(0, 2, 1) @ j, damping), right)[..., 0]
        trial = x + move
        gained = (residual(trial) ** 2).sum(axis=1) < (residual(x) ** 2).sum(axis=1)
        out = point.copy()
        out[blocks[gained]] = trial[gained]
        self.loss.append((residual(out) ** 2).sum(axis=1))
        return Trial(out, gained, ~gained, rests=np.abs(move).max(axis=1) < 1e-12)


def test_every_block_ends_in_its_minimum() -> None:
    """From near and far, and at no step is a loss higher than before; what rests is attempted no more."""
    valley = Valley()
    end = descend(valley.step, STARTS, SCHEDULE, iterations=200, blocks=len(STARTS))
    assert end == pytest.approx(np.ones((4, 2)), abs=1e-9)
    assert (np.diff(valley.loss, axis=0) <= 0).all()
    assert len(valley.going) < 200
    assert valley.going[0] == [0, 1, 2, 3]
    assert valley.going[1] == [0, 1, 2]


@pytest.mark.parametrize("block", range(len(STARTS)))
def test_blocks_do_not_disturb_each_other(block: int) -> None:
    """Each has its own damping: alone it takes the same steps, bit for bit."""
    together = descend(Valley().step, STARTS, SCHEDULE, iterations=9, blocks=len(STARTS))
    alone = descend(Valley().step, STARTS[block : block + 1], SCHEDULE, iterations=9)
    assert np.array_equal(together[block], alone[0])


def test_damping_follows_what_steps_gain() -> None:
    """Up where they are refused, down where they hold, within its bounds, and as it is where neither is said."""
    said = iter([(False, True), (True, False), (False, False), (True, False), (True, False), (False, True)])
    seen = []

    def step(_: int, point: int, blocks: np.ndarray, damping: np.ndarray) -> Trial[int]:
        seen.append(float(damping[0]))
        return Trial(point + 1, *next(said))

    schedule = Schedule(1e-4, easing=10.0, stiffening=20.0, least=5e-4, least_refused=1e-2, most=0.02)
    assert descend(step, 0, schedule, iterations=6) == 6
    assert seen == pytest.approx([1e-4, 1e-2, 1e-3, 1e-3, 5e-4, 5e-4])


def test_a_block_whose_steps_are_all_refused_is_given_up() -> None:
    """Once its damping is as high as it may be; the other goes on."""
    going = []

    def step(_: int, point: None, blocks: np.ndarray, damping: np.ndarray) -> Trial[None]:
        going.append(blocks.tolist())
        return Trial(point, eased=blocks == 1, refused=blocks == 0)

    descend(step, None, Schedule(1.0, stiffening=10.0, most=1e3), iterations=5, blocks=2)
    assert going == [[0, 1], [0, 1], [0, 1], [1], [1]]


def test_nothing_to_fit_takes_no_step() -> None:
    """No blocks, or no iterations."""

    def step(*_: object) -> Trial[str]:
        raise AssertionError

    assert descend(step, "there", SCHEDULE, iterations=5, blocks=0) == "there"
    assert descend(step, "there", SCHEDULE, iterations=0) == "there"


def test_damping_is_a_share_of_the_diagonal() -> None:
    """Of each matrix its own."""
    normal = np.array([[[2.0, 1.0], [1.0, 4.0]], [[1.0, 0.5], [0.5, 1.0]]])
    expected = np.array([[[3.0, 1.0], [1.0, 6.0]], [[1.0, 0.5], [0.5, 1.0]]])
    assert damped(normal, np.array([0.5, 0.0])) == pytest.approx(expected)
