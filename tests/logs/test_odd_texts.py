"""Texts of instruments with an odd ending, header or rows: each gives what the plain table does."""

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.draft_pipeline import recording_of, suggestion_of
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import read_sheet

DEPTH = np.interp(np.arange(400.0), [0, 100, 300, 399], [-0.5, -0.5, 2.0, 2.0])
ROWS = [f"{0.01 * i:.2f}\t{d:.5f}\t{np.maximum(d, 0) ** 1.5:.5f}\n" for i, d in enumerate(DEPTH)]
HEAD = "Time [s]\tTravel [mm]\tLoad [N]\n"


def written(path, *parts, encoding="utf-8"):
    path.write_text("".join(parts), encoding=encoding)
    return path


@pytest.mark.parametrize("name", ["press.TRA", "press.tab", "press.prn", "press.001", "press"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_a_text_of_any_ending_is_a_table(tmp_path, name, encoding):
    path = written(tmp_path / name, HEAD, *ROWS, encoding=encoding)
    assert recording_of(path) is CsvReplay
    columns = suggestion_of(path, {}).device["columns"]
    assert (columns["force"]["column"], columns["position"]["column"]) == ("Load [N]", "Travel [mm]")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mesh.obj", "neither a text with rows of numbers"),
        ("table.csv.bak", "neither a text with rows of numbers"),
        (".hidden", "neither a text with rows of numbers"),
        ("notes.json", "cannot be read as .json"),
    ],
)
def test_a_text_that_holds_no_record_is_not_read(tmp_path, name, words):
    with pytest.raises(LogError, match=words):
        recording_of(written(tmp_path / name, HEAD, *ROWS))


def test_a_text_without_rows_of_numbers_is_not_read(tmp_path):
    with pytest.raises(LogError, match="neither a text with rows of numbers"):
        recording_of(written(tmp_path / "notes.abc", "The tip was cleaned.\n" * 50))


@pytest.mark.parametrize("divider", ["eoh", "----\t----\t----", "=" * 30, "[data]", "***End_of_Header***", "DATA"])
def test_a_line_between_header_and_rows_takes_no_name(tmp_path, divider):
    sheet = read_sheet(written(tmp_path / "press.txt", HEAD, f"{divider}\n", *ROWS), {}).sheet
    assert sheet.names == ("Time [s]", "Travel [mm]", "Load [N]")


def test_lines_of_words_between_rows_are_passed_over_with_a_note(tmp_path):
    path = written(
        tmp_path / "press.txt", HEAD, *ROWS[:150], "EVENT hold\n", *ROWS[150:300], "EVENT end\n", *ROWS[300:]
    )
    assert "2 lines of words are passed over: 'EVENT hold'" in suggestion_of(path, {}).doubts
    assert len(read_sheet(path, {}).values) == len(ROWS)


def test_a_text_in_a_row_is_refused_with_its_line(tmp_path, palpate):
    path = written(tmp_path / "press.txt", HEAD, *ROWS[:150], "1.50\tabc\t0.1\n", *ROWS[150:])
    done = palpate("fit", str(path), "--tip", "paraboloid 3 mm", "-o", str(tmp_path / "fits"))
    assert done.returncode
    assert "press.txt:152: column 1 holds 'abc'" in done.stderr
