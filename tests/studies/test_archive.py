"""A folder of fits packed, moved, and made again; a stranger's settings read nothing outside and execute nothing."""

import getpass
import json
import os
import re
import zipfile
from functools import partial

import pytest
from palpate import trust

from tests.command import call
from tests.curves.conftest import TIP
from tests.studies.study_folder import copied, made, members, packed, rows_of

pytestmark = pytest.mark.slow
FEW = ["control/a_0.csv", "control/b_0.csv", "treated/a_0.csv", "treated/b_0.csv"]


@pytest.fixture(scope="module")
def study_once(tmp_path_factory):
    """Four curves, their fits, and the archive."""
    folder = made(tmp_path_factory.mktemp("study"), FEW)
    (folder / "fits" / "rig.toml").write_text('instrument = "a press"\n')
    done = call("pack", "fits", "-o", "study.zip", "--by", "treatment", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def study(study_once, tmp_path, monkeypatch):
    """A copy of it as the current folder, where nobody has approved a plugin file."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_PROCESS", trust._Consent())
    monkeypatch.setattr(trust, "_consent", trust.ContextVar("_consent", default=trust._PROCESS))
    copied(study_once, tmp_path / "study")
    monkeypatch.chdir(tmp_path / "study")
    return tmp_path / "study"


@pytest.fixture
def palpate(study):
    """The command line in the folder of the study."""
    return partial(call, cwd=study)


def altered(study, change):
    """An archive whose contents were changed, with hashes that fit."""
    contents = members(study / "study.zip")
    change(contents)
    return packed(study / "altered.zip", contents)


def test_an_archive_has_all_of_a_study_and_nothing_of_the_machine(study):
    contents = members(study / "study.zip")
    assert {f"curves/{name}" for name in FEW} <= set(contents)
    assert {f"fits/{name}" for name in ("fits.csv", "conditions.csv", "curves.csv", "pipeline.toml", "review.json",
            "provenance.json", "rig.toml", "report.html", "methods.txt", "methods.tex", "methods.bib", "supplement.csv",
            "supplement.tex", "pictures/elasticity-groups.svg")} <= set(contents)  # fmt: skip
    for name, content in contents.items():
        text = content.decode()
        assert str(study.parent) not in text, name
        assert not re.search(rf"/(home|Users|tmp)/|/{re.escape(getpass.getuser())}/", text), name
    assert all(re.match(r"\.\./curves/", row["file"]) for row in rows_of(contents["fits/curves.csv"]))
    with zipfile.ZipFile(study / "study.zip") as archive:
        assert archive.namelist() == sorted(archive.namelist())
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_same_study_is_the_same_bytes_wherever_it_is(study, tmp_path):
    elsewhere = copied(study, tmp_path / "another" / "place")
    os.utime(elsewhere / "fits" / "fits.csv", (1, 1))
    done = call("pack", elsewhere / "fits", "-o", "again.zip", "--by", "treatment", cwd=elsewhere)
    assert done.returncode == 0, done.stderr
    assert (elsewhere / "again.zip").read_bytes() == (study / "study.zip").read_bytes()


def test_names_of_curves_that_are_paths_lose_their_folders(study, palpate):
    done = palpate("fit", study / "control", "--tip", "paraboloid 3 mm", "--out", "mine", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert f"\n{study}/control/a_0.csv," in (study / "mine" / "fits.csv").read_text()
    done = palpate("pack", "mine", "-o", "mine.zip")
    assert done.returncode == 0, done.stderr
    contents = members(study / "mine.zip")
    assert not [name for name, content in contents.items() if str(study).encode() in content]
    assert {row["curve"] for row in rows_of(contents["fits/fits.csv"])} == {"a_0.csv", "b_0.csv"}


def test_a_moved_archive_is_made_again_to_the_byte(study, tmp_path):
    lone = tmp_path / "lone"
    lone.mkdir()
    (study / "study.zip").rename(lone / "study.zip")
    before = sorted(path.name for path in lone.iterdir())
    done = call("verify", "study.zip", cwd=lone)
    assert done.returncode == 0, done.stderr
    assert "4 curves" in done.stdout
    assert "same to the byte: fits.csv, report.html, methods.txt" in done.stdout
    assert sorted(path.name for path in lone.iterdir()) == before


def test_a_study_of_one_folder_is_made_again_to_the_byte(study, palpate):
    """Its pipeline names the folder of its curves, which is another one in the archive."""
    (study / "presses").mkdir()
    (study / "control").rename(study / "presses" / "control")
    assert palpate("fit", "presses/control", *TIP, "--out", "one").returncode == 0
    assert 'curves = "../presses/control"' in (study / "one" / "pipeline.toml").read_text()
    assert palpate("pack", "one", "-o", "one.zip").returncode == 0
    (study / "presses").rename(study / "elsewhere")
    done = palpate("verify", "one.zip")
    assert (done.returncode, "same to the byte" in done.stdout) == (0, True), done.stdout + done.stderr


def test_a_number_that_was_changed_is_named(study, palpate):
    value = rows_of(members(study / "study.zip")["fits/fits.csv"])[0]["elasticity"]

    def change(contents):
        table = contents["fits/fits.csv"].decode()
        contents["fits/fits.csv"] = table.replace(value, repr(1.01 * float(value)), 1).encode()

    done = palpate("verify", altered(study, change))
    assert done.returncode == 1
    assert "fits.csv: 1 cell differs, numbers by at most" in done.stdout
    assert re.search(r"control/a_0.csv elasticity: \S+ packed, \S+ here \([\d.]+ u\)", done.stdout)
    found = json.loads(palpate("verify", "altered.zip", "--json").stdout)
    assert not found["same"]
    assert [one["column"] for one in found["differences"]] == ["elasticity"]


def test_pages_that_were_changed_are_named_and_another_version_is_said(study, palpate):
    def change(contents):
        contents["fits/methods.txt"] = contents["fits/methods.txt"].replace(b"Methods", b"Method")

    done = palpate("verify", altered(study, change))
    assert done.returncode == 1
    assert "every number is the same; of other bytes: methods.txt" in done.stdout

    def older(contents):
        change(contents)
        contents["study.json"] = contents["study.json"].replace(b'"palpate": "', b'"palpate": "0.0.')

    done = palpate("verify", altered(study, older))
    assert done.returncode == 0
    assert "this is another version: palpate" in done.stdout


def test_curves_that_are_left_out_are_found_by_their_hash(study, tmp_path, palpate):
    assert palpate("pack", "fits", "-o", "small.zip", "--hashes").returncode == 0
    assert not [name for name in members(study / "small.zip") if name.startswith("curves/")]
    refused = palpate("verify", "small.zip")
    assert refused.returncode == 2
    assert "--curves FOLDER" in refused.stderr
    done = palpate("verify", "small.zip", "--curves", ".")
    assert done.returncode == 0, done.stderr
    (study / FEW[0]).write_text((study / FEW[0]).read_text() + "\n")
    refused = palpate("verify", "small.zip", "--curves", ".")
    assert refused.returncode == 2
    assert f"1 curves of the study are not there, such as curves/{FEW[0]}" in refused.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["control", "-o", "x.zip"], "is not a folder of fits"),
        (["fits", "-o", "x.tar"], "ends in .zip"),
        (["fits", "-o", "x.zip", "--by", "treatmint"], "did you mean 'treatment'"),
    ],
)
def test_what_cannot_be_packed_is_named(study, palpate, words, told):
    done = palpate("pack", *words)
    assert done.returncode == 2
    assert told in done.stderr
    assert not (study / "x.zip").exists()


def test_stale_rows_and_curves_that_have_gone_are_not_packed(study, palpate):
    (study / FEW[0]).rename(study / "gone.csv")
    done = palpate("pack", "fits", "-o", "x.zip")
    assert (done.returncode, f"{FEW[0]}: its file is not known, or has gone" in done.stderr) == (2, True)
    (study / "gone.csv").rename(study / FEW[0])
    assert palpate("fit", "fits", "--set", "estimator.fit.segment=load", "--no-refit").returncode == 0
    done = palpate("pack", "fits", "-o", "x.zip")
    assert (done.returncode, "4 rows are not of the present settings: palpate fit fits" in done.stderr) == (2, True)


def _set(contents, name, old, new):
    text = contents[name].decode()
    assert re.search(old, text, re.M)
    contents[name] = re.sub(old, lambda _: new, text, count=1, flags=re.M).encode()


def curve_outside(contents):
    _set(contents, "fits/curves.csv", r"\.\./curves/control/a_0\.csv", "../../../../../../etc/passwd")


def device_outside(contents):
    _set(contents, "fits/pipeline.toml", r'^file = ".*"$', 'file = "/etc/passwd"')


def own_device(contents):
    contents["fits/own.toml"] = b'["control/a_0.csv"]\nset = ["device.log.file=/etc/passwd"]\n'


def live_device(contents):
    contents["fits/pipeline.toml"] += b'\n[device.arm]\ntype = "rdt"\nhost = "192.168.0.9"\n'


def rig_outside(contents):
    _set(contents, "fits/pipeline.toml", r"^\[run\]$", '[run]\nrig = "/etc/passwd"')


def curves_folder_outside(contents):
    _set(contents, "fits/pipeline.toml", r"^\[run\]$", '[run]\ncurves = "/etc"')


def tip_outside(contents):
    tip = r'^type = "paraboloid"\ncurvature_radius = .*$'
    _set(contents, "fits/pipeline.toml", tip, 'type = "profile"\npoints = "/etc/passwd"')


@pytest.mark.parametrize("change", [curve_outside, device_outside, own_device, live_device, rig_outside, tip_outside,
                                    curves_folder_outside])  # fmt: skip
def test_settings_read_nothing_outside_of_the_archive(study, palpate, change):
    done = palpate("verify", altered(study, change))
    assert done.returncode == 2, done.stdout
    assert "outside" in done.stderr or "reads none" in done.stderr


PLUGIN = "open({trace!r}, 'w').close()\nfrom palpate import plugin\n@plugin\ndef palpate_models():\n    return {{}}\n"


def plugin_of_the_pipeline(contents):
    _set(contents, "fits/pipeline.toml", r"^plugins = \[\]$", 'plugins = ["../files/evil.py"]')


def plugin_of_a_curve(contents):
    contents["fits/own.toml"] = b'["control/a_0.csv"]\nset = [\'run.plugins=["../files/evil.py"]\']\n'


@pytest.mark.parametrize("change", [plugin_of_the_pipeline, plugin_of_a_curve])
def test_a_plugin_file_is_executed_by_consent_only(study, tmp_path, palpate, change):
    trace = tmp_path / "trace"

    def both(contents):
        change(contents)
        contents["files/evil.py"] = PLUGIN.format(trace=str(trace)).encode()

    done = palpate("verify", altered(study, both))
    assert done.returncode == 2
    assert "palpate trust FOLDER/fits/../files/evil.py; FOLDER is what palpate verify" in done.stderr
    assert not trace.exists()
    done = palpate("verify", "altered.zip", "--out", "opened")
    assert (done.returncode, "palpate trust opened/fits/../files/evil.py" in done.stderr) == (2, True)
    assert not trace.exists()
    assert not trust.trusted_plugins()
    assert palpate("trust", "opened/files/evil.py").returncode == 0
    palpate("verify", "altered.zip")
    assert trace.exists()


def test_a_folder_with_something_in_it_is_not_written_to(study, palpate):
    done = palpate("verify", "study.zip", "--out", "control")
    assert (done.returncode, "is not empty" in done.stderr) == (2, True)
    assert sorted(path.name for path in (study / "control").iterdir()) == ["a_0.csv", "b_0.csv"]
