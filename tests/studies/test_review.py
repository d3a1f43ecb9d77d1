"""Review: ratings by verdict, residual and distance from the group; marks that leave out and never delete."""

import json
from pathlib import Path

import numpy as np
import pytest
from palpate import Flag, LogError
from palpate_kit.runs.run_folder import RunFolder
from palpate_studies.parameter_values import ParameterValue, readings
from palpate_studies.review_command import rate_values

from tests import result_documents


def reading(name, value, residual=0.05, verdict="good", rejected=None):
    flags = (Flag("lack-of-fit", "x", "doubtful"),) if verdict == "doubtful" else ()
    return ParameterValue(name, Path(name), "", "dr/fit", value, 1e3, "Pa", None, residual, flags, verdict, rejected)


GROUP = [reading(f"run_{i}", 1.1e5 + 1e3 * np.sin(i), 0.05 + 1e-4 * i) for i in range(12)]


def test_what_is_like_the_others_has_ten_of_ten():
    assert [one.rating for one in rate_values(GROUP)] == [10.0] * 12


@pytest.mark.parametrize(
    ("odd", "most"),
    [
        (reading("odd", 2.2e5), 1.0),  # a value that stands out
        (reading("odd", 1.1e5, residual=0.5), 1.0),  # a residual that does
        (reading("odd", 1.1e5, verdict="doubtful"), 6.0),
        (reading("odd", 1.1e5, verdict="invalid"), 0.0),
        (reading("odd", None), 0.0),
    ],
)
def test_what_stands_out_comes_first(odd, most):
    first = rate_values([*GROUP, odd])[0]
    assert first.reading.name == "odd"
    assert first.rating <= most


def test_a_small_residual_is_no_fault_and_three_runs_have_no_outlier():
    assert min(one.rating for one in rate_values([*GROUP, reading("calm", 1.1e5, residual=0.001)])) == 10.0
    assert min(one.rating for one in rate_values([reading("a", 1.0), reading("b", 2.0), reading("c", 9.0)])) == 10.0


def test_what_was_rejected_does_not_count_for_the_others():
    wild = [reading(f"wild_{i}", 5e5, rejected="slipped") for i in range(20)]
    found = {one.reading.name: one.rating for one in rate_values([*GROUP, *wild])}
    assert found["run_0"] == 10.0
    assert found["wild_0"] < 1.0


@pytest.fixture
def runs(tmp_path):
    """Folders of runs with a result each; the last is off."""
    for i, value in enumerate([1.10e5, 1.11e5, 1.12e5, 1.13e5, 1.12e5, 1.9e5]):
        found = result_documents.value(value, std=5e2, combined=1e3)
        document = result_documents.result({"dr/fit": result_documents.track(parameters={"elasticity": found})})
        (tmp_path / f"run_{i}").mkdir()
        (tmp_path / f"run_{i}" / "result.json").write_text(json.dumps(document))
    return [tmp_path / f"run_{i}" for i in range(6)]


@pytest.mark.slow
def test_a_rejected_run_is_left_out_and_comes_back(palpate, runs):
    before = (runs[5] / "result.json").read_bytes()
    found = palpate("repeat", "review", *runs, "--json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["runs"][0]["name"].endswith("run_5")
    assert palpate("repeat", "review", *runs, "--reject", "run_5").returncode == 2  # no reason
    done = palpate("repeat", "review", *runs, "--reject", "run_5", "--reason", "the specimen slipped")
    assert "5 values. E: 5 good, 0 doubtful; 1 more rejected" in done.stdout
    assert (runs[5] / "result.json").read_bytes() == before
    told = palpate("repeat", *runs, "--json")
    document = json.loads(told.stdout)
    assert document["groups"]["runs"]["count"] == 5
    assert list(document["rejected"].values()) == ["the specimen slipped"]
    shown = palpate("repeat", *runs).stdout
    assert "the specimen slipped" in " ".join(shown.split())
    assert shown.splitlines()[-1] == "5 values. E: 5 good, 0 doubtful; 1 more rejected"
    sites = [arg for run in runs[1:] for arg in ("--baseline", run)]
    compared = palpate("map", "compare", *sites, "--suspect", runs[0])
    assert "the specimen slipped" in compared.stderr
    assert "4 baseline" in compared.stdout
    assert palpate("map", runs[5]).returncode == 2
    assert "more rejected" not in palpate("repeat", "review", *runs, "--accept", "run_5").stdout
    assert json.loads(palpate("repeat", *runs, "--json").stdout)["groups"]["runs"]["count"] == 6


@pytest.mark.slow
def test_mistakes_are_told(palpate, runs):
    unknown = palpate("repeat", "review", *runs, "--reject", "run_55", "--reason", "x")
    assert unknown.returncode == 2
    assert "no run is called 'run_55'" in unknown.stderr
    (runs[0] / "review.json").write_text("[]")
    with pytest.raises(LogError, match="is not a review"):
        list(readings(runs[0], None, "elasticity"))
    partly = palpate("repeat", "review", *runs)
    assert partly.returncode == 1
    assert "is not a review of palpate" in partly.stderr


@pytest.mark.slow
def test_cycles_of_a_fit_are_reviewed_one_by_one(tmp_path, palpate):
    rows = [
        {"log": "bag", "track": "dr/fit", "cycle": k, "rms": 0.1, "flags": [],
         "unknowns": {"elasticity": {"value": 1e5 + 100 * k, "std": 1e2, "unit": "Pa", "free": True}}}
        for k in range(1, 7)
    ]  # fmt: skip
    (tmp_path / "fit.json").write_text(json.dumps({"logs": {}, "evaluation": [], "cycles": rows}))
    done = palpate("repeat", "review", tmp_path, "--reject", "bag#3", "--reason", "touched the rim")
    assert done.returncode == 0, done.stderr
    assert RunFolder(tmp_path).rejected == {"bag#3": "touched the rim"}
    assert json.loads(palpate("repeat", tmp_path, "--json").stdout)["groups"]["runs"]["count"] == 5
