"""Several tables under each other in one file: each is a record, and one table ends where the next begins."""

import json

import numpy as np
import pytest
from palpate_logs.csv_roles import read_sheet
from palpate_records.tables.table_records import records_in

NAMES = "Time,Extension,Load"


def stacked(path, moduli, title="Specimen {}", units='"(s)","(mm)","(N)"\n'):
    """Presses of a sphere of 3 mm on half-spaces [kPa], each under a title, its names and its units."""
    time = np.arange(300) / 100.0
    depth = np.clip(time - 0.7, 0.0, 2.0) * 0.5 - 0.3
    text = 'Results Table 1\n,"Modulus"\n,"(kPa)"\n1,"30.1"\n\n'
    for k, modulus in enumerate(moduli, 1):
        force = 16 / 9 * 1e3 * modulus * np.sqrt(3e-3) * np.maximum(1e-3 * depth, 0.0) ** 1.5
        force += 1e-3 * np.random.default_rng(k).standard_normal(len(time))
        rows = (f'"{t:.3f}","{d:.5f}","{f:.5f}"\n' for t, d, f in zip(time, depth, force, strict=True))
        text += f"{title.format(k)}\n{NAMES}\n{units}" + "".join(rows) + "\n"
    path.write_text(text)
    return path


@pytest.mark.parametrize("title", ["Specimen {}", "again"])
def test_every_table_of_a_file_is_a_specimen(tmp_path, title):
    path = stacked(tmp_path / "two.csv", (30.0, 60.0), title)
    names = [record.name for record in records_in(path)]
    assert names == (["Specimen 1", "Specimen 2"] if "{}" in title else ["1", "2"])
    for name in names:
        assert len(read_sheet(path, {"record": name}).values) == 300


def test_one_table_is_the_file(tmp_path):
    assert records_in(stacked(tmp_path / "one.csv", (30.0,))) == ()


@pytest.mark.parametrize("has_time", [True, False])
def test_words_within_a_table_are_passed_over_with_a_note_where_rows_have_a_time(palpate, tmp_path, has_time):
    """What goes on after a line of words is no other table; without a time nothing shows what was lost there."""
    path = stacked(tmp_path / "broken.csv", (30.0,))
    lines = path.read_text().splitlines(keepends=True)
    lines = lines if has_time else [line.partition(",")[2] or line for line in lines]
    path.write_text("".join([*lines[:150], "lost connection\n", *lines[150:]]))
    found = palpate("fit", str(path), "--tip", "paraboloid 3 mm", "-o", str(tmp_path / "fit"))
    if has_time:
        assert "a line of words is passed over: 'lost connection'" in found.stderr
        assert found.returncode == 0
    else:
        assert "'lost connection' is not a row of numbers" in found.stderr
        assert found.returncode


@pytest.mark.slow
def test_each_table_is_a_row(palpate, tmp_path):
    """It was refused at the title of the second, with no way on."""
    path = stacked(tmp_path / "two.csv", (30.0, 60.0))
    told = palpate("fit", str(path), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fit"))
    rows = json.loads(told.stdout)["files"]
    assert [row["curve"] for row in rows] == [f"{path}:Specimen 1", f"{path}:Specimen 2"]
    found = [next(float(v) for k, v in row.items() if k.endswith("elasticity")) for row in rows]
    np.testing.assert_allclose(found, [30e3, 60e3], rtol=0.03)
