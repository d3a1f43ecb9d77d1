"""What people see of a result."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate import Flag, ReportSection
from palpate.host import Result, TrackResult, UncertainValue, display_unit, function_of

from palpate_kit.terminal.quantities import round_number, value_with_uncertainty
from palpate_kit.terminal.table import Table as Cells

_MILLINEWTON = 1e-3  # [N]
_SHOWN = 3  # flags of a track; the rest is counted
_ALONG = "ranges along the path of the tip; by place: palpate map {folder}"

if TYPE_CHECKING:
    from rich.console import RenderableType


def result_view(result: Result, sections: Mapping[str, ReportSection] | None = None) -> RenderableType:
    """The table of tracks, the truth where it is known, sections, flags, and where the run folder is."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    units: dict[str, str] = {}
    for track in result.tracks.values():
        units |= {name: found.unit for name, found in track.parameters.items()}
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
    flags = [Text(line, style="yellow") for line in flag_lines(result.flags, result.tracks)]
    head = [Text("flags")] if flags else [Text("no flags")]
    said = [Text(_ALONG.format(folder=result.folder))] if any(map(_swept, result.tracks.values())) else []
    return Group(
        table,
        *said,
        *_more(result, sections or {}),
        *_derived(result),
        *head,
        *flags,
        Text(f"written to {result.folder}"),
    )


def _residual(force: float) -> str:
    """In mN, or with two digits where that is none."""
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
    """At most three flags of the record and of each track, the worst first; one that several tracks share is said once.

    Each is followed by what to do; notes are not.
    """
    yield from _lines({"every track": of_record})
    yield from _lines({label: track.flags for label, track in tracks.items()})


def _lines(flags: Mapping[str, Sequence[Flag]]) -> Iterator[str]:
    shared: dict[str, dict[str, Flag]] = {}
    for label, every in flags.items():
        for flag in every[:_SHOWN]:
            shared.setdefault(flag.code, {})[label] = flag
    for concerned in shared.values():
        flag = next(iter(concerned.values()))
        of_first = f" ({next(iter(concerned))})" if len(set(concerned.values())) > 1 else ""
        yield f"  {', '.join(concerned)}: {flag}{of_first}"
        if flag.severity != "note" and flag.remedy:
            yield f"    -> {flag.remedy}"
    more = {label: every[_SHOWN:] for label, every in flags.items() if every[_SHOWN:]}
    for label, rest in more.items():
        count = Counter("note" if flag.severity == "note" else "flag" for flag in rest)
        counted = " and ".join(f"{n} {word}{'s' if n > 1 else ''}" for word, n in sorted(count.items()))
        yield f"  {label}: and {counted}"


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
    return value_with_uncertainty(_scaled(found.value, found.unit), _scaled(found.combined, found.unit))


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
