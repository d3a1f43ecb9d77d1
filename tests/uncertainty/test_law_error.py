"""A formula that is off the solution it stands for: by how much is a row of the budget."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate import contact_force
from palpate_kit.budget.force_sensitivity import along
from palpate_models import DimensionalityReduction, Sphere, TwoLayers
from palpate_uncertainty.uncertainty_budget import budgets

SPEC = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
PALPATIONS = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(PALPATIONS)
TRACK = PALPATIONS.evidence(((2.0, 0.8e-3, 0.5),), 0.0, 1)
TIP = Sphere(radius=5e-3)
LAYERED, THETA = TwoLayers(indenter=TIP, skin_thickness=2e-3), np.array([150e3, 50e3, 200.0])


def row(model, values):
    ends = {
        name: replace(getattr(TRACK.ending, name), values=np.tile(values, (len(TRACK.ending.last.time), 1)))
        for name in ("last",)
    }
    track = replace(TRACK, model=model, values=values, ending=replace(TRACK.ending, **ends))
    (diagnosed,) = budgets([track]).values()
    return [term for term in diagnosed.sources if term.cause == "law"]


def test_a_law_that_is_exact_has_no_row():
    assert row(DimensionalityReduction(indenter=TIP), TRACK.values) == []


@pytest.mark.parametrize("waves", [0.0, 1.0, 2.0, 3.0])
def test_the_row_covers_what_an_error_of_the_law_makes_of_the_moduli(waves):
    """A force off by the law's error at the most, this way and that over the depth, fitted by least squares."""
    (term,) = row(LAYERED, THETA)
    last = TRACK.ending.last
    found = along(LAYERED, last, replace(last, values=np.tile(THETA, (len(last.time), 1))), THETA)
    depth, rate = found.depth, found.rate
    off = LAYERED.law_error * np.cos(waves * np.pi * np.sqrt(depth / depth.max()))
    force = contact_force(LAYERED, depth, rate, THETA.tolist()) * (1.0 + off)
    shift, *_ = np.linalg.lstsq(found.jacobian, force - found.force, rcond=None)
    assert (np.abs(shift[:2]) <= 4.0 * np.abs(term.shifts[:2])).all()  # the most is two of its standard uncertainties
    assert (np.abs(term.shifts[:2]) > 0.0).all()
