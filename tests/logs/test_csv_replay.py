"""CSV logs: what is read, and what is refused."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_replay import CsvReplay
from palpate_testing import check_device
from pydantic import ValidationError


def log(path, text, **changes):
    """The device; what is in its file, or None for what is there already."""
    opener = gzip.open if path.suffix == ".gz" else open
    if text is not None:
        with opener(path, "wt") as file:
            file.write(text)
    columns = {"z": {"column": 0, "unit": "mm"}, "fz": {"column": 1, "unit": "N"}}
    return CsvReplay.model_validate({"file": path, "rate": 500.0, "columns": columns, **changes})


def rows(device):
    with device.connect(0) as link:
        batches = list(link.batches())
    return np.concatenate([b.time for b in batches]), np.concatenate([b.values for b in batches])


NUMBERS = "1.5,2\n2.5,-3\n3.5,4e-1\n"


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
@pytest.mark.parametrize("header", ["", "height,force\n", "\ufeffz,f\n"])
def test_numbers_units_and_time(tmp_path, name, header):
    device = log(tmp_path / name, header + NUMBERS)
    time, values = rows(device)
    assert time.tolist() == [0, 2_000_000, 4_000_000]
    np.testing.assert_allclose(values, [[0.0015, 2], [0.0025, -3], [0.0035, 0.4]], rtol=1e-15)
    check_device(device)


def test_time_from_a_column_and_other_delimiters(tmp_path):
    text = "t;z;f\n0.5;1;2\n0.502;2;3\n"
    columns = {"z": {"column": 1, "unit": "cm"}, "fz": {"column": 2, "unit": "mN"}}
    time_column = {"column": 0, "unit": "s"}
    device = log(tmp_path / "a.csv", text, rate=None, time=time_column, columns=columns, delimiter=";")
    time, values = rows(device)
    assert time.tolist() == [500_000_000, 502_000_000]
    np.testing.assert_allclose(values, [[0.01, 0.002], [0.02, 0.003]])


def test_columns_by_the_names_in_the_header(tmp_path):
    columns = {"z": {"column": "height", "unit": "mm"}, "fz": {"column": "force", "unit": "N"}}
    device = log(tmp_path / "a.csv", "\ufefft\tforce\t height\n0\t7\t1.5\n", columns=columns, delimiter="\t")
    np.testing.assert_array_equal(rows(device)[1], [[0.0015, 7.0]])
    check_device(device)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,force\n0,7\n", r"no column of the name 'height' \(t, force\)"),
        ("height,height\n0,7\n", "two columns of the name 'height'"),
        ("0,7\n", r"no column of the name 'height' \(its first line contains numbers\)"),
    ],
)
def test_names_that_are_not_there(tmp_path, text, words):
    with pytest.raises(LogError, match=words):
        rows(log(tmp_path / "a.csv", text, columns={"z": {"column": "height", "unit": "mm"}}))


@pytest.mark.parametrize(
    ("text", "delimiter", "advice"), [("z;f\n1,5;2\n", ";", 'decimal = ","'), ("z,f\n1,5,2,0\n", ",", "with points")]
)
def test_decimal_commas_are_refused_with_advice(tmp_path, text, delimiter, advice):
    with pytest.raises(LogError, match=rf"a\.csv:2: .*decimal comma.*{advice}"):
        rows(log(tmp_path / "a.csv", text, delimiter=delimiter))


def test_stamps_since_1970_keep_their_nanoseconds(tmp_path):
    text = "1700000000.25,1\n1700000000.75,2\n"
    columns = {"z": {"column": 1, "unit": "m"}}
    time, _ = rows(log(tmp_path / "a.csv", text, rate=None, time={"column": 0, "unit": "s"}, columns=columns))
    assert time.tolist() == [1_700_000_000_250_000_000, 1_700_000_000_750_000_000]


def test_empty_cells_and_nan_are_invalid_readings(tmp_path):
    _, values = rows(log(tmp_path / "a.csv", "1,2\n,3\n4,nan\n"))
    assert np.isnan(values).sum() == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,2\n3,abc\n", r":2: column 1 holds 'abc', which is not a number"),
        ("1,2\n3\n", r":2: no column 1; the line has 1"),
        ("", "contains no rows of numbers"),
        ("height,force\n", "contains no rows of numbers"),
        ("1,2\nheight,force\n", r":2: column 0 holds 'height'"),
        ("1\0,2\n", "column 0 holds"),
    ],
)
def test_what_is_no_table_of_numbers_is_refused_with_its_line(tmp_path, text, words):
    with pytest.raises(LogError, match=words):
        rows(log(tmp_path / "a.csv", text))


def test_bytes_that_are_no_text(tmp_path):
    device = log(tmp_path / "a.csv", "")
    device.file.write_bytes(b"\xff\xfe\x00\x01" * 100)
    with pytest.raises(LogError, match="is a binary file and no text"):
        rows(device)


def test_a_gzip_that_is_cut(tmp_path):
    device = log(tmp_path / "a.csv.gz", NUMBERS * 1000)
    device.file.write_bytes(device.file.read_bytes()[:-20])
    with pytest.raises(LogError, match="cannot be read"):
        rows(device)


def test_no_file(tmp_path):
    device = log(tmp_path / "a.csv", NUMBERS)
    device.file.unlink()
    with pytest.raises(LogError, match="no such file"):
        _ = device.streams


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate": None}, "give either rate"),
        ({"time": {"column": 0, "unit": "s"}}, "give either rate"),
        ({"columns": {}}, "at least 1 item"),
        ({"columns": {"z": {"column": -1, "unit": "mm"}}}, "greater than or equal to 0"),
        ({"columns": {"z": {"column": 0, "unit": "quux"}}}, "is not one of length"),
        ({"delimiter": ",,"}, "at most 1 character"),
    ],
)
def test_settings_that_make_no_sense(tmp_path, changes, words):
    with pytest.raises(ValidationError, match=words):
        log(tmp_path / "a.csv", NUMBERS, **changes)


def test_a_file_that_is_cut_within_a_line_is_refused(tmp_path):
    whole = "".join(f"{i},{2 * i},3,4\n" for i in range(100))
    assert len(rows(log(tmp_path / "whole.csv", whole))[0]) == 100
    with pytest.raises(LogError, match=r"cut\.csv:100: the last line has 3 of 4 cells, so the file was cut there"):
        rows(log(tmp_path / "cut.csv", whole[:-3]))


FIXED = [f"{i},{np.sin(i):.4f}" for i in range(300)]
SHORTEST = [f"{i},{round(float(np.sin(i)), 3)!r}" for i in range(300)]
POWERS = [f"{i},{np.sin(i) * 1e-5:.3e}" for i in range(300)]
COUNTS = [f"{i},{8000 + (i * 37) % 500}" for i in range(300)]


@pytest.mark.parametrize(
    ("lines", "cut"),
    [
        ([*FIXED, "300,0.12"], True),
        ([*FIXED, "300,0.123\n"], False),  # its line has an end
        ([*FIXED, "300,-0.1234"], False),  # hand-written tables have no last end of line
        ([*FIXED, "300,0."], True),
        ([*FIXED, "300,12"], True),
        ([*FIXED, "300,"], False),  # an empty cell is an invalid reading as ever
        (["a,b", *FIXED[:50], "300,0.1"], False),  # too few above it to tell
        ([*SHORTEST, "300,0.5"], False),  # as short as others are
        ([*SHORTEST, "300,12.51"], False),
        ([*POWERS, "300,1.234e-0"], True),
        ([*POWERS, "300,1.234"], True),
        ([*POWERS, "300,1.234e-06"], False),
        ([*COUNTS, "300,81"], True),
        ([*COUNTS, "300,8111"], False),
        ([*COUNTS, "300,12345"], False),
    ],
)
@pytest.mark.parametrize("line_end", ["\n", "\r\n"], ids=["unix", "windows"])
def test_a_number_that_is_cut_is_left_out_and_said(tmp_path, lines, cut, line_end):
    device = log(tmp_path / "a.csv", line_end.join(lines), columns={"z": {"column": 1, "unit": "m"}})
    count = len(lines) - lines[0].startswith("a")
    assert len(rows(device)[0]) == count - cut
    assert len(device.warnings) == cut
    if cut:
        assert f"its last number, {lines[-1].partition(',')[2]}, fewer digits" in device.warnings[0]
    notes = [note for note in CsvReplay.survey(device.file).notes if "cut within its last number" in note]
    assert len(notes) == cut


def test_a_number_that_nobody_reads_may_be_cut(tmp_path):
    device = log(tmp_path / "a.csv", "\n".join([*FIXED, "300,0.12"]), columns={"z": {"column": 0, "unit": "m"}})
    assert len(rows(device)[0]) == 301
    assert device.warnings == ()


def test_a_packed_table_is_whole(tmp_path):
    device = log(tmp_path / "a.csv.gz", "\n".join([*FIXED, "300,0.12"]), columns={"z": {"column": 1, "unit": "m"}})
    assert len(rows(device)[0]) == 301


def test_of_the_corpus_only_the_cut_one_loses_a_row():
    corpus = Path(__file__).parent / "corpus"
    for name, count in (("cut_within_its_last_number.csv", 399), ("no_last_end_of_line.csv", 400)):
        device = log(corpus / name, None, columns={"z": {"column": "z_m", "unit": "m"}})
        assert len(rows(device)[0]) == count
        assert len(device.warnings) == 400 - count
