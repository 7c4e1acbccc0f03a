"""A report of a mechanism: joints instead of a plan, any number of channels, several bodies that are drawn."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
import rerun as rr

from runner.localise.regimes import closure_by_regime
from runner.localise.where import localise
from runner.noise.measured import measure
from runner.report import before_after, html
from runner.report.before_after import misses
from runner.report.motions import replay
from runner.report.next_steps import next_steps
from runner.report.record import write_rrd
from runner.report.record_shapes import shapes
from runner.report.suspects import suspects
from runner.simulate.gap import of_a_sample
from runner.systems.case import open_case
from runner.systems.mechanism.drawing import drawn_bodies

RATE_HZ, DURATION_S, STEPS = 50.0, 3.0, 20  # physics steps to a sample
MODEL = """<mujoco model="arm"><option timestep="0.001" integrator="implicitfast"/>
<default><joint type="hinge" axis="0 -1 0" damping="0.2"/>
<geom type="capsule" size="0.02" mass="0" contype="0" conaffinity="0"/></default>
<worldbody><body name="upper" pos="0 0 1"><joint name="shoulder"/><geom fromto="0 0 0 0 0 -0.3"/>
<inertial pos="0 0 -0.15" mass="0.8" diaginertia="0.007 0.007 0.0002"/>
<body name="forearm" pos="0 0 -0.3"><joint name="elbow"/><geom fromto="0 0 0 0 0 -0.25"/>
<inertial pos="0 0 -0.12" mass="0.6" diaginertia="0.004 0.004 0.0001"/></body></body></worldbody>
<actuator><motor name="shoulder" joint="shoulder"/><motor name="elbow" joint="elbow"/></actuator></mujoco>"""
NOMINAL = """model: model.xml
commands: {u_shoulder: {actuator: shoulder}, u_elbow: {actuator: elbow}}
channels:
  q_shoulder: {joint: shoulder, quantity: position}
  q_elbow: {joint: elbow, quantity: position}
noise: {q_shoulder: 0.001, q_elbow: 0.001}
start: rest
"""


def recorded(folder: Path) -> Path:
    """Write a case in which the elbow has dry friction that its model lacks, stepped by MuJoCo alone."""
    rng = np.random.default_rng(3)
    stiff = 'name="elbow" frictionloss="0.06" solreffriction="0.002 1" solimpfriction="0.995 0.999 0.001 0.5 2"'
    model = mujoco.MjModel.from_xml_string(MODEL.replace('name="elbow"', stiff, 1))
    tables = []
    for episode in range(3):
        data, t = mujoco.MjData(model), np.arange(int(DURATION_S * RATE_HZ) + 1) / RATE_HZ
        size, rate = rng.uniform([0.8, 0.3], [1.4, 0.6]), rng.uniform(3.0, 7.0, 2)
        command, q = np.sin(t[:, None] * rate) * size, np.zeros((len(t), 2))
        for k in range(len(t)):
            q[k] = data.qpos
            data.ctrl = command[k]
            mujoco.mj_step(model, data, STEPS)
        q += 1e-3 * rng.standard_normal(q.shape)
        tables.append(
            pd.DataFrame(
                {"episode": episode, "t": t, "u_shoulder": command[:, 0], "u_elbow": command[:, 1],
                 "q_shoulder": q[:, 0], "q_elbow": q[:, 1]}
            )
        )  # fmt: skip
    (folder / "model.xml").write_text(MODEL, encoding="utf-8")
    (folder / "nominal.yaml").write_text(NOMINAL, encoding="utf-8")
    pd.concat(tables).to_parquet(folder / "recording.parquet", index=False)
    return folder


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A diagnosis that found the friction of the elbow."""
    system = open_case(recorded(tmp_path_factory.mktemp("arm")))
    (candidate,) = system.vocabulary.by_name["joint_friction[elbow]"]
    effects = (candidate.with_values({"friction": 0.06}),)
    measured, starts = measure(system), {e: np.zeros(system.initial.size) for e in range(3)}
    where = localise(system, measured, starts)
    rows = [
        {"episode": 2, "channel": c.name, "unit": c.unit, "before": 20e-3, "after": 1.05e-3, "noise": 1e-3}
        for c in system.channels
    ]
    top = SimpleNamespace(
        effects=(candidate.name,), equivalent=(), equal_numbers={}, probability=0.95, gap_closed=0.95, values=effects,
        parameters={candidate.name: {"friction": 0.06}}, errors={candidate.name: {"friction": 0.001}},
    )  # fmt: skip
    unknown: Any = SimpleNamespace(
        effects=("unknown",),
        equivalent=(),
        equal_numbers={},
        probability=0.05,
        gap_closed=None,
        parameters={},
        errors={},
        values=(),
    )
    return SimpleNamespace(
        case="arm", system=system, recording=system.recording, ranked=(top, unknown), gap_closed=0.95,
        effects=effects, fitted=(0, 1), held_out=(2,), measured=measured, stretches=system.stretches(),
        nominal_starts=starts, corrected_starts=starts, where=where, rivals=(), abstention=None, flights=None,
        excess=0.01, nominal_excess=400.0, drive_excess=0.0, left_by_episode={},
        wall_s=1.0, cpu_s=1.5, simulated_s=9.0, next_push=None, doubts=(), notes=(),
        closure=SimpleNamespace(
            table=pd.DataFrame(rows), regimes=closure_by_regime(system, measured, (2,), effects, where.window_s),
            gap_closed=0.95, gap_closed_low=0.94, gap_closed_high=0.96, closable_closed=0.999,
        ),
    )  # fmt: skip


def test_the_right_joint_explains_the_motion(found: Any) -> None:
    """The corrected motion follows the recording, that of the model as believed does not."""
    for path in replay(found):
        missed = [float(np.sqrt(np.nanmean((m - path.measured) ** 2))) for m in (path.nominal, path.corrected)]
        assert missed[0] > 5 * missed[1]


def test_page_of_a_mechanism(found: Any) -> None:
    """Joints are named with their units, and nothing speaks of a floor, a push or a body that moves about."""
    page = html.render(found)
    text = re.sub(r"<[^>]*>", " ", page.partition("</style>")[2])
    for part in (
        "dry friction",
        "model.xml runs in plain MuJoCo",
        "joint friction of elbow",
        "a different dry friction (elbow)",
        "position of 'elbow' [°]",
        "at 'elbow' [N m]",
        "joint position of shoulder missed on episodes that were not fitted",
        "by what the mechanism was doing",
        "by moving joint",
    ):
        assert part in text
    text = text.replace("Ljung–Box", "")
    assert not re.search(r"\b(floor|push(es)?|box|yaw|velocity x|way from above|on the map)\b", text, re.IGNORECASE)
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_what_is_to_be_written_is_set_as_code(found: Any) -> None:
    """Elements of MJCF and commands can be copied from what there is to do; the rest is text."""
    page = html.render(found)
    steps = page.partition("What to do next")[2].partition("</ol>")[0]
    code = re.findall(r"<code>(.*?)</code>", steps)
    assert "&lt;joint name=&#34;elbow&#34;&gt;" in code
    assert any(c.startswith("runner gap ") for c in code)
    assert "&lt;" not in re.sub(r"<code>.*?</code>", "", steps)


def test_what_is_missed_points_at_the_joint(found: Any) -> None:
    """The gap is the elbow's, and so the suspect is."""
    assert "elbow" in found.where.sentence
    unknown: Any = SimpleNamespace(**(vars(found) | {"ranked": found.ranked[1:], "effects": ()}))
    assert any("elbow" in s.where for s in suspects(found.system, found.where))
    assert "elbow" in " ".join(next_steps(unknown))


def test_log_of_a_mechanism(found: Any, tmp_path: Path) -> None:
    """Every body of every model moves as forward kinematics has it, and every joint has its plots."""
    path = write_rrd(found, tmp_path / "arm.rrd")
    rows: dict[str, int] = {}
    drawn = set()
    for chunk in rr.chunk.RrdReader(path).stream():
        batch, entity = chunk.to_record_batch(), chunk.entity_path.lstrip("/")
        if "sim_time" in batch.schema.names:
            rows[entity] = rows.get(entity, 0) + batch.num_rows
        drawn |= {entity} if entity.endswith("/capsule") else set()
    for episode in found.recording.episodes:
        root = f"episode_{episode.index}"
        bodies = [f"{root}/{model}/{body}" for model in ("measured", "nominal") for body in ("upper", "forearm")]
        frames = [f"{root}/corrected/{body}" for body in ("upper", "forearm")]
        for entity in (*bodies, *frames, f"{root}/residual/q_shoulder", f"{root}/residual/q_elbow"):
            assert rows[entity] == len(episode)
        assert {f"{body}/capsule" for body in bodies} <= drawn
        assert {f"{root}/missing_force/{name}" for name in found.system.disturbance.names} <= rows.keys()
    assert not any(entity.endswith(("/command", "/missing_arrow")) for entity in rows)


def test_round_bodies_are_drawn_round() -> None:
    """A ball and an egg are ellipsoids with the half axes that MuJoCo has, turned as their geoms are."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body name="ball"><freejoint/><geom type="sphere" size=".03"/></body>
      <body name="egg"><freejoint/><geom type="ellipsoid" size=".05 .04 .03" quat="0 1 0 0"/></body>
    </worldbody></mujoco>""")
    ball, egg = drawn_bodies(model)
    assert [(s.kind, s.size_m) for s in (*ball.shapes, *egg.shapes)] == [
        ("ellipsoid", (0.03, 0.03, 0.03)),
        ("ellipsoid", (0.05, 0.04, 0.03)),
    ]
    drawn: Any = shapes(egg, "ellipsoid", solid=True, colour=None, grown=1.0, line_m=0.001)
    np.testing.assert_allclose(drawn.half_sizes.as_arrow_array().to_pylist()[0], [0.05, 0.04, 0.03], rtol=1e-6)
    assert drawn.quaternions.as_arrow_array().to_pylist() == [[1.0, 0.0, 0.0, 0.0]]


def test_log_of_what_has_no_shape(found: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel without geoms whose mass is at its axis is not drawn; what it misses is plotted all the same."""
    monkeypatch.setattr(type(found.system), "drawn", lambda _: ())
    monkeypatch.setattr(type(found.system), "poses", lambda *_: {})
    entities = {c.entity_path.lstrip("/") for c in rr.chunk.RrdReader(write_rrd(found, tmp_path)).stream()}
    assert "episode_0/residual/q_elbow" in entities
    assert not any("/measured" in e for e in entities)


def test_misses_of_what_is_sampled_slowly(found: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A horizon shorter than a sample is left out; the others are there."""
    assert [m.horizon_s for m in misses(found)][:3] == [0.1, 0.5, 1.0]
    assert of_a_sample((0.1, 0.5, 1.0), 2.0) == (0.5, 1.0)
    monkeypatch.setattr(before_after, "SHOWN_HORIZONS_S", (0.001, 0.5))
    assert [m.horizon_s for m in misses(found) if not math.isnan(m.horizon_s)] == [0.5, 0.5]
