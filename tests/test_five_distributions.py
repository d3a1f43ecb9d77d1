"""Five distributions as a laboratory writes them: a tip, a model, a filter, a sensor with its log, and a motion."""

import csv
import json
import shutil
import tomllib

import numpy as np
import pytest
from palpate import registry
from palpate_engine import load_pipeline
from palpate_models import DimensionalityReduction, Sphere
from palpate_testing import (
    check_device,
    check_discovery,
    check_estimator,
    check_indenter,
    check_model,
    check_trajectory,
)

NAMES = ("palpate-worn", "palpate-foam", "palpate-fading", "palpate-gauge", "palpate-stairs")
TRUTH = (1e5, 300.0)
PARTS = (
    'indenter.tip={type = "worn-sphere", radius = "5 mm", flat = "1 mm"}',
    'model.foam={type = "stiff-foam", indenter = "tip"}',
    'estimator.fading={type = "fading-squares", force_std = "50 mN"}',
    'trajectory.press={type = "stairs", depth = "4 mm"}',
    'device.rig.specimen={model = "foam", elasticity = "100 kPa", viscosity = "300 Pa*s"}',
    'run.tracks=["foam/fading", "foam/kinematic"]',
)
SETTINGS = [word for part in PARTS for word in ("--set", part)]


@pytest.fixture(scope="module")
def site(tmp_path_factory, root):
    """A folder on the import path with the five, as pip leaves it."""
    folder = tmp_path_factory.mktemp("site")
    for name in NAMES:
        source, package = root / "tests" / "third_party" / name, name.replace("-", "_")
        shutil.copytree(source / package, folder / package)
        project = tomllib.loads((source / "pyproject.toml").read_text())["project"]
        info = folder / f"{package}-{project['version']}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {project['version']}\n")
        entries = "".join(f"{key} = {module}\n" for key, module in project["entry-points"]["palpate"].items())
        (info / "entry_points.txt").write_text(f"[palpate]\n{entries}")
    return folder


@pytest.fixture
def part(site, monkeypatch):
    """Find a part of the five by kind and name."""
    monkeypatch.syspath_prepend(site)
    return registry.load().find


@pytest.fixture
def log(tmp_path):
    """Write a log of the gauge: a second in air, then a sine of 2 Hz in an elastic body under a sphere of 5 mm."""

    def write(name="press.gauge", elasticity=60e3):
        random, time = np.random.default_rng(0), np.arange(0.0, 6.0, 0.002)
        pressed = np.clip(time - 1.0, 0.0, None)
        height = 1e-3 - np.where(pressed < 0.5, 8e-3 * pressed, 4e-3 - 1e-3 * np.sin(4 * np.pi * (pressed - 0.5)))
        depth = np.clip(-height, 0.0, None)
        force = 16 / 9 * elasticity * 0.005**0.5 * depth**1.5 + 2e-3 * random.standard_normal(len(time))
        rows = zip(np.rint(1e6 * time).astype(int), force, 1e6 * height, strict=True)
        (tmp_path / name).write_text("".join(f"{stamp} {newton:.6f} {um:.3f}\n" for stamp, newton, um in rows))
        return tmp_path / name

    return write


def drawing(radii):
    return np.where(radii > 1e-3, (radii**2 - 1e-6) / (2 * 5e-3), 0.0)


def test_each_is_green(part, log):
    tip = part("indenter", "worn-sphere")(radius="5 mm", flat="1 mm")
    check_indenter(tip, shape=drawing)
    check_model(part("model", "stiff-foam")(indenter=tip), TRUTH)
    check_trajectory(part("trajectory", "stairs")(depth="4 mm"), depth=4e-3)
    check_device(part("device", "gauge-log")(file=log()), readings={"force": (0.5, 2.0), "height": (-4e-3, -2e-3)})


@pytest.mark.slow
def test_the_filter_is_green_by_values(part):
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3))
    check_estimator(part("estimator", "fading-squares")(), model, TRUTH, truth=True)


@pytest.mark.parametrize("name", NAMES)
def test_no_command_waits_for_it(site, monkeypatch, name):
    monkeypatch.syspath_prepend(site)
    check_discovery(name.replace("-", "_"))


def test_they_are_listed_and_in_help_and_schema(palpate, site):
    listed = palpate("list", "--plugins", "--json", PYTHONPATH=site)
    stated = {plugin["name"].partition(" ")[0]: plugin["interface"] for plugin in json.loads(listed.stdout)["plugins"]}
    assert [stated[name] for name in NAMES] == [1] * len(NAMES)
    assert listed.stderr == ""
    assert "Stiffness of runs of a staircase." in palpate("--help", PYTHONPATH=site).stdout
    schema = palpate("describe", "schema", PYTHONPATH=site).stdout
    assert '"worn-sphere"' in schema
    assert '"palpate-worn:worn-sphere"' in schema


@pytest.mark.slow
def test_all_of_them_meet_in_one_run(palpate, site, point_pipeline, tmp_path):
    environment = {"PYTHONPATH": site}
    done = palpate("run", point_pipeline, *SETTINGS, "--out", tmp_path / "out", **environment)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    for label, track in document["tracks"].items():
        value = track["parameters"]["elasticity"]
        assert abs(value["value"] - 100e3) < 3 * value["combined"] + 1e3, label
        assert {row["source"] for row in track["budget"]}
        assert f"stairs: {label} has {len(track['budget'])} rows in its budget" in done.stdout
    versions = document["run"]["versions"]
    assert [versions[name] for name in NAMES if name != "palpate-gauge"] == ["1.0"] * 4
    resolved = tomllib.loads((tmp_path / "out" / "pipeline.toml").read_text())
    assert resolved["indenter"]["tip"]["type"] == "palpate-worn:worn-sphere"
    assert resolved["trajectory"]["press"]["type"] == "palpate-stairs:stairs"
    assert palpate("report", tmp_path / "out", **environment).returncode == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert "stairs: foam/fading has" in page
    assert "foam/fading" in palpate("stairs", tmp_path / "out", **environment).stdout
    again = palpate("replay", tmp_path / "out", "--out", tmp_path / "again", **environment)
    assert again.returncode == 0, again.stderr
    tracks = json.loads((tmp_path / "again" / "result.json").read_text())["tracks"]
    assert {name: track["parameters"] for name, track in tracks.items()} == {
        name: track["parameters"] for name, track in document["tracks"].items()
    }


@pytest.mark.slow
def test_the_log_of_the_gauge_is_read_by_every_command_at_once(palpate, site, log, tmp_path):
    environment, file = {"PYTHONPATH": site}, log()
    assert {"(gauge)", "gauge:force"} <= set(palpate("info", file, **environment).stdout.split())
    words = ("fit", file, "--tip", "sphere 5 mm", "--json")
    done = palpate(*words, **environment)
    assert done.returncode == 0, done.stderr
    worn = palpate("fit", file, "--tip", "worn-sphere 5 mm, flat 1 mm", **environment)
    assert worn.returncode == 0, worn.stderr
    (tmp_path / "curves").mkdir()
    for k, elasticity in enumerate((50e3, 70e3)):
        shutil.move(log(f"{k}.gauge", elasticity), tmp_path / "curves")
    folder = palpate("fit", tmp_path / "curves", "--tip", "paraboloid 5 mm", "--out", tmp_path / "fits", **environment)
    assert folder.returncode == 0, folder.stderr
    rows = list(csv.DictReader((tmp_path / "fits" / "fits.csv").read_text().splitlines()))
    stiffness = {row["curve"].rpartition("/")[2]: float(row["elasticity"]) for row in rows}
    assert stiffness == {"0.gauge": pytest.approx(50e3, rel=0.02), "1.gauge": pytest.approx(70e3, rel=0.02)}
    pipeline = tomllib.loads((tmp_path / "fits" / "pipeline.toml").read_text())
    assert pipeline["device"]["log"]["type"] == "palpate-gauge:gauge-log"
    assert pipeline["run"]["distributions"] == ["palpate-gauge 1.0"]
    out = palpate("log", "export", file, "-o", tmp_path / "press.csv", **environment)
    assert out.returncode == 0, out.stderr


def test_a_tip_of_two_keys_in_words(part, point_pipeline):
    part("indenter", "worn-sphere")
    pipeline = load_pipeline(point_pipeline, [PARTS[0]])
    assert pipeline.indenters["tip"].flat == 1e-3
