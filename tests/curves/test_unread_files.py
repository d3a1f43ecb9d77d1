"""Files of a folder that hold records which no device reads: a row each, with what to do."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.logs.draft_pipeline import UNREAD, recording_of

from tests.fit_tables import write_fits


def write_press(path):
    """A press of a stiff half-space with air before and after it."""
    time = np.arange(200) / 100.0
    height = 1.0 - 2.0 * np.clip(time - 0.5, 0.0, 1.0)
    force = 0.5 * np.maximum(-height, 0.0) ** 1.5 + 1e-3 * np.random.default_rng(0).standard_normal(200)
    rows = "".join(f"{t:.3f},{z:.5f},{f:.5f}\n" for t, z, f in zip(time, height, force, strict=True))
    path.write_text("time (s),height (mm),force (N)\n" + rows)


@pytest.mark.parametrize("ending", UNREAD)
def test_a_format_that_nothing_reads_says_what_to_do(tmp_path, ending):
    path = tmp_path / f"record{ending.upper()}"
    path.write_bytes(b"\0\1\2")
    with pytest.raises(LogError, match=f"\\{ending} files are not read: "):
        recording_of(path)


def test_a_file_that_cannot_be_read_is_a_row(palpate, tmp_path):
    """It was in no row and in no count."""
    (tmp_path / "old.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    write_press(tmp_path / "press.csv")
    found = palpate("fit", str(tmp_path), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fit"))
    rows = {row["curve"].rpartition("/")[2]: row for row in json.loads(found.stdout)["files"]}
    assert set(rows) == {"old.xls", "press.csv"}
    assert "save it as .xlsx" in rows["old.xls"]["error"]
    assert found.returncode == 1


def unread_in(table):
    """Files of fits.csv that were not read, and why."""
    with table.open(newline="") as file:
        return {Path(row["curve"]).name: row["error"] for row in csv.DictReader(file) if not row["track"]}


@pytest.mark.slow
def test_a_file_that_cannot_be_read_is_a_row_of_the_table(palpate, tmp_path):
    """An empty notes.csv was a row on the screen, and none in fits.csv; read later, it is a curve like any other."""
    curves, table = tmp_path / "curves", tmp_path / "fit" / "fits.csv"
    curves.mkdir()
    write_press(curves / "press.csv")
    (curves / "notes.csv").write_text("")
    words = ("fit", "curves", "--tip", "paraboloid 3 mm", "-o", "fit")
    shown = palpate(*words)
    assert shown.returncode == 1
    assert re.search(r"^2 files\. E: .*; 1 not read$", shown.stdout, re.M)
    assert unread_in(table) == {"notes.csv": "the file is empty"}
    first = table.read_bytes()
    assert palpate("fit", "fit").returncode == 1
    palpate(*words)
    assert table.read_bytes() == first
    write_press(curves / "notes.csv")
    again = palpate("fit", "fit")
    assert again.returncode == 0, again.stderr
    assert "1 curve fitted again" in again.stdout
    assert unread_in(table) == {}
    (curves / "empty.csv").write_text("")
    palpate("fit", "fit")
    assert unread_in(table) == {"empty.csv": "the file is empty"}
    (curves / "empty.csv").unlink()
    assert palpate("fit", "fit").returncode == 0
    assert unread_in(table) == {}


def test_files_that_were_not_read_are_no_curves_of_a_folder(tmp_path):
    """They have no settings that could change."""
    write_fits(tmp_path / "fits", {"a.csv": 1e5}, {"a.csv": {"treatment": "t"}})
    table = tmp_path / "fits" / "fits.csv"
    columns = table.read_text().splitlines()[0].split(",")
    cells = {"curve": "notes.csv", "error": "the file is empty"}
    table.write_text(table.read_text() + ",".join(cells.get(name, "") for name in columns) + "\n")
    folder = FitFolder(tmp_path / "fits")
    assert folder.names == ["a.csv"]
    assert unread_in(table) == {"notes.csv": "the file is empty"}
