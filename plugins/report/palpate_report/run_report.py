"""The report of one run: everything that stands on the page, then the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from typing import Any

from palpate import FlagMeaning, ReportSection
from palpate_engine import SEVERITIES, display_unit, function_of, registry
from palpate_kit.figures import WIDTHS
from palpate_kit.runs.document_table import document_table
from palpate_kit.runs.lump_table import LUMP_NOTE, chance, lump_table
from palpate_kit.runs.result_file import estimate_of
from palpate_kit.runs.skin_grid import read_lump_findings, read_lumps
from palpate_kit.terminal.comparison_table import comparison_table
from palpate_kit.terminal.quantities import number_with_unit
from palpate_kit.terminal.result_screen import LEGEND
from palpate_kit.terminal.table import Table

from palpate_report import number_texts
from palpate_report.anonymous import Anonymous
from palpate_report.figure_subject import Subject
from palpate_report.result_box import REFUSED, SIMULATED, ResultBox, result_box
from palpate_report.run_contents import RunContents
from palpate_report.run_figures import PICTURES, draw
from palpate_report.run_verdict import LEVELS, RunVerdict, judge
from palpate_report.skin_view import skin_view
from palpate_report.svg import svg_text

_FACTS = {  # of `run` in the result: what they are called, and their unit
    "started": ("started", ""),
    "log_duration": ("length of the record", "s"),
    "samples": ("samples", ""),
    "duration": ("computing time", "s"),
    "seed": ("seed", ""),
    "pipeline": ("pipeline", ""),
    "command": ("command", ""),
    "host": ("host", ""),
}
_MAX_CHARACTERS = 300_000  # of a pipeline on the page: a choice


def subject_of(record: RunContents, verdict: RunVerdict, track: str | None = None) -> Subject:
    """Return the subject of a run's pictures: the track chosen, or the best one, then the others by their level.

    Tracks that must not be used are drawn only if no others exist.
    """
    ranked = [track_verdict.track for level in verdict.levels for track_verdict in verdict.of(level)]
    names = [name for name in ranked if name in record.tracks] or list(record.tracks)
    invalid = {track_verdict.track for track_verdict in verdict.of(LEVELS[2])}
    usable = [name for name in names if name not in invalid] or names
    main = track or (verdict.main if verdict.main in usable else next(iter(usable), None))
    if main not in record.tracks:
        main = next(iter(usable), None)
    return Subject(record, main, [name for name in (main,) if name is not None] + [n for n in usable if n != main])


def page_of(record: RunContents, track: str | None = None, anonymous: bool = False) -> str:
    """Return the whole page of one run."""
    verdict = judge(record)
    subject = subject_of(record, verdict, track)
    veil = Anonymous(record.document, record.resolved, record.path) if anonymous else None
    document = veil.tree(record.document) if veil else record.document
    pictures = {}
    for name in PICTURES:
        picture = draw(name, subject)
        if picture is not None:
            share = 100 * picture.figure.get_figwidth() / (WIDTHS["double"] / 25.4)
            pictures[name] = {"svg": svg_text(picture.figure), "caption": picture.caption, "share": share}
    stated, resolved = record.given_text, record.resolved_text
    sections = list(_sections(record, veil.text if veil else str)) if record.why_not is None else []
    calibration = _calibration(document, record)
    return render(
        "report.html",
        title=veil.text(record.name) if veil else record.name,
        box=_box(record, document),
        legend=LEGEND,
        document=document,
        tracks=document.get("tracks", {}),
        record_flags=_record_flags(document),
        meanings=registry.offers("palpate_flags", FlagMeaning),
        pictures=pictures,
        main=subject.main,
        comparison=_comparison(document),
        numbers=_numbers(document, subject) if len(document.get("tracks", {})) == 1 else [],
        budgets={name: budget_rows(table) for name, table in document.get("tracks", {}).items()},
        sections=sections,
        last=_last_rows(record) if record.why_not is not None else [],
        lumps=lump_table(read_lumps(record.folder.maps)),
        lump_note=LUMP_NOTE,
        exam=read_lump_findings(record.folder.maps),
        skin=skin_view(subject) if "map" in pictures else None,
        calibration=veil.tree(calibration) if veil else calibration,
        facts=_facts(document.get("run", {})),
        truth=_truth(document),
        given=_shown(stated, veil),
        resolved=_shown(resolved, veil),
        why_not=record.why_not,
        unreadable=veil.text(record.unreadable) if veil and record.unreadable else record.unreadable,
        logs=record.logs,
        folder=record.path.name if anonymous else str(record.path),
        parts_of_run=[(part.path.name, _partition(RunContents(part))) for part in record.folder.parts[1:]],
        embedded=number_texts.embed_json(document) if document else None,
    )


def _box(record: RunContents, document: Mapping[str, Any]) -> ResultBox:
    """Return the values of a run with their verdicts, or why it has no result."""
    if record.why_not is not None:
        return ResultBox(REFUSED, ("no result",), ((record.why_not, ""),))
    table = document_table(document)
    if not table.rows:
        return ResultBox(REFUSED, ("no result",), (("The run has no track.", ""),))
    codes = {flag["code"] for track in document["tracks"].values() for flag in track["flags"]}
    return result_box(table, [SIMULATED] if "rehearsal" in codes else [])


def _comparison(document: Mapping[str, Any]) -> Table | None:
    """Return the table that compares the tracks of a run; None of a run with one, or of one before they were
    compared."""
    table = document_table(document)
    is_compared = any(row.measures is not None for row in table.rows)
    return comparison_table(table, is_whole=True) if is_compared else None


def _partition(record: RunContents) -> str:
    """Return how many tracks have which word for each value."""
    return record.why_not or document_table(record.document).partition()


def render(template: str, **content: Any) -> str:
    """Return a page from a template; every text is escaped unless it is an SVG that was drawn here."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("palpate_report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    names = ("number_text", "value_of", "range_of", "parts_of", "readable", "plain")
    helpers = {"chance": chance, **{name: getattr(number_texts, name) for name in names}}
    environment.globals.update(helpers, severities=SEVERITIES, version=version("palpate"))
    return environment.get_template(template).render(**content)


def budget_rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the sources of a track's uncertainty, with contribution and share of the combined variance [%]."""
    rows = []
    extra: dict[str, dict[str, Any]] = {}
    for name, value in table["parameters"].items():
        if estimate_of(value) is None:
            return []
        listed = {row["source"].partition(" ")[0].replace("-", "_") for row in table.get("budget", ())}
        for key, share in value.items():
            cause = key.removeprefix("systematic_")
            if key.startswith("systematic_") and share is not None and cause not in listed:
                extra.setdefault(cause, {})[name] = {"contribution": share}
    causes = [(row["source"], row["std"], row["unit"], row["effects"]) for row in table.get("budget", ())]
    causes += [(cause.replace("_", "-"), None, "", effects) for cause, effects in extra.items()]
    for source, std, unit, effects in causes:
        cells = {}
        for name, value in table["parameters"].items():
            contribution = effects.get(name, {}).get("contribution")
            if contribution is None:
                continue
            combined = value.get("combined")
            share = 100 * (contribution / combined) ** 2 if combined else None
            cells[name] = {"shown": number_texts.number_text(contribution, value["unit"]), "share": share}
        rows.append(
            {"source": source, "std": "" if std is None else number_texts.number_text(std, unit), "cells": cells}
        )
    return rows


def _numbers(document: Mapping[str, Any], subject: Subject) -> list[tuple[str, str, str]]:
    """Return name, value and notes of all values of the main track; along a path the range."""
    table = document.get("tracks", {}).get(subject.main)
    if table is None or subject.main is None or table["verdict"] == "invalid":
        return []
    if any("places" in value for value in table["parameters"].values()):
        return list(_along_the_way(table))
    rows = [(name, value, number_texts.parts_of(value)) for name, value in table["parameters"].items()]
    rows += [
        (name, value, value["caveat"]) for name, value in table.get("derived", {}).items() if value["value"] is not None
    ]
    rows.append(("surface", table["surface"], number_texts.parts_of(table["surface"])))
    return [(number_texts.readable(name), number_texts.value_of(value), small) for name, value, small in rows]


def _along_the_way(table: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    for name, value in table["parameters"].items():
        note = f"along the path, {value['places']['places']} places; ± is that of one place"
        yield number_texts.readable(name), number_texts.range_of(value), note


def _record_flags(document: Mapping[str, Any]) -> list[Any]:
    """Return the flags that every track has, which are those of the record."""
    flag_lists = [track["flags"] for track in document.get("tracks", {}).values()]
    return (
        [flag for flag in flag_lists[0] if all(flag in flags for flags in flag_lists[1:])]
        if len(flag_lists) > 1
        else []
    )


def _sections(record: RunContents, hide: Callable[[str], str]) -> Iterator[dict[str, Any]]:
    """Yield the sections of other plugins on the run; one that fails is reported in its place."""
    sections = registry.offers("palpate_report_sections", ReportSection)
    for name, section in sorted(sections.items(), key=lambda item: (item[1].order, item[0])):
        try:
            shown = list(function_of(section)(record.result()))
        except Exception as error:  # whatever a third-party function raises
            shown = [f"This section could not be made: {type(error).__name__}: {error}"]
        if shown:
            yield {"name": name, "parts": [part if isinstance(part, Table) else hide(str(part)) for part in shown]}


def _facts(run: Mapping[str, Any]) -> dict[str, str]:
    facts = {word: (run[key], unit) for key, (word, unit) in _FACTS.items() if run.get(key) is not None}
    return {word: f"{value:.4g} {unit}" if unit else number_texts.plain(value) for word, (value, unit) in facts.items()}


def _truth(document: Mapping[str, Any]) -> list[str]:
    """Return the true values of a simulated rig, in the units of the tracks."""
    tables = document.get("tracks", {}).values()
    units = {name: found["unit"] for table in tables for name, found in table["parameters"].items()} | {"surface": "m"}
    return [
        f"{number_texts.readable(name)} {number_with_unit(value, units[name], 5)}"
        for name, value in document.get("truth", {}).items()
        if name in units
    ]


def _last_rows(record: RunContents) -> list[dict[str, Any]]:
    """Return the last usable estimate of each track of a run without a result."""
    estimates = []
    for name, (_, track) in record.tracks.items():
        rows = track.usable.nonzero()[0]
        if len(rows):
            last = rows[-1]
            values = {
                key: number_texts.value_of(
                    {"value": column[last], "combined": track.std[key][last], "unit": record.unit(name, key)}
                )
                for key, column in track.values.items()
            }
            estimates.append({"track": name, "time": float(track.time[last]), "values": values})
        else:
            estimates.append({"track": name, "time": None, "values": {}})
    return estimates


def _calibration(document: Mapping[str, Any], record: RunContents) -> dict[str, Any]:
    """Return the facts of the alignment: sources and delays of force and motion, mass, tare, first touch."""
    alignment = record.resolved.get("alignment", {})
    rows: dict[str, Any] = {}
    for name in ("force", "position", "velocity"):
        signal = alignment.get(name)
        if isinstance(signal, dict):
            delay, doubt = signal.get("delay", 0.0), signal.get("uncertainty")
            uncertainty = "not declared" if doubt is None else f"± {number_texts.number_text(doubt, 's')}"
            rows[f"{name} from"] = (
                f"{signal.get('channel')}, delay {number_texts.number_text(delay, 's')} ({uncertainty})"
            )
    for key, unit in (
        ("tip_mass", "kg"),
        ("tip_mass_uncertainty", "kg"),
        ("tare_uncertainty", "N"),
        ("series_stiffness", "N/m"),
    ):
        if isinstance(alignment.get(key), int | float):
            rows[number_texts.readable(key)] = number_texts.number_text(alignment[key], unit)
    run = document.get("run", {})
    if tare := run.get("tare"):
        offset, std = tare.get("offset"), tare.get("std")
        symbol, factor = display_unit("N")
        if offset is not None:
            rows["tare"] = f"{offset * factor:.4g} {symbol}" + (
                f" ± {number_texts.number_text(std, 'N')}" if std else ""
            )
        if tare.get("noise") is not None:
            rows["noise of one force sample"] = number_texts.number_text(tare["noise"], "N")
    if touch := run.get("first_touch"):
        height, method = number_texts.number_text(touch["position"], "m"), number_texts.plain(touch.get("by"))
        rows["first touch"] = f"{touch['time']:.3f} s, at {height} ({method})"
    calibration = record.resolved.get("run", {}).get("calibration")
    rows["calibration file"] = number_texts.plain(calibration) if calibration else "none"
    if uncertainties := record.resolved.get("run", {}).get("uncertainties"):
        rows["declared uncertainties"] = number_texts.plain(uncertainties)
    return rows


def _shown(text: str | None, veil: Anonymous | None) -> str | None:
    if text is None:
        return None
    text = text if len(text) <= _MAX_CHARACTERS else f"{text[:_MAX_CHARACTERS]}\n... cut: {len(text)} characters"
    return veil.text(text) if veil else text
