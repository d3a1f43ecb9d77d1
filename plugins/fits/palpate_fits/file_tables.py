"""What people see of fits of many files: a row for each with its verdict, and what stands behind the doubts."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import typer
from palpate_engine import (
    Pipeline,
    Registry,
    Track,
    display_unit,
    facts_stated,
    is_open,
    verdict_word,
    words_that_state,
)
from palpate_kit.curves.curve_fits import Row, row_conditions, value_units
from palpate_kit.curves.curve_table import summary_of
from palpate_kit.terminal.motion_text import motion_text, row_motion
from palpate_kit.terminal.quantities import value_or_fixed
from palpate_kit.terminal.table import Table, console

from palpate_fits.fit_tables import each_table

_MEASURED = "measured"
MOST = 40  # rows of a table on the terminal
_NAME = 28  # characters of a file's name
_SHOWN = ("elasticity", "viscosity")
_DETAILS = {"rms": ("RMS\nN", ".3g"), "prediction": ("predicted\nwithin", ".1%"), "samples": ("samples", ".0f")}


def is_usable(row: Row) -> bool:
    """Whether a row has values that are not refused, the first that is shown of them among these."""
    named = [key for key in row if key.endswith("_verdict")]
    first = next((key for name in _SHOWN if (key := f"{name}_verdict") in named), next(iter(named), "verdict"))
    return not row.get("error") and "invalid" not in (row.get("verdict"), row.get(first))


def show_rows(rows: Sequence[Row], pipeline: Pipeline, known: Registry, command: str, details: bool = False) -> None:
    """Print a row for each file, why files were not read, which flags make values doubtful, and what to type."""
    shown = rows if details else rows[:MOST]
    (console(160) if details else console()).print(file_table(shown, pipeline, details).view())
    if len(shown) < len(rows):
        typer.echo(f"and {len(rows) - len(shown)} more: --details shows all")
        names = list(value_units(pipeline.tracks[0].model))
        console().print(each_table(summary_of([row for row in rows if row.get("track")], names), pipeline).view())
    alike: dict[str, list[str]] = {}
    for row in rows:
        if row.get("error"):
            alike.setdefault(row["error"], []).append(row["curve"])
    for error, names in alike.items():
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        typer.echo(f"{names[0]}{others}: {error}", err=True)
    for line in verdict_lines(rows, known, command):
        typer.echo(line)


def verdict_lines(rows: Sequence[Row], known: Registry, command: str) -> Iterator[str]:
    """At most three lines: what the values hold for, what was found, and the command that states what is open."""
    counts: Counter[str] = Counter()
    said: dict[str, str] = {}  # with the effect in the first file that has the condition
    for row in rows:
        facts = row_conditions(row)
        counts.update(facts.keys())
        said = facts | said
    needed = Counter(fact for row in rows for fact in row.get("needs", "").split())
    if said:
        fitted = sum(not row.get("error") for row in rows)
        yield "holds if: " + "; ".join(
            said[fact] + ("" if count == fitted else f" [{count} of {fitted}]") for fact, count in counts.most_common()
        )
    doubtful = [row for row in rows if row.get("verdict") == "doubtful"]
    if doubtful:
        yield f"doubtful: {_causes(doubtful, known, 'doubtful')}; palpate describe CODE says what to do"
    ordered = dict.fromkeys(fact for count in (needed, counts) for fact, _ in count.most_common())
    if words := [words_that_state(fact) for fact in ordered if fact in facts_stated()]:
        yield f"state them, with your values: {command} {' '.join(words)}"


def law_line(source: Path, track: Track, known: Registry, better_laws: Sequence[str]) -> str:
    """Return the command that compares a track's law with those that describe its record better; empty without any."""
    laws = [law for law in better_laws if law != known.name_of(type(track.model))]
    if not laws:
        return ""
    models = ",".join([track.name.model, *laws])
    return f"a better law? {shlex.join(['palpate', 'fit', 'choose', str(source), '--models', models])}"


def count_line(rows: Sequence[Row], known: Registry) -> str:
    """How many values are usable, and why the others are not."""
    bad = [row for row in rows if not is_usable(row)]
    usable = len(rows) - len(bad)
    return f"{usable} usable, {len(bad)} not: {_causes(bad, known, 'invalid')}" if bad else f"all {usable} usable"


def file_table(rows: Sequence[Row], pipeline: Pipeline, details: bool = False) -> Table:
    """File, track where there are several, values with combined uncertainty in display units, and verdict."""
    units = value_units(pipeline.tracks[0].model)
    shown = [name for name in _SHOWN if name in units] or list(units)[:2]
    heads = ["file", *(["track"] if len(pipeline.tracks) > 1 else [])]
    values = [f"{name}\n{display_unit(units[name])[0]}" for name in shown]
    more = [*(head for head, _ in _DETAILS.values()), _MEASURED] if details else []
    cells = [
        [
            row["curve"] if details else _short(row["curve"]),
            *([row.get("track", "")] if len(heads) > 1 else []),
            *(_cell(row, name, units[name]) for name in shown),
            *(
                format(float(row[name]), form) if row.get(name) else "-"
                for name, (_, form) in _DETAILS.items()
                if details
            ),
            *([_lines(motion_text([row_motion(row)]))] if details else []),
            verdict_word(row.get("verdict") or "not read"),
            *([row.get("flags", "").replace(" ", "\n")] if details else []),
        ]
        for row in rows
    ]
    behind = ["verdict", *(["flags"] if details else [])]
    return Table.of("", [*heads, *values, *more, *behind], cells, [*heads, *behind, _MEASURED])


def _lines(motion: str) -> str:
    """Return the parts of a motion below one another."""
    return motion.replace("; ", "\n").replace(", ", "\n")


def _cell(row: Mapping[str, Any], name: str, unit: str) -> str:
    word = row.get(f"{name}_verdict") or ""
    if not row.get(name):
        return word if is_open(word) else "-"
    factor = display_unit(unit)[1]
    combined = row.get(f"{name}_combined")
    value = float(row[name]) * factor
    number = value_or_fixed(value, float(combined) * factor) if combined else f"{value:.4g} ± ?"
    return f"{number} {word}" if is_open(word) else number


def _short(name: str) -> str:
    return name if len(name) <= _NAME else f"...{name[3 - _NAME :]}"


def _causes(rows: Sequence[Row], known: Registry, severity: str) -> str:
    """How many have which flags of a severity, the most frequent first."""
    causes: Counter[str] = Counter()
    for row in rows:
        meanings = {code: known.meanings.get(code) for code in row.get("flags", "").split()}
        codes = [code for code, meaning in meanings.items() if meaning is not None and meaning.severity == severity]
        causes.update(codes or ["not read" if row.get("error") else "no value"])
    return ", ".join(f"{cause} ({count})" for cause, count in causes.most_common())
