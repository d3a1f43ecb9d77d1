"""The report of a folder of fits, its methods section and the table of its supplement."""

import csv
import json
import re
import tomllib
from collections import Counter

import numpy as np
import pytest
from palpate_kit.curves.curve_table import latest_rows
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_report.bibliography import bibtex_of, keys_of, references
from palpate_report.cited_text import CitedText, cite
from scipy.stats import ttest_ind

from tests.command import call
from tests.studies.study_folder import NAMES, copied, made

NUMBER = re.compile(r"-?\d+(?:\.\d+)*(?:e[+-]?\d+)?")


@pytest.fixture(scope="module")
def fits_once(tmp_path_factory):
    folder = made(tmp_path_factory.mktemp("study"))
    (folder / "fits" / "rig.toml").write_text('instrument = "a press (model 7)"\n')
    return folder


@pytest.fixture
def study(fits_once, tmp_path):
    return copied(fits_once, tmp_path)


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def shared_part(row, name):
    std, combined = float(row[f"{name}_std"]), float(row[f"{name}_combined"])
    return np.sqrt(max(combined**2 - std**2, 0.0)) / float(row[name])


def numbers_of_files(fits):
    """Every number that a methods section may have, from the files alone."""
    rows, curves = latest_rows(fits / "fits.csv"), {row["curve"]: row for row in table(fits / "curves.csv")}
    rejected = json.loads((fits / "review.json").read_text())["rejected"]
    used = [row for row in rows if row["curve"] not in rejected and row["verdict"] != "invalid"]
    pipeline = tomllib.loads((fits / "pipeline.toml").read_text())
    versions = json.loads((fits / "provenance.json").read_text())[-1]["versions"]
    yield from (str(len(rows)), str(len(used)), str(len(rejected)), "1", "95")  # coverage factor, interval
    yield from NUMBER.findall(tomllib.loads((fits / "rig.toml").read_text())["instrument"])
    yield f"{1e3 * pipeline['indenter']['tip']['curvature_radius']:.4g}"
    yield f"{1e3 * pipeline['alignment']['force']['uncertainty']:.3g}"
    (model,) = pipeline["model"].values()
    yield f"{model.get('poisson', 0.5):g}"  # left out where nobody stated it
    yield from (versions[name] for name in ("palpate", "python", "casadi", "numpy", "scipy"))
    for row in used:
        yield from NUMBER.findall(row["conditions"])
    facts = [entry.partition(":")[0] for row in used for entry in row["conditions"].split("; ") if entry]
    yield from (str(facts.count(fact)) for fact in facts)
    for name, factor in (("elasticity", 1e-3), ("viscosity", 1.0)):
        yield from map(str, Counter(row[f"{name}_verdict"] for row in used).values())
        known = [row for row in used if row[name]]
        if not known:
            continue
        yield str(sum(not row[name] for row in used))
        yield f"{100 * np.median([float(row[f'{name}_combined']) / float(row[name]) for row in known]):.2g}"
        yield f"{100 * np.median([shared_part(row, name) for row in known]):.2g}"
        means = {}
        for group in ("control", "treated"):
            animals = {}
            for row in known:
                if curves[row["curve"]]["treatment"] == group:
                    animals.setdefault(curves[row["curve"]]["animal"], []).append(float(row[name]))
            means[group] = np.array([np.mean(values) for values in animals.values()])
            yield from (str(len(animals)), str(sum(map(len, animals.values()))))
            yield from NUMBER.findall(
                value_with_uncertainty(factor * means[group].mean(), factor * means[group].std(ddof=1))
            )
        yield from (str(sum(map(len, means.values()))), str(len(means)))
        test = ttest_ind(means["treated"], means["control"], equal_var=False)
        low, high = test.confidence_interval(0.95)
        difference = means["treated"].mean() - means["control"].mean()
        yield from (f"{factor * number:.3g}" for number in (difference, low, high))
        yield from (f"{test.statistic:.3g}", f"{test.df:.3g}", f"{test.pvalue:.2g}", "0.001")


@pytest.mark.slow
def test_every_number_of_the_methods_is_one_of_the_files(study, palpate):
    done = palpate("report", "fits", "--methods", "--by", "treatment")
    assert done.returncode == 0, done.stderr
    text = (study / "fits" / "methods.txt").read_text()
    assert done.stdout == text
    paragraphs = re.sub(r" \[[\d, ]+\]", "", text.partition("References")[0])
    known = set(numbers_of_files(study / "fits"))
    found = NUMBER.findall(paragraphs.replace("UR3e", ""))
    assert len(found) > 30
    assert [number for number in found if number not in known] == []
    assert f"A total of {len(NAMES)} force-depth curves were recorded with a press (model 7)." in paragraphs
    assert "1 was excluded (rejected on inspection: the tip slipped, n = 1)" in paragraphs
    assert "The means of 6 units (animal) with 11 curves, 3 in each of 2 groups" in paragraphs


@pytest.mark.slow
def test_the_methods_cite_what_bibtex_has(study, palpate):
    assert palpate("report", "fits", "--methods", "--by", "treatment").returncode == 0
    latex = (study / "fits" / "methods.tex").read_text()
    cited = {key for keys in re.findall(r"\\cite\{([^}]*)\}", latex) for key in keys.split(",")}
    assert {"popov2015", "beber2025", "gum2008", "welch1947", "andersson2019"} == cited
    assert cited == set(re.findall(r"^@\w+\{(\w+),$", (study / "fits" / "methods.bib").read_text(), re.MULTILINE))
    assert not re.search(r"(?<!\\)%(?! \\input)|±|_", latex.partition("\n")[2])


@pytest.mark.slow
def test_an_instrument_that_nobody_has_stated_is_asked_for(study, palpate):
    (study / "fits" / "rig.toml").unlink()
    done = palpate("report", "fits", "--methods")
    assert done.returncode == 0
    assert "[instrument: not stated]" in done.stdout
    assert 'instrument = "..." in fits/rig.toml' in done.stderr
    assert "Results" not in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["csv", "tex", "xlsx"])
def test_a_table_for_the_supplement_has_units_in_its_header(study, palpate, suffix):
    done = palpate("report", "fits", "--supplement", f"table.{suffix}")
    assert done.returncode == 0, done.stderr
    path = study / f"table.{suffix}"
    if suffix == "tex":
        lines = path.read_text().splitlines()
        assert "elasticity [kPa] & " in lines[2]
        assert sum(line.startswith("control/") or line.startswith("treated/") for line in lines) == len(NAMES)
        return
    if suffix == "xlsx":
        from openpyxl import load_workbook

        head, *rows = [list(row) for row in load_workbook(path).active.values]
        assert isinstance(rows[0][head.index("elasticity [kPa]")], float)
    else:
        head, *rows = list(csv.reader(path.read_text().splitlines()))
    assert head[:5] == ["curve", "treatment", "animal", "elasticity [kPa]", "u(elasticity) [kPa]"]
    assert [row[0] for row in rows] == NAMES
    values = [float(row["elasticity"]) for row in table(study / "fits" / "fits.csv")]
    assert [float(row[3]) for row in rows] == pytest.approx([1e-3 * value for value in values], rel=1e-3)
    assert rows[1][-1] == "rejected on inspection: the tip slipped"


@pytest.mark.slow
def test_the_page_says_how_its_curves_were_measured_and_fitted(study, palpate):
    done = palpate("report", "fits", "--by", "treatment")
    assert done.returncode == 0, done.stderr
    page = (study / "fits" / "report.html").read_text()
    for words in (
        "paraboloid, curvature radius 3 mm", "a press (model 7)", "dimensionality-reduction", "Popov and Hess 2015",
        "Budget of uncertainty of a typical curve", "What the values hold for",
        "rejected on inspection: the tip slipped",
        "palpate fit ../control ../treated --tip", "palpate 0.", "casadi", "Curves and their fits", "best: ", "worst: ",
    ):  # fmt: skip
        assert words in page, words
    assert str(study) not in page


@pytest.mark.slow
def test_a_page_without_its_curves_says_so(study, palpate):
    (study / "control").rename(study / "gone")
    (study / "treated").rename(study / "gone too")
    done = palpate("report", "fits", "--by", "treatment")
    assert done.returncode == 0, done.stderr
    assert "Not shown, since the fits cannot be made again here" in (study / "fits" / "report.html").read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--supplement", "table.doc"], "ends in .csv, .tex, .xlsx"),
        (["--unit", "animal"], "with --by COLUMN"),
        (["--methods", "--out", "x.html"], "--out: is for the page"),
        (["--methods", "--by", "treatment", "--unit", "anmal"], "did you mean 'animal'"),
        (["--methods", "--by", "animl"], "did you mean 'animal'"),
    ],
)
def test_what_cannot_be_written_is_named(study, palpate, words, told):
    done = palpate("report", "fits", *words)
    assert (done.returncode, told in done.stderr) == (2, True), done.stderr


@pytest.mark.parametrize("words", [["--methods"], ["--supplement", "x.csv"], ["--unit", "animal"]])
def test_a_run_has_none_of_it(palpate, words):
    done = call("report", "nothing", *words, cwd=".")
    assert (done.returncode, "is for a folder of fits" in done.stderr) == (2, True)


def test_sources_are_found_by_what_models_call_them():
    assert keys_of("paper, eqs. kv_el and TotalForce; Popov and Hess 2015.") == ("beber2025", "popov2015")
    assert keys_of("nobody 1900") == ()
    assert bibtex_of(["popov2015"]).startswith("@book{popov2015,\n  author = {Popov")
    assert "sources" not in "".join(bibtex_of([key]) for key in references())
    assert references()["popov2015"].text.startswith("Popov VL, Hess M (2015). Method of Dimensionality")


def test_citations_are_numbered_in_their_order():
    text = CitedText({"Methods": f"One{cite(['welch1947'])} and 5 %{cite(['popov2015', 'welch1947'])}."})
    assert text.plain.startswith("Methods\n\nOne [1] and 5 % [2, 1].\n\nReferences\n\n[1] Welch")
    assert "One~\\cite{welch1947} and 5 \\%~\\cite{popov2015,welch1947}." in text.latex
