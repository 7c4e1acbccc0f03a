"""Colours that stand for different things differ to those who see few colours, too."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from runner.figures import _look
from runner.report import figures, record_layout
from runner.report.record_gap import LEAST, MUCH
from runner.teleop.sinks import look

# linear sRGB as a deuteranope, a protanope and a tritanope see it (Machado, Oliveira & Fernandes 2009, severity 1)
SEEN = {
    "all": np.eye(3),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
WHITE = TO_XYZ.sum(axis=1)
TOLD = 15.0  # CIE 1976 difference: of lines side by side


def lab(colour: tuple[int, ...], seen: np.ndarray) -> np.ndarray:
    """Return CIE L*a*b* (3,) of an sRGB colour of 0 to 255 as somebody sees it."""
    c = np.array(colour) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    ratio = TO_XYZ @ np.clip(seen @ linear, 0, 1) / WHITE
    f = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def of_hex(text: str) -> tuple[int, ...]:
    """Return red, green, blue of `#d55e00`."""
    return tuple(int(text[i : i + 2], 16) for i in (1, 3, 5))


PALETTES = {
    "report": [of_hex(c) for c in (figures.INK, figures.GREY, figures.ORANGE, figures.ACCENT)],
    "diagnosis.rrd": [*record_layout.COLOURS.values(), record_layout.COMMAND, record_layout.MISSING],
    "the gap, from none to most": [LEAST, MUCH],
    "run.rrd": [look.REMOTE_COLOUR, *look.LOCAL_COLOURS[:3]],
    "figures": [of_hex(c) for c in _look.SERIES],
}


@pytest.mark.parametrize("eye", list(SEEN))
@pytest.mark.parametrize("name", list(PALETTES))
def test_palette_is_told_apart(name: str, eye: str) -> None:
    """No two colours of a palette look alike."""
    seen = [lab(c, SEEN[eye]) for c in PALETTES[name]]
    nearest = min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2))
    assert nearest > TOLD, f"{nearest:.1f}"
