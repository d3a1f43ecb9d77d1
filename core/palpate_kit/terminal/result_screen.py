"""The screen of a table of results: values with their verdicts, findings as compilers write them, open facts."""

from __future__ import annotations

import math
import shlex
import textwrap
from collections.abc import Iterator, Mapping, Sequence
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
_NAME = 28  # characters of a file's name
_NAMED = 2  # tracks of a finding that are named, of more their number
_CAUSED = "\\[[^\\]]*\\]"
_HEADS = rf"^(doubtful|invalid|not determined|note){_CAUSED}"
_ADVICE = r"^ *(help|state|settle|share|why ±|or):"


def title_line(name: str) -> str:
    """Return the name of what is shown, and what ± stands for at the right edge."""
    room = WIDTH - len(LEGEND) - 2
    return f"{name if len(name) <= room else name[: room - 3] + '...'}".ljust(WIDTH - len(LEGEND)) + LEGEND


def with_legend(title: str) -> str:
    """Return the title of a table on a terminal with what ± stands for; as CSV and LaTeX it has columns of it."""
    return f"{title}; {LEGEND}" if layout() == "table" else title


def value_lines(row: ResultRow, truth: Mapping[str, float], names: Sequence[str] = ()) -> Iterator[Text]:
    """Return a line for each value of one row, aligned at their ±: symbol, number, unit, verdict, truth.

    Of the values `names`, without them of elasticity and viscosity.
    """
    from rich.text import Text

    values = [row.values[name] for name in names or row.chief]
    parts = [value.number.partition(" ± ") for value in values]
    widths = [max((len(part[place]) for part in parts), default=0) for place in (0, 2)]
    symbol = max((len(value.symbol) for value in values), default=0)
    unit = max((len(value.shown_unit) for value in values), default=0)
    word = max((len(value.word) for value in values), default=0)
    for value, (number, sign, std) in zip(values, parts, strict=True):
        u = f" ± {std.ljust(widths[1])}" if sign else " " * (widths[1] + 3) * bool(widths[1])
        line = Text(f"  {value.symbol.ljust(symbol)}  {number.rjust(widths[0])}{u} {value.shown_unit.ljust(unit)}   ")
        line.append(value.word.ljust(word), verdict_style(value.word))
        line.append(_truth_of(value.name, value.unit, truth))
        line.rstrip()
        yield line


def _truth_of(name: str, unit: str, truth: Mapping[str, float]) -> str:
    known = truth.get(name, math.nan)
    return f"   truth {round_number(known * display_unit(unit)[1])}" if math.isfinite(known) else ""


def value_table(table: ResultTable, whole_names: bool = False, names: Sequence[str] = ()) -> Table:
    """Return a row for each file and track: its values, each with its verdict next to it; then the truth.

    Of the values `names`, without them of elasticity and viscosity.
    """
    units = {name: value.unit for row in table.rows for name, value in row.values.items()}
    names = names or chief_names(units)
    heads = [
        *(["file"] if any(row.record for row in table.rows) else []),
        *(["track"] if len({row.track for row in table.read}) > 1 or not any(row.record for row in table.rows) else []),
    ]
    columns = [head for name in names for head in (f"{name}\n{display_unit(units[name])[0]}", f"{name}\nverdict")]
    rows = [_cells(row, heads, names, whole_names) for row in table.rows]
    if table.truth:
        known = [(name, table.truth.get(name, math.nan) * display_unit(units[name])[1]) for name in names]
        cells = [cell for _, number in known for cell in (round_number(number) if math.isfinite(number) else "", "")]
        rows.append(["truth", *[""] * (len(heads) - 1), *cells])
    left = (*heads, *columns[1::2])
    return Table("", (*heads, *columns), tuple(map(tuple, rows)), left, is_plain=True)


def _cells(row: ResultRow, heads: Sequence[str], names: Sequence[str], whole_names: bool) -> list[str]:
    labels = {"file": row.record if whole_names else short_name(row.record), "track": row.track}
    cells = [labels[head] for head in heads]
    if row.error:
        return [*cells, "-", "not read", *["", ""] * (len(names) - 1)][: len(heads) + 2 * max(len(names), 1)]
    for name in names:
        value = row.values.get(name)
        cells += ["", ""] if value is None else ["\n".join(value.number_lines), value.word]
    return cells


def short_name(name: str) -> str:
    """Return the end of a name that is too long for a column."""
    return name if len(name) <= _NAME else f"...{name[3 - _NAME :]}"


def finding_lines(
    table: ResultTable, command: str = "", advice: Mapping[str, Sequence[str]] | None = None
) -> Iterator[str]:
    """Return each finding once: verdict, code and cause, the values and rows it is of, what, how large, what to type.

    Notes follow. `command` takes the option of a remedy; `advice` are more lines of help by option.
    """
    for sentence, remedy in findings_in_words(table):
        yield from filled(sentence, "  ")
        yield from _help(remedy, command, advice or {})
    for note, rows, _ in table.shared_notes():
        where = _where(rows, table)
        yield from filled(f"{note.head}{where}{':' * bool(where)} {with_symbols(_sentence(note, len(rows)))}", "  ")
    for flag in table.of_record:
        yield from filled(f"note[{flag.code}] {with_symbols(flag.message)}", "  ")


def findings_in_words(table: ResultTable) -> Iterator[tuple[str, str]]:
    """Return the sentence of each finding, and its remedy: an option that states a fact, or what to do."""
    for finding, rows, names in table.shared_findings():
        yield f"{finding.head} {_of(names)}{_where(rows, table)}: {_what(finding, len(rows))}", finding.remedy


def _of(names: Sequence[str]) -> str:
    return with_symbols(", ".join(name.replace("_", " ") for name in names)) or SHARED


def _where(rows: Sequence[ResultRow], table: ResultTable) -> str:
    """Return of how many rows a finding is, where there are several."""
    if len(table.rows) == 1:
        return ""
    if table.thing == "track" and len(rows) < len(table.rows) and len(rows) <= _NAMED:
        return f", {', '.join(row.track for row in rows)}"
    if len(rows) == 1:
        return f", {short_name(rows[0].record)}"
    return f", {len(rows)} of {counted(len(table.rows), table.thing)}"


def _what(finding: ResultFinding, count: int) -> str:
    """Return the sentence and the sizes of the effects."""
    sentence = _sentence(finding, count)
    if finding.word == "not determined":
        alone = count == 1 and len(finding.sizes) == 1
        return with_symbols(sentence.removeprefix(f"{next(iter(finding.sizes))} is ") if alone else _bounds(finding))
    sizes = [f"{name} by {_percent(size)}" for name, size in finding.sizes.items() if size is not None]
    moved = f"; it can move {', '.join(sizes)}" if sizes else ""
    return with_symbols(f"{sentence}{moved if count == 1 else moved.replace(' by ', ' by up to ')}")


def _sentence(finding: ResultFinding, count: int) -> str:
    """Return the sentence, of several rows without what differs between them."""
    return finding.sentence.partition("; ")[0] if count > 1 else finding.sentence


def _bounds(finding: ResultFinding) -> str:
    """Return why values of several rows are not determined."""
    if not finding.suspects:
        return finding.sentence
    return f"it may be zero, which is within twice its ±; most of the ± is {row_words(finding.suspects[0])}"


def _percent(size: float) -> str:
    return f"{float(f'{100 * size:.2g}'):g} %" if size < 10 else "more than tenfold"


def _help(remedy: str, command: str, advice: Mapping[str, Sequence[str]]) -> Iterator[str]:
    if not remedy.startswith("--"):
        yield from filled(f"  help: {remedy}", "        ") if remedy else ()
        return
    yield f"  help: state it: {command_stating(command, [remedy])}" if command else f"  help: state it with {remedy}"
    yield from (f"        {line}" for line in advice.get(remedy.split()[0], ()))


def facts_in_words(table: ResultTable) -> Iterator[tuple[str, str, str]]:
    """Return the symbols of the values that depend on each open fact, what is assumed, and what settles it."""
    read = len(table.read)
    for _, sentence, remedy, count in table.open_facts():
        some = f" [{count} of {counted(read, table.thing)}]" if 1 < read != count else ""
        yield _concerned(sentence, table), f"{with_symbols(sentence)}{some}", remedy


def fact_lines(table: ResultTable, command: str = "") -> Iterator[str]:
    """Return the open facts under one heading: the values that depend on each, what is assumed, what settles it.

    With a `command` one line states all of them that an option states, those first on which a finding is; a single one
    of a finding stands there already.
    """
    facts = list(facts_in_words(table))
    if not facts:
        return
    yield "Not in the ±, since nobody stated it:"
    width = max(len(symbols) for symbols, _, _ in facts)
    indent = " " * (width + 4)
    following = [*(remedy for _, _, remedy in facts[1:]), ""]
    for (symbols, sentence, remedy), next_remedy in zip(facts, following, strict=True):
        yield from filled(f"  {symbols.ljust(width)}  {sentence}", indent)
        if remedy not in ("", next_remedy) and not (command and remedy.startswith("--")):
            yield f"{indent}{'state' if remedy.startswith('--') else 'settle'}: {remedy}"
    of_findings = [finding.remedy for finding, _, _ in table.shared_findings()]
    remedies = dict.fromkeys((*of_findings, *(remedy for _, _, remedy in facts)))
    options = [remedy for remedy in remedies if remedy.startswith("--")]
    if command and options and (len(options) > 1 or options[0] not in of_findings):
        yield f"  state: {command_stating(command, options)}"


def command_stating(command: str, facts: Sequence[str]) -> str:
    """Return a command that states facts, as in "--tip VALUE", in place of what it states of the same."""
    parts = shlex.split(command)
    for option in (fact.split()[0] for fact in facts):
        if option in parts:
            place = parts.index(option)
            del parts[place : place + 2]  # the option and its value
    return " ".join([shlex.join(parts), *facts])


def _concerned(sentence: str, table: ResultTable) -> str:
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
    text.highlight_regex(_HEADS, "bold yellow")
    text.highlight_regex(_ADVICE, "cyan")
    return text


def print_view(console: Console, view: RenderableType) -> None:
    """Print a view; a line that holds a command is not broken, so that it can be copied."""
    from rich.text import Text

    console.print(view, soft_wrap=isinstance(view, Text))
