"""The lumps that the exam of a run excludes, where `palpate map lumps` has found them."""

from __future__ import annotations

import numpy as np
from palpate_kit.figures import WIDTHS, figure_of
from palpate_kit.runs.exclusion_figure import draw_exclusion
from palpate_kit.runs.skin_grid import read_lump_findings

from palpate_report.figure_subject import ReportFigure, Subject


def exclusion(subject: Subject) -> ReportFigure | None:
    """Return the curve of the lumps that are excluded, contrast over width; None without any."""
    excluded = read_lump_findings(subject.record.folder.maps).get("excluded")
    if not excluded:
        return None
    figure, axes = figure_of(width=min(subject.width, WIDTHS["single"]), height=55.0)
    draw_exclusion(axes[0, 0], excluded)
    columns = {"width_m": "width", "contrast": "contrast"}
    data = {name: np.array([entry[key] for entry in excluded], float) for name, key in columns.items()}
    return ReportFigure(figure, "Lumps that would have been found: those in the shaded part", data)
