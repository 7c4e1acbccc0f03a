"""`report.html`: everything that a diagnosis found, as one page that needs no network.

What it says is said by one statement (`runner.report.statement`); the long sections stand in `runner.report.sections`.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
from markupsafe import Markup

from runner.effects.wording import counted, listed, number, percent, percent_between, plus_minus, probability
from runner.importing.record import called, episode_sources
from runner.report import sections, unknown, words
from runner.report.before_after import headline_miss
from runner.report.motions import replay
from runner.report.next_steps import next_steps, replaying
from runner.report.statement import NONE, Statement, caveats, doubts, state
from runner.storage.reading import file_of
from runner.storage.writing import write_text
from runner.systems.base import AbstractSystem
from runner.systems.recorded import in_parts, longest_part_s

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Ranked

FILE = "report.html"
TEMPLATE = "template.html.j2"
LONG = 220  # letters of a verdict, from which on it is set smaller
SHOWN = 8  # explanations in the ranking; the rest are summed up
CODE = re.compile(r"(`[^`]*`|<[a-z]\w*(?: [^<>]*)?>)")


def write_html(diagnosis: Diagnosis, path: str | Path) -> Path:
    """Write the report of a diagnosis.

    Args:
        diagnosis: What was found.
        path: The file; a folder: `report.html` in it.

    Returns:
        The file.
    """
    path = file_of(path, FILE)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, render(diagnosis, path.parent))
    return path


def render(diagnosis: Diagnosis, folder: Path | None = None) -> str:
    """Return the report as HTML.

    Args:
        diagnosis: What was found.
        folder: Where that is written to, as commands on the page name it; None: nobody knows.
    """
    return page_template("runner.report", TEMPLATE).render(_content(diagnosis, folder))


def page_template(package: str, name: str) -> jinja2.Template:
    """Return a page's template from its package; it may include the style that all pages share."""
    loaders = [jinja2.PackageLoader(p, ".") for p in dict.fromkeys((package, "runner.report"))]
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader(loaders),
        autoescape=jinja2.select_autoescape(enabled_extensions=("j2",)),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template(name)


def _content(diagnosis: Diagnosis, folder: Path | None) -> dict[str, Any]:
    paths, said, verdict = replay(diagnosis), state(diagnosis), words.verdict(diagnosis)
    return {
        "case": diagnosis.case,
        "noun": diagnosis.system.noun,
        "kind": said.kind.value,
        "verdict": verdict,
        "long": len(verdict) > LONG,
        "confounded": words.confounded(diagnosis),
        "doubts": [_with_code(doubt) for doubt in doubts(diagnosis)],
        "flights": "" if diagnosis.flights is None else diagnosis.flights.sentence,
        "steps": [_with_code(step) for step in next_steps(diagnosis, folder)],
        "replaying": replaying(folder),
        "facts": facts(diagnosis, said),
        "first": sections.first_figure(diagnosis, paths),
        "ranking": ranking(diagnosis, said),
        "nearest": unknown.nearest(diagnosis),
        "left": unknown.left(diagnosis),
        "looks": unknown.looks(diagnosis),
        "corrected": said.corrected,
        "held_out": said.held_out,
        "model_use": _with_code(diagnosis.system.model_use(diagnosis.effects)) if said.corrected else "",
        "commanded": diagnosis.system.commanded,
        "trajectories": sections.trajectories(diagnosis, paths),
        "stretch_s": longest_part_s(diagnosis.recording, diagnosis.stretches),
        "closure": sections.closure(diagnosis),
        "whiteness": sections.whiteness(diagnosis, said, paths),
        "where": sections.where(diagnosis, said, paths),
        "noise": sections.noise(diagnosis),
        "believed": _believed(diagnosis),
        "notes": caveats(diagnosis),
        "effort": words.effort(diagnosis),
    }


def _with_code(text: str) -> Markup:
    """Return text with what stands between backticks, and elements of MJCF, as code."""
    parts = CODE.split(text)
    return Markup("").join(Markup("<code>{}</code>").format(p.strip("`")) if i % 2 else p for i, p in enumerate(parts))


def facts(diagnosis: Diagnosis, said: Statement) -> list[tuple[str, str]]:
    """Return the figures below the verdict: what, how much."""
    which = "this answer, or of what can't be told from it" if words.equals(said.top) else "this answer"
    out = [(f"probability of {which}", probability(said.top.probability))]
    unseen = " on episodes that were not fitted" if said.held_out else ""
    if said.gap_closed is not None and said.corrected:
        value = percent(said.gap_closed) if said.interval is None else percent_between(said.gap_closed, *said.interval)
        beyond = words.closed_beyond(said)
        out.append((f"of the gap closed{unseen}{', noise and all' if beyond else ''}", value))
        if beyond:
            out.append((f"of what is beyond the noise closed{unseen} (mean squares)", beyond))
    elif said.closes_nothing_seen and said.settled and said.fitted_closed is not None:
        closed = percent(max(said.fitted_closed, 0.0))
        out.append(("of what is beyond the noise closed, in the episodes that were fitted", closed))
    if said.noisy and said.settled:
        out.append((f"noise levels missed{unseen} (1: the noise)", words.in_noises(said)))
    much, what = words.left(said)
    out.append((what, much))
    if (miss := headline_miss(diagnosis)) is not None:
        sensor, amount = miss
        out.append((f"{sensor} missed{unseen} (root mean square)", amount))
    return out


def ranking(diagnosis: Diagnosis, said: Statement) -> dict[str, Any]:
    """Return the explanations, likeliest first, and the sum of those that are not shown."""
    system = diagnosis.system
    shown, rest = said.shown(SHOWN)
    rows = []
    for ranked in shown:
        closed = said.closed_by(ranked)
        rows.append(
            {
                "name": words.title(ranked.effects or (NONE,)),
                "label": listed(
                    [words.label(system, e, ranked.parameters.get(e, {})) for e in ranked.effects or (NONE,)]
                ),
                "probability": probability(ranked.probability),
                "width": f"{100 * min(max(ranked.probability, 0.0), 1.0):.1f}",
                "amounts": words.amounts(system, ranked),
                "parameters": _parameters(system, ranked),
                "gap": "" if closed is None else percent(closed),
                "equivalent": words.equals_with_amounts(system, ranked),
            }
        )
    return {
        "rows": rows,
        "rest": len(rest),
        "rest_probability": probability(sum(r.probability for r in rest)) if rest else "",
    }


def _parameters(system: AbstractSystem, ranked: Ranked) -> list[tuple[str, str]]:
    """Return each parameter as it stands in `corrected.yaml`, with its standard error and its unit, or not fitted."""
    out, held = [], {}
    for e in system.as_told(tuple(ranked.values), ranked.errors):
        held |= {e.full_name: e, f"{e.name}[*]": e}  # what all of a kind share is alike in each
    for effect, values in ranked.parameters.items():
        errors, units = ranked.errors.get(effect, {}), system.vocabulary.units(effect, system.context)
        for name, v in values.items():
            there, shown = getattr(held.get(effect), name, v), plus_minus(v, errors.get(name), units[name])
            if errors.get(name) == 0.0:
                shown = f"{shown} (not fitted)"
            elif there != v:
                shown = f"{plus_minus(there, unit=units[name])} (not told: {shown})"
            out.append((f"{effect}.{name}", shown))
    return out


def _files(case: Path) -> str:
    """Return which file each episode of an imported case is from; empty: not known, or all from one."""
    return listed([f"{number} is {source}" for number, source in episode_sources(case).items()])


def _believed(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    episodes = diagnosis.recording.episodes
    duration_s = sum(float(e.t_s[-1] - e.t_s[0]) for e in episodes)
    path = diagnosis.recording.path
    held = listed([called(path, episodes[e].index) for e in diagnosis.held_out])
    count = counted(len(episodes), "episode")
    if in_parts(diagnosis.recording):
        count = f"1 episode in {len(episodes)} parts"
    return [
        (
            "recording",
            f"{count}, {number(duration_s)} s in all, {number(diagnosis.system.rate_hz)} samples a second",
        ),
        (
            "kept from the fit",
            f"{'episode' if len(diagnosis.held_out) == 1 else 'episodes'} {held}" if held else "none",
        ),
        *([("episodes", files)] if (files := _files(path)) else []),
        *diagnosis.system.believed(),
    ]
