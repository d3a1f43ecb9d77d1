"""What people see of a result."""

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

_MILLINEWTON = 1e-3  # [N]
_ALONG = "range and mean along the path of the tip; by place: palpate map {folder}"

if TYPE_CHECKING:
    from rich.console import RenderableType


def result_views(pipeline: Pipeline, result: Result, details: bool) -> Iterator[RenderableType]:
    """Yield the values of each track with their verdicts, sections, findings and open facts of a run; a view each.

    With `details` every column, section and flag.
    """
    from rich.text import Text

    table, names = result_table(result), list(_units(result))
    sections = pipeline.registry.report_sections
    shown = {name: section for name, section in sections.items() if details or not section.detail}
    if layout() == "table":
        yield Text(title_line(result.run["name"]))
        yield from map(Text, filled(run_subject(pipeline, result)))
    if details:
        yield _every_number(result)
    elif not result.tracks:
        yield _streams(result).view()
    elif len(table.rows) == 1 and layout() == "table":
        yield from value_lines(table.rows[0], result.truth, names)
    else:
        yield comparison_table(table).view()
        yield from map(Text, lines_below(table) if layout() == "table" else ())
    if any(map(_swept, result.tracks.values())):
        yield Text(_ALONG.format(folder=result.folder))
    yield from _more(result, shown)
    yield from _derived(result)
    yield from _flags(result) if details else map(coloured, _lines_below(table, command_again(pipeline, result)))


def _lines_below(table: ResultTable, command: str) -> Iterator[str]:
    """Yield findings, notes on the record and open facts; of several tracks how many have which word.

    `command` estimates again, with the facts that its options state.
    """
    yield from finding_lines(table, command)
    yield from fact_lines(table, command)
    if len(table.rows) > 1:
        yield from filled(table.partition(), "  ")


def _units(result: Result) -> dict[str, str]:
    """SI units of all parameters by name."""
    return {name: found.unit for track in result.tracks.values() for name, found in track.parameters.items()}


def _streams(result: Result) -> Cells:
    """What a run without tracks recorded."""
    rows = [
        [
            name,
            str(stream["samples"]),
            "" if stream.get("rate") is None else f"{stream['rate']:.1f}",
            str(stream["gaps"]),
        ]
        for name, stream in result.streams.items()
    ]
    return Cells.of(result.run["name"], ["stream", "readings", "rate\nHz", "gaps"], rows, ["stream"])


def _flags(result: Result) -> Iterator[RenderableType]:
    """Yield every open fact and every flag with its remedy."""
    from rich.text import Text

    facts = [f"{text}\n    -> {words}" for text, words in open_facts(result.tracks.values()).items()]
    assumed = ["not in the ±, since nobody stated it:\n  " + "\n  ".join(facts)] if facts else []
    lines = [Text(line, style="yellow") for line in (*assumed, *flag_lines(result.flags, result.tracks))]
    yield from [Text("flags" if lines else "no flags"), *lines]


def open_facts(tracks: Iterable[TrackResult]) -> dict[str, str]:
    """Return the words that state each open fact, by what is assumed and the effect of its alternative; each fact
    once."""
    said: dict[str, tuple[str, str]] = {}
    for track in tracks:
        values = {**track.parameters, **{value.name: value.found for value in track.derived}}
        for one in track.conditions:
            said.setdefault(one.fact, (one.sentence(values), one.remedy))
    return dict(said.values())


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
        table.add_row(label, *_cells(track, list(units)))
    if result.truth:
        known = [_scaled(result.truth.get(name, math.nan), unit) for name, unit in units.items()]
        surface = _scaled(result.truth.get("surface", math.nan), "m")
        table.add_row("truth", *(_plain(v) for v in known), "", _plain(surface), "", "", style="dim")
    return table


def _residual(force: float) -> str:
    """In mN, or with two digits where that shows nothing."""
    return f"{force:.3f}" if not 0 < force < _MILLINEWTON else f"{force:.2g}"


def _derived(result: Result) -> list[RenderableType]:
    """Elasticity and viscosity that follow from other parameters, with their conditions."""
    from rich.text import Text

    lines = [
        Text(f"  {label}: {value.name} {TableValue.of(value.name, value.found).text} ({value.caveat})")
        for label, track in result.tracks.items()
        for value in track.derived
        if math.isfinite(value.found.value)
    ]
    return [Text("derived"), *lines] if lines else []


def _more(result: Result, sections: Mapping[str, ReportSection]) -> Iterator[RenderableType]:
    """What plugins have to show of a result, in the order that they ask for."""
    from rich.text import Text

    for name, section in sorted(sections.items(), key=lambda item: (item[1].order, item[0])):
        try:
            parts = list(function_of(section)(result))
        except Exception as error:  # whatever a third-party function raises
            parts = [f"the section {name!r} could not be made: {type(error).__name__}: {error}"]
        for shown in parts:
            yield shown.view() if isinstance(shown, Cells) else Text(str(shown))


def flag_lines(of_record: Sequence[Flag], tracks: Mapping[str, TrackResult]) -> Iterator[str]:
    """Yield every flag of the record and of each track, the worst first; one that several tracks share is said once.

    Each is followed by what to do; notes are not.
    """
    yield from _lines({"every track": of_record})
    yield from _lines({label: track.flags for label, track in tracks.items()})


def _lines(flags: Mapping[str, Sequence[Flag]]) -> Iterator[str]:
    shared: dict[str, dict[str, Flag]] = {}
    for label, every in flags.items():
        for flag in every:
            shared.setdefault(flag.code, {})[label] = flag
    for concerned in shared.values():
        flag = next(iter(concerned.values()))
        of_first = f" ({next(iter(concerned))})" if len(set(concerned.values())) > 1 else ""
        yield f"  {', '.join(concerned)}: {flag}{of_first}"
        if flag.severity != "note" and flag.remedy:
            yield f"    -> {flag.remedy}"


def _swept(track: TrackResult) -> bool:
    return any(found.places for found in track.parameters.values())


def _scaled(value: float, unit: str) -> float:
    return value * display_unit(unit)[1]


def _plain(value: float) -> str:
    return round_number(value) if math.isfinite(value) else ""


def _shown(name: str, value: UncertainValue) -> str:
    shown = TableValue.of(name, value)
    return " ".join(filter(None, ("\n".join(shown.number_lines), shown.word)))


def _cells(track: TrackResult, names: list[str]) -> list[str]:
    if not track.usable:
        reason = next((flag.code for flag in track.flags if flag.severity == "invalid"), "invalid")
        return [*([reason.replace("-", " ")] * len(names)), "", "", "", ""]
    cells = [_shown(name, track.parameters[name]) if name in track.parameters else "" for name in names]
    if _swept(track):  # delay and surface are of one place
        return [*cells, "", "", _residual(track.force_rms), f"{track.nis:.2f}"]
    every = [*track.parameters.values(), *(value.found for value in track.derived)]
    delays = [found.per_shear for found in every if found.per_shear is not None]
    delay = f"{delays[0] * 1e3:.2f}" if delays else ""
    return [*cells, delay, _shown("surface", track.surface), _residual(track.force_rms), f"{track.nis:.2f}"]
