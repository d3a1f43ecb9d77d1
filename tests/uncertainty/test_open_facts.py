"""Facts that nobody has stated: each with what an alternative would do, and none a doubt."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate import Condition
from palpate.registry import load
from palpate_engine import UncertainValue
from palpate_engine.result.materiality import weigh
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.delay.one_frequency import one_frequency, one_frequency_text
from palpate_uncertainty.open_facts import open_facts
from palpate_uncertainty.undeclared_thickness import stiffer_by

spec = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
palpations = importlib.util.module_from_spec(spec)
spec.loader.exec_module(palpations)
TRACK = palpations.evidence(palpations.SINE, 0.0, 1)


def facts(track):
    return {one.fact: one for one in open_facts([track])[track.name].conditions}


def of(**changes):
    return replace(TRACK, model=DimensionalityReduction(**{"indenter": Sphere(radius=5e-3)} | changes))


def test_an_open_thickness_says_what_the_values_hold_for_and_what_22_mm_would_do():
    thick = facts(of())["thickness"]
    radius = np.sqrt(5e-3 * 4e-3)
    assert thick.text == "specimen thicker than 100 mm"
    share = 1 / (1 + stiffer_by(radius, 22e-3)) - 1
    assert thick.shifts["elasticity"] == pytest.approx(share * TRACK.values[0], rel=0.02)
    assert not open_facts([of()])["t"].terms  # nobody knows how thick it is


@pytest.mark.parametrize("thickness", ["half-space", {"law": "dimitriadis", "height": "22 mm", "bonded": False}])
def test_a_thickness_that_is_stated_is_no_condition(thickness):
    model = DimensionalityReduction.model_validate({"indenter": Sphere(radius=5e-3), "thickness": thickness})
    assert "thickness" not in facts(replace(TRACK, model=model))


def test_a_small_tip_is_asked_for_ten_contact_radii():
    small = facts(of(indenter=Sphere(radius=0.2e-3)))["thickness"]
    assert small.shifts["elasticity"] / TRACK.values[0] == pytest.approx(1 / (1 + stiffer_by(1.0, 10.0)) - 1)


def test_poissons_ratio_is_open_until_it_is_stated():
    assert facts(of())["poisson"].shifts["elasticity"] / TRACK.values[0] == pytest.approx(0.0633, abs=0.005)
    assert "poisson" not in facts(of(poisson=0.5))  # stated, though it is the default
    assert "poisson" not in facts(of(poisson=0.4))
    stated = replace(of(), ending=replace(TRACK.ending, uncertainties={"poisson": 0.01}))
    assert "poisson" not in facts(stated)


def test_an_open_delay_moves_the_viscosity_by_its_shear_modulus_times_10_ms():
    settings = TRACK.ending.settings.model_copy(
        update={"force": TRACK.ending.settings.force.model_copy(update={"uncertainty": None})}
    )
    track = replace(of(), ending=replace(TRACK.ending, settings=settings))
    late = facts(track)["delay"]
    assert late.shifts["viscosity"] == pytest.approx(0.01 * TRACK.values[0] / 3, rel=0.02)
    assert late.needed_by("viscosity", UncertainValue(362.0, 10.0, "Pa*s"))
    assert not late.needed_by("elasticity", UncertainValue(112e3, 1e3, "Pa"))


def test_a_layer_of_22_mm_is_stiffer_by_what_dimitriadis_says():
    """X = sqrt(5 * 4)/22 = 0.203: 1 + 0.230 + 0.053 + 0.006."""
    assert stiffer_by(np.sqrt(20e-6), 22e-3) == pytest.approx(0.290, abs=0.001)


def test_a_half_space_that_is_declared_has_the_force_of_one_that_is_not():
    said, silent = of(thickness="half-space").model, of().model
    assert said.force(4e-3, 1e-2, [112.5e3, 362.0]) == silent.force(4e-3, 1e-2, [112.5e3, 362.0])
    assert said.validity(4e-3) == silent.validity(4e-3)


def test_a_condition_never_makes_a_doubt_and_a_value_may_need_its_fact():
    values = {"elasticity": UncertainValue(100.0, 1.0, "Pa"), "viscosity": UncertainValue(10.0, 1.0, "Pa*s")}
    thick = Condition("thickness", "specimen thicker than 49 mm", "--thickness", "22 mm", {"elasticity": -13.0})
    late = Condition("delay", "simultaneous", "--delay", "10 ms", {"viscosity": 6.0})
    found = weigh([], values, load(), (thick, late))
    assert found.by_value == {"elasticity": "good", "viscosity": "needs delay"}
    assert thick.matters(values)
    assert not replace(thick, shifts={"elasticity": 0.9}).matters(values)
    assert thick.sentence(values) == "specimen thicker than 49 mm: 22 mm makes elasticity 13 % lower"


@pytest.mark.slow
def test_one_frequency_is_a_condition_where_a_tenth_of_the_stiffness_is_more_than_a_tenth_of_the_viscosity():
    found = one_frequency([TRACK])["t"]
    assert found.table["looks_like"]["viscosity"]["value"] == pytest.approx(149.0, rel=0.02)  # of 362
    assert one_frequency_text(TRACK)
    assert not one_frequency_text(replace(TRACK, values=np.array([112.5e3, 1600.0])))
    several = palpations.evidence(palpations.MULTI, 0.0, 2)
    assert not one_frequency_text(replace(several, values=np.array([112.5e3, 100.0])))
