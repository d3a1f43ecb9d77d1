"""Files that come into the folder of the curves are found, and one key says where that folder is."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.folder_settings import curves_folder, settings_text, write_dialects

from tests.curves.conftest import press
from tests.curves.test_bags_of_parts import parts

HEAD = "time_s,force_N,height_mm"


def curve(path, seed, head=HEAD, delimiter=",", factor=(1.0, 1.0, 1.0)):
    path.parent.mkdir(parents=True, exist_ok=True)
    table = press(seed, n=300) * factor
    np.savetxt(path, table, delimiter=delimiter, header=head, comments="", fmt="%.9g")


@pytest.fixture(scope="module")
def fitted_once(tmp_path_factory):
    """Two curves and one of another dialect, fitted."""
    from tests.command import call

    place = tmp_path_factory.mktemp("new")
    curve(place / "in" / "a.csv", 0)
    curve(place / "in" / "b.csv", 1)
    curve(place / "in" / "c.csv", 2, "t;F;z", ";", (1.0, 1e3, 1.0))
    facts = ("--set", "device.log.columns.force.unit=mN", "--thickness", "30 mm")
    (place / "rig.toml").write_text('tip = "paraboloid 3 mm"\n[units]\nF = "mN"\nz = "mm"\n')
    done = call("fit", "in", "--rig", "rig.toml", *facts[2:], "-o", "fits", cwd=place)
    assert done.returncode == 0, done.stderr
    return place


@pytest.fixture
def place(fitted_once, tmp_path, monkeypatch):
    shutil.copytree(fitted_once, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def dialects(place):
    with (place / "fits" / "curves.csv").open() as file:
        return {row["curve"]: row["dialect"] for row in csv.DictReader(file)}


@pytest.mark.parametrize("run", ["run = 5", "[run]\ncurves = 5", '[run]\ncurves = "/nowhere"'])
def test_settings_that_are_damaged_are_no_traceback(tmp_path, run):
    (tmp_path / "pipeline.toml").write_text(run + "\n")
    assert curves_folder(tmp_path) in (None, tmp_path / "5", Path("/nowhere"))
    assert "curves" not in settings_text(tmp_path / "pipeline.toml")
    write_dialects(tmp_path / "pipeline.toml", {"": '[run]\nname = "a"\n'})


@pytest.mark.slow
def test_new_files_are_fitted_as_those_that_are_written_alike(palpate, place):
    """They were not seen: the folder knew the files of its first day."""
    assert dialects(place) == {"in/a.csv": "", "in/b.csv": "", "in/c.csv": "d2"}
    curve(place / "in" / "day 2" / "d.csv", 3)
    curve(place / "in" / "e.csv", 4, "t;F;z", ";", (1.0, 1e3, 1.0))
    curve(place / "in" / "f.csv", 5, "Zeit [s]\tKraft [mN]\tWeg [mm]", "\t", (1.0, 1e3, 1.0))
    (place / "in" / "old.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    told = palpate("fit", "fits")
    assert told.returncode == 1, told.stderr  # old.xls
    assert "3 curves fitted again" in told.stdout
    assert "save it as .xlsx" in told.stderr
    assert dialects(place) == {
        "in/a.csv": "", "in/b.csv": "", "in/c.csv": "d2", "in/day 2/d.csv": "", "in/e.csv": "d2", "in/f.csv": "d3",
    }  # fmt: skip
    folder = FitFolder(place / "fits")
    values = [row.number("elasticity") for row in folder.rows]
    np.testing.assert_allclose(values, 1e5 * 0.85, rtol=0.2)
    assert {row.state for row in folder.rows} == {"current"}
    again = json.loads(palpate("fit", "fits", "--json").stdout)
    assert again["fitted"] == 0
    assert list(again["not_read"]) == ["in/old.xls"]


@pytest.mark.slow
def test_one_key_says_where_the_curves_are(palpate, place, tmp_path_factory):
    """Every line of curves.csv had to be changed; and no value is of another day since."""
    elsewhere = tmp_path_factory.mktemp("server")
    shutil.move(place / "in", elsewhere / "gels")
    settings = place / "fits" / "pipeline.toml"
    text = settings.read_text()
    assert 'curves = "../in"' in text
    settings.write_text(text.replace('curves = "../in"', f'curves = "{elsewhere}/gels"'))
    folder = FitFolder(place / "fits")
    assert {row.state for row in folder.rows} == {"current"}
    assert [curve.file for curve in folder.curves()] == [f"{elsewhere}/gels/{name}.csv" for name in "abc"]
    done = palpate("fit", "fits", "--set", "alignment.tip_mass=1 g")
    assert "3 curves fitted again" in done.stdout, done.stderr
    assert f'curves = "{elsewhere}/gels"' in settings.read_text()


@pytest.mark.slow
def test_a_new_bag_is_one_more_of_its_kind(palpate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parts(tmp_path / "in" / "one", metadata=True)
    assert palpate("fit", "in", "--tip", "paraboloid 5 mm", "-o", "fits").returncode in (0, 1)
    parts(tmp_path / "in" / "two", metadata=True)
    told = palpate("fit", "fits")
    assert "1 curve fitted again" in told.stdout, told.stderr
    assert dialects(tmp_path) == {"in/one": "", "in/two": ""}
