"""The box at the top of a page: values or counts with their verdicts, what was found, and open facts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate_kit.terminal.result_screen import facts_in_words, findings_in_words
from palpate_kit.terminal.result_table import ResultTable

GOOD, DOUBTED, REFUSED = "trust", "look", "refuse"  # colours, as classes of the style sheet
SIMULATED = "simulated: a rehearsal, of no real specimen"


@dataclass(frozen=True)
class ResultBox:
    """The first statement of a page."""

    colour: str
    headlines: tuple[str, ...]
    findings: tuple[tuple[str, str], ...] = ()  # sentences, each with what helps
    facts: tuple[tuple[str, str, str], ...] = ()  # values that depend on each, what is assumed, what settles it


def result_box(table: ResultTable, notes: Sequence[str] = ()) -> ResultBox:
    """Return the box of a table; of a single track its values, else how many have which verdict."""
    verdicts = {value.word for row in table.rows for value in row.chief.values()}
    colour = GOOD if verdicts <= {"good"} else REFUSED if verdicts <= {"invalid"} else DOUBTED
    if len(table.rows) == 1 and table.thing == "track":
        headlines = [f"{value.symbol} {value.text}" for value in table.rows[0].chief.values()]
    else:
        headlines = [table.partition()]
    return ResultBox(colour, (*notes, *headlines), tuple(findings_in_words(table)), tuple(facts_in_words(table)))
