"""A track's name is a text with two halves."""

import json
import pickle

import pytest
from palpate_engine import TrackName


def test_it_is_the_text_that_it_spells():
    name = TrackName("dr", "ekf")
    assert name == "dr/ekf"
    assert {name: 1}["dr/ekf"] == 1
    assert json.dumps([name]) == '["dr/ekf"]'
    assert (name.model, name.estimator) == ("dr", "ekf")


def test_halves_survive_parsing_and_pickling():
    """A name with a slash of its own keeps its halves on its way to another process."""
    name = TrackName("dr/thin", "ekf")
    again = pickle.loads(pickle.dumps(name))
    assert (again.model, again.estimator) == ("dr/thin", "ekf")
    assert TrackName.parse("dr/ekf").estimator == "ekf"
    assert TrackName.parse(name) is name


@pytest.mark.parametrize("text", ["dr", "dr/", "/ekf", ""])
def test_what_names_no_track_is_refused(text):
    with pytest.raises(ValueError, match="MODEL/ESTIMATOR"):
        TrackName.parse(text)
