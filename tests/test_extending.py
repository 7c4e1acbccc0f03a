"""A new effect is one file, a new mechanism is a model and a log: what serves the box serves them."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from scipy.integrate import solve_ivp

from runner.__main__ import main
from runner.diagnosis.pipeline import diagnose
from runner.effects import import_all, planar_box
from runner.effects.planar_box import EFFECTS
from runner.inference.least_squares import NONE, Explanation
from runner.report import words
from runner.systems.planar_box.system import PlanarBox, vocabulary
from tests.cases import fitter_of, made

EFFECT = '''"""A pusher that is weaker towards one side of the world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, effect
from runner.effects.wording import Values


@effect
@dataclass(frozen=True)
class OneSidedGain(PlanarEffect):
    name: ClassVar[str] = "one_sided_gain"
    label: ClassVar[str] = "a pusher that is weaker towards one side"
    share: float

    def edit_command(self, columns: np.ndarray, step_s: float) -> np.ndarray:
        return columns * np.where(columns[:, :1] < 0, self.share, 1.0)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        return (Parameter("share_change", "", 0.15, -0.9, 0.9),)

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(1.0 + float(x[0]))

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase("the pusher is weaker to the left", of.show("share"), "Weaken it there.", "Push a scale.")
'''
HELD = 25  # samples that a command of the pendulum is held
# sixteen lines of MJCF: a lever of 0.4 m, and a motor
PENDULUM = """<mujoco model="pendulum">
  <option timestep="0.001" integrator="implicitfast" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="lever" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 -1 0" damping="0.05"/>
      <inertial pos="0 0 -0.4" mass="1.5" diaginertia="0.01 0.01 0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size=".02" mass="0" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="hinge"/>
  </actuator>
</mujoco>
"""
NOMINAL = {
    "model": "model.xml",
    "commands": {"u": {"actuator": "motor"}},
    "channels": {
        "q": {"joint": "hinge", "quantity": "position"},
        "dq": {"joint": "hinge", "quantity": "velocity"},
    },
    "noise": {"q": 0.001, "dq": 0.01},
}


@pytest.fixture
def one_sided_gain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[type]:
    """An effect whose file lies somewhere else."""
    file = tmp_path / "one_sided_gain.py"
    file.write_text(EFFECT, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("one_sided_gain", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "one_sided_gain", module)
    spec.loader.exec_module(module)
    yield module.OneSidedGain
    del EFFECTS["one_sided_gain"]


def test_a_new_effect_is_one_file(one_sided_gain: type) -> None:
    """Registered by its class alone, it is planted, in the vocabulary, fitted, and put into words."""
    fitter = fitter_of(made((one_sided_gain(0.8),), seed=5, episodes=2, seconds=3.0)[0])
    (candidate,) = fitter.system.vocabulary.by_name["one_sided_gain"]
    count, nominal = fitter.measured.count(range(2)), fitter.fit(NONE, range(2))
    fit = fitter.fit(Explanation((candidate,)), range(2), near=nominal)
    assert fit.total < 1.2 * count < 0.1 * nominal.total
    (effect,) = fit.explanation.make(fit.x, fitter.context)
    assert effect.report()["share"] == pytest.approx(0.8, abs=0.02)
    phrase = words.phrase(fitter.system, effect.full_name, effect.report(), {"share": 0.01})
    assert phrase.what == "the pusher is weaker to the left"
    assert phrase.amount.startswith("0.80")


@pytest.mark.slow
def test_a_new_effect_is_an_answer(one_sided_gain: type) -> None:
    """A whole diagnosis names it, and no other."""
    recording, _ = made((one_sided_gain(0.8),), seed=4, episodes=3, seconds=3.0)
    found = diagnose(PlanarBox(recording), threads=1, advise=False)
    assert found.ranked[0].effects == ("one_sided_gain",)
    value, error = (v["one_sided_gain"]["share"] for v in (found.ranked[0].parameters, found.ranked[0].errors))
    assert abs(value - 0.8) < 4 * error < 0.1
    assert words.verdict(found).startswith("The pusher is weaker to the left: 0.80")


def test_a_file_in_the_folder_is_in_the_vocabulary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What lies in a folder of effects is imported with it: there is no list to be kept."""
    (tmp_path / "one_sided_gain.py").write_text(EFFECT, encoding="utf-8")
    monkeypatch.setattr(planar_box, "__path__", [str(tmp_path)])
    import_all(planar_box.__name__, planar_box.__path__)
    try:
        assert [c.name for c in vocabulary()][-1] == "one_sided_gain"
    finally:
        del EFFECTS["one_sided_gain"], sys.modules["runner.effects.planar_box.one_sided_gain"]


def pendulum_case(folder: Path, *, damping_n_m_s: float) -> Path:
    """Write the recording of a pendulum whose hinge is damped otherwise: written-out equations, SciPy's integrator."""
    folder.mkdir()
    (folder / "model.xml").write_text(PENDULUM, encoding="utf-8")
    (folder / "nominal.yaml").write_text(yaml.safe_dump(NOMINAL), encoding="utf-8")
    rng, t = np.random.default_rng(3), np.arange(301) / 100
    inertia, weight = 0.01 + 1.5 * 0.4**2, 1.5 * 9.81 * 0.4
    tables = []
    for episode in range(5):
        u = 3.0 * np.repeat(rng.uniform(-1, 1, 13), HELD)[: len(t)]
        state, rows = np.array([rng.uniform(-1, 1), 0.0]), []
        for begin in range(0, len(t) - 1, HELD):
            held = t[begin : begin + HELD + 1]
            moved = solve_ivp(
                lambda _, y, u=u[begin]: [y[1], (u - damping_n_m_s * y[1] - weight * np.sin(y[0])) / inertia],
                (held[0], held[-1]),
                state,
                t_eval=held,
                rtol=1e-9,
                atol=1e-10,
                method="DOP853",
            ).y.T
            rows.append(moved[:HELD])
            state = moved[-1]
        q, dq = np.vstack([*rows, state]).T + rng.normal(size=(2, len(t))) * [[0.001], [0.01]]
        tables.append(pd.DataFrame({"episode": episode, "t": t, "u": u, "q": q, "dq": dq}))
    pd.concat(tables).to_parquet(folder / "recording.parquet", index=False)
    return folder


@pytest.mark.slow
def test_a_new_mechanism_is_a_model_and_a_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`runner diagnose` fits, names, localises and reports a pendulum by the code that serves the box."""
    case, out = pendulum_case(tmp_path / "pendulum", damping_n_m_s=0.08), tmp_path / "out"
    assert main(["diagnose", str(case), f"out={out}"]) == 0
    verdict = json.loads((out / "verdict.json").read_text(encoding="utf-8"))
    first = verdict["ranked"][0]
    assert first["effects"] == ["joint_damping[hinge]"]
    damping, error = (first[k]["joint_damping[hinge]"]["damping"] for k in ("parameters", "standard_errors"))
    assert abs(damping - 0.08) < 4 * error
    assert verdict["where"]["p"] < 1e-6
    assert "hinge" in capsys.readouterr().out
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "more viscous friction" in page or "damping" in page
    assert (out / "diagnosis.rrd").stat().st_size > 10_000
    assert 'damping="0.08' in (out / "model.xml").read_text(encoding="utf-8")
    # and the corrected model leaves the noise
    assert main(["gap", str(case), f"model={out / 'corrected.yaml'}", f"out={tmp_path / 'gap'}"]) == 0
    gap = pd.read_parquet(tmp_path / "gap" / "gap.parquet")
    assert (gap.loc[(gap["starts"] == "fitted") & (gap["horizon"] == "episode"), "noises"] < 1.1).all()
