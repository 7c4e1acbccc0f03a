"""The layout of `diagnosis.rrd`: what a viewer shows at first, and in which colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun.blueprint as rrb

from runner.systems.base import AbstractSystem
from runner.systems.channels import Channel

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis

TRAIL_S = 4.0  # how much of the way is seen behind a body
PAPER, INK = (247, 247, 245), (60, 62, 66)
COLOURS = {"measured": (84, 89, 98), "nominal": (130, 135, 142), "corrected": (213, 94, 0)}
COMMAND = (0, 158, 115)
# of the components of the missing force, in turn: told apart by those who see few colours, too
FORCE = ((0, 114, 178), (204, 121, 167), (0, 158, 115), (86, 180, 233), (230, 159, 0), (120, 94, 240))
MOST = 12  # residuals, and
MOST_FORCES = 6  # components of the missing force that have a plot
FROM = np.array([0.35, -0.7, 0.62])  # where the eye is from what it looks at, of length 1


def models(diagnosis: Diagnosis) -> list[str]:
    """Return whose motions are shown."""
    return [m for m in COLOURS if m != "corrected" or diagnosis.effects]


def drawn_channels(system: AbstractSystem) -> tuple[Channel, ...]:
    """Return the channels whose residuals have a plot."""
    return system.channels[:MOST]


@dataclass(frozen=True)
class Eye:
    """What the eye looks at: a place (3,), from how far, and the body that it follows from there on, or None."""

    target_m: np.ndarray
    distance_m: float
    followed: str | None


def blueprint(diagnosis: Diagnosis, eye: Eye) -> rrb.Blueprint:
    """Return the layout."""
    system = diagnosis.system
    paper = rrb.archetypes.PlotBackground(color=PAPER)
    recent = rrb.VisibleTimeRange(
        "sim_time",
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    corrected = ", corrected (orange)" if diagnosis.effects else ""
    scene = rrb.Spatial3DView(
        origin="/world",
        overrides={f"/world/trail/{model}": rrb.VisibleTimeRanges([recent]) for model in models(diagnosis)},
        name=f"measured (black), as believed (grey){corrected}",
        background=list(PAPER),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[120, 124, 130, 90]),
        eye_controls=rrb.EyeControls3D(
            position=tuple(eye.target_m + eye.distance_m * FROM),
            look_target=tuple(eye.target_m),
            eye_up=(0, 0, 1),
            tracking_entity=None if eye.followed is None else f"/world/measured/{eye.followed}",
        ),
    )
    residuals = [
        rrb.TimeSeriesView(
            origin=f"/residual/{channel.name}",
            name=f"missed: {channel.label} [noise levels]",
            background=paper,
            plot_legend=rrb.PlotLegend(visible=i == 0, corner=rrb.Corner2D.RightTop),
        )
        for i, channel in enumerate(drawn_channels(system))
    ]
    disturbance = system.disturbance
    forces = [
        rrb.TimeSeriesView(
            origin=f"/missing_force/{name}",
            name=label,
            background=paper,
            plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.LeftTop),
        )
        for name, label in list(zip(disturbance.names, disturbance.labels, strict=True))[:MOST_FORCES]
    ]
    texts = rrb.Horizontal(
        rrb.TextDocumentView(origin="/verdict", name="verdict"),
        rrb.Vertical(
            rrb.TextDocumentView(origin="/ranking", name="which explanation"),
            rrb.TextDocumentView(origin="/episode", name="now"),
            row_shares=[3, 1],
        ),
        column_shares=[3, 2],
    )
    plots = rrb.Grid(*residuals, grid_columns=2 if len(residuals) <= 8 else 3)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, texts, row_shares=[3, 2]),
            rrb.Vertical(plots, rrb.Grid(*forces, grid_columns=min(len(forces), 3)), row_shares=[3, 1])
            if diagnosis.where is not None
            else plots,
            column_shares=[1, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
