"""The layout of `diagnosis.rrd`: what a viewer shows at first, and in which colours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from runner.report.record_gap import MUCH
from runner.systems.base import AbstractSystem
from runner.systems.channels import Channel

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

PAPER, INK = (247, 247, 245), (60, 62, 66)
# told apart by those who see few colours, too
COLOURS = {"measured": (66, 148, 214), "nominal": (125, 130, 137), "corrected": (213, 94, 0)}
COMMAND, MISSING = (40, 190, 120), MUCH
MOST = 12  # residuals, and
MOST_FORCES = 6  # components of the missing force that have a plot
MOST_TABS = 16  # episodes
WIDE = 39  # letters of a title that a plot has room for beside three others
NUMBERS, FEW = 8, 4  # that an axis has room for, and one of many rows of plots
MOST_ROWS = 3  # so many are not many
ROOM = 0.06  # of an axis beyond its last numbers
FROM = np.array([0.35, -0.7, 0.62])  # where the eye is from what it looks at, of length 1


def models(diagnosis: Diagnosis) -> list[str]:
    """Return whose motions are shown."""
    return [m for m in COLOURS if m != "corrected" or diagnosis.effects]


def drawn_channels(system: AbstractSystem) -> tuple[Channel, ...]:
    """Return the channels whose residuals have a plot."""
    return system.channels[:MOST]


@dataclass(frozen=True)
class Eye:
    """What the eye looks at, a place (3,), and from how far."""

    target_m: np.ndarray
    distance_m: float


@dataclass(frozen=True)
class Tab:
    """An episode: where its entities lie, what it is called, from where it is seen, and from where to where curves go.

    Those are the least and the largest value, by entity.
    """

    root: str
    name: str
    eye: Eye
    spans: Mapping[str, tuple[float, float]]


def axis(low: float, high: float, most: int) -> tuple[float, float] | None:
    """Return limits of an axis that hold zero and what lies between, where a viewer would not have two numbers to show.

    Its numbers are multiples of a power of ten, so many at most as there is room for: an axis to 70 says "0" alone.
    None: its own limits will do.
    """
    low, high = min(low, 0.0), max(high, 0.0)
    largest = max(-low, high)
    if not 0.0 < largest < math.inf:
        return None
    step = 10.0 ** math.floor(math.log10(largest))
    if 1 + math.floor(high / step) - math.ceil(low / step) <= most:
        return None
    first, last = 10 * step * math.floor(low / (10 * step)), 10 * step * math.ceil(high / (10 * step))
    room = ROOM * (last - first)
    return first - room, last + room


def blueprint(diagnosis: Diagnosis, tabs: Sequence[Tab]) -> rrb.Blueprint:
    """Return the layout: a tab for each episode, and beside them what was found."""
    texts = rrb.Vertical(
        rrb.TextDocumentView(origin="/verdict", name="verdict"),
        rrb.TextDocumentView(origin="/ranking", name="which explanation"),
        row_shares=[1, 1],
    )
    shown = [_episode(diagnosis, tab) for tab in tabs[:MOST_TABS]]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Tabs(*shown, active_tab=0), texts, column_shares=[3.4, 1]) if shown else texts,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )


def _episode(diagnosis: Diagnosis, tab: Tab) -> rrb.Container:
    """Return the views of one episode: measured and simulated side by side, below them the curves."""
    corrected = ", orange: corrected" if diagnosis.effects else ""
    root, paper = f"/{tab.root}", rrb.archetypes.PlotBackground(color=PAPER)
    measured = _scene(
        tab,
        "measured" + ("" if diagnosis.system.plan_view is None else "; arrows: commanded (green), missing (purple)"),
        [f"{root}/measured/**", f"{root}/way/measured", f"{root}/command", f"{root}/missing_arrow"],
        without=f"{root}/measured",
        frames=False,
        diagnosis=diagnosis,
    )
    simulated = _scene(
        tab,
        f"simulated as believed; blue frame: measured{corrected}",
        [
            f"{root}/nominal/**",
            f"{root}/measured/**",
            f"{root}/corrected/**",
            f"{root}/way/nominal",
            f"{root}/way/corrected",
        ],
        without=f"{root}/measured",
        frames=True,
        diagnosis=diagnosis,
    )
    channels = drawn_channels(diagnosis.system)
    disturbance = diagnosis.system.disturbance
    lacking = list(zip(disturbance.names, disturbance.labels, strict=True))[:MOST_FORCES]
    columns = len(channels) if len(channels) <= 2 else 3 if len(channels) <= 6 else 4
    rows = [-(-len(channels) // columns), -(-(1 + len(lacking)) // 4)]
    numbers = NUMBERS if sum(rows) <= MOST_ROWS else FEW
    before = "missing: " if all(len(f"missing: {label}") <= WIDE for _, label in lacking) else ""
    hidden = rrb.PlotLegend(visible=False)  # it would lie on a curve; the text beside says which is which
    residuals = [
        rrb.TimeSeriesView(
            origin=f"{root}/residual/{channel.name}",
            name=f"missed: {channel.label} [noises]",
            background=paper,
            plot_legend=hidden,
            axis_y=_axis(tab, f"{root}/residual/{channel.name}", numbers),
        )
        for channel in channels
    ]
    forces = [
        rrb.TimeSeriesView(
            origin=f"{root}/missing_force/{name}",
            name=f"{before}{label}",
            background=paper,
            plot_legend=hidden,
            axis_y=_axis(tab, f"{root}/missing_force/{name}", numbers),
        )
        for name, label in lacking
    ]
    gap = rrb.TimeSeriesView(
        origin=f"{root}/gap",
        name="share of the gap [%]",
        background=paper,
        plot_legend=hidden,
        axis_y=_axis(tab, f"{root}/gap", numbers),
    )
    below = [gap, *forces]
    plots = [
        rrb.Grid(*residuals, grid_columns=columns),
        rrb.Grid(*below, grid_columns=min(len(below), 4)),
    ]
    return rrb.Vertical(
        rrb.Horizontal(measured, simulated),
        rrb.Vertical(*plots, row_shares=rows),
        row_shares=[1.0, 1.0 if sum(rows) <= MOST_ROWS else 1.25],
        name=tab.name,
    )


def _axis(tab: Tab, entity: str, most: int) -> rrb.ScalarAxis | None:
    """Return the axis of a plot with at most so many numbers; None: the viewer's own, as where there is no curve."""
    span = tab.spans.get(entity.removeprefix("/"))
    limits = None if span is None else axis(*span, most)
    return None if limits is None else rrb.ScalarAxis(range=limits)  # one without a range would be warned of


def _scene(
    tab: Tab, name: str, contents: list[str], *, without: str, frames: bool, diagnosis: Diagnosis
) -> rrb.Spatial3DView:
    """Return a view of bodies; of what was measured either the solid bodies or their frames."""
    eye = tab.eye
    hidden = []
    for body in diagnosis.system.drawn():
        for kind in dict.fromkeys(s.kind for s in body.shapes):
            hidden.append(f"- {without}/{body.name}/{kind}" + ("" if frames else "_frame"))
    return rrb.Spatial3DView(
        origin=f"/{tab.root}",
        contents=[*(f"+ {c}" for c in contents), *hidden],
        name=name,
        background=list(PAPER),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[120, 124, 130, 90]),
        eye_controls=rrb.EyeControls3D(
            position=tuple(eye.target_m + eye.distance_m * FROM),
            look_target=tuple(eye.target_m),
            eye_up=(0, 0, 1),
        ),
    )
