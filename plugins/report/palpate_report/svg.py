"""Figures as SVG within a page: text stays text, coordinates are short, the same figure is the same text."""

from __future__ import annotations

import io
import re
from typing import Any

from palpate_kit.figures import style

_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_PATH = re.compile(r' d="[^"]*"')
_HEAD = re.compile(r"^.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)
_NAMED = re.compile(r' id="[A-Za-z0-9.]+_\d+"')  # of groups: axes_1, text_7, FillBetweenPolyCollection_1
_SPACE = re.compile(r"\n\s*")


@style()
def svg_text(figure: Any) -> str:
    """Return the SVG element of a figure; raises nothing that a page could mend."""
    import matplotlib

    file = io.StringIO()
    # Laid out once: with an engine, saving would draw all of it once more before.
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
    with matplotlib.rc_context({"svg.fonttype": "none", "figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
        figure.savefig(file, format="svg", metadata={"Date": None})
    text = _METADATA.sub("", _HEAD.sub("", file.getvalue(), count=1), count=1)
    # Coordinates to a hundredth of a point.
    text = _PATH.sub(lambda path: _NUMBER.sub(lambda number: f"{float(number[0]):.2f}", path[0]), text)
    # Names of groups would be there once for each picture of the page; clip paths and markers are named by contents.
    return _SPACE.sub("\n", _NAMED.sub("", text))
