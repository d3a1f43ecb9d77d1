"""Which commands and versions made the rows of a folder of fits; and nothing in it names a folder of this machine."""

import json

import pytest
from palpate import LogError
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import error_rows
from palpate_kit.curves.curve_pipelines import curve_reader
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.curves.fit_provenance import add_provenance, read_provenance


def test_a_folder_says_what_made_its_rows(folder):
    (entry,) = read_provenance(folder / "fits")
    assert entry.command.startswith("palpate fit ../curves --tip 'paraboloid 3 mm'")
    assert entry.command.endswith("--out . --jobs 1")
    assert {"palpate", "python", "casadi", "numpy", "scipy"} <= set(entry.versions)


def test_each_command_is_noted_once_with_paths_as_seen_from_the_folder(folder, monkeypatch):
    for words in (["palpate", "fit", "fits"], ["palpate", "fit", "fits"], ["python", "x"]):
        monkeypatch.setattr("sys.argv", words)
        add_provenance(folder / "fits")
    monkeypatch.setattr(
        "sys.argv", ["palpate", "fit", f"{folder}/fits", f"--groups={folder}/groups.csv", "--track=none"]
    )
    add_provenance(folder / "fits")
    commands = [entry.command for entry in read_provenance(folder / "fits")]
    assert commands[1:] == ["palpate fit .", "in Python", "palpate fit . --groups=../groups.csv --track=none"]


@pytest.mark.parametrize("text", ["{", '{"command": 1}', '[{"command": "x"}]', "[1]"])
def test_what_is_no_provenance_is_named(folder, text):
    (folder / "fits" / "provenance.json").write_text(text)
    with pytest.raises(LogError, match=r"provenance\.json"):
        read_provenance(folder / "fits")


def test_an_error_of_a_curve_names_it_as_its_row_does(folder):
    curve = FitFolder(folder / "fits").curves()[0]
    rows = list(
        error_rows(curve_reader(FitFolder(folder / "fits")), curve, LogError(f"{curve.file}: has no column force"))
    )
    assert [row["error"] for row in rows] == ["has no column force"]
    assert isinstance(curve, Curve)


@pytest.mark.slow
def test_the_file_of_facts_goes_along_with_the_fits(folder, palpate):
    (folder / "curves" / "rig.toml").write_text('tip = "paraboloid 3 mm"\ninstrument = "a press"\n')
    done = palpate("fit", "curves", "--out", "mine", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert (folder / "mine" / "rig.toml").read_bytes() == (folder / "curves" / "rig.toml").read_bytes()
    assert json.loads((folder / "mine" / "provenance.json").read_text())
