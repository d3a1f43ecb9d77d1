"""Skins that are not level: what the force across the tool says of them, and how good E is where they are stated."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate.alignment_report import SidewaysShare
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.assumptions import assumptions
from palpate_uncertainty.inclined_skin import axial_ratio, inclined_skin, possible_inclinations
from palpate_uncertainty.uncertainty_budget import budgets

HERE = Path(__file__)


def module(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


TRACK = module("palpations", HERE.with_name("palpations.py")).evidence(((2.0, 0.8e-3, 0.5),), 0.0, 1)
SLIDES, STICKS = math.tan(math.radians(20)), 0.1114  # shares of a tilt of 20 degrees


def judged(share, std=1e-4, skin=None, sweep=False, **uncertainties):
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3), skin=skin)
    report = replace(TRACK.ending.report, sideways=share and SidewaysShare(share, 0.0, std))
    ending = replace(TRACK.ending, report=report, is_sweep=sweep, uncertainties=uncertainties)
    return inclined_skin([replace(TRACK, model=model, ending=ending)]).get("t")


@pytest.mark.parametrize(("share", "least"), [(SLIDES, 14.4 / 85.6), (STICKS, 6.8 / 93.2)])
def test_a_tilt_that_nobody_stated_is_told_with_what_it_makes_of_the_values(share, least):
    (flag,) = judged(share).flags
    assert flag.code == "inclined-skin"
    # What friction leaves open ends with a tip that sticks: there the numbers are those of 20 degrees.
    relative = flag.effects["elasticity"] / TRACK.values[0]
    assert relative >= least - 1e-3
    if share == STICKS:
        assert relative == pytest.approx(least, abs=2e-3)
        assert np.degrees(judged(share).table["inclinations"]) == pytest.approx([6.36, 20.0], abs=0.1)
    assert flag.effects["viscosity"] / TRACK.values[1] == pytest.approx(relative)


@pytest.mark.parametrize(
    ("share", "skin", "flagged"),
    [
        (0.015, None, False),  # the axes of a sensor hear one another
        (0.05, None, True),
        (SLIDES, {"inclination": math.radians(20)}, False),
        (STICKS, {"inclination": math.radians(20)}, False),
        (0.02, {"inclination": math.radians(20)}, True),  # friction explains no less than a third
        (0.6, {"inclination": math.radians(20)}, True),
        (0.02, {"inclination": math.radians(4)}, False),
    ],
)
def test_friction_explains_what_lies_between_a_tip_that_slides_and_one_that_sticks(share, skin, flagged):
    assert bool(judged(share, skin=skin).flags) == flagged


@pytest.mark.parametrize(("share", "friction"), [(SLIDES, 0.0), (STICKS, 1.0)])
def test_three_axes_give_the_force_along_the_normal(share, friction):
    """What E is off by: the axial force at that friction over the one midway."""
    t, skin = math.radians(20), {"inclination": math.radians(20)}
    bias = judged(share, skin=skin, inclination="1 deg").biases["elasticity"]
    ratio = (1 + friction * 2 / 3 * math.tan(t) ** 2) / (1 + 0.5 * 2 / 3 * math.tan(t) ** 2)
    assert bias.shift / TRACK.values[0] == pytest.approx(1 - 1 / ratio, abs=5e-4)
    assert 0 < bias.std < abs(bias.shift)
    assert not judged(share).biases
    ending = replace(TRACK.ending, report=replace(TRACK.ending.report, sideways=SidewaysShare(share, 0.0, 1e-4)))
    track = replace(TRACK, model=DimensionalityReduction(indenter=Sphere(radius=5e-3), skin=skin))
    one, three = (budgets([replace(track, ending=end)])["t"].sources for end in (TRACK.ending, ending))
    assert "stick" in {term.cause for term in one}
    assert "stick" not in {term.cause for term in three}


def test_a_declared_uncertainty_of_the_inclination_admits_more():
    skin = {"inclination": math.radians(20)}
    share = math.tan(math.radians(25))
    assert judged(share, skin=skin, inclination="1 deg").flags
    assert not judged(share, skin=skin, inclination="3 deg").flags


def test_chance_sweeps_and_one_axis_say_nothing():
    assert not judged(0.05, std=0.02).flags
    assert judged(SLIDES, sweep=True) is None
    assert judged(None) is None


def test_a_share_comes_of_every_inclination_between_no_friction_and_sticking():
    angles = possible_inclinations(STICKS, 2 / 3)
    ratio = axial_ratio(STICKS, angles, 1.5)
    assert ratio[0] == pytest.approx(math.cos(math.atan(STICKS)) ** 2.5)
    assert ratio[-1] == pytest.approx(1 - 0.0684, abs=1e-3)
    assert (np.diff(ratio) < 0).all()


def test_what_is_not_stated_is_assumed_with_its_size():
    """cos(5.1 deg)^2.5 is 0.99; (1 + 5/250)^-0.5 too."""
    found = assumptions([TRACK])["t"].table
    assert math.degrees(found["level_within"]) == pytest.approx(5.13, abs=0.02)
    assert found["flat_above"] == pytest.approx(0.25, rel=0.01)
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3), skin={"inclination": 0.1})
    assert assumptions([replace(TRACK, model=model)])["t"].table["skin_stated"]


@pytest.mark.slow
def test_e_is_within_its_95_per_cent_where_the_skin_is_stated_and_a_tilt_is_told_where_it_is_not(root):
    benchmark = module("inclined_skins", root / "benchmarks" / "inclined_skins.py")
    draws = [benchmark.draw(seed) for seed in range(8)]
    assert [seed for seed, one in enumerate(draws) if not one.stated.right] == []
    errors, stds = np.transpose([one.stated.by_three_axes for one in draws])
    assert (np.abs(errors) <= 1.96 * stds).all()
    shown = [one for one in draws if one.can_show]
    assert len(shown) >= 2
    assert all(one.is_told for one in shown)
