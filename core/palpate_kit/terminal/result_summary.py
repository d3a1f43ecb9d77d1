"""What people see of a result."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate import Flag, ReportSection
from palpate_engine import Result, TrackResult, UncertainValue, display_unit, function_of, is_open, verdict_word

from palpate_kit.terminal.flag_summary import summary_lines
from palpate_kit.terminal.quantities import round_number, value_or_fixed
from palpate_kit.terminal.table import Table as Cells

_MILLINEWTON = 1e-3  # [N]
_MEANINGS = {  # of the words of a verdict; any other one needs a fact
    "good": "nothing counts against the values",
    "doubtful": "what was found can move a value beyond its ±",
    "not determined": "the value is within twice its ± of none",
    "invalid": "its numbers must not be used",
}
_ALONG = "ranges along the path of the tip; by place: palpate map {folder}"

if TYPE_CHECKING:
    from rich.console import RenderableType


def result_view(
    result: Result, sections: Mapping[str, ReportSection] | None = None, details: bool = False
) -> RenderableType:
    """The values of each track with their verdict, sections, and the worst doubts.

    With `details` every column, section and flag.
    """
    from rich.console import Group
    from rich.text import Text

    shown = {name: section for name, section in (sections or {}).items() if details or not section.detail}
    said = [Text(_ALONG.format(folder=result.folder))] if any(map(_swept, result.tracks.values())) else []
    said += [] if details else map(Text, _meanings(result.tracks.values()))
    parts = [*said, *_more(result, shown), *_derived(result), *_doubts(result, details)]
    table = _every_number(result) if details else _values(result).view() if result.tracks else _streams(result).view()
    return Group(table, *parts)


def _meanings(tracks: Iterable[TrackResult]) -> Iterator[str]:
    """What each word of a verdict in the table means, once; docs/verdict.md says it at length."""
    words = dict.fromkeys(verdict_word(track.verdict) for track in tracks)
    words |= dict.fromkeys(
        value.verdict for track in tracks for value in track.parameters.values()
        if track.usable and value.verdict is not None and is_open(value.verdict)
    )  # fmt: skip
    for word in words:
        yield f"{word} means: {_MEANINGS.get(word, 'it depends on that fact, which nobody has stated')}"


def _units(result: Result) -> dict[str, str]:
    """SI units of all parameters by name."""
    return {name: found.unit for track in result.tracks.values() for name, found in track.parameters.items()}


def _values(result: Result) -> Cells:
    """Every track with its parameters and its verdict, and the truth where it is known."""
    units = _units(result)
    heads = [f"{name}\n{display_unit(unit)[0]}" for name, unit in units.items()]
    rows = [
        [label, *_cells(track, list(units))[: len(units)], verdict_word(track.verdict)]
        for label, track in result.tracks.items()
    ]
    if result.truth:
        rows.append(["truth", *(_plain(_scaled(result.truth.get(name, math.nan), units[name])) for name in units), ""])
    return Cells.of(result.run["name"], ["track", *heads, "verdict"], rows, ["track", "verdict"])


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


def _doubts(result: Result, details: bool) -> list[RenderableType]:
    """The worst doubts, or every flag with its remedy."""
    from rich.text import Text

    if not details:
        return [Text(line, style="yellow") for line in lines_below(result)]
    facts = [f"{text}\n    -> {words}" for text, words in open_facts(result.tracks.values()).items()]
    holds = ["holds if:\n  " + "\n  ".join(facts)] if facts else []
    texts = (*holds, *flag_lines(result.flags, result.tracks))
    lines = [Text(line, style="yellow") for line in texts]
    return [Text("flags" if lines else "no flags"), *lines]


def lines_below(result: Result) -> Iterator[str]:
    """What the values of a run hold for, what was found, and what to type."""
    notes = [flag for flag in result.flags if flag.severity == "note"]
    doubts = [flag for flag in result.flags if flag.severity != "note"]
    flags = {label: [*doubts, *track.flags] for label, track in result.tracks.items()}
    return summary_lines(flags, open_facts(result.tracks.values()), notes)


def open_facts(tracks: Iterable[TrackResult]) -> dict[str, str]:
    """The words that state each open fact, by what is assumed and the effect of its alternative; each fact once."""
    said: dict[str, tuple[str, str]] = {}
    for track in tracks:
        values = {**track.parameters, **{value.name: value.found for value in track.derived}}
        for one in track.conditions:
            said.setdefault(one.fact, (one.sentence(values), one.remedy))
    return dict(said.values())


def _every_number(result: Result) -> RenderableType:
    """Every track with its parameters, surface, residual and NIS."""
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
        Text(f"  {label}: {value.name} {_shown(value.found)} {display_unit(value.found.unit)[0]} ({value.caveat})")
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
            yield shown.view() if isinstance(shown, Cells) else Text(shown)


def flag_lines(of_record: Sequence[Flag], tracks: Mapping[str, TrackResult]) -> Iterator[str]:
    """Every flag of the record and of each track, the worst first; one that several tracks share is said once.

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


def _range(track: TrackResult, name: str) -> str:
    """Where a parameter goes along the way of the tip."""
    if name not in track.parameters:
        return ""
    found = track.parameters[name]
    return " to ".join(f"{_scaled(found.places[end], found.unit):.4g}" for end in ("low", "high"))


def _swept(track: TrackResult) -> bool:
    return any(found.places for found in track.parameters.values())


def _scaled(value: float, unit: str) -> float:
    return value * display_unit(unit)[1]


def _plain(value: float) -> str:
    return round_number(value) if math.isfinite(value) else ""


def _shown(found: UncertainValue) -> str:
    if found.verdict == "invalid":
        return "none"
    number = value_or_fixed(_scaled(found.value, found.unit), _scaled(found.combined, found.unit))
    word = found.verdict or ""
    return f"{number} {word}" if is_open(word) else number


def _cells(track: TrackResult, names: list[str]) -> list[str]:
    if not track.usable:
        reason = next((flag.code for flag in track.flags if flag.severity == "invalid"), "invalid")
        return [*([reason.replace("-", " ")] * len(names)), "", "", "", ""]
    cells = [_shown(track.parameters[name]) if name in track.parameters else "" for name in names]
    if _swept(track):  # one value says nothing of all places
        cells = [_range(track, name) for name in names]
        return [*cells, "", "", _residual(track.force_rms), f"{track.nis:.2f}"]
    every = [*track.parameters.values(), *(value.found for value in track.derived)]
    delays = [found.per_shear for found in every if found.per_shear is not None]
    delay = f"{delays[0] * 1e3:.2f}" if delays else ""
    return [*cells, delay, _shown(track.surface), _residual(track.force_rms), f"{track.nis:.2f}"]
