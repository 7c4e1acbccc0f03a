"""A report says what was found, to people: in sentences, on a page, in a log, in the terminal."""

from __future__ import annotations

import io
import math
import re
import shutil
import subprocess
import sys
from dataclasses import fields, replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rerun as rr
from playwright.sync_api import sync_playwright
from rich.console import Console

from runner.effects.planar_box import EFFECTS, Friction
from runner.effects.wording import plus_minus
from runner.localise.where import localise
from runner.noise.measured import Measured
from runner.noise.model import NoiseModel
from runner.recording import Episode, Form, Noise, Nominal, Recording, Span
from runner.report import html, words
from runner.report.before_after import misses
from runner.report.html import write_html
from runner.report.missing_force import by_regime
from runner.report.motions import autocorrelation, replay
from runner.report.record import write_rrd
from runner.report.terminal import summary
from runner.systems.base import Run
from runner.systems.planar_box.system import PlanarBox

RATE_HZ, DURATION_S = 60.0, 3.0
SIGMA = np.array([5e-4, 5e-4, 1e-3, 5e-3, 5e-3, 1e-2])
TRUE = Friction(0.27)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE_HZ, noise=Noise(5e-4, 1e-3, 5e-3, 1e-2))


def ranked(effects: tuple[str, ...], chance: float, **other: Any) -> Any:
    """Return one explanation."""
    empty = {"equivalent": (), "values": (), "parameters": {}, "errors": {}, "gap_closed": None, "log_evidence": 0.0}
    return SimpleNamespace(**({"effects": effects, "probability": chance} | empty | other))


def pushed(index: int, seed: int) -> Episode:
    """Return an episode of pushes, its motion still to be simulated."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(RATE_HZ * DURATION_S) + 1) / RATE_HZ
    force, point = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    force[: len(t) // 2, :2] = 14 * np.array([math.cos(seed), math.sin(seed)])
    point[: len(t) // 2, :2] = rng.uniform(-0.2, 0.2, 2)
    return Episode(index, t, np.zeros((len(t), 3)), np.zeros((len(t), 3)), force, point)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A recording of a floor that is more slippery than believed, with noise."""
    still = Recording(Path("slippery"), Form.PLANAR, NOMINAL, tuple(pushed(3 + i, 5 + i) for i in range(3)))
    simulator, rng = PlanarBox(still).simulator(), np.random.default_rng(1)
    episodes = []
    for e, episode in enumerate(still.episodes):
        motion = simulator.predict(e, [Run((TRUE,), np.zeros(6))])[0]
        motion = motion + SIGMA * rng.standard_normal(motion.shape)
        episodes.append(replace(episode, pose=motion[:, :3], twist=motion[:, 3:]))
    return replace(still, episodes=tuple(episodes))


@pytest.fixture(scope="module")
def found(recording: Recording) -> Any:
    """A diagnosis that found the friction."""
    values = tuple(np.hstack([e.pose, e.twist]) for e in recording.episodes)
    valid = tuple(np.ones(v.shape, bool) for v in values)
    spans = tuple(Span(e, 0, len(v)) for e, v in enumerate(values))
    measured = Measured(spans, values, SIGMA, NoiseModel.white(6), valid, np.ones(6, bool))
    system = PlanarBox(recording)
    rows = [
        {"episode": 5, "channel": c.name, "before": 9 * s, "after": 1.1 * s, "noise": s, "unit": c.unit}
        for c, s in zip(system.channels, SIGMA, strict=True)
    ]
    friction = ranked(
        ("friction",),
        0.985,
        parameters={"friction": {"mu": 0.2704}},
        errors={"friction": {"mu": 0.0012}},
        gap_closed=0.87,
    )
    return SimpleNamespace(
        case="slippery",
        system=system,
        recording=recording,
        ranked=(friction, ranked(("none",), 0.01, gap_closed=0.0), ranked(("unknown",), 0.005)),
        abstain=False,
        gap_closed=0.87,
        effects=(TRUE,),
        fitted=(0, 1),
        held_out=(2,),
        measured=measured,
        nominal_starts={e: np.zeros(6) for e in range(3)},
        corrected_starts={e: np.zeros(6) for e in range(3)},
        where=localise(system, measured, {e: np.zeros(6) for e in range(3)}),
        closure=SimpleNamespace(
            table=pd.DataFrame(rows),
            regimes=pd.DataFrame([{"regime": "pushed straight", "windows": 31, "before": 9.0, "after": 1.02}]),
            gap_closed=0.87,
            gap_closed_low=0.85,
            gap_closed_high=0.88,
            closable_closed=0.98,
        ),
        rivals=(),
        excess=0.01,
        nominal_excess=4.0,
        seconds=12.0,
        simulated_s=4000.0,
        next_push=None,
        notes=("Only <one> episode was left to check the explanation.",),
    )


@pytest.fixture(scope="module")
def page(found: Any) -> str:
    """Its report."""
    return html.render(found)


def changed(diagnosis: Any, **other: Any) -> Any:
    """Return a diagnosis with other values."""
    return SimpleNamespace(**(vars(diagnosis) | other))


def said(text: str) -> str:
    """Return what a page shows, without its tags, styles and figures' numbers."""

    class Reader(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.parts, self.skip = [], False

        def handle_starttag(self, tag: str, attrs: Any) -> None:
            self.skip = tag == "style"

        def handle_endtag(self, tag: str) -> None:
            self.skip = False

        def handle_data(self, data: str) -> None:
            if not self.skip:
                self.parts.append(data)

    reader = Reader()
    reader.feed(text)
    return " ".join(" ".join(reader.parts).split())


def printed(diagnosis: Any, width: int = 160) -> str:
    """Return the summary as it stands in a terminal."""
    out = io.StringIO()
    Console(file=out, width=width).print(summary(diagnosis))
    return out.getvalue()


def test_verdict_sentence_of_one_effect(found: Any) -> None:
    """What, how much, how sure, and how much better, in two sentences."""
    assert words.verdict(found) == (
        "The floor is more slippery than believed: friction 0.2704 ± 0.0012 instead of 0.300 (probability 0.98). "
        "With it the simulator misses 87 % less on episodes that were not fitted; of what can be closed, all but the "
        "noise, that is 98 % (mean squares)."
    )


def test_verdict_says_which_way(found: Any) -> None:
    """A coefficient above the believed one is a less slippery floor."""
    top = ranked(("friction",), 0.9, parameters={"friction": {"mu": 0.35}}, errors={"friction": {"mu": 0.01}})
    assert words.verdict(changed(found, ranked=(top,))).startswith("The floor is less slippery than believed")


def test_verdict_of_two_effects(found: Any) -> None:
    """Both are named with their values."""
    top = ranked(
        ("friction", "floor_tilt"),
        0.9,
        parameters={"friction": {"mu": 0.27}, "floor_tilt": {"angle_rad": 0.02, "downhill_rad": -1.0}},
        errors={"friction": {"mu": 0.001}, "floor_tilt": {"angle_rad": 0.0005, "downhill_rad": 0.02}},
    )
    text = words.verdict(changed(found, ranked=(top,)))
    assert text.startswith(
        "Two things differ from the model: the floor is more slippery than believed (friction 0.2700"
    )
    assert "the floor is not level (it slopes by 1.15 ± 0.03°" in text
    assert "With them the simulator misses" in text


def test_verdict_of_none(found: Any) -> None:
    """The model will do, and nothing is to be changed."""
    nothing = changed(found, ranked=(ranked(("none",), 0.97), ranked(("wind",), 0.03)), effects=(), gap_closed=0.0)
    assert words.verdict(nothing) == (
        "The simulator as believed will do: what it misses needs no effect to explain it "
        "(mean square 5.00 times the noise's: small errors of any simulator) (probability 0.97). "
        "The likeliest alternative is wind (probability 0.03)."
    )
    assert words.next_steps(nothing)[0].startswith("Keep your model.")


def test_verdict_of_unknown(found: Any) -> None:
    """It says that no effect explains the gap, and how near the nearest comes."""
    order = (ranked(("unknown",), 0.9), ranked(("friction",), 0.1, gap_closed=0.4))
    text = words.verdict(changed(found, ranked=order))
    assert text.startswith("Something is going on that none of the known effects explains (probability 0.90).")
    assert "With the nearest of them, friction, the simulator misses 40 % less" in text


def test_a_correction_that_does_not_help_is_not_praised(found: Any) -> None:
    """A gap that grew is told as one."""
    assert "does not come closer" in words.verdict(changed(found, gap_closed=-0.2))


def test_what_cannot_be_told_apart_is_said(found: Any) -> None:
    """Equivalent explanations are named on the page and in the terminal, with a way to decide."""
    twin = ranked(
        ("mass",), 0.99, parameters={"mass": {"mass_kg": 4.0}}, errors={"mass": {"mass_kg": 0.01}},
        equivalent=(("actuator_gain",),),
    )  # fmt: skip
    both = changed(found, ranked=(twin,), next_push="Add a known weight.")
    for text in (said(html.render(both)), " ".join(printed(both).split())):
        assert "These data would fit actuator gain just as well" in text
        assert "Add a known weight." in text
    assert any("Weigh the object." in step for step in words.next_steps(both))


@pytest.mark.parametrize("variant", [k for kinds in EFFECTS.values() for k in kinds], ids=lambda k: k.__name__)
def test_every_effect_has_its_words(found: Any, variant: Any) -> None:
    """No effect of the vocabulary is described by its parameters' names, and all its numbers are numbers."""
    names = [f.name for f in fields(variant)]
    values = dict.fromkeys(names, 1.25)
    phrase = words.phrase(found.system, variant.name, values, dict.fromkeys(names, 0.05))
    assert "phrase" in vars(variant) or "phrase" in vars(variant.__base__)
    assert "±" in phrase.amount
    for text in (phrase.what, phrase.amount, phrase.remedy, phrase.check):
        assert text
        assert "?" not in text and "nan" not in text  # noqa: PT018
        assert not re.search(r"_(m|rad|n|s|kg)\b", text)


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.27712, 0.00104, "0.2771 ± 0.0010"),
        (0.27712, 0.0026, "0.277 ± 0.003"),
        (4.2259, 0.1, "4.23 ± 0.10"),
        (-41.48, 12.0, "−41 ± 12"),
        (1234.0, 40.0, "1230 ± 40"),
        (0.5, math.nan, "0.500"),
        (0.5, None, "0.500"),
    ],
)
def test_numbers_are_rounded_to_their_error(value: float, error: float | None, text: str) -> None:
    """The error keeps one digit, two below 2, and the value goes as far as the error."""
    assert plus_minus(value, error) == text


def test_page_shows_everything(found: Any, page: str) -> None:
    """Verdict, figures of the held-out episode, ranking, numbers per horizon, caveats and what to do are there."""
    text = said(page)
    assert words.verdict(found) in text
    for part in (
        "What to do next",
        "Set the friction coefficient between object and floor to 0.2704",
        "corrected.yaml",
        "Episode 5, kept from the fit",
        "Only <one> episode was left",
        "87 % (85–88 %)",
    ):
        assert part in text
    assert "Episode 3" not in text  # fitted episodes prove nothing
    # position x: 9 and 1.1 times 0.5 mm
    assert "4.5 → 0.55" in text
    assert page.count("<svg") >= 3


def test_page_is_self_contained(page: str) -> None:
    """No script, and no address that a browser would fetch."""
    assert "<script" not in page
    fetched = re.findall(r"(?:src|href)=\"([^\"]*)\"", page) + re.findall(r"url\(([^)]*)\)", page)
    assert fetched
    assert all(f.startswith(("#", "data:")) for f in fetched)
    assert "@import" not in page


def test_ids_of_the_page_are_unique_and_found(page: str) -> None:
    """Several figures share a page without taking each other's clip paths and markers."""
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    used = set(re.findall(r"url\(#([^)]+)\)", page)) | set(re.findall(r'href="#([^"]+)"', page))
    assert used <= set(ids)


def test_figures_follow_the_theme(page: str) -> None:
    """Lines and text are drawn in the page's colours, so that black does not vanish on black."""
    figures = "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))
    assert not re.findall(r"(?:fill|stroke): ?#(?!ffffff)[0-9a-f]{6}", figures)
    for variable in ("--ink", "--nominal", "--corrected", "--band"):
        assert f"var({variable})" in figures


def test_same_diagnosis_same_page(found: Any, page: str) -> None:
    """The page is reproducible to the byte."""
    assert html.render(found) == page


def test_replay_separates_models(found: Any) -> None:
    """The corrected motion is within the noise, the nominal one is not."""
    for path in replay(found):
        miss = {
            w: np.sqrt(np.mean(((getattr(path, w) - path.measured) / SIGMA) ** 2)) for w in ("nominal", "corrected")
        }
        assert miss["corrected"] == pytest.approx(1.0, abs=0.1)
        assert miss["nominal"] > 3


def test_misses_are_in_small_units(found: Any) -> None:
    """Rows by channel and horizon, whole episodes last, in mm and degrees."""
    rows = misses(found)
    assert [r.horizon for r in rows[:5]] == ["0.1 s", "0.5 s", "1 s", "2 s", "whole episode"]
    yaw = next(r for r in rows if r.channel.name == "yaw" and r.horizon == "whole episode")
    assert yaw.before == pytest.approx(math.degrees(9e-3))
    # the corrected model is the true one: nothing but noise at any horizon
    for row in rows:
        assert row.after < 1.4 * row.noise
        assert row.noise > 0


def test_autocorrelation_of_a_first_order_process() -> None:
    """phi^k for x[t] = phi x[t-1] + e, and no more than chance for white noise."""
    rng, phi = np.random.default_rng(0), 0.6
    e = rng.standard_normal((20, 2000))
    x = np.zeros_like(e)
    for t in range(1, e.shape[1]):
        x[:, t] = phi * x[:, t - 1] + e[:, t]
    r, count = autocorrelation(x, 3)
    assert count == x.size
    assert r == pytest.approx(phi ** np.arange(1, 4), abs=0.02)
    white, _ = autocorrelation(e, 100)
    assert np.mean(np.abs(white) > 1.96 / np.sqrt(e.size)) < 0.12


def test_whiteness_tells_a_right_model_from_a_wrong_one(found: Any, page: str) -> None:
    """Residuals of the true model pass; those of a model without the effect don't."""
    right = said(page)
    assert "Nothing is left" in right
    wrong = said(html.render(changed(found, effects=(Friction(0.28),), excess=0.8)))
    assert "Something is left" in wrong


def test_missing_wrench_of_less_friction_is_along_the_motion(found: Any) -> None:
    """A floor with 0.03 less friction lacks 0.03 m g along the motion, and nothing across it."""
    means = {m.component: m for m in by_regime(found, found.where) if m.regime == "coasting"}
    lacking = 0.03 * 3.0 * 9.81
    assert means["along_n"].value == pytest.approx(lacking, abs=max(4 * means["along_n"].error, 0.1 * lacking))
    assert abs(means["left_n"].value) < 4 * means["left_n"].error
    assert means["along_n"].value > 4 * means["along_n"].error


def test_page_says_where(found: Any, page: str) -> None:
    """The missing force by regime, the shares of the gap with ticks for even ones, and what is left after."""
    text = said(page)
    assert "Where and when the simulator misses" in text
    assert "by regime" in text
    assert "coasting" in text
    assert "missing force over time, episode 5" in text
    assert "no such excess over the noise is left" in text


def test_terminal_summary(found: Any) -> None:
    """The verdict, the ranking and the miss of every channel."""
    text = printed(found)
    assert "The floor is more slippery than believed" in text
    assert re.search(r"friction +0\.98 +friction 0\.2704 ± 0\.0012 instead of 0\.300 +87 %", text)
    assert re.search(r"position x \[mm\] +4\.5 +0\.55 +0\.50", text)


@pytest.fixture(scope="module")
def log(found: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of the diagnosis."""
    return write_rrd(found, tmp_path_factory.mktemp("log"))


def test_log_verifies(log: Path) -> None:
    """The file has its footer and is sound."""
    verdict = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(log)], capture_output=True, text=True, timeout=60
    )
    assert verdict.returncode == 0, verdict.stdout + verdict.stderr


def test_log_holds_all_motions(found: Any, log: Path) -> None:
    """Three bodies and the residuals of every channel, all episodes one after another, held-out ones first."""
    rows: dict[str, int] = {}
    times = []
    for chunk in rr.chunk.RrdReader(log).stream():
        batch = chunk.to_record_batch()
        entity = chunk.entity_path.lstrip("/")
        if "sim_time" in batch.schema.names:
            rows[entity] = rows.get(entity, 0) + batch.num_rows
            if entity == "world/nominal/object":
                times.append(batch.column("sim_time").to_numpy(zero_copy_only=False))
    samples = sum(len(e) for e in found.recording.episodes)
    bodies = [f"world/{model}/object" for model in ("measured", "nominal", "corrected")]
    for entity in (*bodies, "world/command", "residual/x", "residual/wz"):
        assert rows[entity] == samples
    assert rows["episode"] == 3
    assert rows["world/missing_force"] == len(found.where.missing_force)
    time_s = np.concatenate(times).astype("timedelta64[ns]").astype(float) * 1e-9
    assert np.all(np.diff(time_s) > 0)
    assert rr.chunk.RrdReader(log).blueprints()


def test_log_of_none_has_no_corrected_body(found: Any, tmp_path: Path) -> None:
    """Where nothing is corrected nothing is shown in orange."""
    nothing = changed(found, ranked=(ranked(("none",), 1.0),), effects=(), corrected_starts=found.nominal_starts)
    path = write_rrd(nothing, tmp_path / "none.rrd")
    entities = {c.entity_path for c in rr.chunk.RrdReader(path).stream()}
    assert "/world/nominal/object" in entities
    assert not any(e.startswith("/world/corrected") for e in entities)


needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine")


@needs_chromium
def test_page_in_a_browser(found: Any, tmp_path: Path) -> None:
    """It opens from the file, shows the verdict, draws its figures, fetches nothing and says nothing in the console."""
    messages, requests = [], []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        page.on("console", lambda message: messages.append(message.text))
        page.on("pageerror", lambda error: messages.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(write_html(found, tmp_path).as_uri())
        figures = [figure.bounding_box() for figure in page.locator("figure svg").all()]
        assert page.locator("#verdict").text_content() == words.verdict(found)
        wider_by = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
        assert page.evaluate(wider_by) <= 0
        browser.close()
    assert len(figures) >= 3
    assert all(box is not None and box["height"] > 100 for box in figures)
    assert messages == []
    assert [r for r in requests if not r.startswith(("file://", "data:"))] == []


def test_the_missing_wrench_is_drawn_where_longer_windows_were_looked_at(found: Any) -> None:
    """The wrench keeps its short windows when the excess only shows in longer ones."""
    where = found.where
    fewer = replace(where, windows=where.windows.iloc[::2].reset_index(drop=True), window_s=2 * where.window_s)
    assert by_regime(found, fewer) == by_regime(found, where)
