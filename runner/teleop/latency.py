"""What the local side makes of states that are old when they arrive: the local model, simulated again from there.

A received state is the remote's at the time of its sending. The local model keeps what it was commanded since, and its
own states at all those steps. So

 1. what was received is compared with what the local model predicted *for that time*, from the state that was received
    before it: this is the comparison that an ideal link makes, and the estimate is as unbiased as on an ideal link;
 2. the estimate is updated;
 3. the local model starts again from the received state, and is simulated to the present under the recorded commands.

With a constant delay of k ticks the estimates are those of an ideal link, bit for bit, k ticks later. All of it is
MuJoCo: a second model with the local cubes alone, whose player holds the commands and the states of every step.
"""

from __future__ import annotations

import mujoco
import numpy as np

from runner.physics import dry_friction, player
from runner.physics.scene import BodyHandle, build, handles
from runner.teleop.experiment import Commands, Experiment, set_start


class Resimulation:
    """The local cubes of a run, in a simulation of their own that can go back in time.

    `state` and `advance` count physics steps from the start of the run.
    """

    def __init__(self, experiment: Experiment, given: Commands) -> None:
        names = list(experiment.estimator)
        root = build(experiment.scene, dict.fromkeys(names, experiment.local))
        player.add(root, bodies=len(names))
        self.model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        self._scratch = mujoco.MjData(self.model)
        set_start(experiment, self.model, self._scratch)
        found = handles(self.model, names)
        self.handles: tuple[BodyHandle, ...] = tuple(found[name] for name in names)
        self.step = 0
        self._data = mujoco.MjData(self.model)
        self._timestep_s = experiment.scene.timestep_s
        # the remote's commands come first
        self._commands = np.ascontiguousarray(given.pushes[:, dry_friction.PUSH_SIZE :])
        player_of_locals = player.Player(len(names), self.model.nq, self.model.nv)
        self._playback = player_of_locals.start(self._data.userdata, self._commands)

    def set_parameters(self) -> None:
        """Derive what MuJoCo derives from masses and inertias, after they were written into `model`."""
        mujoco.mj_setConst(self.model, self._scratch)

    def advance(self, step: int) -> None:
        """Simulate up to a step."""
        if step > self.step:
            mujoco.mj_step(self.model, self._data, step - self.step)
            self.step = step

    def state(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and velocities of all local cubes at the start of a step, (nq,) and (nv,).

        Those of the past are as they were last simulated; a later step is simulated first. The arrays are live.
        """
        self.advance(step)
        if step == self.step:
            return self._data.qpos, self._data.qvel
        frame = self._playback.frames[step]
        return frame[: self.model.nq], frame[self.model.nq : self.model.nq + self.model.nv]

    def restart(self, step: int, position: np.ndarray, velocity: np.ndarray) -> None:
        """Go to a step, with all local cubes in one state, (nq of a cube,) and (nv of a cube,)."""
        data = self._data
        for handle in self.handles:
            data.qpos[handle.qpos_adr : handle.qpos_adr + handle.nq] = position
            data.qvel[handle.dof_adr : handle.dof_adr + handle.nv] = velocity
        data.time = step * self._timestep_s
        self._playback.go_to(step)
        self.step = step
