"""Tables of tips and depths on one specimen: E_n of each pair, and one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate_kit.curves.shared_specimen import SPECIMEN, SetupPair, agreement_sentence
from palpate_kit.terminal.layout import print_line
from palpate_kit.terminal.table import Table, console

SHOWN_PAIRS = 24  # on the terminal (choice), those that agree least


def show_pairs(pairs: Sequence[SetupPair]) -> None:
    """Print E_n of the pairs that agree least, and what all of them say of the facts; nothing without any."""
    if pairs:
        console().print(pair_table(pairs[:SHOWN_PAIRS]).view())
        print_line(agreement_sentence(pairs))


def pair_table(pairs: Sequence[SetupPair]) -> Table:
    """Return the table of pairs of tips or depths on one specimen, with E_n (ISO 13528) of each value."""
    names = list(dict.fromkeys(name for pair in pairs for name in pair.e_n))
    by_track = len({pair.track for pair in pairs}) > 1
    rows = []
    for pair in pairs:
        label = f"{pair.specimen}\n{pair.track}" if by_track else pair.specimen
        cells = [label, "\n".join(setup.words for setup in pair.setups)]
        for name in names:
            cells.append(f"{pair.e_n[name]:.2f}" if name in pair.e_n else "-")
        rows.append(cells)
    label_headings = [SPECIMEN, "tip and depth"]
    return Table.of(
        "two tips or depths on one specimen",
        [*label_headings, *(f"{name}\nE_n" for name in names)],
        rows,
        label_headings,
    )


def pairs_document(pairs: Sequence[SetupPair]) -> dict[str, Any]:
    """Return every pair and the sentence as plain data."""
    return {"pairs": [pair.table for pair in pairs], "says": agreement_sentence(pairs)}
