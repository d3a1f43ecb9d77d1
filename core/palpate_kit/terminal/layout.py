"""In which form tables are printed: for a terminal, as CSV, or as LaTeX."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from contextvars import ContextVar
from typing import Any, Literal

import typer

Layout = Literal["table", "csv", "latex"]

_ESCAPED = {c: f"\\{c}" for c in "&%$#_{}"} | {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_ESCAPED |= {"\\": r"\textbackslash{}", "µ": r"$\mu$", "°": r"$^\circ$", "²": "$^2$", "·": r"$\cdot$", "±": r"$\pm$"}
_chosen: ContextVar[Layout] = ContextVar("layout", default="table")


def layout() -> Layout:
    """The form that the command line asks for."""
    return _chosen.get()


def choose(context: typer.Context, wanted: Layout) -> Layout:
    """Print the tables of this command in another form."""
    token = _chosen.set(wanted)
    context.call_on_close(lambda: _chosen.reset(token))
    return wanted


def tables_in(shown: Any) -> Iterator[Any]:
    """The tables among what is printed, in their order."""
    from rich.console import Group
    from rich.table import Table

    if isinstance(shown, Table):
        yield shown
    elif isinstance(shown, Group):
        for item in shown.renderables:
            yield from tables_in(item)


def text_of(table: Any, form: Layout) -> str:
    """A table of a terminal as CSV, its first line a comment with the title, or as LaTeX (booktabs)."""
    headings = [_plain(column.header) for column in table.columns]
    rows = [[_plain(cell) for cell in row] for row in zip(*(list(c.cells) for c in table.columns), strict=True)]
    title = _plain(table.title) if table.title else ""
    if form == "csv":
        return _csv(title, headings, rows)
    return _latex(title, headings, rows, ["r" if column.justify == "right" else "l" for column in table.columns])


def _csv(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A value with an uncertainty becomes two columns."""
    double = [any(" ± " in row[i] for row in rows) for i in range(len(headings))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if title:
        text.write(f"# {title}\n")
    writer.writerow(
        [name for head, two in zip(headings, double, strict=True) for name in _both(head, f"u({head})", two)]
    )
    for row in rows:
        pairs = [(*cell.partition(" ± ")[::2], two) for cell, two in zip(row, double, strict=True)]
        writer.writerow([one for value, std, two in pairs for one in _both(value, std, two)])
    return text.getvalue()


def _both(first: str, second: str, two: bool) -> Iterable[str]:
    return (first, second) if two else (first,)


def _latex(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], sides: Sequence[str]) -> str:
    lines = [f"% {title}"] if title else []
    lines += [rf"\begin{{tabular}}{{{' '.join(sides)}}}", r"\toprule"]
    lines += [" & ".join(map(_tex, headings)) + r" \\", r"\midrule"]
    lines += [" & ".join(map(_tex, row)) + r" \\" for row in rows]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _tex(text: str) -> str:
    """A text as LaTeX has it.

    >>> _tex("5 ± 1 %")
    '5 $\\\\pm$ 1 \\\\%'
    """
    return "".join(_ESCAPED.get(character, character) for character in text)


def _plain(cell: Any) -> str:
    return " ".join(str(getattr(cell, "plain", cell)).split())
