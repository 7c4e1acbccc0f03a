"""Which way the local side of a run is done, and the direct way for many runs at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from runner.teleop.follow import Immediate, Unaware
from runner.teleop.late_side import late_side
from runner.teleop.local_side import learner, local_side
from runner.teleop.parameters import ModelArrays
from runner.teleop.run_record import RunRecord


def side_of(record: RunRecord) -> Callable[..., Callable[[], bool]]:
    """Return what does the updates of a run: the direct way where nothing is late, uncertain or held back."""
    follow = record.experiment.follow
    direct = isinstance(follow, Unaware) or (record.fresh and isinstance(follow, Immediate))
    return local_side if direct else late_side


class LocalSides:
    """The updates of many runs whose ticks come together and whose messages arrive at once, done for all at once.

    What `local_side` does run by run, in fewer calls: states are kept, and taken over, in whole tables. The bits are
    the same, as nothing is computed but by the estimators.

    Args:
        records: Of all runs.
        qpos, qvel: Live states of all runs, (n, nq), (n, nv).
        numbers: Of all runs.
    """

    def __init__(
        self, records: Sequence[RunRecord], qpos: np.ndarray, qvel: np.ndarray, numbers: Sequence[ModelArrays]
    ) -> None:
        self.qpos, self.qvel = qpos, qvel
        self.known = [record.known for record in records]
        self.learn = [learner(*one) for one in zip(records, qpos, qvel, numbers, strict=True)]
        ticks = max(len(record.ends) for record in records)
        self.kept_q, self.kept_v = np.empty((ticks, *qpos.shape)), np.empty((ticks, *qvel.shape))
        for i, record in enumerate(records):
            m = len(record.ends)
            record.qpos, record.qvel = self.kept_q[:m, i], self.kept_v[:m, i]
        remote, *locals_ = records[0].handles
        self.remote = remote.qpos_adr, remote.dof_adr, remote.nq, remote.nv
        self.locals = [(local.qpos_adr, local.dof_adr) for local in locals_]

    @staticmethod
    def serves(records: Sequence[RunRecord]) -> bool:
        """Tell whether runs tick together, and all messages arrive at once and are true."""
        first = records[0]
        return all(
            side_of(r) is local_side
            and r.fresh
            and bool((r.message >= 0).all())
            and len(r.handles) == len(first.handles)
            and np.array_equal(r.ends[: len(first.ends)], first.ends[: len(r.ends)])
            for r in records
        )

    def update(self, number: int, ids: Sequence[int]) -> list[int]:
        """Do one update of some runs, and return those in which a value has changed."""
        if not ids:
            return []
        qpos, qvel = self.qpos, self.qvel
        rows: Any = slice(None) if len(ids) == len(qpos) else ids
        self.kept_q[number, rows], self.kept_v[number, rows] = qpos[rows], qvel[rows]
        positions, velocities, known, learn = qpos.tolist(), qvel.tolist(), self.known, self.learn
        changed = []
        for i in ids:
            state = positions[i], velocities[i]
            if learn[i](known[i][number], state, state):
                changed.append(i)
        q, v, nq, nv = self.remote
        for local_q, local_v in self.locals:
            qpos[rows, local_q : local_q + nq] = qpos[rows, q : q + nq]
            qvel[rows, local_v : local_v + nv] = qvel[rows, v : v + nv]
        return changed
