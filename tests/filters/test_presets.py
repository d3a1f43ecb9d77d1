"""Presets of the fading filters."""

import math

import pytest
from palpate.offers import import_target
from palpate_engine.config import load_pipeline
from palpate_filters import palpate_estimators

ESTIMATORS = {name: import_target(place) for name, place in palpate_estimators().items()}


@pytest.mark.parametrize("name", ["afekf", "afukf"])
def test_the_authors_constants(name):
    found = ESTIMATORS[name](preset="authors")
    fading = found.fading
    assert (fading.theta, fading.alpha_max, fading.step_up, fading.step_down) == (1.9e-3, 1.003, 1e-4, 5e-5)
    assert fading.signed
    assert found.derivative_std == pytest.approx(math.sqrt(0.1))


@pytest.mark.parametrize("preset", ["paper", "authors"])
@pytest.mark.parametrize("name", ["afekf", "afukf"])
def test_what_is_given_stands_over_the_preset(name, preset):
    plain, whole = ESTIMATORS[name](), ESTIMATORS[name](preset=preset)
    found = ESTIMATORS[name](preset=preset, fading={"theta": "2 mm/s"}, derivative_std=0.5)
    assert (found.fading.theta, found.derivative_std) == (2e-3, 0.5)
    assert found.fading.alpha_max == whole.fading.alpha_max
    assert whole.fading.signed
    assert not plain.fading.signed
    assert plain == ESTIMATORS[name](preset="palpate")


def test_a_preset_in_a_pipeline(point_pipeline):
    table = '\n[estimator.old]\ntype = "afukf"\npreset = "authors"\n[estimator.old.fading]\nalpha_max = 1.01\n'
    point_pipeline.write_text(point_pipeline.read_text() + table)
    found = load_pipeline(point_pipeline).estimators["old"]
    assert found.fading.alpha_max == 1.01
    assert found.fading.theta == 1.9e-3
    assert not found.redraw
