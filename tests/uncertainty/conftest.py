"""What tests of uncertainty share: wrong records, and a track's evidence made without a pipeline."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate import Problem, Status, TrackEvidence
from palpate_engine.result.sample_keeper import Keeper
from palpate_models import DimensionalityReduction, Sphere

_specification = importlib.util.spec_from_file_location(
    "wrong_records", Path(__file__).parents[2] / "benchmarks" / "wrong_records.py"
)
_module = importlib.util.module_from_spec(_specification)
sys.modules["wrong_records"] = _module  # where its dataclasses look for themselves
_specification.loader.exec_module(_module)


def evidence_of(samples, estimator, radius, mass=0.14, name="model/track"):
    """What a diagnosis is given of an estimator that ran over samples."""
    model = DimensionalityReduction(indenter=Sphere(radius=radius))
    found = estimator.start(Problem(model, mass, None, 1.0)).run(samples)
    keeper = Keeper()
    keeper.add(samples, found)
    last = np.flatnonzero((found.status & Status.IDLE) == 0)[-500:]
    std = found.std[last[-1]]
    values, surface = found.values[last].mean(axis=0), float(found.surface[last].mean())
    return TrackEvidence(
        name, model, estimator, mass, keeper.kept, *keeper.air, values, std, std, surface, found.report
    )


@pytest.fixture(scope="session")
def records():
    """The module of wrong records."""
    return _module


@pytest.fixture(scope="session")
def evidence(records):
    """Evidence of a track on a record: `evidence("memory", CasadiFit(), radius=10e-3)`."""

    def make(kind, estimator, seed=0, **changed):
        palpation = replace(records.Palpation(), **changed)
        return evidence_of(records.record(palpation, kind, seed), estimator, palpation.radius, palpation.mass)

    return make
