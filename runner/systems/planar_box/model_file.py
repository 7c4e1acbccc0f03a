"""The corrected box as MJCF for plain MuJoCo, and how near that comes to the simulator of the diagnosis."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from runner.effects.base import corrected_here
from runner.effects.planar_box import PlanarEffect
from runner.effects.wording import number
from runner.errors import ResultError
from runner.numerics.arrays import FloatArray
from runner.physics.dry_friction import COLUMN, PUSH_SIZE, STRIDE, FrictionView
from runner.recording import Episode, Recording
from runner.recording.model_form_mjcf import quiet
from runner.storage.writing import write_text
from runner.systems.planar_box.plain_box import FEET, film_is_centred, plain
from runner.systems.planar_box.simulator import OBJECT, Simulator
from runner.systems.planar_box.windows import Effects
from runner.systems.simulator import Run

MODEL = "model.xml"
# of the compiled friction what feet, joints and media do too; the other numbers have no element
EXPRESSED = ("mu", "film", "air_drag", "pressure", "half_x", "half_y", "base_x", "base_y", "bearing_radius")
SLIPPERY = 0.02  # friction is taken to be at least this for a push that shows it
DIGITS = 1e-5  # what MuJoCo writes is rounded to six digits
VISIBLE_M_S = 1e-3  # what moves faster is said not to creep
REST_S = 0.25  # so long it is watched at rest, or longer


def write_model(effects: Effects, folder: Path, simulator: Simulator) -> tuple[str, ...]:
    """Write `model.xml` with the effects that MJCF can express, and return its name.

    Its first lines name the others, and say how far a push takes it from where the simulator has it.

    Raises:
        ResultError: If it does not compile.
    """
    coarse = replace(simulator, grid=FEET)
    inside = tuple(e for e in effects if expressible(e, coarse))
    text = plain_mjcf(inside, coarse)
    try:
        with quiet():
            model = mujoco.MjModel.from_xml_string(text)
    except ValueError as error:
        raise ResultError(f"{MODEL}: does not compile: {error}") from None
    left = [e.full_name for e in effects if e not in inside]
    lines = [*([f"Not expressed here: {', '.join(left)}."] if left else []), *corrected_here(inside)]
    lines += [
        f"For plain MuJoCo: '{OBJECT}' is on feet; qpos is x, y, yaw, z, pitch, roll. Push it by mujoco.mj_applyFT.",
        compare(model, inside, simulator).sentence,
    ]
    ours, theirs = (np.ravel(m.body_inertia[m.body(OBJECT).id]) for m in (coarse.model(inside), model))
    if not np.allclose(ours, theirs, rtol=DIGITS):
        lines.append(
            "Its inertia about level axes, which its motion in the plane doesn't tell, is that of a uniform box."
        )
    write_text(folder / MODEL, "".join(f"<!-- {line} -->\n" for line in lines) + text)
    return (MODEL,)


def plain_mjcf(effects: Effects, simulator: Simulator) -> str:
    """Return the MJCF of the box with effects that it can express; the base points of the simulator are its feet."""
    # dm_control's own class of defaults says nothing
    text = simulator.mjcf(effects).to_xml_string().replace('<default class="/"/>', "").replace(' class="/"', "")
    push_n = sum((_constant_push(e)[:2] for e in effects), np.zeros(2))
    return plain(text, simulator.model(effects), OBJECT, push_n).to_xml()


def expressible(effect: PlanarEffect, simulator: Simulator) -> bool:
    """Whether all that an effect does is done by elements of MJCF: not to readings, nor to what is commanded."""
    cls = type(effect)
    if cls.edit_measurement is not PlanarEffect.edit_measurement or cls.edit_pin is not PlanarEffect.edit_pin:
        return False
    if cls.edit_command is not PlanarEffect.edit_command and not _constant_push(effect).any():
        return False
    edited, believed = simulator.model((effect,)), simulator.model(())
    body = edited.body(OBJECT).id
    changed = edited.body_user[body, :STRIDE] != believed.body_user[believed.body(OBJECT).id, :STRIDE]
    if changed[COLUMN["film"]] and not film_is_centred(FrictionView(edited, body)):
        return False
    return not any(changed[number] for name, number in COLUMN.items() if name not in EXPRESSED)


def _constant_push(effect: PlanarEffect) -> FloatArray:
    """Return the force that an effect adds to any command, (12,); 0 if it adds another to another, or a moment."""
    none, some = np.zeros((2, PUSH_SIZE)), np.ones((2, PUSH_SIZE))
    added = effect.edit_command(none, 1.0)
    constant = np.ptp(added, axis=0).max() == 0.0 and np.allclose(effect.edit_command(some, 1.0) - some, added)
    return added[0] if constant and not added[:, 2:].any() else np.zeros(PUSH_SIZE)


@dataclass(frozen=True)
class Compared:
    """How a push from rest moves a box in plain MuJoCo and in the simulator of the diagnosis.

    Attributes:
        pushed: With which force, for how long.
        ours: In the simulator: x, y, yaw, (T, 3), m and rad.
        theirs: In plain MuJoCo, (T, 3).
        uncorrected: In the simulator without effects, (T, 3).
        creep_m_s: Mean speed in plain MuJoCo at the end; NaN where it does not rest in the simulator.
    """

    pushed: str
    ours: FloatArray
    theirs: FloatArray
    uncorrected: FloatArray
    creep_m_s: float

    @property
    def sentence(self) -> str:
        """What a reader of the file has to know."""
        pushed = f"Pushed at the height of its centre and beside it, {self.pushed}, it"
        if not np.isfinite(self.theirs).all():
            return f"{pushed} diverges: it can't stand for the diagnosis' own simulator."
        way = f"{np.linalg.norm(np.diff(self.ours[:, :2], axis=0), axis=1).sum():.3g} m"
        turn = f"{math.degrees(np.abs(np.diff(self.ours[:, 2])).sum()):.3g}°"
        far, corrected = _apart(self.theirs, self.ours), _apart(self.uncorrected, self.ours)
        out = f"{pushed} is at most {_told(far)} from the diagnosis' own simulator on a way of {way} and {turn}"
        if max(corrected) > 0.0:
            out += f"; the box as believed would be {_told(corrected)} from it"
            if all(f >= c for f, c in zip(far, corrected, strict=True)):
                out += ", so that it is no nearer than what was believed (here a box can tip)"
        if self.creep_m_s > VISIBLE_M_S:
            return out + f". Where that rests this one moves on at {number(self.creep_m_s, 2)} m/s: here a box can tip."
        return out + ("." if math.isnan(self.creep_m_s) else f". At rest it creeps {1e6 * self.creep_m_s:.2f} µm/s.")


def _apart(one: FloatArray, other: FloatArray) -> tuple[float, float]:
    """Return the largest distance of two ways (T, 3), m and rad."""
    difference = np.abs(one - other)
    return float(np.hypot(*difference[:, :2].T).max()), float(difference[:, 2].max())


def _told(apart: tuple[float, float]) -> str:
    return f"{number(1000 * apart[0], 2)} mm and {number(math.degrees(apart[1]), 2)}°"


def compare(model: mujoco.MjModel, effects: Effects, simulator: Simulator) -> Compared:
    """Push both from rest, off the centre, over about the length of the box, and let them coast.

    The push is at the height of the geometric centre, as those of a recording that states none are.

    Args:
        model: The box for plain MuJoCo.
        effects: That are in it.
        simulator: Of the recording.
    """
    corrected = simulator.model(effects)
    body = corrected.body(OBJECT).id
    hx, hy, _ = simulator.recording.nominal.half_size_m
    braking = max(FrictionView(corrected, body)["mu"], SLIPPERY) * -float(corrected.opt.gravity[2])
    force_n, last_s = 2.0 * braking * float(corrected.body_mass[body]), math.sqrt((hx + hy) / braking)
    recording = _pushed(simulator.recording, (force_n, last_s), (0.0, 0.25 * hy, 0.0), model.opt.timestep)
    own = replace(simulator, recording=recording, spans=None, threads=1)
    ours, uncorrected = own.predict(0, [Run(effects, np.zeros(6)), Run((), np.zeros(6))])
    theirs = _moved(model, recording.episodes[0])
    rest = np.s_[-max(2, len(theirs) // 10) :]
    stays = np.ptp(ours[rest, :3], axis=0).max() < 1e-6
    lasted = model.opt.timestep * (len(theirs[rest]) - 1)
    creep = float(np.linalg.norm(theirs[rest][-1, :2] - theirs[rest][0, :2])) / lasted if stays else math.nan
    return Compared(f"by {force_n:.3g} N for {last_s:.2g} s", ours[:, :3], theirs, uncorrected[:, :3], creep)


def _pushed(
    recording: Recording, push: tuple[float, float], at_m: tuple[float, float, float], step_s: float
) -> Recording:
    """Return a recording of one push (N along x, s) from rest at a point of the body, coasting and rest; by no pin."""
    force_n, last_s = push
    t_s = step_s * np.arange(math.ceil((2.0 * last_s + max(last_s, REST_S)) / step_s) + 1, dtype=float)
    force, point, at_rest = np.zeros((len(t_s), 3)), np.tile(at_m, (len(t_s), 1)), np.zeros((len(t_s), 3))
    force[t_s < last_s, 0] = force_n
    nominal = replace(recording.nominal, rate_hz=1.0 / step_s, pin=None)
    return replace(recording, nominal=nominal, episodes=(Episode(0, t_s, at_rest, at_rest, force, point),), notes=())


def _moved(model: mujoco.MjModel, episode: Episode) -> FloatArray:
    """Return x, y, yaw of the box under the forces of an episode in plain MuJoCo, a step for each sample, (T, 3)."""
    data, body = mujoco.MjData(model), model.body(OBJECT).id
    out = np.zeros((len(episode), 3))
    with quiet():
        for k in range(len(episode) - 1):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            data.qfrc_applied[:] = 0.0
            at = data.xpos[body] + data.xmat[body].reshape(3, 3) @ episode.point_m[k]
            mujoco.mj_applyFT(model, data, episode.force_n[k], np.zeros(3), at, body, data.qfrc_applied)
            mujoco.mj_step(model, data)
            out[k + 1] = data.qpos[:3]
    return out
