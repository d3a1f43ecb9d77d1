"""The views of a result for a terminal: values, sections of plugins, findings, open facts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate import Flag, ReportSection
from palpate_engine import Pipeline, Result, TrackResult, UncertainValue, display_unit, function_of

from palpate_kit.terminal.comparison_table import comparison_table, lines_below
from palpate_kit.terminal.fact_line import command_again, run_subject
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.quantities import round_number
from palpate_kit.terminal.result_screen import (
    coloured,
    fact_lines,
    filled,
    finding_lines,
    title_line,
    value_lines,
)
from palpate_kit.terminal.result_table import ResultTable, TableValue, result_table
from palpate_kit.terminal.table import Table as Cells

_MIN_DECIMAL_FORCE = 1e-3  # [N], from which on three decimals show a residual
_PATH_LEGEND = "range and mean along the path of the tip; by place: palpate map {folder}"

if TYPE_CHECKING:
    from rich.console import RenderableType


def result_views(pipeline: Pipeline, result: Result, details: bool) -> Iterator[RenderableType]:
    """Yield views of a run: the values of each track with their verdicts, then sections, findings and open facts.

    With `details` every column, section and flag. On a screen there is a title, and a single track has a line for each
    value; in a file everything is a table.
    """
    from rich.text import Text

    table = result_table(result)
    names = list(_units(result))
    is_screen = layout() == "table"
    sections = pipeline.registry.report_sections
    if not details:
        sections = {name: section for name, section in sections.items() if not section.detail}
    # The head, the values, the sections of plugins, and what is to be known of the values.
    if is_screen:
        yield Text(title_line(result.run["name"]))
        yield from map(Text, filled(run_subject(pipeline, result)))
    if details:
        yield _every_number(result)
    elif not result.tracks:
        yield _stream_table(result).view()
    elif len(table.rows) == 1 and is_screen:
        yield from value_lines(table.rows[0], result.truth, names)
    else:
        yield comparison_table(table).view()
        yield from map(Text, lines_below(table) if is_screen else ())
    if any(map(_has_places, result.tracks.values())):
        yield Text(_PATH_LEGEND.format(folder=result.folder))
    yield from _section_views(result, sections)
    yield from _derived_views(result)
    if details:
        yield from _flag_views(result)
    else:
        yield from map(coloured, _lines_below(table, command_again(pipeline, result)))


def _lines_below(table: ResultTable, command: str) -> Iterator[str]:
    """Yield findings, notes on the record and open facts; of several tracks also the counts of their verdicts.

    `command` repeats the estimates, and takes options that state facts.
    """
    yield from finding_lines(table, command)
    yield from fact_lines(table, command)
    if len(table.rows) > 1:
        yield from filled(table.partition(), "  ")


def _units(result: Result) -> dict[str, str]:
    """Return the SI units of all parameters by name."""
    return {name: value.unit for track in result.tracks.values() for name, value in track.parameters.items()}


def _stream_table(result: Result) -> Cells:
    """Return the streams of a run without tracks: readings, rate and gaps."""
    rows = []
    for name, stream in result.streams.items():
        rate = "" if stream.get("rate") is None else f"{stream['rate']:.1f}"
        rows.append([name, str(stream["samples"]), rate, str(stream["gaps"])])
    return Cells.of(result.run["name"], ["stream", "readings", "rate\nHz", "gaps"], rows, ["stream"])


def _flag_views(result: Result) -> Iterator[RenderableType]:
    """Yield every open fact and every flag with its remedy."""
    from rich.text import Text

    facts = [f"{text}\n    -> {remedy}" for text, remedy in open_facts(result.tracks.values()).items()]
    assumed = ["not in the ±, since nobody stated it:\n  " + "\n  ".join(facts)] if facts else []
    lines = [Text(line, style="yellow") for line in (*assumed, *flag_lines(result.flags, result.tracks))]
    yield from [Text("flags" if lines else "no flags"), *lines]


def open_facts(tracks: Iterable[TrackResult]) -> dict[str, str]:
    """Return the remedy of each open fact, by the sentence on its assumption and its effect; each fact once."""
    sentences_and_remedies: dict[str, tuple[str, str]] = {}  # by fact
    for track in tracks:
        values = {**track.parameters, **{value.name: value.found for value in track.derived}}
        for condition in track.conditions:
            sentence = condition.sentence(values)
            sentences_and_remedies.setdefault(condition.fact, (sentence, condition.remedy))
    return dict(sentences_and_remedies.values())


def _every_number(result: Result) -> RenderableType:
    """Return every track with its parameters, surface, residual and NIS."""
    from rich.table import Table

    units = _units(result)
    table = Table(title=result.run["name"], title_justify="left")
    table.add_column("track")
    for name, unit in units.items():
        table.add_column(f"{name}\n{display_unit(unit)[0]}", justify="right")
    for heading in ("eta/G\nms", "surface\nmm", "residual\nN", "NIS\n"):
        table.add_column(heading, justify="right")
    for label, track in result.tracks.items():
        table.add_row(label, *_track_cells(track, list(units)))
    if result.truth:
        true_values = [_true_number(result.truth, name, unit) for name, unit in units.items()]
        table.add_row("truth", *true_values, "", _true_number(result.truth, "surface", "m"), "", "", style="dim")
    return table


def _residual(force: float) -> str:
    """Return a force [N] with three decimals, or with two digits where three decimals would show zero."""
    return f"{force:.3f}" if not 0 < force < _MIN_DECIMAL_FORCE else f"{force:.2g}"


def _derived_views(result: Result) -> list[RenderableType]:
    """Return the elasticity and viscosity that follow from other parameters, with their conditions."""
    from rich.text import Text

    lines = [
        Text(f"  {label}: {value.name} {TableValue.of(value.name, value.found).text} ({value.caveat})")
        for label, track in result.tracks.items()
        for value in track.derived
        if math.isfinite(value.found.value)
    ]
    return [Text("derived"), *lines] if lines else []


def _section_views(result: Result, sections: Mapping[str, ReportSection]) -> Iterator[RenderableType]:
    """Yield the sections of plugins in their order; one that fails is replaced by its error."""
    from rich.text import Text

    for name, section in sorted(sections.items(), key=lambda item: (item[1].order, item[0])):
        try:
            parts = list(function_of(section)(result))
        except Exception as error:  # a third-party function may raise anything
            parts = [f"the section {name!r} could not be made: {type(error).__name__}: {error}"]
        for part in parts:
            yield part.view() if isinstance(part, Cells) else Text(str(part))


def flag_lines(of_record: Sequence[Flag], tracks: Mapping[str, TrackResult]) -> Iterator[str]:
    """Yield every flag of the record, then every flag of the tracks; one that several tracks share once.

    Each is followed by its remedy, unless it is a note.
    """
    yield from _shared_flag_lines({"every track": of_record})
    yield from _shared_flag_lines({label: track.flags for label, track in tracks.items()})


def _shared_flag_lines(flags: Mapping[str, Sequence[Flag]]) -> Iterator[str]:
    """Yield each code of a flag with the labels that have it, and the message of the first of them."""
    labels_by_code: dict[str, dict[str, Flag]] = {}
    for label, flags_of_label in flags.items():
        for flag in flags_of_label:
            labels_by_code.setdefault(flag.code, {})[label] = flag
    for flag_by_label in labels_by_code.values():
        first_label, flag = next(iter(flag_by_label.items()))
        differs = len(set(flag_by_label.values())) > 1
        yield f"  {', '.join(flag_by_label)}: {flag}{f' ({first_label})' if differs else ''}"
        if flag.severity != "note" and flag.remedy:
            yield f"    -> {flag.remedy}"


def _has_places(track: TrackResult) -> bool:
    """Return True for a track along a path, whose values differ from place to place."""
    return any(value.places for value in track.parameters.values())


def _true_number(truth: Mapping[str, float], name: str, unit: str) -> str:
    """Return the true value of a simulated rig in the unit that is shown; empty without one."""
    number = truth.get(name, math.nan) * display_unit(unit)[1]
    return round_number(number) if math.isfinite(number) else ""


def _value_cell(name: str, value: UncertainValue) -> str:
    """Return the number of a value with its verdict."""
    table_value = TableValue.of(name, value)
    return " ".join(filter(None, ("\n".join(table_value.number_lines), table_value.word)))


def _track_cells(track: TrackResult, names: list[str]) -> list[str]:
    """Return the cells of the named values, eta/G [ms], surface [mm], residual [N] and NIS of a track."""
    if not track.usable:
        reason = next((flag.code for flag in track.flags if flag.severity == "invalid"), "invalid")
        return [*([reason.replace("-", " ")] * len(names)), "", "", "", ""]
    cells = [_value_cell(name, track.parameters[name]) if name in track.parameters else "" for name in names]
    residual, nis = _residual(track.force_rms), f"{track.nis:.2f}"
    if _has_places(track):  # along a path, delay and surface would be those of a single place
        return [*cells, "", "", residual, nis]
    values = [*track.parameters.values(), *(value.found for value in track.derived)]
    delays = [value.per_shear for value in values if value.per_shear is not None]  # [s]
    delay = f"{delays[0] * 1e3:.2f}" if delays else ""
    return [*cells, delay, _value_cell("surface", track.surface), residual, nis]
