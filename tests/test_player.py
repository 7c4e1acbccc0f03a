"""The player plays and records exactly what stepping one by one would give, and leaves other models alone."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from runner.physics import dry_friction, player
from runner.physics.scene import BodyConfig, SceneConfig, build, push_columns

STEPS = 200


def compiled(with_player: bool) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return two cubes on a patch, with room for a player or without."""
    root = build(SceneConfig(grid=4), {"a": BodyConfig(3.0, 0.3), "b": BodyConfig(1.0, 0.2)})
    if with_player:
        player.add(root, bodies=2)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    return model, mujoco.MjData(model)


def pushes() -> np.ndarray:
    """Return random commands for two bodies, (STEPS + 1, 24), another one in every step."""
    rng = np.random.default_rng(2)
    force, point = rng.uniform(-30, 30, (2, STEPS + 1, 3)), rng.uniform(-0.3, 0.3, (2, STEPS + 1, 3))
    force[..., 2] = 0
    return np.concatenate(push_columns(force, point), axis=1)


def one_by_one(given: np.ndarray) -> np.ndarray:
    """Return the frames of the same steps, taken one at a time without a player."""
    model, data = compiled(with_player=False)
    out = []
    for k in range(STEPS):
        for body in range(2):
            at = body * dry_friction.USERDATA_SIZE
            data.userdata[at : at + dry_friction.PUSH_SIZE] = given[
                k, body * dry_friction.PUSH_SIZE : (body + 1) * dry_friction.PUSH_SIZE
            ]
        state = np.concatenate([data.qpos, data.qvel])
        mujoco.mj_step(model, data)
        said = data.userdata.reshape(2, dry_friction.USERDATA_SIZE)[:, dry_friction.PUSH_SIZE : dry_friction.PIN_ADR]
        out.append(np.concatenate([state, said.ravel()]))
    return np.array(out)


@pytest.mark.parametrize("chunk", [1, 7, STEPS])
def test_a_player_is_the_same_as_stepping_one_by_one(chunk: int) -> None:
    """However many steps go into a call, every step gets its own command, and every frame has the same bits."""
    given = np.ascontiguousarray(pushes())
    model, data = compiled(with_player=True)
    playback = player.Player(2, model.nq, model.nv).start(data.userdata, given)
    for start in range(0, STEPS, chunk):
        mujoco.mj_step(model, data, min(chunk, STEPS - start))
    assert np.array_equal(playback.frames, one_by_one(given))
    assert np.ptp(playback.frames[:, 0]) > 1e-3  # they did move


def test_a_player_stops_at_its_end() -> None:
    """Steps beyond the last command neither write nor read, and push nothing new."""
    given = np.ascontiguousarray(pushes()[:11])
    model, data = compiled(with_player=True)
    playback = player.Player(2, model.nq, model.nv).start(data.userdata, given)
    mujoco.mj_step(model, data, 10)
    before = playback.frames.copy()
    mujoco.mj_step(model, data, 50)
    assert np.array_equal(playback.frames, before)
    playback.stop()
    assert not data.userdata[-player.SIZE :].any()


def test_models_without_a_player_are_left_alone() -> None:
    """With the callback installed, a model without any userdata, and one without a player, move as ever."""
    player.install()
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    assert data.qvel[2] == pytest.approx(-9.81 * 10 * model.opt.timestep)
    model, data = compiled(with_player=False)
    mujoco.mj_step(model, data, 10)
    assert not data.qpos.any()


def test_commands_of_the_wrong_shape_are_refused() -> None:
    """A player reads memory as it finds it, so it takes arrays of its own layout only."""
    model, data = compiled(with_player=True)
    made = player.Player(2, model.nq, model.nv)
    for wrong in (np.zeros((5, 12)), np.zeros((5, 24), dtype=np.float32), np.zeros((24, 5)).T):
        with pytest.raises(ValueError, match="C-contiguous float64 of width 24"):
            made.start(data.userdata, wrong)
