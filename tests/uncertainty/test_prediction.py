"""Prediction of a held-out half: exact for a linear law, and as large as what the law does not describe."""

import numpy as np
import palpate
import pytest
from palpate_kit.terminal.prediction_text import BLOCK, HALF
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.prediction import predict_other_half

RADIUS, MODULUS = 5e-3, 50e3  # m, Pa
TIME = np.arange(2000) / 500.0  # s
PRESS = np.interp(TIME, [0.0, 0.8, 2.4, 4.0], [-1e-3, -0.2e-3, 1.6e-3, -0.4e-3])  # m of depth
OSCILLATION = 1.6e-3 + 0.4e-3 * np.sin(4 * np.pi * TIME)


def recorded(depth, share=0.0, seed=0):
    """A press of a paraboloid, with a force that grows by a share of itself over the record; noise 5 mN."""
    contact = np.maximum(depth, 0.0)
    force = 16 / 9 * MODULUS * np.sqrt(RADIUS) * contact**1.5 * (1.0 + share * TIME / TIME[-1])
    force += 5e-3 * np.random.default_rng(seed).standard_normal(len(TIME))
    zero = {"tare": "free-air"} if depth[0] < 0 else {"tare": "none", "alignment": {"tare_uncertainty": "1 mN"}}
    return palpate.record(
        time=TIME, force=force, height=-depth, delay={"height": "0 ms", "force": "0 ms"}, timing="0.2 ms",
        tip_mass="0 g", **zero,
    )  # fmt: skip


def fitted(record):
    model = DimensionalityReduction(indenter=Sphere(radius=RADIUS), thickness="half-space")
    return palpate.fit(record, model=model)


def test_the_step_of_a_linear_law_is_the_fit_of_the_half():
    """Residuals about the estimate of the whole, less J times the step, are those of a fit to the half."""
    random = np.random.default_rng(1)
    jacobian = random.standard_normal((400, 3))
    force = jacobian @ [1.0, -2.0, 0.5] + 10.0 + 0.2 * random.standard_normal(400)
    whole = np.linalg.lstsq(jacobian, force, rcond=None)[0]
    half = np.linalg.lstsq(jacobian[:200], force[:200], rcond=None)[0]
    found = predict_other_half(jacobian, force - jacobian @ whole, force, 0.0, oscillates=True)
    error = np.sqrt(np.mean((force[200:] - jacobian[200:] @ half) ** 2)) / np.mean(np.abs(force[200:]))
    assert found.error == pytest.approx(error)
    assert found.words == HALF


def test_a_record_too_short_for_halves_has_none():
    assert predict_other_half(np.ones((60, 1)), np.zeros(60), np.ones(60), 0.0, oscillates=False) is None


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "words"), [(PRESS, BLOCK), (OSCILLATION, HALF)], ids=["press", "oscillation"])
def test_a_law_predicts_its_own_force_to_the_noise(depth, words):
    fit = fitted(recorded(depth))
    assert fit.prediction < 1e-3
    assert fit.track.document["diagnoses"]["model-discrepancy"]["prediction"]["words"] == words


@pytest.mark.slow
def test_a_force_that_grows_by_a_tenth_is_predicted_within_some_per_cent():
    fit = fitted(recorded(OSCILLATION, share=0.1))
    assert 0.01 < fit.prediction < 0.1
