"""Lack of fit along a sweep: forces of a half-space and of a layer, written out by hand, over a surface with relief."""

import numpy as np
import pytest
from palpate import Problem, Samples, TrackEvidence
from palpate_engine.result.track_record import TrackRecord
from palpate_filters import AdaptiveFadingUkf, KinematicFilter
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.lack_of_fit import LEVEL, lack_of_fit

E, ETA, RADIUS, MASS = 112.5e3, 362.0, 5e-3, 0.14
MODEL = DimensionalityReduction(indenter=Sphere(radius=RADIUS))


def sweep(seed, height=np.inf, estimator=None, softer=0.0, name="t"):
    """12 s at 4 mm/s, 1 mm at 2 Hz around 4 mm; on a bonded layer of a height Dimitriadis' factor; E with a lump."""
    random, time = np.random.default_rng(seed), np.arange(6000) / 500.0
    n, omega, always = len(time), 4 * np.pi, np.ones(len(time), bool)
    relief = 0.1e-3 * np.sin(2 * np.pi * time / 5.0 + 1.0)
    tip = -4e-3 - 1e-3 * np.sin(omega * time)
    rate = 1e-3 * omega * np.cos(omega * time)
    depth, deeper = relief - tip, rate + np.gradient(relief, time)
    x = np.sqrt(RADIUS * depth) / height
    factor = 1 + 1.133 * x + 1.283 * x**2 + 0.769 * x**3 + 0.0975 * x**4
    modulus = E * (1 - softer * np.exp(-(((time - 6.0) / 1.5) ** 2)))
    elastic = 16 / 9 * modulus * RADIUS**0.5 * depth**1.5 * factor
    force = elastic + 8 * ETA * (RADIUS * depth) ** 0.5 * deeper - MASS * 1e-3 * omega**2 * np.sin(omega * time)
    noise = random.standard_normal((3, n))
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0), force + 0.05 * noise[0],
        tip + 5e-6 * noise[1], -rate + 0.67e-3 * noise[2], always, always,
        np.column_stack([0 * time, 4e-3 * time]),
    )  # fmt: skip
    estimator = estimator or KinematicFilter(sweep_speed=4e-3)
    record = TrackRecord(3.0)
    record.add(samples, estimator.start(Problem(MODEL, MASS)).run(samples), 0.0)
    _, last = record.ends(1.0)
    values, std, surface = last.values.mean(axis=0), last.std[-1], float(last.surface.mean())
    return TrackEvidence(
        name, MODEL, estimator, MASS, record.keeper.kept, *record.keeper.air, values, std, std, surface, None
    )


@pytest.mark.parametrize("softer", [0.0, -0.3])
def test_a_clean_sweep_is_not_flagged_nor_one_over_a_lump(softer):
    found = lack_of_fit([sweep(1, softer=softer)])["t"]
    assert not found.flags
    assert found.table["p"] > LEVEL


@pytest.mark.slow
def test_a_layer_under_a_sweep_is_flagged_and_the_value_has_a_larger_uncertainty():
    track = sweep(2, height=8e-3)
    assert track.values[0] > 2 * E
    found = lack_of_fit([track])["t"]
    assert {flag.code for flag in found.flags} <= {"lack-of-fit", "model-discrepancy"}
    assert found.flags
    assert found.terms["elasticity"] > 0.02 * track.values[0]


@pytest.mark.slow
def test_a_fading_filter_is_not_judged_by_its_innovations():
    tracks = [
        sweep(3, height=8e-3, estimator=estimator, name=name)
        for name, estimator in (("fading", AdaptiveFadingUkf()), ("kinematic", None))
    ]
    assert lack_of_fit(tracks).keys() == {"kinematic"}
