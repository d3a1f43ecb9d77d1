"""A folder of fits of many curves: settings, marks, groups, and the commands that read it."""

import csv
import json

import pytest
from palpate import ConfigurationError, LogError
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_table import latest_rows
from palpate_kit.curves.fit_folder import FitFolder

from tests.curves.conftest import NAMES


def elasticity(folder):
    """By curve."""
    return {row["curve"]: float(row["elasticity"]) for row in latest_rows(folder / "fits" / "fits.csv")}


@pytest.mark.slow
def test_another_tip_makes_rows_stale_and_they_are_fitted_anew_one_or_all(folder, palpate):
    before = elasticity(folder)
    said = palpate("fit", "fits", "--tip", "paraboloid 12 mm", "--no-refit")
    assert "8 of 8 curves are to be fitted" in said.stdout
    assert {row.state for row in FitFolder(folder / "fits").rows} == {"stale"}
    assert palpate("fit", "fits", "--where", f"curve={NAMES[2]}").returncode == 0
    assert [row.curve for row in FitFolder(folder / "fits").rows if row.state == "current"] == [NAMES[2]]
    assert palpate("fit", "fits", "--jobs", "1").returncode == 0
    after = elasticity(folder)
    assert list(after) == list(before)
    for name in NAMES:  # E goes with one over the root of the radius
        assert after[name] == pytest.approx(before[name] / 2, rel=1e-3)
    assert palpate("fit", "fits", "--set", "indenter.tip.curvature_radius=3 mm").returncode == 0
    assert elasticity(folder) == before  # what was refitted is to the digit what was fitted first


@pytest.mark.gate
@pytest.mark.slow
def test_a_curve_has_settings_of_its_own_and_loses_them(folder, palpate):
    before = elasticity(folder)
    one = f"curve={NAMES[1]}"
    assert palpate("fit", "fits", "--where", one, "--set", "indenter.tip.curvature_radius=12 mm").returncode == 0
    assert 'set = [\n    "indenter.tip.curvature_radius=12 mm",\n]' in (folder / "fits" / "own.toml").read_text()
    after = elasticity(folder)
    assert after[NAMES[1]] == pytest.approx(before[NAMES[1]] / 2, rel=1e-3)
    assert {name for name in NAMES if after[name] != before[name]} == {NAMES[1]}
    assert palpate("fit", "fits", "--where", one, "--unset", "indenter.tip.curvature_radius").returncode == 0
    assert elasticity(folder) == before


@pytest.mark.slow
def test_another_model_stands_in_place_of_the_first(folder, palpate):
    assert palpate("fit", "fits", "--model", "hunt-crossley", "--no-refit").returncode == 0
    assert palpate("fit", "fits", "--where", "S1_0").returncode == 0
    rows = latest_rows(folder / "fits" / "fits.csv")
    assert [row["track"] for row in rows] == ["hunt-crossley/fit", *["dimensionality-reduction/fit"] * 7]
    assert float(rows[0]["reference_force"]) > 0


@pytest.mark.slow
def test_what_was_rejected_is_in_no_statistics_and_no_map_and_named_on_the_page(folder, palpate):
    assert "8 of 8 curves" not in palpate("fit", "fits", "--groups", "groups.csv", "--no-refit").stdout
    told = palpate("repeat", "review", "fits", "--reject", NAMES[3], "--reason", "the tip slipped")
    assert "; 1 more rejected" in told.stdout
    assert palpate("repeat", "review", "fits", "--accept", NAMES[4]).returncode == 0
    found = json.loads(palpate("repeat", "fits", "--by", "sample", "--json").stdout)
    assert {name: group["count"] for name, group in found["groups"].items()} == {"S1": 4, "S2": 3}
    values = elasticity(folder)
    assert found["groups"]["S1"]["mean"] == pytest.approx(sum(values[name] for name in NAMES[::2]) / 4)
    assert found["tests"][0]["p"] < 1e-6
    made = palpate("map", "fits", "--json")
    assert json.loads(made.stdout)["sites"] == 7
    assert palpate("report", "fits", "--by", "sample").returncode == 0
    page = (folder / "fits" / "report.html").read_text()
    assert "8 curves" in page
    assert "rejected: the tip slipped" in page
    assert json.loads((folder / "fits" / "review.json").read_text())["accepted"] == {NAMES[4]: ""}
    marks = {row.curve: row.mark for row in FitFolder(folder / "fits").rows}
    assert (marks[NAMES[3]], marks[NAMES[4]], marks[NAMES[0]]) == ("bad", "good", "none")
    assert palpate("repeat", "review", "fits", "--clear", NAMES[3], "--clear", NAMES[4]).returncode == 0
    assert {row.mark for row in FitFolder(folder / "fits").rows} == {"none"}


@pytest.mark.slow
def test_models_are_chosen_over_the_curves_of_a_sample(folder, palpate):
    palpate("fit", "fits", "--groups", "groups.csv", "--no-refit")
    found = palpate("fit", "choose", "fits", "--models", "dr,hunt-crossley", "--where", "sample=S1", "--json")
    document = json.loads(found.stdout)
    assert {row["record"] for row in document["candidates"]} == set(NAMES[::2])
    assert document["standings"][0]["model"] == "dimensionality-reduction"


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("", 8), ("S1", 4), ("E>110", 4), ("E>110kPa", 4), ("elasticity<=110 s2", 0), ("verdict:good", 8),
        ("condition:thickness", 8), ("eta:needs", 0), ("E:good", 8), ("E:needs", 0),
        ("sample=S2 mark:none", 4), ("rms<0.05", 8), ("rms<50mN state:current", 8),
        ("curve='curves/S1_0.csv'", 1),
    ],
)  # fmt: skip
def test_filter_words_choose_rows(folder, palpate, words, count):
    palpate("fit", "fits", "--groups", "groups.csv", "--no-refit")
    found = FitFolder(folder / "fits")
    assert len(curve_filter(words, found).choose(found.rows)) == count


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("flg:stuck", "did you mean 'flag'"),
        ("flag:stuk", "no curve has the flag"),
        ("condition:thicknes", "did you mean 'thickness'"),
        ("eta:need", "did you mean 'needs'"),
        ("verdict:bad", "is not a verdict"),
        ("elastcity>1", "did you mean 'elasticity'"),
        ("E>1mm", "not a pressure"),
        ("E>", "E>"),
        ("sample=S1", "has no column 'sample'"),
        ("curve=S1_0.csv", "no curve"),
        ("'S1", "No closing quotation"),
    ],
)
def test_a_word_that_is_none_is_named(folder, palpate, words, message):
    refused = palpate("fit", "fits", "--where", words, "--no-refit")
    assert refused.returncode == 2
    assert message in " ".join(refused.stderr.split())
    with pytest.raises(ConfigurationError):
        curve_filter(words, FitFolder(folder / "fits"))


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("own.toml", '["S1_9.csv"]\nset = ["a.b=1"]\n', "no curve 'S1_9.csv'"),
        ("own.toml", '["curves/S1_0.csv"]\nste = []\n', "did you mean 'set'"),
        ("own.toml", '["curves/S1_0.csv"]\nset = [3]\n', "list of texts"),
        ("own.toml", "[", "cannot be read"),
        ("curves.csv", "curve,sample\ncurves/S1_0.cvs,S1\n", "curves.csv:2: no curve 'curves/S1_0.cvs'"),
        ("curves.csv", "curv,sample\n", "has no column 'curve'; did you mean 'curv'"),
        ("curves.csv", "curve,a\ncurves/S1_0.csv,1\ncurves/S1_0.csv,2\n", "is there twice"),
        ("curves.csv", "curve\ncurves/S1_0.csv,1\n", "2 cells for 1 columns"),
        ("review.json", "[]", "is not a review of palpate"),
        ("fits.csv", "", "is not a table of fits"),
        ("fits.csv", "time,force\n0,1\n", "is not a table of fits"),
        ("fits.csv", "curve,track,elasticity,elasticity_std,rms\n", "was written by another version of palpate"),
        ("fits.csv", "curve,track\n\0\n", "was written by another version of palpate"),
    ],
)
def test_a_file_that_does_not_fit_is_named_and_nothing_is_lost(folder, palpate, file, text, message):
    (folder / "fits" / file).write_text(text)
    before = {path.name: path.read_bytes() for path in (folder / "fits").iterdir()}
    refused = palpate("repeat", "fits")
    assert refused.returncode == 2
    assert message in " ".join(refused.stderr.split())
    assert {path.name: path.read_bytes() for path in (folder / "fits").iterdir()} == before


def test_a_setting_of_one_curve_that_cannot_be_is_told_with_its_file(folder, palpate):
    (folder / "fits" / "own.toml").write_text(f'["{NAMES[0]}"]\nset = ["estimator.fit.segmnt=load"]\n')
    refused = palpate("fit", "fits")
    assert refused.returncode == 2
    assert "own.toml, estimator.fit.segmnt=load:" in refused.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "estimator.fit.segment=laod"], "segment 'laod'"),
        (["--where", "S1", "--set", "estimator.fit.segmnt=load"], "did you mean 'segment'"),
        (["--where", "S1", "--set", "estimator.fit.segment=laod"], "segment 'laod'"),
        (["--tip", "spher 3 mm"], "did you mean 'sphere'"),
        (["--model", "hrtz"], "no model 'hrtz'"),
        (["--where", "S1", "--tip", "paraboloid 3 mm"], "one for all curves"),
        (["--unset", "estimator.fit.segment"], "of single curves"),
        (["--pipeline", "x.toml"], "has its pipeline"),
        (["--groups", "none.csv"], "no such file"),
    ],
)
def test_settings_that_cannot_be_are_refused_before_anything_is_written(folder, palpate, options, message):
    before = {path.name: path.read_bytes() for path in (folder / "fits").iterdir()}
    refused = palpate("fit", "fits", *options)
    assert refused.returncode == 2
    assert message in " ".join(refused.stderr.split())
    assert {path.name: path.read_bytes() for path in (folder / "fits").iterdir()} == before


def test_rows_that_later_ones_stand_for_and_a_torn_line_do_not_count(folder):
    table = folder / "fits" / "fits.csv"
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join([*lines, lines[1].replace(",558,", ",1,"), lines[2][:40]]))
    rows = latest_rows(table)
    assert [row["curve"] for row in rows] == list(csv.DictReader(lines).__next__().values())[:1] + NAMES_SORTED[1:]


NAMES_SORTED = sorted(NAMES)


@pytest.mark.slow
def test_a_curve_in_a_group_without_a_usable_value_is_told(folder, palpate):
    palpate("fit", "fits", "--groups", "groups.csv", "--no-refit")
    for name in NAMES[::2]:
        palpate("repeat", "review", "fits", "--reject", name, "--reason", "x")
    refused = palpate("repeat", "fits", "--by", "sample")
    assert refused.returncode == 2
    assert "group S1: no run has a value" in refused.stderr
    with pytest.raises(LogError):
        FitFolder(folder / "curves").settings_text()


def test_what_all_curves_share_is_not_taken_away_by_a_mean(folder, palpate):
    """The tip's radius and the thickness have the same error in each curve, and so in their mean."""
    rows = FitFolder(folder / "fits").rows
    shared = sorted(row.systematic("elasticity") for row in rows)
    assert shared[0] > 0.9 * rows[0].number("elasticity_combined")
    (group,) = json.loads(palpate("repeat", "fits", "--json").stdout)["groups"].values()
    assert group["combined_of_mean"] >= max(group["std_of_mean"], shared[len(shared) // 2 - 1])
