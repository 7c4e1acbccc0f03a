"""The score of a blind test: figures that can be counted by hand, the hash checked first, the page as it is shown."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cases import made
from rich.console import Console
from scipy.stats import binomtest

from runner.__main__ import main
from runner.blind.checkpoint import Checkpoint
from runner.blind.make import HASH_FILE
from runner.blind.oracle import candidates_of
from runner.blind.planted import difference, planted
from runner.blind.score import Bar, blind_score, check_hash, if_calibrated, of_oracle
from runner.blind.score.figures import draw
from runner.blind.score.page import headline
from runner.blind.score.words import notes, outcome
from runner.commands._print import print_table
from runner.diagnosis.score import calibration_error, is_right, share
from runner.effects.planar_box import AnisotropicFriction, AxisFriction, Mass, ViscousDrag, ViscousFilm
from runner.effects.vocabulary import Candidate
from runner.errors import ResultError
from runner.recording import Nominal, write_case
from runner.systems.planar_box.system import vocabulary

RANDOM = np.random.default_rng(5)
Plain = dict[str, Any]


def answer(*effects: tuple[str, str, Plain], accept: tuple[str, ...] = ()) -> Plain:
    """Return the answer of one case."""
    planted = [{"name": n, "severity": s, "true": t} for n, s, t in effects]
    return {"effects": planted, "accept": sorted({*accept, *(n for n, _, _ in effects)}) or ["none"]}


def verdict(*ranked: tuple[tuple[str, ...], float, Plain], **other: Any) -> Plain:
    """Return a verdict: names, probability, and `{effect: {parameter: (value, error)}}`."""
    return {
        "ranked": [
            {
                "effects": list(names), "probability": p, "equivalent": [],
                "parameters": {e: {k: v[0] for k, v in d.items()} for e, d in stated.items()},
                "standard_errors": {e: {k: v[1] for k, v in d.items()} for e, d in stated.items()},
            }
            for names, p, stated in ranked
        ],
        "closable_closed": 0.9,
    } | other  # fmt: skip


def both(rows: list[tuple[Plain, Plain]]) -> tuple[Plain, Plain]:
    """Return verdicts and answers of numbered cases."""
    return {f"c{i}": v for i, (v, _) in enumerate(rows)}, {f"c{i}": a for i, (_, a) in enumerate(rows)}


def bars_of(rows: list[tuple[Plain, Plain]]) -> dict[str, Bar]:
    return {b.name: b for b in blind_score(*both(rows)).bars}


def test_every_bar_counts_its_own_cases() -> None:
    """Singles by size, nulls, unknowns and pairs, each counted by hand; intervals by Wilson."""
    mass = {"mass": {"mass_kg": (3.1, 0.1)}}
    right, wrong = verdict((("mass",), 0.9, mass)), verdict((("inertia",), 0.9, {}), (("mass",), 0.1, mass))
    none, alarm = verdict((("none",), 0.8, {})), verdict((("friction",), 0.8, {}))
    unknown = verdict((("unknown",), 0.7, {}))
    two, half = verdict((("friction", "mass"), 0.9, mass)), verdict((("mass",), 0.9, mass))
    rows = [
        *[(right, answer(("mass", "strong", {"mass_kg": 3.0})))] * 3,
        (wrong, answer(("mass", "moderate", {"mass_kg": 3.0}))),
        (right, answer(("actuator_gain", "subtle", {"gain": 0.9}), accept=("mass",))),
        (wrong, answer(("mass", "subtle", {"mass_kg": 3.0}))),
        *[(none, answer())] * 4,
        (alarm, answer()),
        *[(unknown, answer(("unknown", "strong", {"what": "wear"})))] * 2,
        (alarm, answer(("unknown", "strong", {"what": "wear"}))),
        (two, answer(("mass", "strong", {"mass_kg": 3.0}), ("friction", "moderate", {"friction": 0.2}))),
        (half, answer(("mass", "strong", {"mass_kg": 3.0}), ("friction", "moderate", {"friction": 0.2}))),
        (alarm, answer(("mass", "strong", {"mass_kg": 3.0}), ("wind", "strong", {"force_n": 1.0}))),
    ]
    bars = bars_of(rows)
    for name, hits, count in (
        ("moderate, strong: first", 3, 4),
        ("subtle: first", 1, 2),
        ("false alarms on nulls", 1, 5),
        ("unknowns abstained from", 2, 3),
        ("pairs: both found", 1, 3),
        ("pairs: one found", 2, 3),
    ):
        bar, wilson = bars[name], binomtest(hits, count).proportion_ci(method="wilson")
        assert (bar.value, bar.cases) == (hits / count, count), name
        assert (bar.low, bar.high) == (wilson.low, wilson.high), name
    assert bars["false alarms on nulls"].missed_by == pytest.approx(0.17)
    assert math.isnan(bars["gap closed, of oracle's"].value)
    found = blind_score(*both(rows))
    mine = found.effects.set_index(["effect", "size"])
    assert mine.loc[("mass", "all"), "cases"] == 5
    assert mine.loc[("mass", "all"), "first_three_right"] == 1.0
    assert mine.loc[("mass", "moderate"), "first_right"] == 0.0
    assert found.basic.cases["rank_of_truth"].iloc[3] == 2
    assert found.worst["probability"].is_monotonic_decreasing
    assert len(found.worst) == 6


@pytest.mark.parametrize(
    ("named", "truth", "accept", "right"),
    [
        (["mass"], ["mass"], {"mass"}, True),
        (["actuator_gain"], ["mass"], {"mass", "actuator_gain"}, True),
        (["armature[slide]"], ["mass[carriage]"], {"armature[slide]", "mass[carriage]"}, True),
        (["mass", "friction"], ["mass"], {"mass"}, False),
        (["stiction", "observation_delay"], ["actuator_delay", "stiction"],
         {"actuator_delay", "observation_delay", "stiction"}, True),
        (["actuator_delay", "observation_delay"], ["actuator_delay", "stiction"],
         {"actuator_delay", "observation_delay", "stiction"}, False),
        (["unknown"], ["unknown"], {"unknown"}, True),
        (["unknown"], ["mass"], {"mass"}, False),
        (["none"], [], {"none"}, True),
        (["mass"], [], {"none"}, False),
    ],
)  # fmt: skip
def test_right_is_one_name_for_each_effect(named: list[str], truth: list[str], accept: set[str], right: bool) -> None:
    """Equivalents stand for the effect that they are equivalent to, and for no other."""
    assert is_right(named, truth, accept) is right


def test_calibration_error_of_known_probabilities() -> None:
    """Ten answers at 0.85 of which six are right are off by a quarter; half of all cases halves it."""
    p = np.array([0.85] * 10 + [0.35] * 10)
    right = np.array([1] * 6 + [0] * 4 + [1, 1, 1, 1, 0, 0, 0, 0, 0, 0], float)
    assert calibration_error(p, right) == pytest.approx(0.5 * 0.25 + 0.5 * 0.05)
    # exactly right probabilities of 0.5: the mean distance of a binomial share of 400 from it
    assert if_calibrated(np.full(400, 0.5)) == pytest.approx(math.sqrt(2 / math.pi) * 0.025, rel=0.1)


def test_intervals_of_right_size_cover_95_percent() -> None:
    """Stated errors that are true are seen to hold 95 %, those of half the size about 67 %; NaN where there is none."""
    shares = {}
    for honest in (1.0, 0.5):
        draws = RANDOM.normal(size=400)
        rows = [
            (verdict((("friction",), 1.0, {"friction": {"mu": (0.3 + 0.01 * z, honest * 0.01)}})),
             answer(("friction", "strong", {"friction": 0.3})))
            for z in draws
        ]  # fmt: skip
        coverage = blind_score(*both(rows)).coverage.set_index("parameter")
        assert coverage.loc["mu", "covered"] == np.mean(np.abs(draws) <= honest * 1.959964)
        shares[honest] = coverage.loc["mu", "covered"]
    assert shares[1.0] == pytest.approx(0.95, abs=0.035)
    assert shares[0.5] == pytest.approx(0.673, abs=0.08)
    assert all(math.isnan(v) for v in share([]))


def test_planted_values_under_the_names_of_a_verdict() -> None:
    """Renamed, made relative, and left out where the number is of another kind."""
    nominal = Nominal((0.5, 0.4, 0.3), 3.0, 0.3, 9.81, 60.0)

    def of(name: str, **true: Any) -> dict[str, float]:
        whole = answer((name, "strong", true), ("mass", "strong", {"mass_kg": 6.0}))
        return planted(whole["effects"][0], whole, nominal)

    assert of("friction", friction=0.2)["mu"] == 0.2
    assert of("stribeck", change=0.1, speed_m_per_s=0.3)["speed_m_s"] == 0.3
    assert of("viscous_drag", coefficient_n_s_per_m=2.0, acts="film")["film_n_s_per_m"] == 2.0
    # twice the mass has twice the inertia: what is left is a ratio of 1.5
    assert of("inertia", inertia_kg_m2=3.0 * 0.41 / 3 * 2 * 1.5)["ratio"] == pytest.approx(1.5)
    aniso = of("anisotropic_friction", friction_1=0.36, friction_2=0.24, axis_1_rad=0.1, flow="scaled")
    assert (aniso["ratio"], aniso["angle_rad"]) == (pytest.approx(1.5), 0.1)
    assert set(of("friction_patch", change=1.0, x_m=0.0, y_m=1.0, radius_m=2.0, shape="gaussian")) == {"x_m", "y_m"}
    assert of("contact_pressure", share=0.2, where="rim") == {}
    assert difference("wind", "direction_rad", math.pi - 0.1, -math.pi + 0.1) == pytest.approx(-0.2)
    assert difference("anisotropic_friction", "angle_rad", math.pi / 2 - 0.1, -math.pi / 2) == pytest.approx(-0.1)
    assert difference("anisotropic_friction", "ratio", 4.0, 0.5) == 3.5


def test_place_of_a_patch_and_of_a_tether() -> None:
    """Distance from the truth, and the stated error of both coordinates together."""
    stated = {"x_m": (1.3, 0.3), "y_m": (2.4, 0.4), "change": (0.5, 0.1)}
    true = {"x_m": 1.0, "y_m": 2.0, "change": 0.5, "radius_m": 1.0, "shape": "disc"}
    rows = [
        (verdict((("friction_patch",), 0.9, {"friction_patch": stated})), answer(("friction_patch", "strong", true))),
        (verdict((("mass",), 0.9, {})), answer(("tether", "strong", {"x_m": 1.0, "y_m": 1.0}))),
    ]
    places = blind_score(*both(rows)).places
    assert len(places) == 1
    assert places.loc[0, "distance_m"] == pytest.approx(0.5)
    assert places.loc[0, "stated_error_m"] == pytest.approx(0.5)


def test_the_oracle_takes_the_variant_that_was_planted() -> None:
    """A film is fitted as a film, a drag of the body as a drag; no effect outside the vocabulary."""

    def kinds_of(effects: list[Plain]) -> list[Candidate]:
        return candidates_of(effects, vocabulary())

    film, mass, drag = Candidate(ViscousFilm), Candidate(Mass), Candidate(ViscousDrag)
    assert kinds_of([{"name": "viscous_drag", "true": {"acts": "film"}}, {"name": "mass"}]) == [film, mass]
    assert kinds_of([{"name": "viscous_drag", "true": {"acts": "body"}}]) == [drag]
    for flow, variant in (("associated", AnisotropicFriction), ("scaled", AxisFriction)):
        assert kinds_of([{"name": "anisotropic_friction", "true": {"friction_1": 0.3, "flow": flow}}]) == [
            Candidate(variant)
        ]
    with pytest.raises(ResultError, match="no effect 'wear'"):
        kinds_of([{"name": "wear"}])


def test_no_case_makes_up_for_another_in_the_share_of_the_oracle_s_closure() -> None:
    """At most 1 where the oracle ended in a hollow, -1 at worst, none where nothing could be closed."""
    assert of_oracle(0.45, 0.9, 20.0) == pytest.approx(0.5)
    assert of_oracle(0.9, 0.05, 20.0) == 1.0
    assert of_oracle(-7.0, 0.9, 20.0) == -1.0
    assert math.isnan(of_oracle(0.9, 0.9, 0.05))
    # effects that don't show in these episodes: shares of less than nothing
    assert math.isnan(of_oracle(-3e7, -1e7, -0.02))
    assert math.isnan(of_oracle(-1e7, -3e7, -0.02))
    assert math.isnan(of_oracle(0.5, math.nan, 20.0))


def test_a_case_without_a_verdict_is_wrong() -> None:
    """It is in every figure of its kind, and is said to be missing."""
    rows = [(verdict((("none",), 0.8, {})), answer())] * 3
    verdicts, answers = both(rows)
    del verdicts["c1"]
    found = blind_score(verdicts, answers)
    alarms = next(b for b in found.bars if b.name == "false alarms on nulls")
    assert (alarms.value, alarms.cases) == (pytest.approx(1 / 3), 3)
    assert notes(found)[0].startswith("1 of 3 cases have no verdict and count as wrong: c1")


def test_a_value_without_an_error_holds_nothing() -> None:
    """What is stated without an interval, and is off, counts against the intervals."""
    true = {"mass_kg": 3.0}
    rows = [
        (verdict((("mass",), 0.9, {"mass": {"mass_kg": (3.1, e)}})), answer(("mass", "strong", true)))
        for e in (0.1, 0.1, None, 0.1)
    ]
    bar = bars_of(rows)["truth in 95 % intervals"]
    assert (bar.value, bar.cases) == (0.75, 4)
    assert bar.low < 0.75 < bar.high


@pytest.mark.parametrize(
    ("x", "y", "held"), [((None, None), (2.0, 0.1), 1), ((1.1, None), (2.1, None), 0), ((1.1, 0.1), (2.1, 0.1), 2)]
)
def test_a_value_that_is_not_stated_holds_nothing(x: tuple, y: tuple, held: int) -> None:
    """A number that did not exist counts as one that is off; a place without an error is not drawn."""
    stated = {"friction_patch": {"x_m": x, "y_m": y}}
    true = {"x_m": 1.0, "y_m": 2.0, "shape": "disc"}
    row = verdict((("friction_patch",), 0.9, stated)), answer(("friction_patch", "strong", true))
    found = blind_score(*both([row]))
    assert (found.parameters["covered"].sum(), len(found.parameters)) == (held, 2)
    assert ("places" in draw(found)) == (held == 2)


def test_words_of_an_outcome() -> None:
    """Reached or missed by how much, and whether the interval settles it."""
    assert outcome(Bar("a", 0.97, 0.96, 0.99, 200, least=0.95)) == "met"
    assert outcome(Bar("a", 0.97, 0.90, 0.99, 30, least=0.95)) == "met ?"
    assert outcome(Bar("a", 0.91, 0.88, 0.96, 90, least=0.95)) == "missed by 4.0 ?"
    assert outcome(Bar("a", 0.10, 0.05, 0.2, 90, most=0.03)) == "missed by 7.0"
    assert outcome(Bar("a", 0.99, 0.985, 1.0, 900, least=0.9, most=0.98)) == "missed by 1.0"
    assert outcome(Bar("a", 1.0, 1.0, 1.0, 6, least=0.9, most=0.98)) == "missed by 2.0 ?"
    assert outcome(Bar("a", math.nan, math.nan, math.nan, 0, least=0.9)) == "not measured"
    assert headline([Bar("a", 1, 1, 1, 3, least=0.5), Bar("b", 0, 0, 0, 3, least=0.5)]).endswith("missed: b.")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Results of a blind run of 30 cases, with their answers beside, made by hand."""
    rows = []
    for i in range(30):
        name = ("mass", "friction_patch", "wind")[i % 3]
        size = ("subtle", "moderate", "strong")[(i // 3) % 3]
        true = {"mass": {"mass_kg": 3.0}, "wind": {"force_n": 1.0, "direction_rad": 3.1}}.get(
            name, {"change": 0.4, "x_m": 0.0, "y_m": 0.5, "radius_m": 1.0, "shape": "disc"}
        )
        stated = {name: {k: (v + 0.02 * RANDOM.normal(), 0.02) for k, v in true.items() if not isinstance(v, str)}}
        p = 0.55 + 0.44 * RANDOM.random()
        good, bad = ((name,), p, stated), (("rotational_damping",), 1 - p, {})
        order = (good, bad) if i % 10 else (bad, good)
        rows.append((verdict(*order), answer((name, size, true))))
    rows.append((verdict((("none",), 0.9, {})), answer()))
    rows.append((verdict((("unknown",), 0.9, {})), answer(("unknown", "strong", {}))))
    verdicts, answers = both(rows)
    text = json.dumps(answers)
    (tmp_path / "answers.json").write_text(text)
    results = tmp_path / "results"
    results.mkdir()
    (results / "verdicts.json").write_text(json.dumps(verdicts))
    (results / HASH_FILE).write_text(hashlib.sha256(text.encode()).hexdigest() + "\n")
    by = {"runner": "0.1.0", "commit": "f" * 40, "changed": False, "begun": "2026-01-01T00:00:00+00:00"}
    (results / "diagnosed_by.json").write_text(json.dumps([by]))
    return tmp_path


def test_what_is_printed_and_kept(run: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
    """Tables within 80 columns without a cut value, Parquet, figures, and a page that says which commit diagnosed."""
    monkeypatch.setenv("COLUMNS", "80")
    words = [f"verdicts={run / 'results'}", f"answers={run / 'answers.json'}", f"out={run / 'out'}"]
    assert main(["blind", "score", *words]) == 0
    out = capsys.readouterr().out
    assert max(len(line) for line in out.splitlines()[:-1]) <= 80
    assert "…" not in out
    assert "moderate, strong: first" in " ".join(out.split())
    page = (run / "out" / "score.html").read_text()
    assert "ffffffffffff" in page
    assert page.count("<svg ") == 6
    assert "http" not in page.replace("http://www.w3.org", "")
    assert {p.name for p in (run / "out" / "figures").glob("*.png")} >= {"bars.png", "confusion.png", "places.png"}
    assert len(pd.read_parquet(run / "out" / "score_cases.parquet")) == 32
    assert set(pd.read_parquet(run / "out" / "score_bars.parquet")["name"]) >= {"subtle: first"}


def test_targets_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    """A name in brackets is part of the name, in the terminal too."""
    print_table(Console(), "Named", (("planted",), [("joint_friction[elbow]",)]))
    assert "joint_friction[elbow]" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("answers", '{"c0": {"effects": [{"severity": "strong"}], "accept": []}}', "case 'c0': each of `effects` must"),
        ("answers", '{"c0": {"effects": []}}', "case 'c0': must have the lists `effects` and `accept`"),
        ("answers", "[]", "must hold an object with `effects`"),
        ("results/verdicts", '{"c0": {"ranked": []}}', "case 'c0': `ranked` must be a list of explanations"),
        ("results/verdicts", '{"c0": {"ranked": [{"effects": ["mass"]}]}}', "`probability` from 0 to 1, got None"),
        ("results/verdicts", '{"c0": {"ranked": [{"effects": [], "probability": 1}]}}', "`effects`, a list of names"),
        ("results/verdicts", '{"c0": {"ranked": [{"effects": ["mass"], "probability": 1}]}}', "have `parameters` by"),
        ("results/diagnosed_by", '[{"runner":', "diagnosed_by.json: not JSON"),
    ],
)
def test_what_is_no_verdict_or_no_answer_is_said(
    run: Path, file: str, content: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line that names the file and the case, and exit code 2."""
    (run / f"{file}.json").write_text(content)
    text = (run / "answers.json").read_bytes()
    (run / "results" / HASH_FILE).write_text(hashlib.sha256(text).hexdigest() + "\n")
    words = [f"verdicts={run / 'results'}", f"answers={run / 'answers.json'}", f"out={run / 'out'}"]
    assert main(["blind", "score", *words]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_the_oracle_is_asked_once_for_each_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Taken up again, the score fits only what is missing; other episodes left out are another fit."""
    rows = [(verdict((("mass",), 0.9, {}), held_out=[h]), answer(("mass", "strong", {}))) for h in (4, 5, 6)]
    verdicts, answers = both(rows)
    for name in answers:
        write_case(made(episodes=2, seconds=1.0)[0], tmp_path / "cases" / name)
    asked = tmp_path / "asked"
    asked.mkdir()

    def told(name: str, case: Path, effects: object, unseen: list[int]) -> tuple[str, tuple[float, float]]:
        (asked / f"{name}-{unseen[0]}").touch(exist_ok=False)
        return name, (1.0, 20.0)

    monkeypatch.setattr("runner.blind.score.gap._told", told)
    of = {"answers": "f" * 64}

    def scored() -> tuple[list[float], set[str]]:
        gap = blind_score(
            verdicts, answers, tmp_path / "cases", checkpoint=Checkpoint(tmp_path / "fits", of), workers=1
        ).gap
        assert gap is not None
        return list(gap["ratio"]), {p.name for p in asked.iterdir()}

    assert scored() == ([0.9] * 3, {"c0-4", "c1-5", "c2-6"})
    lines = (tmp_path / "fits").read_text().splitlines(keepends=True)
    (asked / "c2-6").unlink()
    (tmp_path / "fits").write_text("".join(lines[:-1]) + lines[-1][:9])  # killed while it wrote
    verdicts["c0"]["held_out"] = [0]
    assert scored() == ([0.9] * 3, {"c0-0", "c0-4", "c1-5", "c2-6"})


def test_other_answers_are_refused(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A byte changed in the answers, or no hash beside the verdicts, is one line and exit code 2."""
    words = [f"verdicts={run / 'results' / 'verdicts.json'}", f"answers={run / 'answers.json'}", f"out={run / 'out'}"]
    (run / "answers.json").write_text((run / "answers.json").read_text() + "\n")
    assert main(["blind", "score", *words]) == 2
    err = capsys.readouterr().err
    assert "not the answers that were set down beforehand" in err
    assert err.count("\n") == 1
    (run / "results" / HASH_FILE).unlink()
    assert main(["blind", "score", *words]) == 2
    assert "answers.sha256: no such file" in capsys.readouterr().err
    with pytest.raises(ResultError, match="can't be read"):
        check_hash(run / "nowhere.json", run / "results")
