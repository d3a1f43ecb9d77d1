"""The subject of a picture, a run with its tracks; and the figure with the numbers behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from palpate import Floats
from palpate_kit.figures import WIDTHS, figure_of

from palpate_report.figure_data import Curves, curves_of
from palpate_report.run_contents import RunContents

MAX_POINTS = 800  # of a curve: a choice; more do not show in print
# Choices, by which bands that overlap still show: of two standard deviations, and of quartiles.
BAND_OPACITY, QUARTILE_OPACITY = 0.15, 0.18
MAX_TRACKS = 7  # of one panel: as many as the style has colours
_MAX_NARROW_WIDTH = 100.0  # [mm] of a picture whose panels stand one above the other: a choice
_PANEL_HEIGHT = 52.0  # [mm] of one of two panels: a choice


@dataclass(frozen=True)
class ReportFigure:
    """A figure, what it shows in one sentence, and its numbers by column [SI]; columns may differ in length."""

    figure: Any
    caption: str
    data: Mapping[str, Floats]


@dataclass(frozen=True)
class Subject:
    """A run with the tracks that are drawn, and the one that is drawn where there is room for one."""

    record: RunContents
    main: str | None
    tracks: Sequence[str]  # the main one first
    width: float = WIDTHS["double"]  # [mm]
    _known: dict[str, Curves] = field(default_factory=dict)

    def curves(self, name: str) -> Curves:
        """Return the curves of one track."""
        if name not in self._known:
            self._known[name] = curves_of(self.record, name)
        return self._known[name]


def beside(subject: Subject, panels: int) -> int:
    """Return how many panels there is room for side by side."""
    return min(panels, 2 if subject.width > _MAX_NARROW_WIDTH else 1)


def pair(subject: Subject, panels: int) -> tuple[Any, list[Any]]:
    """Return a figure with one or two panels, side by side where there is room."""
    columns = beside(subject, panels)
    figure, axes = figure_of(columns, -(-panels // columns), width=subject.width, height=_PANEL_HEIGHT)
    return figure, list(axes.ravel())
