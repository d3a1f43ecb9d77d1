"""``palpate fit --each``: thousands of curves, each a row of a table that can be gone on with."""

import csv
import json

import numpy as np
import palpate as python
import pytest
from palpate_engine import Source, build_pipeline, is_open, run_pipeline
from palpate_fits.estimator import CasadiFit
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.curve_fits import CurveReader, fit_curves
from palpate_models import DimensionalityReduction, Sphere

PIPELINE = """
[run]
PLUGINS
[device.log]
type = "csv-replay"
file = "reader.csv"
rate = "500 Hz"
columns = { z = { column = 0, unit = "mm" }, v = { column = 1, unit = "mm/s" }, fz = { column = 2, unit = "N" } MORE }
[alignment]
force = { channel = "log.fz", uncertainty = "0.2 ms" }
position = "log.z"
velocity = "log.v"
tare_duration = "0.2 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.fit]
type = "casadi-fit"
segment = "cycle"
"""
DEADLY = '''
import os
from palpate import Estimates, Estimator, plugin

class Deadly(Estimator):
    """Ends its process over short curves."""

    online = False

    def start(self, problem):
        return self

    def run(self, samples):
        if len(samples) < 600:
            os._exit(9)
        return Estimates.idle(samples, 2)

@plugin
def palpate_estimators():
    return {"deadly": Deadly}
'''


def curve(elasticity, seed, speed=5e-3):
    """A press: z [mm], v [mm/s], F [N]."""
    n = int(4e-3 / speed * 500)
    height = np.concatenate([np.full(150, 1e-3), 1e-3 - np.r_[np.arange(n), np.arange(n)[::-1]] * speed / 500])
    velocity = np.concatenate([np.zeros(150), np.repeat([-speed, speed], n)])
    depth = np.maximum(-height, 0.0)
    force = 16 / 9 * elasticity * np.sqrt(5e-3) * depth**1.5 - 8 * 362.0 * np.sqrt(5e-3 * depth) * velocity
    noise = 0.02 * np.random.default_rng(seed).standard_normal(len(depth))
    return np.column_stack([1e3 * height, 1e3 * velocity, np.maximum(force, 0) + noise])


TRUTHS = [80e3, 90e3, 100e3, 110e3, 120e3]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Five curves, one of which is not one, and how they are read."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curves" / "deeper").mkdir(parents=True)
    for i, truth in enumerate(TRUTHS):
        name = f"deeper/{i}.csv" if i == 4 else f"{i}.csv"
        np.savetxt(tmp_path / "curves" / name, curve(truth, i), delimiter=",")
    (tmp_path / "curves" / "2.csv").write_text("1,2,no number\n")
    (tmp_path / "curves" / "notes.txt").write_text("no curve")
    np.savetxt(tmp_path / "reader.csv", curve(1e5, 0), delimiter=",")
    (tmp_path / "reader.toml").write_text(PIPELINE.replace("PLUGINS", "").replace("MORE", ""))
    return tmp_path


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


EACH = ["fit", "--each", "curves", "--pipeline", "reader.toml", "--out", "out"]


def test_every_curve_is_a_row_and_what_cannot_be_read_says_why(folder, palpate):
    done = palpate(*EACH, "--jobs", "1")
    assert done.returncode == 1
    assert "1 fits of 5 failed" in done.stderr
    rows = rows_of(folder / "out" / "fits.csv")
    assert [row["curve"] for row in rows] == ["0.csv", "1.csv", "2.csv", "3.csv", "deeper/4.csv"]
    for row, truth in zip(rows, TRUTHS, strict=True):
        if row["curve"] == "2.csv":
            assert "no number" in row["error"]
        else:
            assert abs(float(row["elasticity"]) - truth) < 4 * float(row["elasticity_std"])
            assert 0 < float(row["elasticity_std"]) < 0.02 * truth


def cells_of(track):
    """What a row should say of a track of result.json."""
    cells = {"surface": track["surface"]["value"], "surface_combined": track["surface"]["combined"]}
    for name, found in track["parameters"].items():
        cells |= {name: found["value"], f"{name}_std": found["std"], f"{name}_combined": found["combined"]}
        if is_open(found["verdict"]):  # its uncertainties stay
            del cells[name]
    codes = " ".join(sorted({flag["code"] for flag in track["flags"]}))
    return {key: repr(value) for key, value in cells.items()} | {"verdict": track["verdict"], "flags": codes}


@pytest.mark.slow
def test_a_row_is_what_fit_says_of_the_curve_alone(folder, palpate):
    palpate(*EACH, "--jobs", "1")
    alone = palpate("fit", "curves/3.csv", "--pipeline", "reader.toml", "--out", "one", "--no-pictures", "--json")
    (log,) = json.loads(alone.stdout)["logs"].values()
    (track,) = log["tracks"].values()
    row = rows_of(folder / "out" / "fits.csv")[3]
    told = cells_of(track)
    assert {key: row[key] for key in told} == told
    assert float(row["elasticity_combined"]) > 2 * float(row["elasticity_std"])


@pytest.mark.slow
def test_a_hundred_curves_are_one_number_in_the_table_in_a_run_and_in_python(tmp_path, monkeypatch):
    """For 210 fits: what curves that share a compiled law do to one another shows in few of them."""
    monkeypatch.chdir(tmp_path)
    random = np.random.default_rng(36)
    curves = []
    for i in range(100):
        name = f"{i}.csv"
        table = curve(random.uniform(2e4, 3e5), i, random.uniform(4e-3, 8e-3))
        table[:, 2] *= 1 + random.choice([0.0, 0.0, 0.3]) * (table[:, 0] < -2)  # some of another law
        np.savetxt(name, table, delimiter=",")
        curves.append(Curve(name, str(tmp_path / name)))
    (tmp_path / "reader.csv").write_bytes((tmp_path / "0.csv").read_bytes())
    text = PIPELINE.replace("PLUGINS", "").replace("MORE", "")
    rows = [row for (row,) in fit_curves(CurveReader(text, "reader.toml", (), "log"), curves)]
    fitter = python.prepare(
        tip=Sphere(radius="5 mm"), model=DimensionalityReduction(indenter=Sphere(radius="5 mm")),
        estimator=CasadiFit(segment="cycle"),
    )  # fmt: skip
    for i, row in enumerate(rows):
        z, v, force = np.loadtxt(f"{i}.csv", delimiter=",").T
        record = python.record(
            rate="500 Hz", force=force, height=z, velocity=v, units={"height": "mm", "velocity": "mm/s"},
            timing="0.2 ms", alignment={"tare_duration": "0.2 s"},
        )  # fmt: skip
        told = cells_of(fitter.fit(record).track.document)
        assert {key: row[key] for key in told} == told
    for i in range(0, 100, 10):
        source = Source(text, tmp_path / "reader.toml")
        source.override(f'device.log.file="{i}.csv"')
        (track,) = run_pipeline(build_pipeline(source), tmp_path / f"run{i}").table()["tracks"].values()
        told = cells_of(track)
        assert {key: rows[i][key] for key in told} == told


@pytest.mark.gate
@pytest.mark.slow
def test_what_was_torn_is_gone_on_with_to_the_same_bytes(folder, palpate):
    palpate(*EACH, "--jobs", "2")
    table = folder / "out" / "fits.csv"
    whole = table.read_bytes()
    lines = whole.splitlines(keepends=True)
    table.write_bytes(b"".join(lines[:3]) + lines[3][:7])
    palpate(*EACH, "--jobs", "1")
    assert table.read_bytes() == whole
    palpate(*EACH, "--jobs", "1")
    assert table.read_bytes() == whole  # nothing was left to do


@pytest.mark.slow
def test_other_settings_are_not_mixed_in(folder, palpate):
    palpate(*EACH, "--no-refit")
    refused = palpate(*EACH, "--set", "indenter.tip.radius=6 mm")
    assert "other settings" in refused.stderr
    assert "radius" in refused.stderr
    (folder / "other").mkdir()
    (folder / "other" / "file").write_text("something")
    assert "no fits to go on with" in palpate(*EACH[:-1], "other").stderr


@pytest.mark.slow
def test_curves_of_one_file_begin_where_a_channel_changes(folder, palpate):
    marked = [np.column_stack([curve(truth, i), np.full(len(curve(truth, i)), i)]) for i, truth in enumerate(TRUTHS)]
    np.savetxt("all.csv", np.concatenate(marked), delimiter=",")
    np.savetxt("reader.csv", marked[0], delimiter=",")
    more = ', curve = { column = 3, unit = "1" }'
    (folder / "reader.toml").write_text(PIPELINE.replace("PLUGINS", "").replace("MORE", more))
    options = ["--pipeline", "reader.toml", "--out", "out", "--jobs", "1"]
    assert palpate("fit", "--each", "all.csv", "--by", "curve", *options).returncode == 0
    rows = rows_of(folder / "out" / "fits.csv")
    assert len(rows) == len(TRUTHS)
    for row, truth in zip(rows, TRUTHS, strict=True):
        assert abs(float(row["elasticity"]) - truth) < 4 * float(row["elasticity_std"])
    refused = palpate("fit", "--each", "all.csv", "--by", "nothing", *options)
    assert "no" in refused.stderr
    assert "fz" in refused.stderr


@pytest.mark.slow
def test_a_process_that_is_killed_costs_its_curve_only(folder, palpate):
    np.savetxt("curves/2.csv", curve(1e5, 2, speed=20e-3), delimiter=",")  # short
    text = PIPELINE.replace("PLUGINS", 'plugins = ["deadly.py"]').replace("MORE", "")
    (folder / "deadly.py").write_text(DEADLY)
    (folder / "reader.toml").write_text(text.replace('type = "casadi-fit"\nsegment = "cycle"', 'type = "deadly"'))
    palpate(*EACH, "--jobs", "2")
    rows = rows_of(folder / "out" / "fits.csv")
    assert [row["curve"] for row in rows] == ["0.csv", "1.csv", "2.csv", "3.csv", "deeper/4.csv"]
    assert ["was killed" in row["error"] for row in rows] == [False, False, True, False, False]


def test_nothing_to_read_is_refused_in_words(folder, palpate):
    assert "--pipeline" in palpate("fit", "--each", "curves").stderr
    assert "no such" in palpate(*EACH[:2], "nowhere", *EACH[3:]).stderr
    (folder / "empty").mkdir()
    assert "no file that the pipeline could read" in palpate(*EACH[:2], "empty", *EACH[3:]).stderr
