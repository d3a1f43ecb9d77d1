"""The view of a map on a surface that turns: its numbers, and the script of the page, which loads nothing."""

from __future__ import annotations

import base64
import hashlib
from dataclasses import dataclass
from importlib.resources import files

from palpate_kit.runs.skin_grid import read_lumps, skin_of_map

from palpate_report.figure_subject import Subject
from palpate_report.number_texts import embed_json
from palpate_report.run_map import surface_map_of

_START = """
const skin = JSON.parse(document.getElementById("skin-data").textContent);
document.getElementById("turning").hidden = false;
new SkinView(document.getElementById("skin")).show(skin, skin);
"""


@dataclass(frozen=True)
class SkinView:
    """Data and script of the view, for the page."""

    data: str  # JSON
    code: str  # JavaScript

    @property
    def hash(self) -> str:
        """Digest by which the page permits this script alone."""
        return "sha256-" + base64.b64encode(hashlib.sha256(self.code.encode()).digest()).decode()


def skin_view(subject: Subject) -> SkinView | None:
    """Return the view of the newest map of a run where that is on a surface, and of its main parameter; else None."""
    if subject.main is None:
        return None
    surface_map = surface_map_of(subject.record, next(iter(subject.curves(subject.main).values)))
    if surface_map is None:
        return None
    script = (files("palpate_kit.page") / "static" / "skin.js").read_text(encoding="utf-8")
    lumps = read_lumps(subject.record.folder.maps)
    return SkinView(embed_json(skin_of_map(surface_map, lumps), indent=None), script + _START)
