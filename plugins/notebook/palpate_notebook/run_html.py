"""A run as text and as HTML: values with their combined uncertainty, and the flags in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape
from typing import Any

from palpate import printable
from palpate_engine import display_unit
from palpate_kit.terminal.quantities import round_number

from palpate_notebook.html_table import html_table
from palpate_notebook.quantity import UncertainQuantity

Document = Mapping[str, Any]


def _cells(document: Document) -> tuple[list[str], list[list[str]]]:
    """Headings and a row for each track, the truth last where it is known."""
    tracks, truth = document["tracks"], document["truth"]
    units = {name: found["unit"] for track in tracks.values() for name, found in _values(track).items()}
    headings = ["track", *(f"{name} [{display_unit(unit)[0]}]" for name, unit in units.items()), "NIS", "verdict"]
    rows = []
    for name, track in tracks.items():
        found = {} if track["verdict"] == "invalid" else _values(track)
        usable = {key for key, value in found.items() if value.get("verdict") != "invalid"}
        values = [UncertainQuantity.of(key, found[key]).number if key in usable else "" for key in units]
        nis = "" if track["nis"] is None else f"{track['nis']:.2f}"
        rows.append([name, *values, nis, track["verdict"]])
    if truth:
        known = [
            round_number(truth[name] * display_unit(unit)[1]) if name in truth else "" for name, unit in units.items()
        ]
        rows.append(["truth", *known, "", ""])
    return headings, rows


def _values(track: Document) -> dict[str, Any]:
    return {**track["parameters"], **track.get("derived", {}), "surface": track["surface"]}


def _flags(document: Document) -> Iterator[str]:
    """Each flag once, with the tracks that it concerns."""
    concerned: dict[tuple[str, str, str], list[str]] = {}
    for name, track in document["tracks"].items():
        for flag in track["flags"]:
            concerned.setdefault((flag["severity"], flag["code"], flag["message"]), []).append(name)
    for (severity, code, message), names in concerned.items():
        every = len(names) == len(document["tracks"]) > 1
        yield f"{'every track' if every else ', '.join(names)}: {severity}: {code}: {message}"


def run_text(document: Document) -> str:
    """The table of tracks and the flags, for a terminal."""
    headings, rows = _cells(document)
    widths = [max(len(row[i]) for row in [headings, *rows]) for i in range(len(headings))]
    lines = [printable(document["run"]["name"])]
    for row in [headings, *rows]:
        lines.append("  ".join(cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths))))
    listed = [f"  {printable(text)}" for text in _flags(document)]
    return "\n".join([*lines, "flags" if listed else "no flags", *listed])


def run_html(document: Document) -> str:
    """The table of tracks and the flags, for a notebook; every text is escaped."""
    headings, rows = _cells(document)
    listed = "".join(f"<li>{escape(printable(text))}</li>" for text in _flags(document))
    name = escape(printable(document["run"]["name"]))
    return f"<b>{name}</b>{html_table(headings, rows)}{f'<ul>{listed}</ul>' if listed else 'no flags'}"
