"""``palpate fit FILES --tip``: files of several dialects without a pipeline, one table with a verdict for each."""

import csv

import numpy as np
import palpate as python
import pytest
from palpate_models import Sphere

TIP = ["--tip", "sphere 3 mm"]


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


def test_a_folder_in_two_dialects_is_one_table_and_what_was_done_stands_beside_it(files, palpate):
    done = palpate("fit", "curves", *TIP, "--out", "out")
    assert done.returncode == 1
    assert "bad.csv: no two columns" in done.stderr
    lines = done.stdout.splitlines()
    assert max(len(line) for line in lines if "│" in line) <= 80
    assert lines[-1].startswith("3 usable, 1 not: not read (1)")
    assert {path.name for path in (files / "out").iterdir()} == {"fits.csv", "pipeline.toml", "pipeline-2.toml"}
    with (files / "out" / "fits.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for seed, row in enumerate(rows):
        assert abs(float(row["elasticity"]) - 1e5 * (1 + 0.1 * seed)) < 3 * float(row["elasticity_combined"])
    again = palpate("fit", "curves", *TIP, "--out", "out")
    assert again.stdout == done.stdout


def test_python_says_the_same_in_three_lines(files, palpate):
    palpate("fit", "curves/0.csv", *TIP, "--out", "out")
    fitter = python.prepare(tip=Sphere(radius="3 mm"), model="dr")
    found = fitter.fit(python.read("curves/0.csv"))
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
        (["--tip", "sphere diam 3 mm"], "did you mean 'diameter'"),
        (["--tip", "sphere diameter 3 V"], "not a length"),
        ([*TIP, "--model", "hrtz"], "there is no model 'hrtz'"),
        ([*TIP, "--pipeline", "x.toml"], "which has a tip of its own"),
    ],
)
def test_a_mistake_is_named(files, palpate, options, words):
    refused = palpate("fit", "curves/0.csv", *options)
    assert refused.returncode == 2
    assert words in refused.stderr


@pytest.mark.parametrize(("name", "words"), [("none.csv", "no such file"), ("curves/bad.csv", "no two columns")])
def test_what_cannot_be_read_says_why(files, palpate, name, words):
    refused = palpate("fit", name, *TIP)
    assert refused.returncode == 2
    assert words in refused.stderr
