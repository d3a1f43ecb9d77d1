"""Values that need a fact or are not determined: none to calculate with in files, and the word itself on pages."""

import json

import pytest
from palpate_engine import UncertainValue, is_open, needs_fact
from palpate_kit.runs.result_file import estimate_of, read_result, usable_value
from palpate_report.number_texts import value_of
from palpate_report.run_contents import RunContents
from palpate_report.run_verdict import LEVELS, judge, levels_of

from tests.result_documents import result, track, value


@pytest.mark.parametrize("verdict", ["needs delay", "not determined", "doubtful"])
def test_every_value_has_its_number_next_to_its_verdict(verdict):
    table = UncertainValue(16.0, 3.0, "Pa*s", verdict=verdict).table()
    assert (table["value"], table["std"], table["verdict"]) == (16.0, 3.0, verdict)


@pytest.mark.parametrize("made", [value(16.0, "Pa*s", 3.0, verdict="needs delay"), None], ids=["now", "before"])
def test_a_file_that_has_the_number_as_an_estimate_is_read_the_same(tmp_path, made):
    path = tmp_path / "result.json"
    made = made or value(None, "Pa*s", 3.0, verdict="needs delay") | {"estimate": 16.0}
    parameters = {"elasticity": value(1e5), "viscosity": made}
    path.write_text(json.dumps(result({"dr/ekf": track(parameters=parameters)})))
    found = read_result(path)["tracks"]["dr/ekf"]
    assert found["parameters"]["viscosity"]["value"] == 16.0
    assert estimate_of(found["parameters"]["viscosity"]) == 16.0
    assert usable_value(found, "viscosity") is None  # it enters no mean
    assert usable_value(found, "elasticity")["value"] == 1e5


def test_what_is_not_determined_enters_a_mean_and_what_needs_a_fact_does_not():
    assert is_open("not determined")
    assert not needs_fact("not determined")
    assert is_open("needs delay")
    assert needs_fact("needs delay")


def test_a_page_says_why_there_is_no_number(tmp_path):
    assert value_of(value(16.0, "Pa*s", 3.0, verdict="needs delay")) == "16.0 ± 3.0 Pa s needs delay"
    assert value_of(value(None, "Pa*s", 3.0, verdict="needs delay")) == "needs delay"
    assert value_of(value(None, "Pa*s", 3.0, verdict="invalid")) == "–"
    made = {"dr/ekf": track("needs thickness", parameters={"elasticity": value(1e5, verdict="needs thickness")})}
    (tmp_path / "result.json").write_text(json.dumps(result(made)))
    assert judge(RunContents.read(tmp_path)).level == "needs thickness"


def test_what_is_open_stands_between_doubtful_and_invalid():
    good, doubtful, invalid = LEVELS
    assert levels_of([invalid, "needs delay", good, doubtful, good]) == [good, doubtful, "needs delay", invalid]
