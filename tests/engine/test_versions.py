"""A pipeline of a newer version is refused by name; one of today states its version."""

import tomllib

import pytest
from palpate.errors import ConfigurationError
from palpate_engine.config import Source, build_pipeline, load_pipeline, resolved_text


def test_what_is_resolved_states_its_version(point_pipeline):
    text = resolved_text(load_pipeline(point_pipeline))
    assert tomllib.loads(text)["palpate"] == "0.2"
    assert resolved_text(build_pipeline(Source(text, point_pipeline))) == text


@pytest.mark.parametrize(
    ("version", "problem"),
    [
        ("9.3", r'point\.toml:1: written for palpate 9\.3, but this palpate reads up to "0\.2": update it'),
        ("new", r'point\.toml:1: palpate is \'new\'; write a version, such as palpate = "0\.2"'),
    ],
)
def test_another_version_is_refused_by_name(point_pipeline, version, problem):
    point_pipeline.write_text(f'palpate = "{version}"\n{point_pipeline.read_text()}')
    with pytest.raises(ConfigurationError, match=problem):
        load_pipeline(point_pipeline)


@pytest.mark.parametrize("version", ["", 'palpate = "0.1"\n', 'palpate = "0.2"\n'])
def test_a_key_of_a_draft_is_a_mistake_that_names_the_one_of_today(point_pipeline, version):
    text = point_pipeline.read_text().replace("[trajectory.press]", "[trajectory.press]\nstandstil = '3 s'  #", 1)
    point_pipeline.write_text(version + text)
    with pytest.raises(ConfigurationError, match="unknown key 'standstil'; did you mean 'standstill'"):
        load_pipeline(point_pipeline)
