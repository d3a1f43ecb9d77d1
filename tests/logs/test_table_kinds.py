"""Tables of many programs and laboratories: each is read rightly, or asks for what it does not state."""

import sys

import numpy as np
import palpate
import pytest
from palpate import ConfigurationError, LogError
from palpate_logs.csv_replay import CsvReplay

from tests.logs.table_kinds import FILES, KINDS, Press, halves, plain, press, table

NAMES = [kind.name for kind in KINDS]


def device(path, choices=None, **changes):
    """The device that is suggested for a file, which way its channels count, and what it asks."""
    suggestion = CsvReplay.suggest(path, choices or {})
    tables = {key: value for key, value in suggestion.device.items() if key != "type"} | changes
    return (
        tables,
        {role: suggestion.alignment[role]["sign"] for role in tables["columns"] if role in suggestion.alignment},
        suggestion.blanks,
    )


def read(tables, signs):
    log = CsvReplay.model_validate(tables)
    with log.connect(0) as link:
        batches = list(link.batches())
    values = np.concatenate([batch.values for batch in batches])
    columns = dict(zip(tables["columns"], values.T, strict=True))
    time = np.concatenate([batch.time for batch in batches]) / 1e9
    return Press(time, signs["position"] * columns["position"], signs["force"] * columns["force"])


def assert_same(found, wanted):
    assert len(found.t) == len(wanted.t)
    np.testing.assert_allclose(found.f, wanted.f, atol=2e-3 * np.ptp(wanted.f))
    np.testing.assert_allclose(found.z - found.z[0], wanted.z - wanted.z[0], atol=2e-3 * np.ptp(wanted.z))
    np.testing.assert_allclose(found.t - found.t[0], wanted.t - wanted.t[0], atol=1e-3)


@pytest.mark.parametrize("kind", KINDS, ids=NAMES)
def test_force_height_and_time_are_those_of_the_press(tmp_path, kind):
    if kind.suffix == ".xlsx":
        pytest.importorskip("openpyxl")
    for number in range(FILES):
        p = press(number)
        path = tmp_path / f"{number}{kind.suffix}"
        path.write_bytes(kind.write(p, number))
        assert CsvReplay.recognises(path)
        tables, signs, blanks = device(path, {"rate": kind.timing} if kind.timing else None)
        assert [text.partition(":")[0] for text in blanks] == [*kind.answers]
        for key, answer in kind.answers.items():
            _, role, setting = key.split(".")
            tables["columns"][role][setting] = answer(number)
        assert_same(read(tables, signs), halves(p)[0] if kind.part == "approach" else p)


def test_nearly_all_files_need_no_question_and_many_are_those_of_known_programs():
    asking = [kind for kind in KINDS if kind.answers]
    assert len(KINDS) * FILES >= 200
    assert len(asking) <= 0.1 * len(KINDS)
    assert sum(FILES for kind in KINDS if kind.source) >= 40


@pytest.mark.parametrize("name", [kind.name for kind in KINDS if kind.timing])
def test_a_table_without_time_asks_for_its_rate(tmp_path, name):
    kind = KINDS[NAMES.index(name)]
    path = tmp_path / "a.csv"
    path.write_bytes(kind.write(press(0), 0))
    tables, _, blanks = device(path)
    assert tables["rate"] == "? Hz"
    assert blanks[0].startswith("rate: ")


def written(path, text):
    path.write_text(text)
    return path


PLAIN = table(plain(press(1)))
ROWS = PLAIN.partition("\n")[2]
COLUMNS = {"force": {"column": 1, "unit": "N"}, "position": {"column": 2, "unit": "mm"}}
TIME = {"column": 0, "unit": "s"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            PLAIN + PLAIN,
            r"a\.csv:402: column 1 holds 'force_N', which is not a number",
        ),  # two tables, one below the other
        ("0.1,1\n" + ROWS, r"a\.csv:1: the line has 2 cells, those below it 3; header = LINE"),
        ("name\n0.1,1\n" + ROWS, r"a\.csv:2: the line has 2 cells, those below it 3"),
        (PLAIN + "mean,1.2,0.3\n9,1.0,2.0\n", r"a\.csv:402: column 0 holds 'mean', which is not a number"),
        ("time,force,height\ns,kN,mm\n" + ROWS, r"a\.csv:2: the row of units says 'kN' for column 1, and not 'N'"),
        ("# only\n# comments\n", "no rows of numbers"),
    ],
)
def test_no_line_with_numbers_is_left_out_in_silence(tmp_path, text, words):
    path = written(tmp_path / "a.csv", text)
    log = CsvReplay.model_validate({"file": path, "columns": COLUMNS, "time": TIME})
    with log.connect(0) as link, pytest.raises(LogError, match=words):
        list(link.batches())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "t;F [mN];z [um]\n" + "".join(f"{i};1,{i}00;2,{i}00\n" for i in range(1, 9)),
            "can be one and a fraction or a thous",
        ),
        (
            "t,F,z\n" + "".join(f"{i},0,{i},5,{i},2\n" for i in range(1, 9)),
            "between commas: write the numbers with points",
        ),
    ],
)
def test_commas_that_can_mean_two_things_are_asked_for(tmp_path, text, words):
    with pytest.raises(LogError, match=words):
        CsvReplay.suggest(written(tmp_path / "a.csv", text), {})


def test_what_a_comma_means_can_be_stated(tmp_path):
    rows = "".join(
        f"{x:.3f};{1 + y:.3f}\n".replace(".", ",") for x, y in zip(press(0).f + 1, 1e3 * press(0).z, strict=True)
    )
    path = written(tmp_path / "a.csv", "F [N];z [mm]\n" + rows.replace("-", ""))
    for key in ("decimal", "thousands"):
        tables, _, _ = device(path, {key: ",", "rate": "250 Hz"})
        assert tables[key] == ","


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"header": 2}, "force,time,height\ntime,force,height\n" + ROWS),
        ({"header": 0}, "height,time,force\n" + ROWS),
        ({"units": 0}, "time,force,height\ns,kN,mm\n" + ROWS),
        ({"units": 3}, "time,force,height\n-,-,-\ns,N,mm\n" + ROWS),
        ({"comment": "//"}, "time,force,height\n// 1,2,3\n" + ROWS + "// 4,5,6\n"),
        ({"encoding": "utf-16-le"}, None),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_lines_and_encoding_that_are_stated(tmp_path, changes, text):
    path = tmp_path / "a.csv"
    path.write_bytes(PLAIN.encode("utf-16-le") if text is None else text.encode())
    tables = {"file": path, "columns": COLUMNS, "time": TIME, **changes}
    assert_same(read(tables, {"position": 1, "force": 1}), press(1))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"encoding": "latin-11"}, "no such encoding; did you mean 'latin-1'"),
        ({"decimal": ",", "thousands": ","}, "is the mark before the decimals"),
        ({"header": 9}, "header = 9: that line holds numbers; rows of numbers begin in line 10"),
        ({"encoding": "ascii"}, "is not a text in ascii: state another encoding"),
    ],
)
def test_keys_that_cannot_be(tmp_path, changes, words):
    path = written(tmp_path / "a.csv", "time,force,höhe\n" + ROWS)
    with pytest.raises((ValueError, LogError), match=words):
        read({"file": path, "columns": COLUMNS, "time": TIME, **changes}, {"position": 1, "force": 1})


def test_a_workbook_needs_openpyxl_and_must_be_one(tmp_path, monkeypatch):
    pytest.importorskip("openpyxl")
    path = written(tmp_path / "a.xlsx", "no workbook")
    with pytest.raises(LogError, match="is not a workbook that can be read"):
        CsvReplay.suggest(path, {})
    path.write_bytes(KINDS[NAMES.index("workbook")].write(press(0), 1))
    with pytest.raises(LogError, match=r"no sheet 'dato'; did you mean 'data'\? \(there are: Sheet, data\)"):
        CsvReplay.suggest(path, {"sheet": "dato"})
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(LogError, match=r"needs openpyxl: pip install 'palpate\[excel\]'"):
        CsvReplay.suggest(path, {"sheet": "data"})


def folder(path):
    """Three files that are read alike, one with another separator, one without a time, one that is none."""
    path.mkdir()
    for number in range(3):
        above = ["Operator: A. B."] * number  # lines above the header may differ
        written(path / f"{number}.csv", table(plain(press(number)), above=above))
    written(path / "tabs.txt", table(plain(press(3)), "\t"))
    written(path / "timeless.csv", table(plain(press(4))[1:]))
    written(path / "words.csv", "a,b\nc,d\n")
    written(path / "README.txt", "These are presses, of Tuesday, and of Wednesday.\n")
    return path


@pytest.mark.slow
def test_a_folder_is_suggested_once_and_what_is_unlike_is_named(tmp_path, monkeypatch, palpate):
    monkeypatch.chdir(tmp_path)
    folder(tmp_path / "curves")
    done = palpate("info", "curves", "--suggest", "-o", "reader.toml")
    assert done.returncode == 0
    lines = done.stderr.splitlines()
    assert lines[0] == "reader.toml: 3 files read alike: 0.csv, 1.csv, 2.csv"
    assert lines[1] == "reader-2.toml: 1 file with another delimiter: tabs.txt"
    assert lines[2].startswith(
        "reader-3.toml: 1 file with another time.column, time.unit, alignment.gap, ...: timeless.csv"
    )
    assert lines[4] == "curves/words.csv: the file contains no rows of numbers"
    assert "README" not in done.stderr
    fitted = palpate("info", "curves", "--suggest", "-o", "reader.toml")
    assert fitted.returncode == 2
    assert "exists already" in fitted.stderr
    assert not (tmp_path / "reader-4.toml").exists()
    text = (tmp_path / "reader.toml").read_text()
    assert 'file = "curves/0.csv"' in text


@pytest.mark.parametrize(("name", "words"), [("a.csv", "no rows of numbers"), ("a.toml", "holds no file that palpate")])
def test_a_folder_without_logs_says_so(tmp_path, palpate, name, words):
    written(tmp_path / name, "a,b\nc,d\n")
    assert "is a folder; with --suggest" in palpate("info", str(tmp_path)).stderr
    refused = palpate("info", str(tmp_path), "--suggest")
    assert refused.returncode == 2
    assert words in refused.stderr


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ({"decmal": ","}, "a table has no 'decmal'; did you mean 'decimal'"),
        ({"decimal": ";"}, 'decimal = \';\': expected "." or ","'),
        ({"header": "first"}, "header = 'first': expected a line, counted from 1, or 0"),
        ({"columns.force.scale": "much"}, "columns.force.scale = 'much': expected a number"),
    ],
)
def test_what_cannot_be_stated_of_a_table(tmp_path, choices, words):
    path = tmp_path / "a.csv"
    path.write_bytes(KINDS[NAMES.index("volts")].write(press(0), 0))
    with pytest.raises(LogError, match=words):
        CsvReplay.suggest(path, choices)


def test_python_asks_and_takes_the_answer(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(KINDS[NAMES.index("volts")].write(press(0), 0))
    with pytest.raises(ConfigurationError, match=r'state it in signals=\{"columns\.force\.scale": \.\.\.\}'):
        palpate.read(path)
    record = palpate.read(path, signals={"columns.force.scale": 0.025})
    assert record.devices["log"]["columns"]["force"] == {"column": "Force [mV]", "unit": "N", "scale": 0.025}
