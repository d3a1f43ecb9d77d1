"""A file with the header of one that was looked at whole gets the dialect and layout that it would get by itself."""

import numpy as np
import pytest
from palpate import LogError
from palpate_records.tables import csv_sheet, table_forms
from palpate_records.tables.csv_sheet import Sheet

HEADS = {
    "names with units": "z (mm){d}v (mm/s){d}Force (N)\n",
    "names and a row of units": "z{d}v{d}Force\nmm{d}mm/s{d}N\n",
    "a quoted head": '"z (mm)"{d}"v (mm/s)"{d}"Force (N)"\n',
    "lines above the names": "Operator: A. B.\nDiameter{d}14\n\nz (mm){d}v (mm/s){d}Force (N)\n",
}
FORMATS = {
    "fractions": "{:.4f}",
    "thousandths": "{:.3f}",
    "exponents": "{:.5e}",
    "whole numbers": "{:.0f}",
    "one digit": "{:.1f}",
    "thousands": "{:,.0f}",
}


@pytest.fixture(autouse=True)
def nothing_is_remembered(monkeypatch):
    """Begin without forms."""
    monkeypatch.setattr(table_forms, "_forms", {})


def table(head, delimiter, decimal, number, seed, rows=60, edit=lambda line: line):
    """The text of a table of three columns of numbers up to some thousand."""
    numbers = 3000 * np.random.default_rng(seed).random((rows, 3))
    text = head.format(d=delimiter)
    for row in numbers:
        cells = [number.format(value) for value in row]
        if decimal == ",":
            cells = [cell.replace(",", " ").replace(".", ",") for cell in cells]
        text += edit(delimiter.join(cells)) + "\n"
    return text


def look(path):
    """How a file is written; the words of a mistake where it is none."""
    try:
        sheet = Sheet.of(path)
    except LogError as error:
        return str(error)
    return sheet.dialect, sheet.layout


def looks_after(path, first, second):
    """How the second text is written in a process that has looked at the first, and in a new one."""
    path.write_text(first)
    look(path)
    path.write_text(second)
    after = look(path)
    table_forms._forms.clear()
    return after, look(path)


@pytest.mark.parametrize("head", HEADS.values(), ids=[*HEADS])
@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")])
def test_a_form_is_that_of_the_file_itself(tmp_path, head, delimiter, decimal):
    for name, number in FORMATS.items():
        first = table(head, delimiter, decimal, FORMATS["fractions"], 1)
        after, alone = looks_after(tmp_path / "table.csv", first, table(head, delimiter, decimal, number, 2))
        assert after == alone, name


ODD = {
    "an empty cell": lambda line: line.replace(line.split(",")[1], "", 1),
    "a word": lambda line: line.replace(line.split(",")[1], "OVER", 1),
    "a unit": lambda line: line + " N",
    "one cell more": lambda line: line + ",1.5",
    "a comment": lambda line: "# " + line,
    "a time of day": lambda line: line.replace(line.split(",")[0], "12:30:05.5", 1),
    "quotation marks": lambda line: line.replace(line.split(",")[1], '"1.5"', 1),
    "no row": lambda line: "",
}


@pytest.mark.parametrize("odd", ODD.values(), ids=[*ODD])
@pytest.mark.parametrize("rows", ["every", "last", "first"])
def test_rows_that_are_not_plain_are_looked_at_whole(tmp_path, odd, rows):
    head, lines = HEADS["names with units"], iter(range(60))

    def edit(line):
        k = next(lines)
        return odd(line) if rows == "every" or k == (59 if rows == "last" else 0) else line

    plain, edited = table(head, ",", ".", "{:.4f}", 1), table(head, ",", ".", "{:.4f}", 2, edit=edit)
    after, alone = looks_after(tmp_path / "table.csv", plain, edited)
    assert after == alone
    after, alone = looks_after(tmp_path / "table.csv", edited, plain)
    assert after == alone


@pytest.mark.parametrize("row", ["0,125;0,250;1", "-1;1250,125;0", "1;12,5;3", "1,5e-3;2;3"])
def test_the_files_of_a_folder_are_looked_at_whole_once(tmp_path, monkeypatch, row):
    dialect_of, looked = csv_sheet.dialect_of, []
    monkeypatch.setattr(csv_sheet, "dialect_of", lambda lines: looked.append(1) or dialect_of(lines))
    for seed in range(5):
        path = tmp_path / f"{seed}.csv"
        path.write_text(table(HEADS["names with units"], ";", ",", "{:.4f}", seed, edit=lambda line: row))
        assert look(path)[0].decimal == ","
    assert len(looked) == 1
