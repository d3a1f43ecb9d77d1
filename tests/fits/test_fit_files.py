"""``palpate fit FILES --tip``: files of several dialects without a pipeline, one table with a verdict for each."""

import csv
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import palpate as python
import pytest
from palpate_kit.curves.curve_table import latest_rows

from tests.logs import table_kinds as kinds

TIP = ["--tip", "paraboloid 3 mm"]


def press(seed, n=700):
    """Time [s], height [mm] and force [N] of a press on some 100 kPa."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 500
    depth = 4e-3 * np.sin(np.pi * time / time[-1]) - 1e-3
    speed, contact = np.gradient(depth, time), np.maximum(depth, 0.0)
    force = 16 / 9 * 1e5 * (1 + 0.1 * seed) * np.sqrt(3e-3) * contact**1.5
    force = np.maximum(force + 8 * 360 * np.sqrt(3e-3 * contact) * speed, 0.0)
    return time, -1e3 * depth + 2e-4 * random.standard_normal(n), force + 0.02 * random.standard_normal(n)


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Three files in two dialects, and one that is none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curves").mkdir()
    for i in range(2):
        time, height, force = press(i)
        columns = np.column_stack([time, force, height])
        np.savetxt(f"curves/{i}.csv", columns, delimiter=",", header="time_s,force_N,height_mm", comments="")
    np.savetxt("curves/2.csv", np.column_stack(press(2)), delimiter=";", header="t [s];z [mm];F [N]", comments="")
    (tmp_path / "curves" / "bad.csv").write_text("a,b\n1,2\n3,4\n")
    return tmp_path


@pytest.mark.slow
def test_a_folder_in_two_dialects_is_one_table_and_what_was_done_stands_beside_it(files, palpate):
    done = palpate("fit", "curves", *TIP, "--out", "out")
    assert done.returncode == 1
    assert "bad.csv: no two columns" in done.stderr
    lines = done.stdout.splitlines()
    assert max(len(line) for line in lines if " ± " in line) <= 79
    assert re.fullmatch(r"4 files\. E: .*; 1 not read", lines[-2])
    assert {path.name for path in (files / "out").iterdir()} == {
        "fits.csv", "conditions.csv", "curves.csv", "pipeline.toml", "provenance.json",
    }  # fmt: skip
    with (files / "out" / "fits.csv").open(newline="") as file:
        *rows, unread = sorted(csv.DictReader(file), key=lambda row: not row["track"])
    assert unread["curve"] == "curves/bad.csv"
    assert unread["error"].startswith("no two columns")
    for row in rows:
        seed = int(re.sub(r"\D", "", Path(row["curve"]).stem))
        assert abs(float(row["elasticity"]) - 1e5 * (1 + 0.1 * seed)) < 3 * float(row["elasticity_combined"])
    again = palpate("fit", "curves", *TIP, "--out", "out")
    assert again.stdout == done.stdout
    tables = tomllib.loads((files / "out" / "pipeline.toml").read_text())
    assert set(tables["dialect"]["d2"]) <= {"device", "alignment", "run"}  # what the other kind of file has otherwise
    words = ["--pipeline", "out/pipeline.toml", "--set", "run.dialect=d2", "--out", "alone"]
    alone = palpate("fit", "curves/2.csv", *words, "--json")
    assert alone.returncode == 0, alone.stderr
    (track,) = json.loads(alone.stdout)["logs"]["2"]["tracks"].values()
    assert repr(track["parameters"]["elasticity"]["value"]) in {row["elasticity"] for row in rows}
    refused = palpate("fit", "curves/2.csv", "--pipeline", "out/pipeline.toml", "--set", "run.dialect=3")
    assert "no [dialect.3]" in refused.stderr


@pytest.mark.slow
def test_python_says_the_same_in_three_lines(files, palpate):
    palpate("fit", "curves/0.csv", *TIP, "--out", "out")
    found = python.fit(python.read("curves/0.csv"), tip="paraboloid 3 mm", model="dr")
    with (files / "out" / "fits.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["elasticity"] == repr(found.elasticity.value)
    assert row["viscosity_combined"] == repr(found.viscosity.combined)
    assert row["verdict"] == found.verdict


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tip", "spher 3 mm"], "did you mean 'sphere'"),
        (["--tip", "sphere"], "needs its radius"),
        (["--tip", "sphere 3"], "--tip 'sphere 3': ExactSphere: radius: '3' has no unit"),
        (["--tip", "3 mm"], 'write it as in "sphere 3 mm"'),
        ([*TIP, "--model", "drr"], "did you mean 'dr'"),
        ([], "say its tip, as in palpate fit curves/0.csv --tip 'sphere 3 mm'"),
        (["--tip", "sphere diam 3 mm"], "did you mean 'diameter'"),
        (["--tip", "sphere diameter 3 V"], "not a length"),
        ([*TIP, "--model", "hrtz"], "no model 'hrtz'"),
        ([*TIP, "--pipeline", "x.toml"], "which has a tip of its own"),
    ],
)
def test_a_mistake_is_named(files, palpate, options, words):
    refused = palpate("fit", "curves/0.csv", *options)
    assert refused.returncode == 2
    assert words in refused.stderr


@pytest.mark.slow
def test_a_folder_that_is_fitted_again_shows_its_files_and_what_ails_many_is_told_once(files, palpate):
    for number in range(3):
        np.savetxt(
            f"curves/n{number}.csv", np.column_stack(press(0)), delimiter=",", header="t [s],z [mm],F [V]", comments=""
        )
    first = palpate("fit", "curves", *TIP, "--out", "out", "--details")
    assert "curves/n0.csv and 2 more: columns.force.scale: " in first.stderr
    assert "RMS" in first.stdout
    again = palpate("fit", "out", "--set", "alignment.tare=free-air")
    assert again.returncode == 1, again.stderr  # files of the folder are still not read
    lines = [line for line in again.stdout.splitlines() if line.startswith("curves/")]
    assert [line.split()[0] for line in lines] == [
        *(f"curves/{name}.csv" for name in ("0", "1", "2", "bad", "n0", "n1", "n2")),
    ]
    assert sum("not read" in line for line in lines) == 4
    assert "3 curves fitted again" in again.stdout


def test_a_folder_without_a_tip_says_what_to_type(files, palpate):
    assert "palpate fit curves --tip 'sphere 3 mm'" in palpate("fit", "curves").stderr


@pytest.mark.parametrize(("name", "words"), [("none.csv", "no such file"), ("curves/bad.csv", "no two columns")])
def test_what_cannot_be_read_says_why(files, palpate, name, words):
    refused = palpate("fit", name, *TIP)
    assert refused.returncode == 2
    assert words in refused.stderr


def rows_of(folder):
    return {row["curve"].rpartition("/")[2].partition(".")[0]: row for row in latest_rows(folder / "fits.csv")}


@pytest.mark.slow
@pytest.mark.parametrize("part", range(3))
def test_tables_of_all_kinds_give_the_elasticity_of_the_plain_one(tmp_path, palpate, part):
    """One file of each kind through the command, with the answer to what it asks."""
    (tmp_path / "curves").mkdir()
    some = [kind for kind in kinds.KINDS[part::3] if not kind.answers and not kind.timing]
    for number, kind in enumerate(some):
        press_of = kinds.press(number % kinds.FILES)
        (tmp_path / "curves" / f"{kind.name}{kind.suffix}").write_bytes(kind.write(press_of, number % kinds.FILES))
    done = palpate("fit", str(tmp_path / "curves"), *TIP, "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    found = rows_of(tmp_path / "out")
    assert {*found} == {kind.name for kind in some}
    for number, kind in enumerate(some):
        expected = 1e5 * (1 + 0.1 * (number % kinds.FILES))
        assert float(found[kind.name]["elasticity"]) == pytest.approx(expected, rel=0.005), kind.name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "asked", "answer"),
    [
        (
            "volts",
            "say it with --set device.log.columns.force.scale=NUMBER",
            ["--set", "device.log.columns.force.scale=0.025"],
        ),
    ],
)
def test_what_a_file_does_not_state_is_asked_for_and_can_be_answered(tmp_path, palpate, kind, asked, answer):
    kind = next(one for one in kinds.KINDS if one.name == kind)
    (tmp_path / "a.csv").write_bytes(kind.write(kinds.press(0), 0))
    command = ["fit", str(tmp_path / "a.csv"), *TIP, "--out", str(tmp_path / "out")]
    refused = palpate(*command)
    assert refused.returncode == 2
    assert asked in refused.stderr
    assert palpate(*command, *answer).returncode == 0
    assert float(rows_of(tmp_path / "out")["a"]["elasticity"]) == pytest.approx(1e5, rel=0.005)


@pytest.mark.slow
def test_a_rate_touches_no_file_that_has_a_time(files, palpate):
    """One file of the folder asks for it: the viscosity of the others is that of their own time."""
    (files / "curves" / "bad.csv").unlink()
    stated = [*TIP, "--set", "alignment.force.uncertainty=0.1 ms"]
    assert palpate("fit", "curves", *stated, "--out", "without").returncode == 0
    np.savetxt("curves/3.csv", np.column_stack(press(0)[1:]), delimiter=",", header="z [mm],F [N]", comments="")
    done = palpate("fit", "curves", *stated, "--rate", "250 Hz", "--out", "with")
    assert "--rate is ignored for 3 files that have a time" in done.stderr.splitlines()
    before, after = rows_of(files / "without"), rows_of(files / "with")
    assert {name: after[name]["viscosity"] for name in before} == {n: row["viscosity"] for n, row in before.items()}
    assert float(after["3"]["viscosity"]) == pytest.approx(2 * float(before["0"]["viscosity"]), rel=0.1)


def press_file(path, names, extra=()):
    p = kinds.press(0)
    path.write_text(kinds.table([*kinds.plain(p, names), *extra], above=["Tip diameter: 10 mm"]))
    return p


@pytest.mark.slow
def test_what_is_guessed_is_said_and_counts_as_assumed(tmp_path, palpate):
    press_file(tmp_path / "a.csv", ("time", "force", "height"))
    command = ["fit", str(tmp_path / "a.csv"), *TIP, "--out", str(tmp_path / "out")]
    done = palpate(*command)
    assert "check a.csv: unit of the force: N is a guess" in done.stderr
    assert "check a.csv: line 1 states Tip diameter: 10 mm, and --tip a radius of 3 mm" in done.stderr
    assert "device.log.columns.force.unit" in (tmp_path / "out" / "pipeline.toml").read_text()
    again = palpate(*command[:-1], str(tmp_path / "other"), "--set", "device.log.columns.force.unit=kgf")
    assert "unit of the force" not in again.stderr
    assert float(rows_of(tmp_path / "other")["a"]["elasticity"]) == pytest.approx(9.80665e5, rel=0.01)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("time_s", "force [daN]", "height_mm"), "how many N one daN of column force [daN] is"),
        (("time_s", "force_N", "motor [steps]"), "how many mm one steps of column motor [steps] is"),
    ],
)
def test_units_that_are_not_known_are_asked_for(tmp_path, palpate, names, words):
    press_file(tmp_path / "a.csv", names)
    refused = palpate("fit", str(tmp_path / "a.csv"), *TIP)
    assert refused.returncode == 2
    assert words in refused.stderr


def test_one_of_several_forces_over_one_height_is_asked_for(tmp_path, palpate):
    p = kinds.press(1)
    extra = [("force 2 (N)", 1.3 * p.f, ".4f")]
    press_file(tmp_path / "a.csv", ("time (s)", "force 1 (N)", "height (mm)"), extra)
    refused = palpate("fit", str(tmp_path / "a.csv"), *TIP)
    assert refused.returncode == 2
    assert "the force can be force 1 (N), force 2 (N); say which with --force" in refused.stderr


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ([], "--tip 'paraboloid 3 mm' --delay VALUE"),
        (["force"], "position"),
    ],
)
def test_the_timing_that_is_still_to_be_stated_is_named(tmp_path, palpate, stated, words):
    p = kinds.press(0, 700)
    time, z = p.t, 1e3 * np.round(p.z, 5)  # as commanded: without noise, in steps
    smooth = np.convolve(np.pad(z, 30, "edge"), np.ones(61) / 61, "valid")
    columns = [("time_s", time, ".4f"), ("force_N", p.f, ".4f"), ("height_mm", smooth, ".8f")]
    (tmp_path / "a.csv").write_text(kinds.table(columns))
    options = [text for role in stated for text in ("--set", f"alignment.{role}.uncertainty=1 ms")]
    done = palpate("fit", str(tmp_path / "a.csv"), *TIP, *options)
    assert words in done.stdout
