"""What people see of a result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import OutputError
from palpate.result import Found, TrackResult

if TYPE_CHECKING:
    from rich.console import RenderableType

    from palpate.pipeline import Result

# SI unit -> what people write, and how many of it one SI unit is.
_PEOPLE = {"Pa": ("kPa", 1e-3), "m": ("mm", 1e3), "Pa*s": ("Pa s", 1.0)}
_UNUSABLE = {"no-contact": "no contact", "not-identifiable": "not identifiable", "diverged": "diverged"}


def measured(value: float, std: float) -> str:
    """A value and its uncertainty, to two digits of the uncertainty.

    >>> measured(126.5312, 0.2134)
    '126.53 ± 0.21'
    """
    if not math.isfinite(value):
        return "-"
    if not (math.isfinite(std) and std > 0):
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


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
        table.add_column(f"{name}\n{_PEOPLE.get(unit, (unit, 1))[0]}", justify="right")
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
    return Group(table, *head, *flags, Text(f"written to {result.folder}"))


def _track_lines(result: Result) -> Iterator[str]:
    """Flags by track; what concerns all of them alike, an undeclared timing, is said once."""
    said = False
    for label, track in result.tracks.items():
        for text in track.flags:
            undeclared = text.startswith("timing-undeclared")
            if not (undeclared and said):
                yield f"  {label}: {text}"
            said = said or undeclared


def _scaled(value: float, unit: str) -> float:
    return value * _PEOPLE.get(unit, (unit, 1.0))[1]


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
    delays = [found.per_shear for found in track.parameters.values() if found.per_shear is not None]
    delay = f"{delays[0] * 1e3:.2f}" if delays else ""
    return [*cells, delay, _shown(track.surface), f"{track.force_rms:.3f}", f"{track.nis:.2f}"]
