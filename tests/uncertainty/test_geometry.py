"""What nobody has said of the specimen: its thickness, and what else one frequency may be."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.delay.one_frequency import one_frequency
from palpate_uncertainty.undeclared_thickness import geometry, stiffer_by

spec = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
palpations = importlib.util.module_from_spec(spec)
spec.loader.exec_module(palpations)
TRACK = palpations.evidence(palpations.SINE, 0.0, 1)


def of(**changes):
    return replace(TRACK, model=DimensionalityReduction(**{"indenter": Sphere(radius=5e-3)} | changes))


def test_an_undeclared_thickness_is_told_with_what_it_would_take():
    found = geometry([of()])["t"]
    assert [flag.code for flag in found.flags] == ["thickness-undeclared"]
    radius = np.sqrt(5e-3 * 4e-3)
    assert found.table["contact_radius"] == pytest.approx(radius, rel=0.01)
    assert found.table["half_space_from"] == pytest.approx(1.133 * radius / 0.05, rel=0.01)
    assert not found.terms  # nobody knows how thick it is


@pytest.mark.parametrize("thickness", ["half-space", {"law": "dimitriadis", "height": "22 mm", "bonded": False}])
def test_a_thickness_that_is_declared_is_not_asked_for(thickness):
    model = DimensionalityReduction.model_validate({"indenter": Sphere(radius=5e-3), "thickness": thickness})
    assert not geometry([replace(TRACK, model=model)])


def test_a_small_contact_is_not_asked_for_a_thickness():
    assert not geometry([of(indenter=Sphere(radius=0.2e-3))])


def test_a_half_space_that_is_declared_has_the_force_of_one_that_is_not():
    said, silent = of(thickness="half-space").model, of().model
    assert said.force(4e-3, 1e-2, [112.5e3, 362.0]) == silent.force(4e-3, 1e-2, [112.5e3, 362.0])
    assert said.validity(4e-3) == silent.validity(4e-3)


def test_a_layer_of_22_mm_is_stiffer_by_what_dimitriadis_says():
    """X = sqrt(5 * 4)/22 = 0.203: 1 + 0.230 + 0.053 + 0.006."""
    assert stiffer_by(np.sqrt(20e-6), 22e-3) == pytest.approx(0.290, abs=0.001)


@pytest.mark.slow
def test_one_frequency_is_a_flag_where_a_tenth_of_the_stiffness_is_more_than_a_tenth_of_the_viscosity():
    found = one_frequency([TRACK])["t"]
    assert found.table["looks_like"]["viscosity"]["value"] == pytest.approx(149.0, rel=0.02)  # of 362
    assert [flag.code for flag in found.flags] == ["one-frequency"]
    much = replace(TRACK, values=np.array([112.5e3, 1600.0]))
    assert not one_frequency([much])["t"].flags
    several = palpations.evidence(palpations.MULTI, 0.0, 2)
    several = one_frequency([replace(several, values=np.array([112.5e3, 100.0]))])
    assert not any(found.flags for found in several.values())
