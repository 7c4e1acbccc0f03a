"""Dry friction that MuJoCo's solver softens is no property of a machine: the recording says how it is solved."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
import pytest

import runner
from runner.diagnosis.corrected import write_corrected
from runner.diagnosis.pipeline import diagnose
from runner.effects.mechanism import JointFriction
from runner.inference.contender import least_gain
from runner.inference.least_squares import NONE, Fit, Fitter
from runner.inference.solver_choice import better_solved
from runner.noise.measured import measure
from runner.recording.model_form import read_model_case
from runner.systems.base import AbstractSystem
from runner.systems.mechanism import MechanismSystem
from runner.systems.simulator import Run
from tests.mechanism_cases import joint_channels, system_of, write_case

MASS_KG, DRY_N, NOISE = 2.0, 3.0, {"q_slide": 1e-5, "dq_slide": 1e-3}
MODEL = f"""<mujoco><option timestep="0.001"/><worldbody><body name="carriage">
<joint name="slide" type="slide" axis="1 0 0" frictionloss="{DRY_N}"/>
<inertial pos="0 0 0" mass="{MASS_KG}" diaginertia=".01 .01 .01"/></body></worldbody>
<actuator><motor name="drive" joint="slide"/></actuator></mujoco>"""


def pushed(u: np.ndarray, step_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion of a mass with Coulomb's friction, (T,) each: parabolas, between which it turns or stays."""
    q, v = np.zeros(len(u)), np.zeros(len(u))
    for k in range(len(u) - 1):
        at, rate, left = q[k], v[k], step_s
        while left > 0:
            way = np.sign(rate) or (np.sign(u[k]) if abs(u[k]) > DRY_N else 0.0)
            if not way:
                break
            a = (u[k] - way * DRY_N) / MASS_KG
            spent = min(left, -rate / a) if rate * a < 0 else left
            at, rate = at + rate * spent + 0.5 * a * spent**2, rate + a * spent
            rate = 0.0 if spent < left else rate
            left -= spent
        q[k + 1], v[k + 1] = at, rate
    return q, v


def dry_case(
    folder: Path, mass_kg: float = MASS_KG, noise: dict[str, float] = NOISE, lasting_s: float = 1.5
) -> MechanismSystem:
    """Return a mass that truly sticks, believed so heavy; MuJoCo's default friction lets it creep."""
    rng, episodes = np.random.default_rng(3), []
    for period_s in (0.31, 0.43, 0.37):
        t = np.arange(0.0, lasting_s, 0.005)
        u = np.round(5.0 * np.sin(2.0 * np.pi * t / period_s), 2)
        q, dq = (y + s * rng.normal(size=len(t)) for y, s in zip(pushed(u, 0.005), noise.values(), strict=True))
        episodes.append({"t": t, "u": u, "q_slide": q, "dq_slide": dq})
    model = MODEL.replace(f'mass="{MASS_KG}"', f'mass="{mass_kg}"')
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"]), "noise": noise}
    return system_of(write_case(folder / "case", model, episodes, nominal))


def fitted(system: MechanismSystem) -> tuple[Fitter, Fit]:
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    return fitter, fitter.fit(NONE, range(len(system.recording.episodes)))


def test_a_joint_that_truly_sticks_is_simulated_so(tmp_path: Path) -> None:
    """By the motion in closed form: the model as written leaves several noises, solved hard it leaves none."""
    system = dry_case(tmp_path, lasting_s=1.0)
    fitter, nominal = fitted(system)
    assert fitter.measured.excess(nominal.total, nominal.episodes) > 0.5
    hard = better_solved(fitter, nominal, system.solved)
    assert hard is not None
    fitter, nominal = fitted(cast(MechanismSystem, hard))
    assert fitter.measured.excess(nominal.total, nominal.episodes) < 0.05


@pytest.mark.slow
def test_a_joint_that_truly_sticks_needs_no_cause(tmp_path: Path) -> None:
    """A whole diagnosis of it: nothing is to be named, and how friction is solved is said."""
    found = diagnose(dry_case(tmp_path, lasting_s=1.0), threads=1, advise=False)
    assert found.ranked[0].effects == ("none",)
    assert any("solreffriction" in note for note in found.notes)


@pytest.mark.slow
def test_what_was_found_is_asked_where_the_nominal_model_could_not_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a mass far off, either way of solving it leaves thousands of noises."""

    def of_effects(fitter: Fitter, fit: Fit, as_believed: str) -> AbstractSystem | None:
        return better_solved(fitter, fit, as_believed) if fit.explanation.candidates else None

    monkeypatch.setattr("runner.diagnosis.attempt.better_solved", of_effects)
    found = diagnose(dry_case(tmp_path, 3.0, lasting_s=1.0), threads=1, advise=False)
    assert found.ranked[0].effects == ("mass[carriage]",)
    assert abs(found.ranked[0].parameters["mass[carriage]"]["mass_kg"] - MASS_KG) < 0.01
    assert found.excess < 0.05
    assert any("solreffriction" in note for note in found.notes)


def made_soft(folder: Path, noise: dict[str, float] = NOISE) -> MechanismSystem:
    """Return a mass that creeps as MuJoCo lets it."""
    system, rng, start = dry_case(folder, noise=noise), np.random.default_rng(1), np.zeros(2)
    soft = [system.simulator(threads=1).predict(e, [Run((), start)])[0] for e in range(len(system.recording.episodes))]
    return system.with_values([v + rng.normal(size=v.shape) * list(noise.values()) for v in soft])


def test_friction_that_was_made_soft_stays_soft(tmp_path: Path) -> None:
    made = made_soft(tmp_path)
    assert better_solved(*fitted(made), made.solved) is None
    (hard,) = made.solved_otherwise()
    again = better_solved(*fitted(hard), made.solved)
    assert again is not None
    assert again.solved == made.solved


def test_what_was_chosen_before_anything_explained_the_recording_is_given_up_for_less(tmp_path: Path) -> None:
    """In noise beside which creep is worth no effect, friction stays hard only where it was believed to be."""
    made = made_soft(tmp_path, {name: 40.0 * s for name, s in NOISE.items()})
    (hard,) = made.solved_otherwise()
    fitter, fit = fitted(hard)
    least = fitted(made)[1].total
    assert 5.0 < fit.total - least < least_gain(fitter.measured.count(fit.episodes))
    assert better_solved(fitter, fit, hard.solved) is None
    again = better_solved(fitter, fit, made.solved)
    assert again is not None
    assert again.solved == made.solved


def test_a_corrected_model_is_solved_as_it_was_when_it_was_found(tmp_path: Path) -> None:
    """A later recording is held against joints that hold if those of the diagnosis did."""
    system = dry_case(tmp_path)
    (hard,) = system.solved_otherwise()
    path = write_corrected(tmp_path / "found", (), hard)
    case = runner.read(system.recording.path)
    assert runner.Corrected.read(path, case).system.solved == hard.solved
    again = runner.Corrected.read(path, case).save(tmp_path / "again").parent / "model.xml"
    assert "solreffriction" in again.read_text()
    tables = [runner.gap(case, model=m, horizons_s=(0.5,)).table for m in (None, path)]
    left = [t.loc[t["starts"] == "fitted", "noises"].mean() for t in tables]
    assert left[1] < 0.5 * left[0], left
    path.write_text(path.read_text().replace("truly", "hardly"))
    with pytest.raises(runner.RunnerError, match="solved: allowed of this model: 'dry friction as soft"):
        runner.gap(case, model=path)


def test_nothing_is_said_of_how_friction_is_solved_where_there_is_none(tmp_path: Path) -> None:
    recording = dry_case(tmp_path).recording
    path = recording.model_path
    path.write_text(re.sub(' frictionloss="[^"]*"', "", path.read_text()))
    system = MechanismSystem(replace(recording))
    assert "solved" not in write_corrected(tmp_path / "without", (), system).read_text()
    assert "solved" in write_corrected(tmp_path / "with", (JointFriction("slide", 4.0),), system).read_text()


def test_a_model_that_means_hard_friction_has_no_other_way(tmp_path: Path) -> None:
    system = dry_case(tmp_path)
    text = system.recording.model_path.read_text().replace("frictionloss", 'solreffriction="0.001 1" frictionloss')
    system.recording.model_path.write_text(text)
    assert MechanismSystem(replace(system.recording)).solved_otherwise() == ()


def test_the_corrected_model_holds_as_what_was_simulated_does(tmp_path: Path) -> None:
    """In plain MuJoCo: under a push below friction a joint of the model as written creeps."""
    (hard,) = dry_case(tmp_path).solved_otherwise()
    hard.write_model((JointFriction("slide", 4.0),), tmp_path)
    crept = []
    for path in (tmp_path / "model.xml", hard.recording.model_path):
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.9 * model.dof_frictionloss[0]
        for _ in range(1000):
            mujoco.mj_step(model, data)
        crept.append(abs(float(data.qpos[0])))
    assert crept[0] < 0.1 * crept[1]


@pytest.mark.parametrize(("hard", "effects"), [(True, ()), (True, (JointFriction("slide", 2.0),)), (False, ())])
def test_how_it_is_solved_is_told_as_what_to_write(tmp_path: Path, hard: bool, effects: tuple[JointFriction, ...]):
    """Of a joint that creeps by the file and held here: the attributes that make it hold there, too."""
    t = np.arange(60) * 0.01
    columns = {"t": t, "u": 0 * t, "q_slide": 0 * t, "dq_slide": 0 * t}
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"])}
    recording = read_model_case(write_case(tmp_path, MODEL, [columns, columns], nominal))
    said = MechanismSystem(recording, hard_friction=hard).solver_remedy(effects)
    if hard:
        assert '<joint name="slide"> set solreffriction="0.002" solimpfriction="0.995 0.999".' in said
    else:
        assert not said
