"""A file is looked at once: what several ask of it is worked out once, with the same numbers as line by line."""

import random

import numpy as np
import pytest
from palpate_engine import registry
from palpate_kit.curves.alike_logs import specimens_of
from palpate_kit.logs.draft_pipeline import suggestion_of
from palpate_records.tables import csv_sheet, dialect
from palpate_records.tables.csv_sheet import Sheet, together

from tests.logs.test_csv_plain import TEXTS

CELLS = (
    *("1", "1.5", "1,5", "1.234,5", "1,234.5", "1 234", "1'234", "1\u00a0234", "a", "", "12:30:01"),
    *("1.5 N", '"x"', '"1,5"', "1e-5", "-0,3", '"'),
)


@pytest.fixture
def curve(tmp_path):
    """A press with a header, in a file."""
    time = np.arange(400) * 2e-3
    height = 1.0 - 4.0 * np.sin(np.pi * time / time[-1]) ** 2
    table = np.column_stack([time, height, np.maximum(-height, 0.0) ** 1.5])
    path = tmp_path / "curve.csv"
    np.savetxt(path, table, delimiter=",", fmt="%.6g", header="Time (s),Position (mm),Force (N)", comments="")
    return path


def test_neither_layout_nor_plugins_are_found_twice(curve, monkeypatch):
    known, sheets, loads = registry.load(), [], []
    suggestion_of(curve, {"tip": "paraboloid 5 mm"}, known)  # the tip is built
    files = [curve.with_name(f"{k}.csv") for k in range(10)]
    for file in files:
        file.write_text(curve.read_text())
    of, load = Sheet.of.__func__, registry.load
    monkeypatch.setattr(Sheet, "of", classmethod(lambda cls, *given: sheets.append(given) or of(cls, *given)))
    monkeypatch.setattr(registry, "load", lambda *given: loads.append(given) or load(*given))
    parts = [part for file in files for part in specimens_of(file, known)]
    for part in parts:
        suggestion_of(part.path, {"tip": "paraboloid 5 mm"}, known)
    assert len(parts) == len(sheets) == len(files)
    assert not loads


def test_dialects_that_differ_in_marks_no_line_holds_are_scored_once(curve, monkeypatch):
    scored, score = [], dialect._score
    monkeypatch.setattr(dialect, "_score", lambda lines, one: scored.append(one) or score(lines, one))
    assert dialect.dialect_of(curve.read_text().splitlines(keepends=True)) == dialect.Dialect()
    assert len(scored) <= 5


def test_the_dialect_is_that_of_the_best_score_of_all():
    draw = random.Random(3)
    for _ in range(300):
        separator, some = draw.choice(("\t", ";", ",", " ", "  ", ", ")), draw.sample(CELLS, draw.randint(1, 5))
        rows = [separator.join(draw.choices(some, k=draw.randint(1, 4))) for _ in range(draw.randint(2, 16))]
        lines = [draw.choice(("", "\t", "")) + row + "\n" for row in rows]
        late = lines[len(lines) // 2 :]
        likeliest = [*sorted(late, key=len)[-15:], *late[-15:]]
        best = max(dialect._score(likeliest, one) for one in dialect._dialects(lines))
        assert dialect._score(likeliest, dialect.dialect_of(lines)) == best, lines


@pytest.mark.parametrize("name", [name for name, text in TEXTS.items() if text.strip() and name != "header alone"])
def test_numbers_are_those_of_line_by_line(name, tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    path.write_text(TEXTS[name], newline="")
    sheet = Sheet.of(path)
    at_once = together(sheet.blocks(), 100_000)
    footer = list(sheet.footer)
    monkeypatch.setattr(csv_sheet, "plain_numbers", lambda *given: None)
    by_line = together(sheet.blocks(), 100_000)
    np.testing.assert_array_equal(at_once, by_line)
    assert sheet.footer == footer
