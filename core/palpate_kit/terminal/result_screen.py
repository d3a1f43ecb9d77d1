"""The screen of a table of results: values with their verdicts, findings as compilers write them, open facts."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from palpate_engine import display_unit, row_words

from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.quantities import round_number
from palpate_kit.terminal.result_table import (
    ResultFinding,
    ResultRow,
    ResultTable,
    chief_names,
    counted,
    with_symbols,
)
from palpate_kit.terminal.table import Table, verdict_style

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.text import Text

WIDTH = 79
LEGEND = "± one standard uncertainty"
SHARED = "every value"  # in place of symbols: a finding on the whole record
_MAX_NAME = 28  # [characters] of a file's name: a choice
_MAX_NAMED_TRACKS = 2  # of a finding; of more tracks their number is shown: a choice
_TENFOLD = 10.0  # relative size of an effect, from which on no number is shown: a choice
_HEAD = r"^(doubtful|invalid|not determined|note)\[[^\]]*\]"
_ADVICE = r"^ *(help|state|settle|share|why ±|or):"


def title_line(name: str) -> str:
    """Return a name, and at the right edge the meaning of ±; a name that is too long is cut."""
    room = WIDTH - len(LEGEND) - 2
    return f"{name if len(name) <= room else name[: room - 3] + '...'}".ljust(WIDTH - len(LEGEND)) + LEGEND


def with_legend(title: str) -> str:
    """Return a title with the meaning of ± on a terminal; in CSV and LaTeX the uncertainties have their own columns."""
    return f"{title}; {LEGEND}" if layout() == "table" else title


def value_lines(row: ResultRow, truth: Mapping[str, float], names: Sequence[str] = ()) -> Iterator[Text]:
    """Yield a line for each value of one row, aligned at their ±: symbol, number, unit, verdict, truth.

    The values are those with `names`, by default elasticity and viscosity.
    """
    from rich.text import Text

    values = [row.values[name] for name in names or row.chief]
    parts = [value.number.partition(" ± ") for value in values]
    number_width = _width(number for number, _, _ in parts)
    std_width = _width(std for _, _, std in parts)
    symbol_width = _width(value.symbol for value in values)
    unit_width = _width(value.shown_unit for value in values)
    verdict_width = _width(value.word for value in values)
    for value, (number, sign, std) in zip(values, parts, strict=True):
        # A value without ± among others has blanks in its place, three of them for " ± ".
        uncertainty = " " * (std_width + 3) if std_width else ""
        if sign:
            uncertainty = f" ± {std.ljust(std_width)}"
        symbol, unit = value.symbol.ljust(symbol_width), value.shown_unit.ljust(unit_width)
        line = Text(f"  {symbol}  {number.rjust(number_width)}{uncertainty} {unit}   ")
        line.append(value.word.ljust(verdict_width), verdict_style(value.word))
        line.append(_truth_text(value.name, value.unit, truth))
        line.rstrip()
        yield line


def _width(texts: Iterable[str]) -> int:
    """Return the length of the longest text."""
    return max(map(len, texts), default=0)


def _truth_text(name: str, unit: str, truth: Mapping[str, float]) -> str:
    """Return the true value of a simulated rig in the unit that is shown; empty without one."""
    true_value = truth.get(name, math.nan)
    return f"   truth {round_number(true_value * display_unit(unit)[1])}" if math.isfinite(true_value) else ""


def value_table(table: ResultTable, whole_names: bool = False, names: Sequence[str] = ()) -> Table:
    """Return a row for each file and track: its values, each followed by its verdict; then a row of the truth.

    The values are those with `names`, by default elasticity and viscosity. `table` has a row for each track with
    values, verdicts and findings, and the truth where it is known.
    """
    units = {name: value.unit for row in table.rows for name, value in row.values.items()}
    names = names or chief_names(units)
    # Columns: labels of the row, then number and verdict of each value.
    label_headings = _label_headings(table)
    headings = []
    for name in names:
        headings += [f"{name}\n{display_unit(units[name])[0]}", f"{name}\nverdict"]
    rows = [_cells(row, label_headings, names, whole_names) for row in table.rows]
    if table.truth:
        rows.append(["truth", *[""] * (len(label_headings) - 1), *_truth_cells(table.truth, names, units)])
    return Table(
        "",
        headings=(*label_headings, *headings),
        rows=tuple(map(tuple, rows)),
        left=(*label_headings, *headings[1::2]),
        is_plain=True,
    )


def _label_headings(table: ResultTable) -> list[str]:
    """Return "file" if rows are of files, and "track" if there are several tracks, or no file."""
    has_files = any(row.record for row in table.rows)
    has_tracks = len({row.track for row in table.read}) > 1 or not has_files
    return ["file"] * has_files + ["track"] * has_tracks


def _truth_cells(truth: Mapping[str, float], names: Sequence[str], units: Mapping[str, str]) -> list[str]:
    """Return the true value of each name in the unit that is shown, and an empty verdict."""
    cells = []
    for name in names:
        number = truth.get(name, math.nan) * display_unit(units[name])[1]
        cells += [round_number(number) if math.isfinite(number) else "", ""]
    return cells


def _cells(row: ResultRow, label_headings: Sequence[str], names: Sequence[str], whole_names: bool) -> list[str]:
    """Return the cells of a row; one of a file that was not read says so in place of the first verdict."""
    labels = {"file": row.record if whole_names else short_name(row.record), "track": row.track}
    cells = [labels[heading] for heading in label_headings]
    if row.error:
        cell_count = len(label_headings) + 2 * max(len(names), 1)
        return [*cells, "-", "not read", *["", ""] * (len(names) - 1)][:cell_count]
    for name in names:
        value = row.values.get(name)
        cells += ["", ""] if value is None else ["\n".join(value.number_lines), value.word]
    return cells


def short_name(name: str) -> str:
    """Return the end of a name that is too long for a column."""
    return name if len(name) <= _MAX_NAME else f"...{name[3 - _MAX_NAME :]}"


def finding_lines(
    table: ResultTable, command: str = "", advice: Mapping[str, Sequence[str]] | None = None
) -> Iterator[str]:
    """Yield each finding once: verdict, code, cause, its values and rows, its sentence, sizes and remedy; then notes.

    `table` has the rows of results; a finding is what contradicts a law or a stated fact. `command` takes the option of
    a remedy; `advice` are more lines of help by option.
    """
    for sentence, remedy in findings_in_words(table):
        yield from filled(sentence, "  ")
        yield from _help(remedy, command, advice or {})
    for note, rows, _ in table.shared_notes():
        row_text = _row_text(rows, table)
        colon = ":" if row_text else ""
        yield from filled(f"{note.head}{row_text}{colon} {with_symbols(_sentence(note, len(rows)))}", "  ")
    for flag in table.of_record:
        yield from filled(f"note[{flag.code}] {with_symbols(flag.message)}", "  ")


def findings_in_words(table: ResultTable) -> Iterator[tuple[str, str]]:
    """Yield the sentence of each finding, and its remedy: an option that states a fact, or an instruction."""
    for finding, rows, names in table.shared_findings():
        values = _value_text(names)
        yield f"{finding.head} {values}{_row_text(rows, table)}: {_effect_text(finding, len(rows))}", finding.remedy


def _value_text(names: Sequence[str]) -> str:
    """Return the symbols of some values; "every value" without any."""
    return with_symbols(", ".join(name.replace("_", " ") for name in names)) or SHARED


def _row_text(rows: Sequence[ResultRow], table: ResultTable) -> str:
    """Return the tracks, the file or the number of rows of a finding, as in ", 3 of 24 files"; empty for one row."""
    if len(table.rows) == 1:
        return ""
    if table.thing == "track" and len(rows) < len(table.rows) and len(rows) <= _MAX_NAMED_TRACKS:
        return f", {', '.join(row.track for row in rows)}"
    if len(rows) == 1:
        return f", {short_name(rows[0].record)}"
    return f", {len(rows)} of {counted(len(table.rows), table.thing)}"


def _effect_text(finding: ResultFinding, count: int) -> str:
    """Return the sentence of a finding on a `count` of rows, with the sizes of the effects; the largest of several."""
    sentence = _sentence(finding, count)
    if finding.word == "not determined":
        if count == 1 and len(finding.sizes) == 1:
            return with_symbols(sentence.removeprefix(f"{next(iter(finding.sizes))} is "))
        return with_symbols(_bounds(finding))
    by = "by" if count == 1 else "by up to"
    sizes = [f"{name} {by} {_percent(size)}" for name, size in finding.sizes.items() if size is not None]
    return with_symbols(f"{sentence}; it can move {', '.join(sizes)}" if sizes else sentence)


def _sentence(finding: ResultFinding, count: int) -> str:
    """Return the sentence; for several rows without the part that differs between them, behind a semicolon."""
    return finding.sentence.partition("; ")[0] if count > 1 else finding.sentence


def _bounds(finding: ResultFinding) -> str:
    """Return the sentence on values of several rows that are not determined, with the largest part of their ±."""
    if not finding.suspects:
        return finding.sentence
    return f"it may be zero, which is within twice its ±; most of the ± is {row_words(finding.suspects[0])}"


def _percent(size: float) -> str:
    """Return a relative size in percent, to two digits."""
    return f"{float(f'{100 * size:.2g}'):g} %" if size < _TENFOLD else "more than tenfold"


def _help(remedy: str, command: str, advice: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield the lines of a remedy: an instruction, or the command that states a fact, followed by its advice."""
    if not remedy.startswith("--"):
        yield from filled(f"  help: {remedy}", "        ") if remedy else ()
        return
    yield f"  help: state it: {command_stating(command, [remedy])}" if command else f"  help: state it with {remedy}"
    yield from (f"        {line}" for line in advice.get(remedy.split()[0], ()))


def facts_in_words(table: ResultTable) -> Iterator[tuple[str, str, str]]:
    """Yield for each open fact the symbols of the values that depend on it, the assumption, and the remedy."""
    read_count = len(table.read)
    for _, sentence, remedy, count in table.open_facts():
        share = f" [{count} of {counted(read_count, table.thing)}]" if 1 < read_count != count else ""
        yield _concerned_symbols(sentence, table), f"{with_symbols(sentence)}{share}", remedy


def fact_lines(table: ResultTable, command: str = "") -> Iterator[str]:
    """Yield the open facts under one heading: the values that depend on each, the assumption, and the remedy.

    A row of `table` has conditions: facts that nobody stated, and what is assumed in their place. With a `command` one
    line states all open facts that have an option, first those of findings; but not a single one of a finding, whose
    remedy is that command already.
    """
    facts = list(facts_in_words(table))
    if not facts:
        return
    yield "Not in the ±, since nobody stated it:"
    yield from _assumption_lines(facts, has_command=bool(command))
    finding_remedies = [finding.remedy for finding, _, _ in table.shared_findings()]
    remedies = dict.fromkeys((*finding_remedies, *(remedy for _, _, remedy in facts)))
    options = [remedy for remedy in remedies if remedy.startswith("--")]
    if command and options and (len(options) > 1 or options[0] not in finding_remedies):
        yield f"  state: {command_stating(command, options)}"


def _assumption_lines(facts: Sequence[tuple[str, str, str]], has_command: bool) -> Iterator[str]:
    """Yield each open fact, and its remedy unless the next fact has the same, or a command states it."""
    width = _width(symbols for symbols, _, _ in facts)
    indent = " " * (width + 4)  # two blanks before the symbols, and two behind
    next_remedies = [*(remedy for _, _, remedy in facts[1:]), ""]
    for (symbols, sentence, remedy), next_remedy in zip(facts, next_remedies, strict=True):
        yield from filled(f"  {symbols.ljust(width)}  {sentence}", indent)
        is_option = remedy.startswith("--")
        if remedy not in ("", next_remedy) and not (has_command and is_option):
            yield f"{indent}{'state' if is_option else 'settle'}: {remedy}"


def command_stating(command: str, facts: Sequence[str]) -> str:
    """Return a command with options such as "--tip VALUE", which replace those of the same name that it has."""
    parts = shlex.split(command)
    for option in (fact.split()[0] for fact in facts):
        if option in parts:
            place = parts.index(option)
            del parts[place : place + 2]  # the option and its value
    return " ".join([shlex.join(parts), *facts])


def _concerned_symbols(sentence: str, table: ResultTable) -> str:
    """Return the symbols of the values that a sentence names; of one that names none those of all."""
    names = [name for name in table.names if name in sentence] or table.names
    return with_symbols(", ".join(names))


def filled(text: str, indent: str = "") -> list[str]:
    """Return the lines of a text as wide as a screen, all but the first indented."""
    return textwrap.wrap(text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def coloured(line: str) -> Text:
    """Return a line with the colours of its verdict and of the words before what is to be typed."""
    from rich.text import Text

    text = Text(line)
    text.highlight_regex(_HEAD, "bold yellow")
    text.highlight_regex(_ADVICE, "cyan")
    return text


def print_view(console: Console, view: RenderableType) -> None:
    """Print a view; a line that holds a command is not broken, so that it can be copied."""
    from rich.text import Text

    console.print(view, soft_wrap=isinstance(view, Text))
