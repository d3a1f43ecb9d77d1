"""The section on a folder of fits in its report: methods, drawn curves, a typical budget."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from palpate import PalpateError
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.figures import WIDTHS
from palpate_kit.terminal.fact_line import facts_in_words
from palpate_kit.terminal.motion_text import measured_text, row_motion
from palpate_kit.terminal.phrase import curve_count

from palpate_report.bibliography import sources_of
from palpate_report.budget_rows import budget_rows
from palpate_report.folder_facts import FolderFacts, exclusion_of, libraries
from palpate_report.svg import svg_text
from palpate_report.typical_curves import (
    captions,
    drawing,
    excluded_curves_figure,
    excluded_rows,
    outcome_of,
    ranked_rows,
    used_curves_figure,
)

_INCH = 25.4  # [mm]
_EQUATION = re.compile(r", eq\. [^;]*")  # of a source: a number that only its reader can look up


def folder_section(facts: FolderFacts, hide: Callable[[str], str] = str) -> dict[str, Any]:
    """Return the section of a page on a folder of fits: measurement, typical budget, exclusions, figures, origin.

    `facts` are a folder of fits with the rows that are reported. `hide` takes paths out of texts. Parts for which
    curves would have to be fitted again, and cannot, have a note.
    """
    notes: list[str] = []
    section: dict[str, Any] = {"measured": {}, "budget": None}
    for key, make in (("measured", _measured), ("budget", _typical_budget)):
        try:
            section[key] = make(facts)
        except PalpateError as error:
            notes.append(hide(f"Not shown, since the fits cannot be made again here: {error}"))
    return {
        **section,
        "notes": list(dict.fromkeys(notes)),
        "exclusions": facts.exclusions,
        "conditions": facts.conditions,
        "used_count": len(facts.used),
        "figures": _figures(facts) if not notes else [],
        "origin": _origin(facts, hide),
    }


def _measured(facts: FolderFacts) -> Mapping[str, str]:
    """Return the facts of the measurement by name: instrument, tip, model, force, motion, estimator.

    Tip, model and force are those of each dialect (pipeline) of the folder, where they differ.
    """
    pipelines = facts.pipelines  # each with the number of its curves, that of most first
    facts_table = {"instrument": facts.instrument or 'not stated (rig.toml of the folder: instrument = "...")'}
    texts = facts_in_words(pipelines)
    for key, name in (("tip", "tip"), ("model", "model"), ("force", "force and position")):
        facts_table[name] = texts.get(key, "none")
    if motion := measured_text([row_motion(row.cells) for row in facts.used]):
        facts_table["motion"] = motion
    pipeline = pipelines[0][0]
    track = pipeline.tracks[0]
    facts_table["model by name"] = pipeline.registry.name_of(type(track.model))
    facts_table["source of the model"] = _EQUATION.sub("", sources_of(type(track.model))) or "none stated"
    facts_table["estimator"] = pipeline.registry.name_of(type(track.estimator))
    if facts.own_settings:
        facts_table["settings of single curves"] = f"of {curve_count(facts.own_settings)} (own.toml)"
    return facts_table


def _typical_budget(facts: FolderFacts) -> dict[str, Any] | None:
    """Return the budget of the row whose first value is the middle one, as its fit finds it again."""
    row = facts.typical(facts.values[0]) if facts.values else None
    if row is None or not facts.folder.file_of(row.curve):
        return None
    table = outcome_of(facts.folder, row.curve).result.tracks[row.track].table()
    rows = budget_rows(table)
    return {"curve": row.curve, "parameters": table["parameters"], "rows": rows} if rows else None


def _figures(facts: FolderFacts) -> list[dict[str, Any]]:
    """Return the best, the middle and the worst curve, and some that are not used.

    `facts` have the rows of a folder of fits; drawings are curves with measured and modelled force.
    """
    folder: FitFolder = facts.folder
    pictures = []
    ranked = ranked_rows(facts)
    if ranked:
        drawings = [drawing(folder, row, rank) for rank, row in ranked.items()]
        caption = f"Least, middle and largest residual of the curves used ({'; '.join(captions(ranked))})"
        pictures.append(_picture(used_curves_figure(drawings), caption))
    if excluded := excluded_rows(facts):
        drawings = [drawing(folder, row, str(number)) for number, row in enumerate(excluded, start=1)]
        reasons = "; ".join(f"{number}: {exclusion_of(row)}" for number, row in enumerate(excluded, start=1))
        caption = f"{len(excluded)} of {sum(facts.exclusions.values())} curves that are not used ({reasons})"
        pictures.append(_picture(excluded_curves_figure(drawings), caption))
    return pictures


def _picture(figure: Any, caption: str) -> dict[str, Any]:
    share = 100 * figure.get_figwidth() / (WIDTHS["double"] / _INCH)  # [%] of the width of the page
    return {"svg": svg_text(figure), "caption": caption, "share": share}


def _origin(facts: FolderFacts, hide: Callable[[str], str]) -> dict[str, str]:
    """Return the commands and the versions that made the rows of a folder of fits; `hide` takes paths out of them."""
    provenance = facts.provenance
    if not provenance:
        return {"made by": "not known: the rows were fitted by a palpate that did not note it"}
    rows = {
        f"command {number}" if len(provenance) > 1 else "command": hide(entry.command)
        for number, entry in enumerate(provenance, 1)
    }
    versions = {entry.versions.get("palpate", "?") for entry in provenance}
    rows["versions"] = ", ".join(f"{name} {version}" for name, version in libraries(provenance).items())
    if len(versions) > 1:
        rows["rows of several versions"] = ", ".join(sorted(versions))
    return rows
