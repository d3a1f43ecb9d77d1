"""`palpate report budget`: the table of a run's uncertainty."""

import json

import pytest
from palpate import ConfigurationError
from palpate_uncertainty.budget_command import budget

from tests.result_documents import result, track


def run_folder(tmp_path, **changes):
    effect = {"sensitivity": -37.5e3, "contribution": 7.5, "percent": 2.07}
    value = {"value": 362.0, "unit": "Pa*s", "std": 3.0, "settling": 0.0, "combined": 8.08}
    rows = [
        {"source": "estimator", "std": None, "unit": "", "effects": {"viscosity": {**effect, "contribution": 3.0}}},
        {"source": "timing", "std": 2e-4, "unit": "s", "effects": {"viscosity": effect}},
    ]
    found = track(**{"parameters": {"viscosity": value}, "budget": rows, **changes})
    document = result({"dr/fit": found})
    (tmp_path / "result.json").write_text(json.dumps(document))
    return tmp_path


def test_every_source_is_shown_with_its_share(tmp_path, capsys):
    budget(run_folder(tmp_path), details=True)
    shown = capsys.readouterr().out
    for words in ("timing", "7.5 Pa s (2.1 %)", "estimator", "combined", "8.08 Pa s (2.2 %)"):
        assert words in shown


def test_a_corrected_value_stands_below_with_its_own_uncertainty(tmp_path, capsys):
    value = {"value": 362.0, "unit": "Pa*s", "std": 3.0, "settling": 0.0, "combined": 14.2}
    known = {"bias": 13.0, "bias_std": 3.3, "corrected": 349.0, "corrected_combined": 6.1}
    budget(run_folder(tmp_path, parameters={"viscosity": value | known}), details=True)
    assert "349 Pa s +- 6.1 Pa s" in capsys.readouterr().out


def test_as_json_it_is_that_of_the_result(tmp_path, capsys):
    budget(run_folder(tmp_path), as_json=True)
    (rows,) = json.loads(capsys.readouterr().out).values()
    assert [row["source"] for row in rows] == ["estimator", "timing"]


def test_a_track_that_is_not_there_is_a_mistake(tmp_path):
    with pytest.raises(ConfigurationError, match="did you mean 'dr/fit'"):
        budget(run_folder(tmp_path), track="dr/fti")
