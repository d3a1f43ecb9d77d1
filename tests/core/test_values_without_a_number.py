"""Values that need a fact or are not determined: none to calculate with in files, and the word itself on pages."""

import json

import pytest
from palpate import Flag
from palpate_engine import UncertainValue
from palpate_kit.runs.result_file import estimate_of, read_result, usable_value
from palpate_kit.terminal.flag_summary import summary_lines
from palpate_report.number_texts import value_of
from palpate_report.run_contents import RunContents
from palpate_report.run_verdict import LEVELS, judge, levels_of

from tests.result_documents import result, track, value


@pytest.mark.parametrize("verdict", ["needs delay", "not determined"])
def test_what_has_no_value_keeps_its_estimate_under_another_name(verdict):
    table = UncertainValue(16.0, 3.0, "Pa*s", verdict=verdict).table()
    assert (table["value"], table["estimate"], table["std"]) == (None, 16.0, 3.0)
    assert "estimate" not in UncertainValue(16.0, 3.0, "Pa*s", verdict="doubtful").table()


def test_a_file_that_has_the_number_as_its_value_is_read_the_same(tmp_path):
    path = tmp_path / "result.json"
    made = {"elasticity": value(1e5), "viscosity": value(16.0, "Pa*s", 3.0, verdict="needs delay")}
    path.write_text(json.dumps(result({"dr/ekf": track(parameters=made)})))
    found = read_result(path)["tracks"]["dr/ekf"]
    assert found["parameters"]["viscosity"]["value"] is None
    assert estimate_of(found["parameters"]["viscosity"]) == 16.0
    assert usable_value(found, "viscosity") is None
    assert usable_value(found, "elasticity")["value"] == 1e5


def test_a_page_says_why_there_is_no_number(tmp_path):
    assert value_of(value(None, "Pa*s", 3.0, verdict="needs delay")) == "needs delay"
    assert value_of(value(None, "Pa*s", 3.0, verdict="invalid")) == "–"
    made = {"dr/ekf": track("needs thickness", parameters={"elasticity": value(1e5, verdict="needs thickness")})}
    (tmp_path / "result.json").write_text(json.dumps(result(made)))
    assert judge(RunContents.read(tmp_path)).level == "needs thickness"


def test_what_has_no_number_stands_between_doubtful_and_invalid():
    good, doubtful, invalid = LEVELS
    assert levels_of([invalid, "needs delay", good, doubtful, good]) == [good, doubtful, "needs delay", invalid]


def test_three_lines_stand_below_a_table():
    """What the values hold for, what was found, what to type."""
    flags = [
        Flag("memory", "the force fades", "doubtful", remedy="Take a model that relaxes."),
        Flag("misfit", "more than noise", "doubtful", remedy="Look at the residual."),
        Flag("transient", "begins at 1 s", "note"),
    ]
    facts = {"specimen thicker than 49 mm": '--thickness "22 mm"', "force in time": "--delay"}
    assert list(summary_lines({"a": flags, "b": flags[:1]}, facts)) == [
        "holds if: specimen thicker than 49 mm; force in time",
        "doubtful: all: memory: the force fades; and misfit; note: transient",
        '-> --thickness "22 mm"; --delay; Take a model that relaxes; --details',
    ]
    assert list(summary_lines({"a": flags[2:]})) == ["note: transient", "-> palpate describe transient"]
    assert list(summary_lines({"a": []})) == []
