"""Sentences on open facts: once in ``conditions.csv``, by codes in the rows of ``fits.csv``."""

import csv

import pytest
from palpate import LogError
from palpate_kit.curves.condition_codes import CONDITIONS, ConditionCodes
from palpate_kit.curves.curve_table import columns_in, latest_rows, replace_columns, write_rows
from palpate_kit.curves.fit_folder import FitFolder

THICK = "thickness: specimen thicker than 62 mm: 22 mm makes elasticity 14 %, viscosity 14 % lower"
THICKER = THICK.replace("62 mm", "70 mm")
UNIT = "unit of fz: unit of fz: N"


def raw_cells(table):
    with table.open(newline="") as file:
        return [row["conditions"] for row in csv.DictReader(file)]


def test_a_fact_is_a_code_and_its_sentence_is_written_once(tmp_path):
    written = ConditionCodes(tmp_path)
    cells = [f"{THICK}; {UNIT}", "", THICKER, THICK]
    assert written.codes(cells) == ["thickness unit_of_fz", "", "thickness.2", "thickness"]
    assert written.codes(cells[2:]) == ["thickness.2", "thickness"]
    assert len((tmp_path / CONDITIONS).read_text().splitlines()) == 4  # the names of the columns, and three sentences
    read = ConditionCodes(tmp_path)
    assert [read.words(cell) for cell in written.codes(cells)] == cells


def test_two_writers_of_one_folder_keep_the_sentences_of_each_other(tmp_path):
    first, second = ConditionCodes(tmp_path), ConditionCodes(tmp_path)
    codes = [*first.codes([THICK]), *second.codes([THICKER]), *first.codes([UNIT])]
    assert codes == ["thickness", "thickness.2", "unit_of_fz"]
    assert [ConditionCodes(tmp_path).words(code) for code in codes] == [THICK, THICKER, UNIT]
    assert first.words("thickness.2") == THICKER  # which came after the first had read


def test_a_sentence_that_was_torn_is_written_again(tmp_path):
    ConditionCodes(tmp_path).codes([THICK])
    path = tmp_path / CONDITIONS
    whole = path.read_bytes()
    path.write_bytes(whole + b'thickness.2,thickness,"specimen thi')
    codes = ConditionCodes(tmp_path).codes([UNIT])
    assert path.read_bytes() == whole + b"unit_of_fz,unit of fz,unit of fz: N\n"
    assert ConditionCodes(tmp_path).words(codes[0]) == UNIT


def test_a_fact_without_its_sentence_is_still_open(tmp_path):
    assert ConditionCodes(tmp_path).words("thickness") == "thickness: its sentence is not in conditions.csv"
    (tmp_path / CONDITIONS).write_text("a,b\n")
    with pytest.raises(LogError, match=r"conditions\.csv: lacks the columns code, fact, sentence"):
        ConditionCodes(tmp_path)


def test_a_folder_has_codes_in_its_rows_and_words_for_its_readers(folder):
    table = folder / "fits" / "fits.csv"
    coded = raw_cells(table)
    assert all(cell and ":" not in cell for cell in coded)
    rows = latest_rows(table)
    assert all(row["conditions"].count(": ") >= len(cell.split()) for row, cell in zip(rows, coded, strict=True))
    assert "thickness" in FitFolder(folder / "fits").rows[0].conditions


def test_the_table_of_an_earlier_version_has_its_words_in_each_row(folder):
    """It is read as it is; where it is rewritten, it has codes."""
    table = folder / "fits" / "fits.csv"
    rows, columns = latest_rows(table), columns_in(table)
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    (folder / "fits" / CONDITIONS).unlink()
    assert ": " in raw_cells(table)[0]
    assert latest_rows(table) == rows
    replace_columns(table, columns)
    assert ": " not in "".join(raw_cells(table))
    assert latest_rows(table) == rows


def test_rows_that_are_written_elsewhere_bring_their_sentences(folder, tmp_path):
    rows = latest_rows(folder / "fits" / "fits.csv")
    other = tmp_path / "other"
    other.mkdir()
    write_rows(other / "fits.csv", columns_in(folder / "fits" / "fits.csv"), rows)
    assert latest_rows(other / "fits.csv") == rows
