"""A CSV file of plain numbers is read at once, any other line by line: with the same numbers and the same refusals."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_link import CsvLink
from palpate_logs.csv_replay import CsvReplay

ROWS = "".join(f"{i},{i * 0.25:.8g},{-i}e-3\n" for i in range(30))
LONG = "".join(f"{i},{i / 7:.17g},{np.sin(i):.17g}\n" for i in range(9000))
TEXTS = {
    "plain": ROWS,
    "windows": ROWS.replace("\n", "\r\n"),
    "old mac": ROWS.replace("\n", "\r"),
    "no end": ROWS.rstrip("\n"),
    "header": "a,b,c\n" + ROWS,
    "header alone": "a,b,c\n",
    "long": LONG,
    "long with header": "a,b,c\n" + LONG,
    "late blank line": LONG + "\n" + ROWS,
    "late text": LONG + "1,x,2\n",
    "late quotes": LONG + '1,"2",3\n',
    "quoted header": '"a","b","c"\n' + ROWS,
    "quoted line end": '1,2,"3\n"\n' + ROWS,
    "blank lines": "\n\n" + ROWS + "\n1,2,3\n",
    "spaces": ROWS.replace(",", ", "),
    "empty cell": ROWS + "1,,3\n",
    "cut cell": ROWS + "1,2e,3\n",
    "two signs": ROWS + "1,2-5,3\n",
    "cut line": ROWS + "1,2\n",
    "cell too many": ROWS + "1,2,3,4\n",
    "empty cell too many": ROWS + "1,2,3,\n",
    "infinite": ROWS + "inf,nan,3\n",
    "overflow": ROWS + "1e999,2,3\n",
    "nothing": "",
    "only line ends": "\n\n",
    "one column": "1\n2\n",
}


def read(path, delimiter):
    log = CsvReplay(
        file=path, delimiter=delimiter, rate="500 Hz",
        columns={"a": {"column": 0, "unit": "mm"}, "c": {"column": 2, "unit": "N"}},
    )  # fmt: skip
    try:
        with log.connect(0) as link:
            batches = list(link.batches())
    except LogError as error:
        return str(error)
    return np.concatenate([b.values for b in batches]), np.concatenate([b.time for b in batches])


@pytest.mark.parametrize("delimiter", [",", ";", "\t"], ids=["comma", "semicolon", "tab"])
@pytest.mark.parametrize("name", TEXTS)
def test_both_ways_read_the_same(tmp_path, monkeypatch, name, delimiter):
    path = tmp_path / "log.csv"
    path.write_bytes(TEXTS[name].replace(",", delimiter).encode())
    found = read(path, delimiter)
    monkeypatch.setattr(CsvLink, "_plain_numbers", lambda self, text: None)
    expected = read(path, delimiter)
    if isinstance(expected, str):
        assert found == expected
    else:
        np.testing.assert_array_equal(found[0], expected[0])
        np.testing.assert_array_equal(found[1], expected[1])


def test_plain_numbers_are_not_read_line_by_line(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text("a,b,c\n" + LONG)
    monkeypatch.setattr(CsvLink, "_blocks_by_line", None)
    assert len(read(path, ",")[0]) == 9000


@pytest.mark.parametrize("form", ["%.17g", "%.8g", "%.18e", "%+.3f", "%.25g", "%.0f"])
def test_plain_numbers_are_rounded_as_those_that_are_read_one_by_one(tmp_path, form):
    random = np.random.default_rng(5)
    texts = [form % value for value in random.standard_normal(3000) * 10.0 ** random.integers(-9, 12, 3000)]
    (tmp_path / "log.csv").write_text("".join(",".join(texts[i : i + 3]) + "\n" for i in range(0, 3000, 3)))
    columns = {name: {"column": i, "unit": "1"} for i, name in enumerate("abc")}
    log = CsvReplay.model_validate({"file": tmp_path / "log.csv", "rate": 500.0, "columns": columns}, strict=False)
    with log.connect(0) as link:
        values = np.concatenate([batch.values for batch in link.batches()])
    assert np.array_equal(values.ravel(), [float(text) for text in texts])
