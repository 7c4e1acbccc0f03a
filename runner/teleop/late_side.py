"""The local side of a run whose received states are old, or uncertain, or not taken over at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from runner.teleop.estimators import Outcome, Seen
from runner.teleop.follow import ALL, Difference
from runner.teleop.latency import Resimulation
from runner.teleop.local_side import cuts_of
from runner.teleop.parameters import ModelArrays, sizes, writer
from runner.teleop.run_record import RunRecord


class LateSide:
    """Does the updates of a run, on live views of its state and its model's numbers.

    The estimate is made in a simulation of its own, see `runner.teleop.latency`. The local cubes of the run are what
    the operator is shown: they follow it by the policy, and have no part in the estimate.

    Args:
        record: Of the run.
        qpos, qvel: Live state, (nq,), (nv,).
        numbers: Of the run's model.
    """

    def __init__(self, record: RunRecord, qpos: np.ndarray, qvel: np.ndarray, numbers: ModelArrays) -> None:
        self.record, self.qpos, self.qvel = record, qpos, qvel
        experiment = record.experiment
        self.own = Resimulation(experiment, record.commands)
        self.step_s = experiment.scene.timestep_s
        remote, self.shown = record.handles[0], record.handles[1:]
        self.remote_cuts = cuts_of(remote)
        self.at_v = slice(remote.dof_adr, remote.dof_adr + remote.nv)
        self.total = np.vstack([np.zeros(3), np.cumsum(record.commands.force_n, axis=0) * self.step_s])
        self.rules = list(experiment.estimator.values())
        self.memories = [rule.start(record.setup) for rule in self.rules]
        self.write_own, self.write_shown = (
            [writer(rule.names, n, handles[j].body_id, experiment.local) for j, rule in enumerate(self.rules)]
            for n, handles in ((ModelArrays.of(self.own.model), self.own.handles), (numbers, self.shown))
        )
        self.values = [np.array(rule.values(memory)) for rule, memory in zip(self.rules, self.memories, strict=True)]
        self.given = [value.copy() for value in self.values]  # to the shown cubes
        self.outcomes = [Outcome.no_message] * len(self.rules)
        # the state that both had when they were last made equal, and the step of that
        self.common: tuple[list[float], list[float]] = qpos.tolist(), qvel.tolist()
        self.common_step = 0
        self.number, self.now, self.before = -1, 0, 0  # the update; its step, and that of the one before

    def update(self) -> bool:
        """Do one update; return whether a value of a shown cube has changed."""
        record = self.record
        self.number += 1
        record.count, self.now = self.number + 1, int(record.ends[self.number])
        record.qpos[self.number], record.qvel[self.number] = self.qpos, self.qvel
        self.outcomes = [Outcome.no_message] * len(self.rules)
        for message in record.taken[self.number]:
            self._take_in(message)
        best_state = self.own.state(self.now)
        changed = [self._follow(j, *best_state) for j in range(len(self.rules))]
        for j in range(len(self.rules)):
            record.memories[j].append(self.memories[j])
            record.outcomes[j].append(self.outcomes[j])
            record.shown[j].append(tuple(self.given[j].tolist()))
        self.before = self.now
        return any(changed)

    def _take_in(self, message: int) -> None:
        """Let every estimator compare a message with what was predicted for its time, and start again from there."""
        record, own, h = self.record, self.own, self.step_s
        step = int(record.ends[message])
        q, v = own.state(step)
        state, said = (q.tolist(), v.tolist()), record.received(message)
        taken = said[0].tolist(), said[1].tolist()
        impulse = (self.total[step] - self.total[self.common_step]).tolist()
        times = self.now * h, step * h, self.common_step * h
        for j, rule in enumerate(self.rules):
            seen = Seen(*times, impulse, *state, *taken, *self.common, cuts_of(own.handles[j]), self.remote_cuts)
            memory, self.outcomes[j] = rule.update(self.memories[j], seen)
            if memory is not self.memories[j]:
                self.memories[j] = memory
                self.values[j] = np.array(rule.values(memory))
                self.write_own[j](self.values[j])
                own.set_parameters()
        own.restart(step, said[0][self.remote_cuts[0]], said[1][self.at_v])
        self.common, self.common_step = taken, step

    def _follow(self, j: int, best_qpos: np.ndarray, best_qvel: np.ndarray) -> bool:
        """Let a shown cube follow the estimate's by the policy; return whether its values have changed."""
        experiment, local, best = self.record.experiment, self.shown[j], self.own.handles[j]
        straight = self.remote_cuts[1].stop - self.remote_cuts[1].start
        best_q, best_v = best_qpos[best.qpos_adr : best.qpos_adr + best.nq], best_qvel[best.dof_adr :][: best.nv]
        shown_q = self.qpos[local.qpos_adr : local.qpos_adr + local.nq]
        shown_v = self.qvel[local.dof_adr :][: local.nv]
        dq, dv = local.difference(shown_q, best_q), best_v - shown_v
        dp = self.values[j] - self.given[j]
        share = experiment.follow.share(
            Difference(
                position_m=_size(dq[:straight]),
                angle_rad=_size(dq[straight:]),
                velocity_m_s=_size(dv[:straight]),
                rate_rad_s=_size(dv[straight:]),
                parameters=float(np.max(np.abs(dp / sizes(self.rules[j].names, experiment.local, self.given[j])))),
                speed_m_s=_size(best_v[:straight]),
                turning_rad_s=_size(best_v[straight:]),
                pushed=bool(self.record.commands.force_n[self.before : self.now].any()),
                interval_s=(self.now - self.before) * self.step_s,
            )
        )
        if share == ALL:
            shown_q[:], shown_v[:] = best_q, best_v
        else:
            local.move(shown_q, np.repeat(share[:2], (straight, len(dq) - straight)) * dq)
            shown_v += np.repeat(share[2:4], (straight, len(dv) - straight)) * dv
        if share.parameters == 0.0 or not dp.any():
            return False
        self.given[j] = self.values[j].copy() if share.parameters == 1.0 else self.given[j] + share.parameters * dp
        self.write_shown[j](self.given[j])
        return True


def _size(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def late_side(record: RunRecord, qpos: np.ndarray, qvel: np.ndarray, numbers: ModelArrays) -> Callable[[], bool]:
    """Return what `local_side` returns, for states that are old, or uncertain, or not taken over at once."""
    return LateSide(record, qpos, qvel, numbers).update
