"""`palpate repeat --by`: groups of curves are compared by their units, such as animals."""

import csv
import json

import numpy as np
import pytest
from palpate_engine import registry
from scipy.stats import ttest_ind

from tests.fit_tables import draw_animals, write_fits


@pytest.fixture
def fits(tmp_path):
    """Two treatments without any effect, each of five animals of forty curves."""
    return draw_animals(tmp_path / "fits")


def table(folder, name):
    with (folder / name).open(encoding="utf-8", newline="") as file:
        return {row["curve"]: row for row in csv.DictReader(file)}


def means_of(folder, column):
    """Means of elasticity [Pa] by a column, in lists by treatment."""
    values, cells = table(folder, "fits.csv"), table(folder, "curves.csv")
    found = {}
    for name, row in cells.items():
        of_unit = found.setdefault(row["treatment"], {})
        of_unit.setdefault(row[column], []).append(float(values[name]["elasticity"]))
    return [[np.mean(numbers) for numbers in units.values()] for units in found.values()]


def test_groups_are_compared_by_the_means_of_their_animals(palpate, fits):
    done = palpate("repeat", "fits", "--by", "treatment", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["replication"]["unit"] == "animal"
    assert (found["replication"]["units"], found["replication"]["curves"]) == (10, 400)
    assert found["replication"]["icc"] == pytest.approx(0.92, abs=0.06)
    first, second = means_of(fits, "animal")
    expected = ttest_ind(second, first, equal_var=False)
    (test,) = found["tests"]
    assert (test["t"], test["degrees_of_freedom"], test["p"]) == pytest.approx(
        (expected.statistic, expected.df, expected.pvalue)
    )
    group = found["groups"]["t0"]
    assert (group["units"], group["curves"], group["count"]) == (5, 200, 200)
    assert group["mean"] == pytest.approx(np.mean(first))
    assert group["std_of_mean"] == pytest.approx(np.std(first, ddof=1) / np.sqrt(5))
    common = np.sqrt(1600.0**2 - 300.0**2)
    assert group["combined_of_mean"] == pytest.approx(np.hypot(group["std_of_mean"], common))


def test_units_scatter_and_test_are_printed(palpate, fits):
    done = palpate("repeat", "fits", "--by", "treatment")
    text = " ".join(done.stdout.split())
    assert "The means of 10 units (animal) with 400 curves, 5 in each of 2 groups" in text
    assert "ICC 0.9" in text
    assert "between" in text
    assert "within" in text
    assert "specimen of its own" not in text


def test_a_test_of_curves_beside_animals_must_be_asked_for(palpate, fits):
    found = json.loads(palpate("repeat", "fits", "--by", "treatment", "--unit", "curve", "--json").stdout)
    by_unit = json.loads(palpate("repeat", "fits", "--by", "treatment", "--json").stdout)
    assert found["replication"]["unit"] == "curve"
    assert found["tests"][0]["p"] < 1e-3 < 0.05 < by_unit["tests"][0]["p"]
    text = " ".join(palpate("repeat", "fits", "--by", "treatment", "--unit", "curve").stdout.split())
    assert "as if it were of a specimen of its own" in text


def test_two_animals_a_group_give_no_p_value_and_it_says_why(palpate, tmp_path):
    draw_animals(tmp_path / "few", animals=2)
    done = palpate("repeat", "few", "--by", "treatment")
    assert done.returncode == 0, done.stderr
    assert "no p-value below 3 units (animal) in a group: t0 has 2, t1 has 2" in " ".join(done.stdout.split())
    assert json.loads(palpate("repeat", "few", "--by", "treatment", "--json").stdout)["tests"][0]["p"] is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--unit", "site"], "--unit site: s0 lies in several groups"),
        (["--unit", "anmal"], "did you mean 'animal'"),
        (["--unit", "curve", "--mixed"], "--mixed: each unit (curve) has one value"),
    ],
)
def test_a_unit_that_is_none_is_refused(palpate, fits, words, message):
    done = palpate("repeat", "fits", "--by", "treatment", *words)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())


def test_two_columns_that_cross_are_refused_by_name(palpate, tmp_path):
    cells = {
        f"{t}{i}": {"treatment": t, "animal": f"{t}a{i % 2}", "day": f"{t}d{i // 2}"} for t in "ab" for i in range(4)
    }
    write_fits(tmp_path / "fits", dict.fromkeys(cells, 1e5), cells)
    done = palpate("repeat", "fits", "--by", "treatment")
    assert done.returncode == 2
    assert "give --unit animal or --unit day" in " ".join(done.stderr.split())


def test_a_curve_without_an_animal_is_named(palpate, fits):
    lines = (fits / "curves.csv").read_text().replace("0-0-7.csv,t0,0-0", "0-0-7.csv,t0,")
    (fits / "curves.csv").write_text(lines)
    done = palpate("repeat", "fits", "--by", "treatment")
    assert done.returncode == 2
    assert "0-0-7.csv: curves.csv does not say of which animal it is" in " ".join(done.stderr.split())


def test_groups_of_folders_have_units_too(palpate, tmp_path):
    for name in "ab":
        cells = {f"{name}{i}": {"animal": f"{name}{i // 3}"} for i in range(9)}
        write_fits(tmp_path / name, {curve: 1e5 + 1e3 * i**2 for i, curve in enumerate(cells)}, cells)
    found = json.loads(palpate("repeat", "--group", "one=a", "--group", "two=b", "--json").stdout)
    assert found["replication"] | {"unit": "animal", "units": 6, "curves": 18} == found["replication"]
    found = json.loads(palpate("repeat", "--group", "one=a", "--group", "two=[a]", "--json").stdout)
    assert found["replication"]["unit"] == "curve"  # the same animals in both


def test_units_of_runs_are_refused(palpate, tmp_path):
    done = palpate("repeat", tmp_path, "--unit", "animal")
    assert done.returncode == 2


@pytest.mark.slow
def test_a_mixed_model_is_near_the_test_of_means(palpate, fits):
    pytest.importorskip("statsmodels")
    found = json.loads(palpate("repeat", "fits", "--by", "treatment", "--mixed", "--json").stdout)
    first, second = means_of(fits, "animal")
    (test,) = found["tests"]
    assert found["test"] == "mixed"
    assert test["degrees_of_freedom"] == 8
    assert test["p"] == pytest.approx(ttest_ind(first, second).pvalue, rel=1e-3)


def test_without_statsmodels_a_mixed_model_fails_by_name(palpate, fits, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "statsmodels.regression.mixed_linear_model", None)
    done = palpate("repeat", "fits", "--by", "treatment", "--mixed")
    assert done.returncode == 2
    assert "--mixed needs statsmodels" in done.stderr


@pytest.mark.slow
def test_many_groups_print_at_most_twenty_pairs_with_corrected_values(palpate, tmp_path):
    draw_animals(tmp_path / "many", groups=12, animals=3, curves=2)
    text = palpate("repeat", "many", "--by", "treatment").stdout
    assert sum(" - t" in line for line in text.splitlines()) == 20
    assert "p by Holm" in text
    assert "the 20 smallest p of 66 pairs" in text
    assert "Games-Howell is liberal with fewer than 10 units" in text
    whole = palpate("repeat", "many", "--by", "treatment", "--details").stdout
    assert sum(" - t" in line for line in whole.splitlines()) == 66


@pytest.mark.parametrize("command", [["repeat", "fits", "--by", "treatment"], ["repeat", "review", "fits"]])
def test_many_curves_are_a_screen_and_ask_for_the_plugins_once(palpate, fits, command, monkeypatch):
    """Once the registry of plugins was loaded for each curve: 24 s for 2000 of them, and 14 002 lines."""
    calls, load = [], registry.load
    monkeypatch.setattr(registry, "load", lambda *files: calls.append(files) or load(*files))
    done = palpate(*command)
    assert done.returncode == 0, done.stderr
    assert len(calls) < 10
    assert len(done.stdout.splitlines()) < 60


@pytest.mark.slow
def test_all_rows_of_a_review_are_there_as_csv(palpate, tmp_path):
    draw_animals(tmp_path / "many", curves=20)
    assert "40 of 200 rows, all with --format csv" in " ".join(palpate("repeat", "review", "many").stdout.split())
    rows = palpate("repeat", "review", "many", "--format", "csv").stdout.splitlines()
    assert sum(row.startswith("curves/") for row in rows) == 200
