"""Groups of files by a pattern of their names."""

import csv

import numpy as np
import pytest

from tests.curves.conftest import press

TIP = ("--tip", "paraboloid 3 mm")


def folder(path, names):
    for k, name in enumerate(names):
        file = path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        table = press(k, 5e4 if "ctrl" in name else 1e5, 300)
        np.savetxt(file, table, delimiter=",", header="time_s,force_N,height_mm", comments="", fmt="%.9g")
    return path


@pytest.mark.slow
def test_files_are_grouped_by_their_names(palpate, tmp_path, monkeypatch):
    """It was refused: with a pipeline it splits a log, and a table of the names had to be written by hand."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("palpate_fits.name_groups._MAX_GROUPS", 3)
    folder(tmp_path / "in", ["ctrl_1.csv", "ctrl_2.csv", "day2/treat_1.csv", "blank.csv"])
    told = palpate("fit", "in", *TIP, "--by", "(?P<arm>ctrl|treat)_(\\d)", "-o", "fits")
    with (tmp_path / "fits" / "curves.csv").open() as file:
        groups = {row["curve"]: (row["arm"], row["group2"]) for row in csv.DictReader(file)}
    assert groups["in/ctrl_1.csv"] == ("ctrl", "1")
    assert groups["in/day2/treat_1.csv"] == ("treat", "1")
    assert groups["in/blank.csv"] == ("", "")
    assert "median (quartiles) of the groups" in told.stdout
    assert "ctrl 2" in told.stdout
    assert "and 1 more" in told.stdout


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("(ctrl", "is not a pattern of names"),
        ("ctrl", "has no group in brackets"),
        ("(?P<file>ctrl)", "a group cannot be called 'file'"),
        ("(knee|hip)", "no name has it, such as 'ctrl_1.csv'"),
    ],
)
def test_a_pattern_that_groups_nothing_is_refused(palpate, tmp_path, pattern, words):
    folder(tmp_path / "in", ["ctrl_1.csv"])
    refused = palpate("fit", str(tmp_path / "in"), *TIP, "--by", pattern)
    assert refused.returncode == 2
    assert words in refused.stderr
