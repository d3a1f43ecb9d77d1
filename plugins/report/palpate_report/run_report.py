"""The report of one run: everything that stands on the page, then the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from typing import Any

from palpate import FlagMeaning, ReportSection
from palpate_engine import SEVERITIES, function_of, registry
from palpate_kit.figures import WIDTHS
from palpate_kit.runs.document_table import document_table
from palpate_kit.runs.lump_table import LUMP_NOTE, chance, lump_table
from palpate_kit.runs.skin_grid import read_lump_findings, read_lumps
from palpate_kit.terminal.comparison_table import comparison_table
from palpate_kit.terminal.result_screen import LEGEND
from palpate_kit.terminal.table import Table

from palpate_report import number_texts
from palpate_report.anonymous import Anonymous, Unchanged
from palpate_report.budget_rows import budget_rows
from palpate_report.figure_subject import Subject
from palpate_report.result_box import REFUSED, SIMULATED, ResultBox, result_box
from palpate_report.run_contents import RunContents
from palpate_report.run_facts import calibration_facts, origin_facts, true_values
from palpate_report.run_figures import PICTURES, draw
from palpate_report.run_verdict import LEVELS, RunVerdict, judge
from palpate_report.skin_view import skin_view
from palpate_report.svg import svg_text

_INCH = 25.4  # [mm]
_MAX_CHARACTERS = 300_000  # of a pipeline on the page: a choice


def subject_of(record: RunContents, verdict: RunVerdict, track: str | None = None) -> Subject:
    """Return the subject of a run's pictures: the track chosen, or the best one, then the others by their level.

    `verdict` has the levels good, doubtful and invalid of the tracks. Tracks that must not be used are drawn only if no
    others exist.
    """
    ranked = [track_verdict.track for level in verdict.levels for track_verdict in verdict.of(level)]
    names = [name for name in ranked if name in record.tracks] or list(record.tracks)
    invalid = {track_verdict.track for track_verdict in verdict.of(LEVELS[2])}
    usable = [name for name in names if name not in invalid] or names
    best = verdict.main if verdict.main in usable else next(iter(usable), None)
    main = track or best
    if main not in record.tracks:
        main = next(iter(usable), None)
    others = [name for name in usable if name != main]
    return Subject(record, main, others if main is None else [main, *others])


def page_of(record: RunContents, track: str | None = None, anonymous: bool = False) -> str:
    """Return the whole page (HTML) of one run; an `anonymous` one is without host and paths.

    `record` is a run folder as far as it can be read. `track` is shown first, by default the best.
    """
    subject = subject_of(record, judge(record), track)
    # A veil takes host and paths out of texts and documents.
    veil = Anonymous(record.document, record.resolved, record.path) if anonymous else Unchanged()
    document = veil.tree(record.document)
    tables = document.get("tracks", {})
    pictures = _pictures(subject)
    # A run without a result shows its last estimates in place of the sections of other plugins.
    has_result = record.why_not is None
    return render(
        "report.html",
        title=veil.text(record.name),
        box=_box(record, document),
        legend=LEGEND,
        document=document,
        tracks=tables,
        record_flags=_record_flags(document),
        meanings=registry.offers("palpate_flags", FlagMeaning),
        pictures=pictures,
        main=subject.main,
        comparison=_comparison(document),
        numbers=_numbers(document, subject) if len(tables) == 1 else [],
        budgets={name: budget_rows(table) for name, table in tables.items()},
        sections=list(_sections(record, veil.text)) if has_result else [],
        last=[] if has_result else _last_rows(record),
        lumps=lump_table(read_lumps(record.folder.maps)),
        lump_note=LUMP_NOTE,
        exam=read_lump_findings(record.folder.maps),
        skin=skin_view(subject) if "map" in pictures else None,
        calibration=veil.tree(calibration_facts(document, record)),
        facts=origin_facts(document.get("run", {})),
        truth=true_values(document),
        given=_shown(record.given_text, veil),
        resolved=_shown(record.resolved_text, veil),
        why_not=record.why_not,
        unreadable=record.unreadable and veil.text(record.unreadable),
        logs=record.logs,
        folder=record.path.name if anonymous else str(record.path),
        parts_of_run=[(part.path.name, _partition(RunContents(part))) for part in record.folder.parts[1:]],
        embedded=number_texts.embed_json(document) if document else None,
    )


def _pictures(subject: Subject) -> dict[str, dict[str, Any]]:
    """Return drawing, caption and width [% of the page] of each picture for which the run has something to show."""
    pictures = {}
    for name in PICTURES:
        picture = draw(name, subject)
        if picture is not None:
            share = 100 * picture.figure.get_figwidth() / (WIDTHS["double"] / _INCH)
            pictures[name] = {"svg": svg_text(picture.figure), "caption": picture.caption, "share": share}
    return pictures


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


def _numbers(document: Mapping[str, Any], subject: Subject) -> list[tuple[str, str, str]]:
    """Return name, value and notes of all values of the main track; along a path the range."""
    table = document.get("tracks", {}).get(subject.main)
    if table is None or subject.main is None or table["verdict"] == "invalid":
        return []
    if any("places" in value for value in table["parameters"].values()):
        return list(_along_the_way(table))
    rows = [(name, value, number_texts.parts_of(value)) for name, value in table["parameters"].items()]
    for name, value in table.get("derived", {}).items():
        if value["value"] is not None:
            rows.append((name, value, value["caveat"]))
    rows.append(("surface", table["surface"], number_texts.parts_of(table["surface"])))
    return [(number_texts.readable(name), number_texts.value_of(value), note) for name, value, note in rows]


def _along_the_way(table: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield name, range and notes of each parameter of a track along a path."""
    for name, value in table["parameters"].items():
        note = f"along the path, {value['places']['places']} places; ± is that of one place"
        yield number_texts.readable(name), number_texts.range_of(value), note


def _record_flags(document: Mapping[str, Any]) -> list[Any]:
    """Return the flags that every track has, which are those of the record; none of a run with one track."""
    flag_lists = [track["flags"] for track in document.get("tracks", {}).values()]
    if len(flag_lists) < 2:
        return []
    first, *others = flag_lists
    return [flag for flag in first if all(flag in flags for flags in others)]


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


def _last_rows(record: RunContents) -> list[dict[str, Any]]:
    """Return the last usable estimate of each track of a run without a result; time None where it has none."""
    estimates = []
    for name, (_, track) in record.tracks.items():
        time, values = None, {}
        rows = track.usable.nonzero()[0]
        if len(rows):
            last = rows[-1]
            time = float(track.time[last])
            for key, column in track.values.items():
                estimate = {"value": column[last], "combined": track.std[key][last], "unit": record.unit(name, key)}
                values[key] = number_texts.value_of(estimate)
        estimates.append({"track": name, "time": time, "values": values})
    return estimates


def _shown(text: str | None, veil: Anonymous | Unchanged) -> str | None:
    """Return the text of a pipeline as it stands on the page, its begin where it is too long for one."""
    if text is None:
        return None
    if len(text) > _MAX_CHARACTERS:
        text = f"{text[:_MAX_CHARACTERS]}\n... cut: {len(text)} characters"
    return veil.text(text)
