"""What a run has found is read back as it was: every number to the bit, flags of the record and of tracks apart."""

import json

import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_kit.jobs import result_cache as answers


@pytest.fixture
def result(point_pipeline, tmp_path):
    """A run of a filter and of a fit."""
    text = point_pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    point_pipeline.write_text(text + '[estimator.fit]\ntype = "casadi-fit"\n')
    return run_pipeline(load_pipeline(point_pipeline, ['run.tracks=["dr/ekf","dr/fit"]']), tmp_path / "run")


@pytest.mark.slow
def test_it_is_read_as_it_was(result):
    assert any(track.report and track.report.correlations for track in result.tracks.values())
    answers.write_cache(result)
    found = answers.read_cached(result.folder)
    assert json.dumps(found.table()) == json.dumps(result.table())
    assert found.flags == result.flags
    assert found.folder == result.folder
    for name, track in result.tracks.items():
        assert found.tracks[name].report == track.report
        assert found.tracks[name].parameters == track.parameters
        assert found.tracks[name].flags == track.flags


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"tracks": {}}', '{"tracks": {"a": {}}}', '{"tracks": 1}'])
def test_half_of_an_answer_is_none(content, tmp_path):
    (tmp_path / answers.ANSWER).write_text(content)
    assert answers.read_cached(tmp_path) is None


def test_without_an_answer_there_is_none(tmp_path):
    assert answers.read_cached(tmp_path / "nowhere") is None
