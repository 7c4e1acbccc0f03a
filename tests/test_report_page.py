"""The page of a report holds everything, stands alone, and opens in a browser."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import sync_playwright

from runner.effects.planar_box import Friction
from runner.recording import Span
from runner.report import html, words
from runner.report.html import write_html
from tests.report_case import changed, diagnosis, ranked, said

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def found() -> Any:
    """A diagnosis that found the friction."""
    return diagnosis()


@pytest.fixture(scope="module")
def page(found: Any) -> str:
    """Its report."""
    return html.render(found)


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


@pytest.mark.usefixtures("undrawn")
def test_page_says_over_how_long_models_were_replayed(found: Any, page: str) -> None:
    """Whole episodes, or parts of them, each with a start of its own: a figure begins anew there."""
    assert "from the start to the end of an episode" in said(page)
    first = found.stretches[0]
    halves = (Span(first.episode, 0, 50), Span(first.episode, 50, first.end), *found.stretches[1:])
    text = said(html.render(changed(found, stretches=halves)))
    assert "from the start to the end" not in text
    assert "s at a time, each with a start of its own" in text


@pytest.mark.usefixtures("undrawn")
def test_page_says_that_starts_are_fitted(found: Any, page: str) -> None:
    """A model that begins beside what was measured does so because that suits it best."""
    fitted = "Positions and speeds at the start are fitted to all of {}, in each simulator so that it misses least"
    assert fitted.format("the episode") in said(page)
    first = found.stretches[0]
    halves = (Span(first.episode, 0, 50), Span(first.episode, 50, first.end), *found.stretches[1:])
    assert fitted.format("such a part") in said(html.render(changed(found, stretches=halves)))


def test_page_of_none_corrects_nothing(found: Any) -> None:
    """Where the model will do there is no after, nothing in orange, and what is missed is told as it is."""
    nothing = ranked(("none",), 0.97, gap_closed=0.0)
    page = html.render(
        changed(found, ranked=(nothing,), effects=(), gap_closed=0.0, corrected_starts=found.nominal_starts)
    )
    text = said(page)
    for part in (
        "Keep your model.",
        "Nothing was corrected.",
        "2.2 times the noise",
        "Small errors are left",
    ):
        assert part in text
    for part in ("simulator corrected", "corrected.yaml", "After the correction", "what is left is"):
        assert part not in text
    assert "var(--corrected)" not in "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))


@pytest.mark.usefixtures("undrawn")
def test_commands_of_the_page_run_where_the_diagnosis_ran(found: Any, page: str, tmp_path: Path) -> None:
    """They name the folder of results, in quotes where a shell would part it."""
    written = write_html(found, tmp_path / "my results/report.html")
    text = said(written.read_text(encoding="utf-8"))
    assert "model=FOLDER" in said(page)
    assert "model=FOLDER" not in text
    assert text.count(f"runner gap NEW model='{tmp_path / 'my results'}'") == 2


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


@pytest.mark.usefixtures("undrawn")
def test_whiteness_tells_a_right_model_from_a_wrong_one(found: Any, page: str) -> None:
    """Residuals of the true model pass; those of a model without the effect don't."""
    right = said(page)
    assert "Nothing is left" in right
    wrong = said(html.render(changed(found, effects=(Friction(0.28),), excess=0.8)))
    assert "Something is left" in wrong


def test_page_says_where(found: Any, page: str) -> None:
    """The missing force by regime, the shares of the gap with ticks for even ones, and what is left after."""
    text = said(page)
    assert "Where and when the simulator misses" in text
    assert "by regime" in text
    assert "coasting" in text
    assert "missing force over time, episode 5" in text
    assert "no such excess over the noise is left" in text


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
        # on a telephone nothing of a table of three columns has to be scrolled to
        page.set_viewport_size({"width": 390, "height": 800})
        assert page.evaluate(wider_by) <= 0
        narrow = page.locator(".wide", has_text="what went on")
        assert narrow.evaluate("e => e.scrollWidth - e.clientWidth") <= 0
        browser.close()
    assert len(figures) >= 3
    assert all(box is not None and box["height"] > 100 for box in figures)
    assert messages == []
    assert [r for r in requests if not r.startswith(("file://", "data:"))] == []
