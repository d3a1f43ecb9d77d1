"""A fact of one curve in ``curves.csv`` is the same in its row, on its page, in Python and in the methods section."""

import csv
import html
import json
import re
import shlex
from functools import partial
from pathlib import Path

import numpy as np
import palpate as python
import pytest
from palpate_fits.fit_sources import named_pipelines
from palpate_kit.curves.curve_list import FACTS, fact_counts
from palpate_kit.curves.curve_pipelines import pipeline_counts
from palpate_kit.curves.fit_folder import FitFolder
from palpate_notebook.fitter_object import RecordEstimator

from tests.command import call

RIG = """
instrument = "a press"
tip = "sphere 5 mm"
delay = "0 ms +- 0.2 ms"
tip_mass = "10 g +- 1 g"
tare = "none"
poisson = 0.5
"""
STATED = {
    "tip": "sphere 4 mm",
    "tip_uncertainty": "200 um",
    "thickness": "10 mm",
    "base": "sliding",
    "delay": "3 ms +- 0.1 ms",
    "tare": "20 mN +- 1 mN",
    "tip_mass": "50 g",
    "poisson": "0.45 +- 0.01",
    "inclination": "8 deg",
    "mount": "20 N/mm",
    "beam": "2 N/mm +- 5 %",
    "position_of": "tip",
    "truth": "elasticity 25 kPa",
}
NEEDED = {"base": {"thickness": "10 mm"}}  # facts that another one needs
SENTENCES = {
    "tip": "The tip was an exact sphere with a radius of 4 or 5 mm (13 curves).",
    "tip_uncertainty": "The tip was an exact sphere with a radius of 5 mm (standard uncertainty 0.2 mm) (1 curve).",
    "thickness": "The finite thickness of the specimens, 10 mm, was corrected by the law of Garcia et al. [",
    "base": "The finite thickness of the specimens sliding on their base, 10 mm, was corrected by the law of Dim",
    "delay": "a delay of the force of 3 ms (standard uncertainty 0.1 ms) was corrected (1 curve).",
    "tare": "The zero of the force was 0.02 N (standard uncertainty 0.001 N); ",
    "tip_mass": "The inertia of the 50 g behind the force sensor was subtracted (1 curve).",
    "poisson": "with a Poisson's ratio of 0.45 or 0.5 (standard uncertainty 0.01 or 0.01155).",
    "inclination": "The skin under the tip was inclined by 8 deg (1 curve).",
    "mount": "The compliance of the rig (2e+04 N/m) was counted as an uncertainty (1 curve).",
    "beam": "the deflection of the beam of 2000 N/m (standard uncertainty 100 N/m) on it was subtracted (1 curve).",
    "position_of": "The tip was an exact sphere",
    "truth": "The tip was an exact sphere",  # no estimate depends on it
}


def press(seed, thickness=None, n=200):
    """Time [s], force [N] and height [mm] of a press on 25 kPa, on a half-space or a bonded layer [m]."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 200
    depth = 2.5e-3 * np.sin(np.pi * time / time[-1]) - 0.5e-3
    contact = np.maximum(depth, 0.0)
    share = 0.0 if thickness is None else np.sqrt(5e-3 * contact) / thickness
    stiffer = 1 + 1.133 * share + 1.497 * share**2 + 1.469 * share**3 + 0.755 * share**4
    force = 16 / 9 * 25e3 * np.sqrt(5e-3) * contact**1.5 * stiffer + 2e-3 * random.standard_normal(n)
    return np.column_stack([time, force, -1e3 * depth + 2e-4 * random.standard_normal(n)])


def write_study(folder, stated, thicknesses, tip="sphere"):
    """Curves of layers, and what ``curves.csv`` states of each, by the names of the files."""
    (folder / "study").mkdir()
    for seed, (name, thickness) in enumerate(thicknesses.items()):
        path = folder / "study" / f"{name}.csv"
        np.savetxt(path, press(seed, thickness), delimiter=",", header="time_s,force_N,height_mm", comments="")
    columns = list(dict.fromkeys(key for cells in stated.values() for key in cells))
    with (folder / "study" / "curves.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, ["curve", *columns], restval="")
        table.writeheader()
        table.writerows({"curve": f"{name}.csv", **cells} for name, cells in stated.items())
    (folder / "study" / "rig.toml").write_text(RIG.replace("sphere", tip))


def rows_of(folder):
    with (folder / "fits.csv").open(newline="") as file:
        return {Path(row["curve"]).stem: row for row in csv.DictReader(file)}


@pytest.fixture(scope="module")
def study_once(tmp_path_factory):
    """A curve for each fact that ``curves.csv`` may state, one without any, and their folder of fits, not fitted."""
    folder = tmp_path_factory.mktemp("facts")
    write_study(
        folder,
        {key: {key: text, **NEEDED.get(key, {})} for key, text in STATED.items()},
        dict.fromkeys(["plain", *STATED]),
    )
    done = call("fit", "study", "--no-refit", "--out", "fits", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def study(study_once, monkeypatch):
    monkeypatch.chdir(study_once)
    return study_once


def test_facts_are_counted_in_one_order():
    """A set of texts has another order in every process."""
    line = "curves.csv states tip of 2, thickness of 1, delay of 1, mount of 1 of 3 curves"
    assert fact_counts([{"delay", "thickness", "tip"}, frozenset({"mount", "tip"}), {}], 3) == line


def test_every_fact_of_a_curve_is_tested():
    assert STATED.keys() == FACTS.keys() == SENTENCES.keys()


@pytest.mark.parametrize("key", ["plain", *STATED])
def test_row_page_and_python_have_one_pipeline(study, key):
    folder = FitFolder(study / "fits")
    ((row, _),) = pipeline_counts(folder, [f"study/{key}.csv"])
    ((_, page),) = named_pipelines([Path(f"study/{key}.csv")], Path("fits/pipeline.toml"), [], {})
    estimator = RecordEstimator(["dr"], ["casadi-fit"], None, None)
    in_python = estimator.pipeline(python.read(f"study/{key}.csv"))
    plain = pipeline_counts(folder, ["study/plain.csv"])[0][0]
    for other in (page, in_python):
        assert [track.model for track in other.tracks] == [track.model for track in row.tracks]
        assert other.run.uncertainties == row.run.uncertainties
        assert other.run.truth == row.run.truth
        assert other.alignment.model_dump(exclude={"force": {"channel"}}) == row.alignment.model_dump(
            exclude={"force": {"channel"}}
        )
    facts = [(one.tracks[0].model, one.run.uncertainties, one.run.truth, one.alignment) for one in (row, plain)]
    assert (facts[0] == facts[1]) == (key == "plain")


def test_an_uncertainty_of_another_value_does_not_stay(study):
    ((weighed, _),) = pipeline_counts(FitFolder(study / "fits"), ["study/tip_mass.csv"])
    ((plain, _),) = pipeline_counts(FitFolder(study / "fits"), ["study/plain.csv"])
    assert (plain.alignment.tip_mass, plain.alignment.tip_mass_uncertainty) == (0.01, 0.001)
    assert (weighed.alignment.tip_mass, weighed.alignment.tip_mass_uncertainty) == (0.05, None)


@pytest.fixture
def layers(tmp_path, monkeypatch):
    """Three layers, two of which ``curves.csv`` states; ``rig.toml`` states that of the third."""
    heights = {"a": 10e-3, "b": 15e-3, "c": 22e-3}
    write_study(tmp_path, {"a": {"thickness": "10 mm"}, "b": {"thickness": "15 mm"}}, heights, "paraboloid")
    with (tmp_path / "study" / "rig.toml").open("a") as file:
        file.write('thickness = "22 mm"\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def heights_of(folder):
    return [pipeline.tracks[0].model.thickness.height for pipeline, _ in pipeline_counts(folder, folder.names)]


@pytest.mark.parametrize(
    ("options", "heights"),
    [
        ([], [10e-3, 15e-3, 22e-3]),
        (["--thickness", "12 mm"], [12e-3]),
        (["--set", 'model.dimensionality-reduction.thickness={law="garcia", height="13 mm"}'], [13e-3]),
    ],
)
def test_an_option_goes_before_curves_csv_and_that_before_the_file_of_facts(layers, palpate, options, heights):
    done = palpate("fit", "study", *options, "--no-refit", "--out", "fits")
    assert done.returncode == 0, done.stderr
    assert ("curves.csv states thickness of 2 of 3 curves" in done.stderr) == (not options)
    assert heights_of(FitFolder(layers / "fits")) == pytest.approx(heights)


def test_new_files_and_curves_of_another_pipeline_have_the_facts_of_their_rows(layers, palpate):
    palpate("fit", "study", "--no-refit", "--out", "fits")
    np.savetxt("study/d.csv", press(3, 12e-3), delimiter=",", header="time_s,force_N,height_mm", comments="")
    with (layers / "study" / "curves.csv").open("a") as file:
        file.write("d.csv,12 mm\n")
    again = palpate("fit", "fits", "--no-refit")
    assert again.returncode == 0, again.stderr
    assert heights_of(FitFolder(layers / "fits")) == pytest.approx([10e-3, 15e-3, 22e-3, 12e-3])
    each = palpate("fit", "study", "--each", "--pipeline", "fits/pipeline.toml", "--no-refit", "--out", "each")
    assert each.returncode == 0, each.stderr
    folder = FitFolder(layers / "each")
    assert folder.names == ["a.csv", "b.csv", "c.csv", "d.csv"]
    assert folder.curves_folder is None
    assert heights_of(folder) == pytest.approx([10e-3, 15e-3, 22e-3, 12e-3])


def test_a_file_of_several_curves_is_asked_which(layers, palpate):
    palpate("fit", "study", "--no-refit", "--out", "fits")
    path = layers / "fits" / "curves.csv"
    path.write_text(path.read_text() + "twice,../study/a.csv,,\n")
    asked = palpate("fit", "study/a.csv", "--pipeline", "fits/pipeline.toml", "--out", "page")
    assert asked.returncode == 2
    assert "is 2 curves (study/a.csv, twice)" in asked.stderr


def test_python_takes_its_arguments_first(layers):
    record = python.read("study/a.csv")
    assert "curves.csv states thickness" in repr(record)
    for rig, height in ((None, 10e-3), ({"thickness": "12 mm"}, 12e-3), ("study/rig.toml", 10e-3)):
        estimator = RecordEstimator(["dr"], ["casadi-fit"], None, None, rig)
        assert estimator.pipeline(record).tracks[0].model.thickness.height == height
    weighed = RecordEstimator(["dr"], ["casadi-fit"], None, None).pipeline(python.read("study/a.csv", tip_mass="20 g"))
    assert weighed.alignment.tip_mass == pytest.approx(0.02)


def test_a_cell_that_states_no_fact_is_named(layers, palpate):
    (layers / "study" / "curves.csv").write_text("curve,thickness\na.csv,thin\n")
    done = palpate("fit", "study/a.csv")
    assert done.returncode == 2
    assert "study/a.csv: curves.csv: thickness: 'thin' is not a length" in done.stderr
    with pytest.raises(python.LogError, match=r"curves\.csv: thickness"):
        python.read("study/a.csv")


@pytest.fixture(scope="module")
def fitted(study_once):
    """The rows of the folder, its methods section, and its archive, verified."""
    outputs = {}
    for name, words in {
        "fit": "fit fits", "methods": "report fits --methods", "pack": "pack fits -o study.zip",
        "verify": "verify study.zip",
    }.items():  # fmt: skip
        done = call(*words.split(), cwd=study_once)
        assert name == "fit" or done.returncode == 0, done.stderr
        outputs[name] = done.stdout
    return outputs


def same_value(row, parameters):
    """Whether a row and a table of parameters have the same elasticity, to the bit."""
    found = parameters["elasticity"]
    return [row["elasticity"], row["elasticity_combined"]] == [repr(found["value"]), repr(found["combined"])]


def page_of(document):
    """The parameters of the one track of the one log that `palpate fit --json` printed."""
    ((_, log),) = json.loads(document)["logs"].items()
    ((_, track),) = log["tracks"].items()
    return track["parameters"]


@pytest.mark.slow
@pytest.mark.parametrize("key", STATED)
def test_row_page_python_and_the_pipeline_of_the_report_give_one_number(study, fitted, key):
    palpate = partial(call, cwd=study)
    row = rows_of(study / "fits")[key]
    shown = palpate("fit", f"study/{key}.csv", "--pipeline", "fits/pipeline.toml", "--out", f"page-{key}", "--json")
    assert same_value(row, page_of(shown.stdout)), shown.stderr
    fit = python.fit(f"study/{key}.csv")
    assert row["elasticity"] == repr(fit.elasticity.value)
    assert row["elasticity_combined"] == repr(fit.elasticity.combined)
    done = palpate("report", "fits", "--where", f"curve=study/{key}.csv", "--out", f"{key}.html")
    assert done.returncode == 0, done.stderr
    page = (study / f"{key}.html").read_text()
    text = html.unescape(re.search(r"<pre>(palpate = .*?)</pre>", page, re.DOTALL)[1])
    (study / "fits" / "again.toml").write_text(text)
    again = palpate("fit", "fits/again.toml", "--out", f"again-{key}", "--json")
    assert same_value(row, page_of(again.stdout)), again.stderr


@pytest.mark.slow
@pytest.mark.parametrize("key", STATED)
def test_the_methods_say_what_was_stated_of_which_curves(fitted, key):
    assert SENTENCES[key] in fitted["methods"]


@pytest.mark.slow
def test_no_sentence_of_the_methods_is_of_all_where_curves_differ(fitted):
    text = fitted["methods"]
    assert "The specimens were treated as a half-space, without a correction of their thickness (12 curves)." in text
    assert "The force was used as recorded, without a correction of its zero; " in text
    assert "settings of their own" not in text
    assert "same to the byte" in fitted["verify"]


@pytest.mark.slow
def test_layers_of_several_heights_are_one_study(layers, palpate):
    done = palpate("fit", "study", "--out", "fits")
    assert done.returncode == 0, done.stderr
    assert "dr, nu 0.5, 10 to 22 mm thick;" in " ".join(done.stdout.split())
    for row in rows_of(layers / "fits").values():
        assert float(row["elasticity"]) == pytest.approx(25e3, abs=3 * float(row["elasticity_combined"]))
    command = re.search(r"a page on one: palpate (.*) && palpate (.*)", done.stdout)
    for words in command.groups():
        assert palpate(*shlex.split(words)).returncode == 0
    document = json.loads((layers / "fits" / "page" / "a" / "result.json").read_text())
    ((_, track),) = document["tracks"].items()
    assert same_value(rows_of(layers / "fits")["a"], track["parameters"])
    methods = palpate("report", "fits", "--methods").stdout
    assert (
        "The finite thickness of the specimens, 10 to 22 mm, was corrected by the law of Garcia et al. [3]." in methods
    )
    assert "half-space, without" not in methods
