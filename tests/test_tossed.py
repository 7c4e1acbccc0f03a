"""Free bodies that fly, hit and slide: against closed forms, and made tosses whose cause is found."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import mujoco
import numpy as np
import pandas as pd
import pytest
import yaml
from mechanisms import ARM, TOSSED, compiled, scope
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from tosses import BELIEVED, COLUMNS, NOISE, toss_case, world, write

from runner.api.case import read
from runner.diagnosis.flights import flights_alone
from runner.diagnosis.pipeline import diagnose
from runner.diagnosis.ranking import values_of
from runner.diagnosis.result import Flights, Ranked
from runner.effects import mechanism as m
from runner.effects.mechanism import contacts
from runner.effects.vocabulary import Candidate
from runner.effects.wording import Values
from runner.errors import ConfigError, RecordingError
from runner.inference import multiple_shooting
from runner.inference.confounding import are_one
from runner.inference.contender import contend
from runner.inference.doubts import errors_off
from runner.inference.evidence import by_form, directions, sensitivities
from runner.inference.flown import Flown
from runner.inference.least_squares import NONE, Explanation, Fit, Fitter
from runner.inference.start_draws import tried_from_the_air
from runner.noise.measured import measure
from runner.recording import Span, read_case
from runner.settings import SETTINGS
from runner.systems.case import open_case
from runner.systems.channels import Scatter
from runner.systems.mechanism import MechanismSystem
from runner.systems.mechanism.box_form import free_box
from runner.systems.mechanism.flights import into_impacts
from runner.systems.mechanism.scope import raw_signals
from runner.systems.simulator import AbstractSimulator, Run
from runner.systems.windows import Windows

G = 9.81
SIDES = (0.06, 0.04, 0.03)  # half, of a box that tumbles: three moments of inertia


def still(folder: Path, **nominal: object) -> MechanismSystem:
    """Return the system of a box that nothing is known to move: two episodes of poses at one place in the air."""
    t = np.arange(60) / 150
    pose = dict(zip(COLUMNS, (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0), strict=True))
    table = pd.concat([pd.DataFrame({"episode": e, "t": t, **pose}) for e in range(2)], ignore_index=True)
    system = open_case(write(folder, table, {**BELIEVED, **nominal}))
    assert isinstance(system, MechanismSystem)
    return system


@pytest.mark.parametrize(
    ("ratio", "x_to_y", "z_to_xy"), [(1.0, 1.0, 1.0), (1.0, 0.8, 1.3), (2.0, 1.2, 0.75)], ids=["right", "shape", "all"]
)
def test_a_tumbling_box_turns_as_euler_says(tmp_path: Path, ratio: float, x_to_y: float, z_to_xy: float):
    """Torque-free rotation of a body with three moments: where ever shorter steps lead, and straight there."""
    recording = still(tmp_path, half_size=list(SIDES)).recording
    spin = np.array([6.0, 0.3, 8.0])
    start = np.concatenate([[0, 0, 2.0, 0, 0, 0], [0, 0, 0], spin])
    x, y, z = np.array(SIDES) ** 2
    # of moments times (x_to_y, 1, z_to_xy sqrt(x_to_y)) proportions are the wanted ones; size does nothing
    inertia = np.array([(y + z) * x_to_y, x + z, (x + y) * z_to_xy * math.sqrt(x_to_y)])

    def change(_: float, state: np.ndarray) -> np.ndarray:
        w, (i, j, k, r) = state[:3], state[3:]
        turning = 0.5 * np.array([r * w + np.cross([i, j, k], w)]).ravel()
        return np.concatenate([np.cross(inertia * w, w) / inertia, turning, [-0.5 * np.dot([i, j, k], w)]])

    t = recording.episodes[0].t_s
    run = solve_ivp(change, (0, t[-1]), [*spin, 0, 0, 0, 1], t_eval=t, rtol=1e-10, atol=1e-12)
    true = Rotation.from_quat(run.y[3:].T)
    effects = (m.FreeInertia("box", ratio, x_to_y, z_to_xy),)
    coarse, fine = (
        MechanismSystem(recording, step_s=1 / 150 / n).simulator().predict(0, [Run(effects, start)])[0] for n in (3, 6)
    )
    off = [(true.inv() * Rotation.from_rotvec(shown[:, 3:6])).as_rotvec() for shown in (coarse, fine)]
    # of second order: of steps half as long a quarter
    assert np.abs(off[1]).max() < 3e-4
    assert np.abs(off[1]).max() == pytest.approx(np.abs(off[0]).max() / 4, rel=0.2)
    assert np.abs(4 * off[1] - off[0]).max() < 1e-4
    height = MechanismSystem(recording).context.model.qpos0[2] + 2.0
    assert fine[:, 2] == pytest.approx(height - 0.5 * G * t**2, abs=1e-6)


def test_moments_of_inertia_that_are_fitted_are_some_body_s():
    """None is larger than the sum of the others wherever a search goes, and all grow with the ratio alone."""
    context = scope(TOSSED, "cube")
    bounds = [(p.lower, p.upper) for p in m.FreeInertia.parameters(context)]
    g = np.random.default_rng(0)
    for x in g.uniform(*np.transpose(bounds), size=(50, 3)):
        model = compiled(TOSSED, m.FreeInertia.from_vector(x, context))
        moments, believed = (np.array(of.body("cube").inertia) for of in (model, context.model))
        assert (moments.sum() - 2 * moments >= 0.0).all()
        assert np.prod(moments / believed) == pytest.approx(np.exp(3 * x[0]))
    nothing = m.FreeInertia.from_vector(np.zeros(3), context)
    assert (nothing.ratio, nothing.x_to_y, nothing.z_to_xy) == pytest.approx((1.0, 1.0, 1.0))


def test_moments_of_inertia_that_no_body_has_are_refused():
    """A rod has two of one size and one of nearly none; two of nearly none and one are none."""
    compiled(TOSSED, m.FreeInertia("cube", 1.0, 1.0, 0.01))
    with pytest.raises(
        ConfigError, match=r"inertia\[cube\]: no moment .* larger than the sum of the other two, got 0\."
    ):
        compiled(TOSSED, m.FreeInertia("cube", 1.0, 1.0, 2.1))


def test_moments_of_inertia_are_in_the_corrected_model(tmp_path: Path):
    """In plain MuJoCo; what a report says to write is the same."""
    system = open_case(toss_case(tmp_path / "case", world(), tosses=2))
    effect = m.FreeInertia("box", 1.5, 1.1, 0.75)
    assert system.write_model((effect,), tmp_path) == ("model.xml",)
    believed = 0.5 * 2 * 0.05**2 / 3
    wanted = believed * 1.5 * np.array([1.1**0.5 * 0.75 ** (-1 / 3), 1.1**-0.5 * 0.75 ** (-1 / 3), 0.75 ** (2 / 3)])
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    np.testing.assert_allclose(written.body("box").inertia, wanted, rtol=1e-5)
    assert written.body("box").mass == pytest.approx(0.5)
    remedy = m.FreeInertia.phrase(Values(effect.report(), {}), system.context.at("box"), "box").remedy
    inertial = remedy[remedy.index("<inertial") : remedy.index("/>") + 2]
    by_hand = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><body name='box'><freejoint/>{inertial}<geom size='.1'/></body></worldbody></mujoco>"
    )
    np.testing.assert_allclose(by_hand.body("box").inertia, wanted, rtol=1e-4)


def test_a_size_of_the_inertia_that_flight_does_not_tell_is_not_told():
    """An error as large as before the recording says that nothing was learned."""
    context, values = scope(TOSSED, "cube"), {"ratio": 1.0, "x_to_y": 1.0, "z_to_xy": 0.75}
    unsure, sure = (
        m.FreeInertia.phrase(Values(values, {"ratio": e, "x_to_y": 0.01, "z_to_xy": 0.01}), context, "cube").amount
        for e in (0.25, 0.02)
    )
    assert "about z 0.750 ± 0.010 times" in unsure
    assert "does not tell how large" in unsure
    assert "all of them 1.00 ± 0.02 times" in sure


def test_a_body_that_a_joint_turns_about_one_axis_has_one_inertia():
    """And a free one has three numbers of it, under one name."""
    for xml, body, count in ((ARM, "forearm", 1), (TOSSED, "cube", 3)):
        context = scope(xml, body)
        some = [cls for cls in m.EFFECTS if cls.name == "inertia" and cls.applies(context)]
        assert [len(cls.parameters(context)) for cls in some] == [count]


@pytest.mark.parametrize("mu", [0.2, 0.5])
def test_a_sliding_box_stops_where_friction_says(tmp_path: Path, mu: float):
    """Coulomb friction is named by the effect alone: v^2 / (2 mu g)."""
    system = still(tmp_path)
    model = system._models.edited((m.ContactFriction("box", mu),))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)  # until it lies
    begin, speed = data.qpos[0], 1.0
    data.qvel[:] = [speed, 0, 0, 0, 0, 0]
    mujoco.mj_step(model, data, round(2 * speed / (mu * G) / model.opt.timestep))
    assert data.qpos[0] - begin == pytest.approx(speed**2 / (2 * mu * G), rel=0.03)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_a_ball_rebounds_as_told(ratio: float):
    """The speed after a fall onto the floor is that share of the speed before."""
    model = compiled(
        """<mujoco><option timestep="0.0002"/><worldbody><geom type="plane" size="1 1 1"/><body name="ball"
        pos="0 0 0.5"><freejoint name="ball"/><geom type="sphere" size=".03" mass="0.1" solref="0.01 1"
        solimp="0.95 0.95 0.001" priority="1"/></body></worldbody></mujoco>""",
        m.Restitution("ball", ratio),
    )
    data = mujoco.MjData(model)
    speeds = []
    while data.time < 0.5:
        mujoco.mj_step(model, data)
        speeds.append(float(data.qvel[2]))
    assert max(speeds) / -min(speeds) == pytest.approx(ratio, abs=0.06)


def test_rebound_and_damping_are_inverse():
    """Of the same oscillator, below and beyond critical damping."""
    ratios = (0.05, 0.1, 0.135, 0.5, 0.9)
    assert [contacts.rebound(contacts.damping_for(e)) for e in ratios] == pytest.approx(ratios)
    assert contacts.rebound(1.0) == pytest.approx(math.exp(-2))


def test_a_body_s_contacts_are_its_own():
    """A friction is given to one body, whatever the floor has, and not to the next."""
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><geom type="plane" size="1 1 1" friction="0.8"/>
        <body name="a"><freejoint/><geom type="sphere" size=".1" friction="0.5"/></body>
        <body name="b"><freejoint/><geom type="sphere" size=".1" friction="0.6"/></body></worldbody></mujoco>"""
    )
    assert contacts.believed(model, "a").sliding[0] == 0.8
    m.ContactFriction("a", 0.3).edit_model(model)
    assert contacts.believed(model, "a").sliding[0] == 0.3
    assert contacts.believed(model, "b").sliding[0] == 0.8


def test_mass_of_what_is_tossed_is_not_offered(tmp_path: Path):
    """No motion without a force depends on it; nor on where along an even floor it happens."""
    names = {c.name for c in open_case(toss_case(tmp_path, world(), tosses=2)).vocabulary}
    assert "mass[box]" not in names
    assert {"friction[box]", "contact_stiffness[box]", "restitution[box]", "body_size[box]", "frame_tilt"} <= names
    assert "sensor_offset[z]" in names
    assert not {"sensor_offset[x]", "sensor_scale[z]", "sensor_lag[x]"} & names
    assert "sensor_scale[*]" in names  # what tracks a body may be calibrated by a wand of another length


def test_mass_of_what_a_known_force_pushes_is_offered(tmp_path: Path):
    """A force that was recorded tells the mass, in the air too."""
    system = open_case(toss_case(tmp_path, world(), tosses=2, push_n=2.0))
    assert "mass[box]" in {c.name for c in system.vocabulary}


def test_drag_of_the_air_is_the_coefficient_s():
    """A cube that falls meets the coefficient times the speed squared."""
    plain, airy = (compiled(TOSSED, *e) for e in ((), (m.AirDrag("cube", 0.01),)))
    slower = []
    for model in (plain, airy):
        data = mujoco.MjData(model)
        data.qpos[2], data.qvel[2] = 5.0, -3.0
        mujoco.mj_forward(model, data)
        slower.append(float(data.qacc[2]))
    assert slower[1] - slower[0] == pytest.approx(0.01 * 9.0 / 1.0, rel=1e-6)


def test_drag_and_hard_contacts_are_in_the_corrected_model(tmp_path: Path):
    """In plain MuJoCo: the step is as short as hard contacts ask for, and what falls has its coefficient of drag."""
    system = open_case(toss_case(tmp_path / "case", world(), tosses=2))
    assert system.write_model((m.AirDrag("box", 0.02), m.ContactStiffness("box", 100.0)), tmp_path) == ("model.xml",)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml"))
    believed = world()
    assert model.opt.timestep < believed.opt.timestep
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[:3] = 5.0, (2.0, 0.0, -1.0)
    mujoco.mj_forward(model, data)
    drag = -0.02 / 0.5 * np.sqrt(5.0) * np.array([2.0, 0.0, -1.0])
    np.testing.assert_allclose(data.qacc[:3], drag + np.array([0.0, 0.0, -9.81]), rtol=1e-5, atol=1e-6)


def test_a_corrected_model_with_drag_may_be_believed_next(tmp_path: Path):
    """What the air acts on is no body of its own, and more drag is more of the same."""
    folder = toss_case(tmp_path / "case", world(), tosses=2)
    for name in ("new", "more"):
        (tmp_path / name).mkdir()
    open_case(folder).write_model((m.AirDrag("box", 0.02),), tmp_path / "new")
    again = tmp_path / "again"
    shutil.copytree(folder, again)
    shutil.copy(tmp_path / "new/model.xml", again / "model.xml")
    believed = yaml.safe_load((again / "nominal.yaml").read_text())
    channels: dict[str, dict] = {a: {"body": "box", "quantity": "position", "axis": a} for a in "xyz"}
    channels["quat"] = {"body": "box", "quantity": "orientation", "columns": ["qw", "qx", "qy", "qz"]}
    (again / "nominal.yaml").write_text(yaml.safe_dump({"model": "model.xml", "channels": channels}))
    before, after = open_case(folder), open_case(again)
    assert "half_size" in believed
    assert {c.name for c in after.vocabulary} == {c.name for c in before.vocabulary}
    assert after.write_model((m.AirDrag("box", 0.01),), tmp_path / "more") == ("model.xml",)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "more/model.xml"))
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[2] = 5.0, -3.0
    mujoco.mj_forward(model, data)
    assert data.qacc[2] + G == pytest.approx(0.03 * 9.0 / 0.5, rel=1e-4)


def test_drag_is_not_offered_of_what_carries_others():
    """The force acts on one body's centre of mass alone."""
    carrying = TOSSED.replace(
        'priority="1"/></body>', 'priority="1"/><body pos="0 0 .1"><geom size=".02"/></body></body>'
    )
    for xml, offered in ((TOSSED, True), (carrying, False)):
        model = compiled(xml)
        assert contacts.is_free(model, "cube")
        assert (not contacts.carries(model, "cube")) is offered


def test_every_effect_that_mjcf_has_is_written(tmp_path: Path):
    """And moves as in the simulation, which is checked as it is written: with a clock and hard contacts, too."""
    (tmp_path / "out").mkdir()
    system = open_case(toss_case(tmp_path / "case", world(), tosses=2))
    some = [
        c.make(np.array([0.4 * p.scale for p in c.parameters(system.context)]), system.context)
        for c in system.vocabulary
    ]
    for effects in (*some, (m.ClockScale(1.02), m.ContactStiffness("box", 100.0))):
        assert system.write_model(effects, tmp_path / "out") == ("model.xml",)
    written = mujoco.MjModel.from_xml_path(str(tmp_path / "out/model.xml"))
    system.write_model((m.ContactStiffness("box", 100.0),), tmp_path / "out")
    alone = mujoco.MjModel.from_xml_path(str(tmp_path / "out/model.xml"))
    assert written.opt.timestep == alone.opt.timestep  # the clock is the recording's


def test_a_tilted_camera_and_a_tilted_pull_are_one_motion_of_what_flies(tmp_path: Path):
    """In the air, with free starts; the air's drag, fitted to the same, is another one."""
    tilted = world(gravity=(G * math.sin(0.03), 0.0, -G * math.cos(0.03)))
    system = open_case(toss_case(tmp_path, tilted, tosses=4, length_s=0.12))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    nominal = fitter.fit(NONE, range(4))
    variants = {len(c.parameters(system.context)): c for c in system.vocabulary if c.effect.name == "gravity"}
    tried = [system.vocabulary.by_name["frame_tilt"][0], variants[2], system.vocabulary.by_name["air_drag[box]"][0]]
    tilt, pull, drag = (fitter.fit(Explanation((c,)), range(4), near=nominal) for c in tried)
    context = system.context
    assert are_one(tilt, pull, context)
    assert are_one(pull, tilt, context)
    assert not are_one(tilt, drag, context)
    assert not are_one(tilt, nominal, context)


def test_a_wrong_scale_of_lengths_and_a_wrong_pull_are_one_motion_of_what_flies(tmp_path: Path):
    """Lengths that are shown too long fall too fast, by the same ratio."""
    system = open_case(toss_case(tmp_path, world(gravity=(0.0, 0.0, -1.03 * G)), tosses=4, length_s=0.12))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    variants = {len(c.parameters(system.context)): c for c in system.vocabulary if c.effect.name == "gravity"}
    tried = [system.vocabulary.by_name["sensor_scale[*]"][0], variants[1]]
    scale, pull = (fitter.fit(Explanation((c,)), range(4)) for c in tried)
    assert are_one(scale, pull, system.context)
    assert float(np.exp(scale.x[0])) == pytest.approx(1.03, abs=0.005)


def test_what_two_explanations_share_says_nothing_of_where_they_differ(tmp_path: Path):
    """Beside a large tilt, two small effects that are merely alike stay two."""
    tilted = world(gravity=(G * math.sin(0.3), 0.0, -G * math.cos(0.3)))
    system = open_case(toss_case(tmp_path, tilted, tosses=4, length_s=0.12))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    named = [system.vocabulary.by_name[n][0] for n in ("frame_tilt", "air_drag[box]", "clock_scale")]
    tilt, drag, clock = named
    fit, other = (fitter.fit(Explanation((tilt, c)), range(4)) for c in (drag, clock))

    def faint(of: Fit, noises: float) -> Fit:
        """Return a fit whose second effect moves the prediction by so much, as a root of its sum of squares."""
        part = of.explanation.parts(system.context)[1][1]
        size = math.sqrt(sum(float(((j[:, part] @ np.ones(1)) ** 2).sum()) for j in of.jacobian))
        return replace(of, x=np.append(of.x[: part.start], noises / size))

    def beside(noises: float) -> bool:
        """Whether they are one where what they predict is apart by the root of a tenth of a squared noise."""
        count = sum(map(len, fit.residual))
        near = replace(other, residual=tuple(r + math.sqrt(0.1 / count) for r in fit.residual))
        return are_one(faint(fit, noises), faint(near, noises), system.context)

    assert not beside(3.0)
    assert beside(30.0)


def test_a_law_that_engines_do_not_share_is_known_to_its_form(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A rebound has the uncertainty of the law of contacts beside that of the data; a size has not."""
    system = open_case(toss_case(tmp_path, world(half_m=0.052), tosses=2))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    nominal, share = fitter.fit(NONE, range(2), iterations=5), SETTINGS.odds.rough_form_share
    by_name = system.vocabulary.by_name
    both = [by_name[name][0] for name in ("restitution[box]", "body_size[box]")]
    around = sensitivities(fitter, nominal, [d for d in directions(system) if d.candidate in both])
    rebound, size = (
        contend(fitter, fitter.fit(Explanation((c,)), range(2), near=nominal, iterations=3), around) for c in both
    )
    stated = [values_of(c, system.context)[1][c.fit.explanation.names[0]]["ratio"] for c in (rebound, size)]
    monkeypatch.setattr("runner.inference.evidence.by_form", lambda c, context: np.zeros(len(c.parameters(context))))
    by_data = [values_of(c, system.context)[1][c.fit.explanation.names[0]]["ratio"] for c in (rebound, size)]
    assert stated[0] > 1.5 * by_data[0]
    assert stated[1] == by_data[1]
    assert (by_name["restitution[box]"][0].parameters(system.context)[0].scale * share) ** 2 == pytest.approx(
        by_form(by_name["restitution[box]"][0], system.context)[0]
    )


def test_noise_of_an_orientation_is_told_where_it_tumbles(tmp_path: Path):
    """From samples alone: to within what some hundred of them tell, however fast it turns."""
    spun, data = world(gravity=(0.0, 0.0, 0.0)), []
    for e in range(4):
        motion = mujoco.MjData(spun)
        motion.qpos[2], motion.qvel[3:] = 1.0, (9.0, -6.0, 4.0 + e)
        rows = []
        for _ in range(100):
            rows.append(np.concatenate([[motion.time], motion.qpos]))
            mujoco.mj_step(spun, motion, 20)
        table = np.array(rows)
        g = np.random.default_rng(e)
        for row in table:
            mujoco.mju_quatIntegrate(row[4:], NOISE["yaw"] * g.normal(size=3), 1.0)
        data.append(pd.DataFrame(table, columns=["t", *COLUMNS]).assign(episode=e))
    folder = write(tmp_path, pd.concat(data, ignore_index=True), {**BELIEVED, "rate_hz": 100})
    believed = yaml.safe_load((folder / "nominal.yaml").read_text())
    (folder / "nominal.yaml").write_text(yaml.safe_dump({k: v for k, v in believed.items() if k != "noise"}))
    sigma = raw_signals(open_case(folder).recording).sigma
    np.testing.assert_allclose(sigma[-3:], NOISE["yaw"], rtol=0.1)


def test_a_reader_is_shown_orientations(tmp_path: Path):
    """As rotation vectors of the body against the world, not as the zeros that residuals are taken from."""
    case = read(toss_case(tmp_path, world(), tosses=2))
    shown = case.data[["quat.x", "quat.y", "quat.z"]].to_numpy()
    wanted = np.concatenate([e.orientations["quat"] for e in case.system.recording.episodes])
    apart = Rotation.from_quat(wanted.copy(), scalar_first=True).inv() * Rotation.from_rotvec(shown.copy())
    assert apart.magnitude().max() < 1e-9
    assert np.ptp(shown, axis=0).min() > 0.1
    table = pd.read_parquet(case.path / "recording.parquet")
    table.loc[40, ["qw", "qx", "qy", "qz"]] = np.nan
    table.to_parquet(case.path / "recording.parquet", index=False)
    again = read(case.path).data[["quat.x", "quat.y", "quat.z"]].to_numpy()
    assert np.flatnonzero(np.isnan(again).any(axis=1)).tolist() == [40]


def test_replay_begins_in_flight(tmp_path: Path):
    """Stretches begin before the first touch and end soon after it; every toss has one."""
    system = open_case(toss_case(tmp_path, world(), tosses=4))
    spans = system.stretches()
    assert {s.episode for s in spans} == set(range(4))
    for s in spans:
        z = system.values()[s.episode][:, 2]
        # or the body lies there until the end
        assert z[s.begin] > 1.1 * BELIEVED["half_size"] or (s.end == len(z) and np.ptp(z[s.begin :]) < 2e-3)
        assert s.end - s.begin < len(z)


def test_an_episode_without_a_flight_is_taken_from_its_beginning(tmp_path: Path):
    """Beside others that have one: what slides, or is let go on the table."""
    recording = open_case(toss_case(tmp_path, world(), tosses=3)).recording
    episodes = recording.episodes
    flying = [[Span(e, 2, 10)] if e else [] for e in range(len(episodes))]
    spans = into_impacts(recording, flying, 0.1)
    assert [(s.episode, s.begin) for s in spans] == [(e, 2 if e else 0) for e in range(len(episodes))]
    assert spans[0].end == min(round(0.1 / episodes[0].step_s), len(episodes[0]))


def test_where_a_tossed_body_is_missed_is_told_of_the_body(tmp_path: Path):
    """By its height and the axis along which it moves, of forces on it, and of no joint nor command."""
    system = open_case(toss_case(tmp_path, world(), tosses=2))
    assert isinstance(system, MechanismSystem)
    windows = Windows(np.array([0, 0, 0]), np.array([0, 20, 40]), 21)
    table = system.label(raw_signals(system.recording), windows).table
    assert set(table["moving joint"]) == {"'box'"}
    place = system.values()[0][:, :3]
    ways = [
        ("up" if z > 0 else "down") if abs(z) > max(abs(x), abs(y)) else ""
        for x, y, z in place[[16, 36, 56]] - place[[4, 24, 44]]
    ]
    for text, way in zip(table["direction"].tolist(), ways, strict=True):
        assert re.fullmatch(f"'box' moves {way or '(along|against) [xy]'}", text)
    assert all(re.fullmatch(r"'box' at a height of [\d.]+ to [\d.]+ m", p) for p in table["position"].tolist())
    assert system.disturbance.labels[0] == "force on 'box' along x [N]"
    assert system.disturbance.labels[5] == "torque on 'box' about its own z [N m]"
    assert not system.commanded


def test_velocities_count_where_their_noise_is_stated(tmp_path: Path):
    """Otherwise a note says why they do not."""
    toss_case(tmp_path, world(), tosses=2)
    table = pd.read_parquet(tmp_path / "recording.parquet").assign(vx=0.1, vy=0.0, vz=0.0)
    table.to_parquet(tmp_path / "recording.parquet", index=False)
    system = open_case(tmp_path)
    assert not any(c.name == "vx" for c in system.channels)
    assert any("vx, vy, vz are not counted" in n for n in system.recording.notes)


def test_a_body_that_lies_shows_the_noise_of_its_position(tmp_path: Path):
    """Orientations are zero where nothing is predicted: they must not pass for noise, slow and far too large."""
    toss_case(tmp_path, world(), tosses=4, length_s=1.5)
    nominal = yaml.safe_load((tmp_path / "nominal.yaml").read_text())
    (tmp_path / "nominal.yaml").write_text(yaml.safe_dump({**nominal, "noise": None}))
    system = open_case(tmp_path)
    assert system.rests()  # it lies for long enough in some
    measured = measure(system)
    np.testing.assert_allclose(measured.sigma[:3], NOISE["position"], rtol=0.15)
    np.testing.assert_allclose(measured.sigma[3:], NOISE["yaw"], rtol=0.15)
    assert not measured.noise_model.lag_one.any()


def test_a_force_with_holes_is_refused(tmp_path: Path):
    """Where it is measured at some samples of an episode only, nobody knows what acted at the others."""
    toss_case(tmp_path, world(), tosses=2)
    table = pd.read_parquet(tmp_path / "recording.parquet")
    force = np.where(np.arange(len(table)) % 2, 1.0, np.nan)
    table.assign(fx=force, fy=force, fz=force, px=0.0, py=0.0).to_parquet(tmp_path / "recording.parquet", index=False)
    with pytest.raises(RecordingError, match="not measured"):
        free_box(read_case(tmp_path))


def test_a_tilted_frame_is_a_tilted_world():
    """In it gravity and the floor lean alike: a cube at rest on the floor stays at rest."""
    tilt = math.radians(3.0)
    model = compiled(TOSSED, m.FrameTilt(tilt, 0.0))
    assert model.opt.gravity == pytest.approx([G * math.sin(tilt), 0.0, -G * math.cos(tilt)])
    normal = np.empty(3)
    mujoco.mju_rotVecQuat(normal, np.array([0.0, 0.0, 1.0]), model.geom_quat[0])
    assert normal == pytest.approx(-model.opt.gravity / G)


@pytest.mark.slow
def test_a_wrong_friction_is_named(tmp_path: Path):
    """Four tosses of a box with half of the friction that its owner believes: the cause, and how much."""
    system = open_case(toss_case(tmp_path, world(friction=0.2), tosses=4, length_s=0.5))
    found = diagnose(system, threads=1, advise=False)
    assert found.ranked[0].effects == ("friction[box]",)
    mu, error = (of["friction[box]"]["mu"] for of in (found.ranked[0].parameters, found.ranked[0].errors))
    assert abs(mu - 0.2) < 3 * error < 0.05
    assert found.gap_closed > 0.7


@pytest.mark.slow
def test_moments_of_inertia_are_named_by_their_proportions(tmp_path: Path):
    """Tosses that end in the air, of a cube that is not even inside: how large all of them are stays as believed."""
    truth = world()
    truth.body("box").inertia[2] *= 0.75
    mujoco.mj_setConst(truth, mujoco.MjData(truth))
    system = open_case(toss_case(tmp_path, truth, tosses=4, height_m=3.0, spin_rad_s=6.0))
    found = diagnose(system, threads=1, advise=False)
    assert found.ranked[0].effects == ("inertia[box]",)
    told, error = (of["inertia[box]"] for of in (found.ranked[0].parameters, found.ranked[0].errors))
    assert abs(told["z_to_xy"] - 0.75) < 3 * error["z_to_xy"] < 0.1
    assert abs(told["x_to_y"] - 1.0) < 3 * error["x_to_y"] < 0.1
    assert told["ratio"] == pytest.approx(1.0, abs=0.01)
    assert error["ratio"] > 0.24  # what was believed before it was recorded: nothing was learned
    assert found.gap_closed > 0.7


def begun(
    folder: Path, truth: mujoco.MjModel, *, tosses: int = 4, height_m: float = 0.16, spin_rad_s: float = 3.0
) -> tuple[Fitter, Fit]:
    """Return the fitter of some tosses in the stretches that are searched, and the fit without effects, some steps."""
    system = open_case(toss_case(folder, truth, tosses=tosses, height_m=height_m, spin_rad_s=spin_rad_s))
    whole = Fitter(system, system.simulator(threads=1), measure(system, scatter=system.scatter()))
    fitter = whole.stretched(system.stretches())
    return fitter, fitter.fit(NONE, range(len(fitter.measured.spans)), iterations=5)


def offered(fitter: Fitter, name: str) -> Candidate:
    return next(c for c in fitter.system.vocabulary if c.name == name)


def test_what_shows_after_a_hit_alone_is_tried_from_the_air(tmp_path: Path):
    """Of a friction far lower than believed an amount near it is tried, from starts with which most of it is gone."""
    fitter, nominal = begun(tmp_path, world(friction=0.1), tosses=2)
    (found,) = tried_from_the_air(fitter, nominal, [(0.0, offered(fitter, "friction[box]"), np.zeros(1))])
    assert math.exp(found.x[0]) == pytest.approx(0.1 / BELIEVED["friction"], rel=0.5)
    assert found.total < 0.5 * nominal.total
    assert fitter.loss(found.explanation, found.x, found.starts, nominal.episodes) == pytest.approx(found.total)
    assert tried_from_the_air(fitter, nominal, []) == []


def test_a_flight_rules_out_nothing_that_shows_after_a_hit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Whatever explains the flights, and where the model misses little that is anything: friction is still tried."""
    monkeypatch.setattr(multiple_shooting, "explains", lambda *_: True)
    seen = multiple_shooting.look(*begun(tmp_path, world(), tosses=2))
    assert seen is not None
    assert seen.beginning.seeds
    assert not seen.beginning.ruled_out


def test_a_flight_rules_out_what_leaves_much_of_it(tmp_path: Path):
    """Where a centre of mass explains the flights no other effect is tried alone, and friction beside it is."""
    seen = multiple_shooting.look(*begun(tmp_path, world(off_m=0.008), tosses=3, height_m=0.4, spin_rad_s=8.0))
    assert seen is not None
    short, seeds = {k[0].name for k in seen.beginning.short}, {c.name for k in seen.beginning.seeds for c in k}
    assert seen.beginning.ruled_out == seen.beginning.short
    assert "com_offset[box]" in seeds
    assert {"friction[box]", "gravity", "restitution[box]"} <= short
    assert "com_offset[box]" not in short
    check_what_the_flights_say(seen.flown)


def test_a_flight_too_short_to_be_looked_at_has_ended_in_a_hit_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """One toss flies to its end, the other hits almost at once: the flight that is looked at is not all there is."""
    system = open_case(toss_case(tmp_path, world(), tosses=2, length_s=0.2))
    fitter = Fitter(system, system.simulator(threads=1), measure(system, scatter=system.scatter()))
    (whole, soon), values = range(2), fitter.measured.values
    calm = [np.arange(len(v)) < 3 if e == soon else np.ones(len(v), bool) for e, v in enumerate(values)]
    fitter = replace(fitter, measured=replace(fitter.measured, scatter=Scatter(fitter.measured.sensor, tuple(calm))))
    nominal = fitter.fit(NONE, [whole, soon], iterations=0)
    assert [s.episode for s in fitter.until_hit([whole, soon])] == [whole]
    monkeypatch.setattr(multiple_shooting, "search", lambda *_, **__: SimpleNamespace(contenders=(), nominal=nominal))
    monkeypatch.setattr(multiple_shooting, "likeliest", lambda *_: (None, 1.0, 1.0))

    def told(fitter: Fitter, best: object, noises: float, probability: float, all_of_it: bool) -> None:
        raise InterruptedError(f"all of it: {all_of_it}")  # enough was seen

    monkeypatch.setattr(multiple_shooting, "Flown", told)
    with pytest.raises(InterruptedError, match="all of it: False"):
        multiple_shooting.look(fitter, nominal)


def check_what_the_flights_say(flown: Flown | None) -> None:
    """They name the centre of mass, with its amount, wherever the answer for all of it does not hold that."""
    assert flown is not None
    assert not flown.all_of_it

    counted = SimpleNamespace(simulated_s=0.0)

    def told(of: Flown | None, *names: str) -> Flights | None:
        return flights_alone(of, [Ranked(names, (), 0.97, (), {}, {}, None, None)], cast("AbstractSimulator", counted))

    # a likelier one than each of the others is not likelier than all of them
    for none in (None, replace(flown, all_of_it=True), replace(flown, probability=0.4)):
        assert told(none, "unknown") is None
    assert told(flown, "com_offset[box]", "friction[box]") is None
    assert counted.simulated_s == 0.0
    found = told(replace(flown, noises=5.0), "unknown")
    assert found is not None
    assert found.effects == ("com_offset[box]",)
    assert found.parameters["com_offset[box]"]["x_m"] == pytest.approx(0.008, abs=0.001)
    assert found.sentence.startswith(
        "Before the first hit, flights alone are explained by com offset of box (off by x 8"
    )
    assert found.sentence.endswith("leaves no more than the noise. What nothing explains comes with the contact.")
    assert found.noises < 1.05
    assert counted.simulated_s > 0.0
    assert told(flown, "friction[box]") is not None


@pytest.mark.parametrize("ratio", [0.92, 1.04])
def test_a_derivative_through_a_hit_outlasts_the_step_in_which_it_falls(tmp_path: Path, ratio: float):
    """A box believed too large or too small: differences of a tenth of a prior width end its fit where it begins.

    What is hit leaves one valley beside the next, of which a single descent may end in the last but one.
    """
    fitter, nominal = begun(tmp_path, world(half_m=0.05 * ratio))
    size = Explanation((offered(fitter, "body_size[box]"),))
    found = fitter.fit(size, nominal.episodes, near=nominal)
    assert abs(math.exp(found.x[0]) - ratio) < 0.25 * abs(1.0 - ratio)
    assert found.total < 0.3 * nominal.total


def test_a_switch_is_offered_as_a_whole(tmp_path: Path):
    """Half a friction cone means nothing: it is tried as the other kind, whatever a linear model would have of it."""
    truth = world()
    truth.opt.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    fitter, nominal = begun(tmp_path, truth, tosses=2)
    cone = offered(fitter, "friction_cone[box]")
    every = sensitivities(fitter, nominal, directions(fitter.system))
    around = contend(fitter, nominal, every, dispersion=4.0)
    assert around.gains[cone][1].tolist() == [1.0]
    (found,) = tried_from_the_air(fitter, nominal, [(0.0, cone, np.full(1, 0.25))])
    assert found.x.tolist() == [1.0]
    assert found.total < nominal.total
    fit = fitter.fit(found.explanation, nominal.episodes, x=found.x, starts=found.starts, iterations=2)
    other = contend(fitter, fit, every, dispersion=4.0)
    errors = errors_off(other, cone, slice(0, 1), fitter.context, [around, other])
    assert errors == pytest.approx(math.sqrt((nominal.total - fit.total) / 4.0))
