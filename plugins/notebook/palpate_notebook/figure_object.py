"""A picture that a notebook shows, and that can be saved."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from palpate_kit.figures import save_figure, style

from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@with_suggestions
class Picture:
    """Picture, drawn without a screen; `figure` is matplotlib's, and may be changed."""

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    @property
    def axes(self) -> list[Axes]:
        """The axes of matplotlib, in the order of the panels."""
        return list(self.figure.axes)

    def save(self, path: str | Path) -> Path:
        """Write the picture, PNG, SVG or PDF by the name, and return its path; raises OutputError."""
        save_figure(self.figure, Path(path))
        return Path(path)

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        with style():
            self.figure.savefig(buffer, format="png", metadata={"Software": None})
        return buffer.getvalue()

    def __repr__(self) -> str:
        width, height = self.figure.get_size_inches()
        return f"<Picture of {len(self.figure.axes)} panels, {width:g} x {height:g} inch; .save(path) keeps it>"
