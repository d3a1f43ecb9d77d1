"""What people see of a result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.fit_tables import comparison, evidence
from palpate.cli.quantities import measured
from palpate.errors import OutputError
from palpate.result import Found, TrackResult
from palpate.units import people

if TYPE_CHECKING:
    from rich.console import RenderableType

    from palpate.pipeline import Result

_UNUSABLE = {
    "no-contact": "no contact",
    "not-fitted": "not fitted",
    "not-identifiable": "not identifiable",
    "diverged": "diverged",
}


@contextmanager
def drawing(path: Path) -> Iterator[None]:
    """Turns what can go wrong while a picture is drawn into an OutputError."""
    try:
        yield
    except ImportError as error:
        raise OutputError(f"{path}: drawing wants matplotlib: pip install matplotlib") from error
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot draw: {error}") from error


def result_view(result: Result) -> RenderableType:
    """The table of tracks, the truth where it is known, the flags, and where the run folder is."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    units: dict[str, str] = {}
    for track in result.tracks.values():
        units |= {name: found.unit for name, found in track.parameters.items()}
    table = Table(title=result.run["name"], title_justify="left")
    table.add_column("track")
    for name, unit in units.items():
        table.add_column(f"{name}\n{people(unit)[0]}", justify="right")
    for heading in ("eta/G\nms", "surface\nmm", "residual\nN", "NIS\n"):
        table.add_column(heading, justify="right")
    for label, track in result.tracks.items():
        table.add_row(label, *_cells(track, list(units)))
    if result.truth:
        known = [_scaled(result.truth.get(name, math.nan), unit) for name, unit in units.items()]
        surface = _scaled(result.truth.get("surface", math.nan), "m")
        table.add_row("truth", *(_plain(v) for v in known), "", _plain(surface), "", "", style="dim")
    lines = [f"  every track: {text}" for text in result.flags]
    lines += list(_track_lines(result))
    flags = [Text(line, style="yellow") for line in lines]
    head = [Text("flags")] if flags else [Text("no flags")]
    return Group(table, *_fits(result), *_derived(result), *head, *flags, Text(f"written to {result.folder}"))


def _derived(result: Result) -> list[RenderableType]:
    """Elasticity and viscosity that follow from other parameters, with what has to hold for them."""
    from rich.text import Text

    lines = [
        Text(f"  {label}: {value.name} {_shown(value.found)} {people(value.found.unit)[0]} ({value.caveat})")
        for label, track in result.tracks.items()
        for value in track.derived
        if math.isfinite(value.found.value)
    ]
    return [Text("derived"), *lines] if lines else []


def _fits(result: Result) -> list[RenderableType]:
    """Comparison of the offline fits among the tracks, where there are several."""
    from rich.text import Text

    fits = {name: track for name, track in result.tracks.items() if track.details.get("fit")}
    return [comparison({result.run["name"]: fits}), Text(evidence(fits))] if len(fits) > 1 else []


def _track_lines(result: Result) -> Iterator[str]:
    """Flags by track; an undeclared timing, which concerns most of them, is said once, with their names."""
    undeclared = {label: text for label, track in result.tracks.items() for text in track.flags if _undeclared(text)}
    for text in list(undeclared.values())[:1]:
        yield f"  {', '.join(undeclared)}: {text}"
    for label, track in result.tracks.items():
        yield from (f"  {label}: {text}" for text in track.flags if not _undeclared(text))


def _undeclared(text: str) -> bool:
    return text.startswith("timing-undeclared")


def _scaled(value: float, unit: str) -> float:
    return value * people(unit)[1]


def _plain(value: float) -> str:
    return f"{value:.5g}" if math.isfinite(value) else ""


def _shown(found: Found) -> str:
    return measured(_scaled(found.value, found.unit), _scaled(found.combined, found.unit))


def _cells(track: TrackResult, names: list[str]) -> list[str]:
    codes = {text.partition(":")[0] for text in track.flags}
    spoiled = next((words for code, words in _UNUSABLE.items() if code in codes), None)
    if spoiled:
        return [*([spoiled] * len(names)), "", "", "", ""]
    cells = [_shown(track.parameters[name]) if name in track.parameters else "" for name in names]
    every = [*track.parameters.values(), *(value.found for value in track.derived)]
    delays = [found.per_shear for found in every if found.per_shear is not None]
    delay = f"{delays[0] * 1e3:.2f}" if delays else ""
    return [*cells, delay, _shown(track.surface), f"{track.force_rms:.3f}", f"{track.nis:.2f}"]
