"""An item's rows as a table for a terminal, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence

from palpate_kit.terminal.quantities import round_number, value_with_uncertainty
from palpate_kit.terminal.table import Table

from reproduction.item import Item
from reproduction.item_rows import Row
from reproduction.verdict import Status

HEADINGS = ("row", "quantity", "palpate", "paper", "ratio", "allowed\n+- %", "source", "verdict")
_WORDS = {"failed": "FAILED", "outside": "OUTSIDE"}


def cells(row: Row) -> list[str]:
    """The row as texts, for people."""
    published = row.published
    own = "-" if row.value is None else _number(row.value, row.std)
    ratio = "-" if row.ratio is None else _number(row.ratio, row.ratio_std)
    unit = f" {published.unit}" if published.unit else ""
    verdict = _WORDS.get(row.status, row.status)
    allowed = "" if row.tolerance is None else f"{100 * row.tolerance / abs(published.number):.2g}"
    return [
        published.row, published.quantity + unit, own, _number(published.number, published.spread), ratio, allowed,
        published.source, verdict,
    ]  # fmt: skip


def _number(value: float, std: float | None) -> str:
    return value_with_uncertainty(value, std) if std else round_number(value)


def table_of(item: Item, rows: Sequence[Row]) -> Table:
    """palpate | paper | ratio."""
    lines = [cells(row) for row in rows]
    return Table.of(f"{item.label}: {item.title}", HEADINGS, lines, ("row", "quantity", "source", "verdict"))


def tally(made: Sequence[tuple[Item, Sequence[Row]]]) -> str:
    """First how many distinct numbers are reproduced of those that can be, then how all others ended, and why.

    A number that a public recording could give, and one that none could give, are counted each by itself.
    """
    rows = [row for _, item_rows in made for row in item_rows]
    count = Counter(row.status for row in rows)
    possible = sum(row.published.possible for row in rows)
    impossible = sum(missing.numbers for item, _ in made for missing in item.missing)
    words: dict[Status, str] = {
        "outside": "outside of their tolerance",
        "no test": "with a tolerance over 20 %, which is not a test",
        "failed": "failed",
        "skipped": "whose recording is not here",
        "fitted": "to which a constant was fitted",
        "arithmetic": "of the paper's own arithmetic that come out",
        "simulated": "simulated",
        "shown": "shown and not judged",
    }
    own = sum(row.status == "outside" and row.published.source == "arithmetic" for row in rows)
    words["outside"] += f" ({own} of the paper's own arithmetic)" if own else ""
    others = [f"{count[status]} {word}" for status, word in words.items() if count[status]]
    others += [f"{impossible} not possible from public data"] if impossible else []
    first = f"{count['reproduced']} distinct of {possible} possible numbers reproduced"
    return first + (f"\nnot among them: {', '.join(others)}" if others else "")


def csv_text(item: Item, rows: Sequence[Row]) -> str:
    """Every row with its tolerance and reasons."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([
        "label", "row", "quantity", "unit", "palpate", "palpate_std", "paper", "paper_spread", "ratio", "ratio_std",
        "tolerance", "source", "recording", "verdict", "flags", "said",
    ])  # fmt: skip
    for row in rows:
        p = row.published
        numbers = [_plain(v) for v in (row.value, row.std, p.number, p.spread, row.ratio, row.ratio_std, row.tolerance)]
        writer.writerow([
            item.label, p.row, p.quantity, p.unit, *numbers, p.source, p.recording, row.status,
            " ".join(row.flags), row.said,
        ])  # fmt: skip
    for missing in item.missing:
        writer.writerow([item.label, missing.what, *[""] * 10, "not possible", "", missing.reason])
    return text.getvalue()


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.10g}"


def latex_text(item: Item, rows: Sequence[Row]) -> str:
    """A table for a paper, by booktabs."""
    lines = [
        r"\begin{tabular}{l l r r r l}", r"\toprule",
        r"& quantity & palpate & published & ratio & source \\", r"\midrule",
    ]  # fmt: skip
    for row in rows:
        name, quantity, own, paper, ratio, _, source, _ = cells(row)
        lines.append(" & ".join(_escaped(text) for text in (name, quantity, own, paper, ratio, source)) + r" \\")
    return "\n".join([f"% {item.label}: {item.title}", *lines, r"\bottomrule", r"\end{tabular}", ""])


def _escaped(text: str) -> str:
    for sign in "\\_%&#$":
        text = text.replace(sign, rf"\{sign}" if sign != "\\" else r"\textbackslash ")
    return text.replace("±", r"$\pm$")
