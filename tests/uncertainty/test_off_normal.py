"""A tool that stands off the skin's normal: what its tip makes of that."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate.alignment_report import TurnedTool
from palpate.alignment_settings import AlignmentSettings
from palpate_models import Cone, DimensionalityReduction, Flat, Sphere
from palpate_uncertainty.tool_off_normal import tool_off_normal
from palpate_uncertainty.uncertainty_budget import budgets

SPEC = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
PALPATIONS = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(PALPATIONS)
TRACK = PALPATIONS.evidence(((2.0, 0.8e-3, 0.5),), 0.0, 1)
SPHERE, FLAT, CONE = Sphere(radius=5e-3), Flat(radius=5e-3), Cone(angle=math.radians(20.0))


def standing(tip, tilt=0.0, slope=0.0, sweep=False, **alignment):
    turned = TurnedTool(0.0, 0.0, 0.0, 0.0, None, 0.0, slope, 0.0, 0.0, math.radians(tilt))
    given = {"force": "rig.wrench.z", "position": "rig.tip.z", "normal": [0, 0, 1], **alignment}
    ending = replace(
        TRACK.ending,
        report=replace(TRACK.ending.report, turned=turned),
        is_sweep=sweep,
        settings=AlignmentSettings.model_validate(given),
    )
    return replace(TRACK, model=DimensionalityReduction(indenter=tip), ending=ending)


@pytest.mark.parametrize(
    ("tip", "tilt", "codes"),
    [
        (SPHERE, 44.0, []),
        (SPHERE, 46.0, ["off-normal"]),
        (SPHERE, 61.0, ["far-off-normal"]),
        (SPHERE, 180.0, ["far-off-normal"]),  # the z of the pose looks out of the skin
        (FLAT, 1.9, []),
        (FLAT, 2.2, ["off-normal"]),
        (FLAT, 9.9, ["off-normal"]),
        (FLAT, 10.2, ["far-off-normal"]),
        (CONE, 5.0, ["off-normal"]),
        (CONE, 12.0, ["far-off-normal"]),
    ],
)
def test_what_a_tip_needs(tip, tilt, codes):
    found = tool_off_normal([standing(tip, tilt)])
    assert [flag.code for diagnosed in found.values() for flag in diagnosed.flags] == codes


@pytest.mark.parametrize("degrees", [10.0, 30.0])
def test_a_normal_that_is_off_costs_depth_where_the_motion_is_oblique(degrees):
    """Of a motion at b to the normal a depth is d cos b: 1 degree at b = 30 is 1.0 % of it, and 1.5 % of Hertz's E."""
    slope, off = math.tan(math.radians(degrees)), math.radians(1.0)

    def row(**changes):
        (diagnosed,) = budgets([standing(SPHERE, normal_uncertainty="1 deg", **changes)]).values()
        (term,) = (term for term in diagnosed.sources if term.cause == "normal")
        return abs(term.shifts[0]) / TRACK.values[0]

    depth = math.cos(math.radians(degrees) - off) / math.cos(math.radians(degrees))
    assert row(slope=slope) - row() == pytest.approx(depth**1.5 - 1.0, rel=0.1)
    assert row(slope=slope, sweep=True) == row()
    assert np.isfinite(row())
