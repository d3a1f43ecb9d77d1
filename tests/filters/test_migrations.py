"""Pipelines of before read as they did."""

import pytest
from palpate_engine.config import load_pipeline

OLD = """
[estimator.fading]
type = "afukf"
theta = "1.2 mm/s"
covariance_cap = 2.0
[estimator.iterated]
type = "iekf"
[estimator.biased]
type = "kinematic-smoother"
bias_std = "0.1 N"
bias_walk = 1e-6
"""


def test_keys_of_before_are_read(point_pipeline):
    point_pipeline.write_text(point_pipeline.read_text() + OLD)
    pipeline = load_pipeline(point_pipeline)
    found = pipeline.estimators
    assert found["fading"].fading.theta == pytest.approx(1.2e-3)
    assert found["fading"].fading.covariance_cap == 2.0
    assert found["fading"].fading.alpha_max == 1.02
    assert found["iterated"].iterations == 3
    assert found["biased"].drift_walk == pytest.approx(1e-3)  # the root of the density
    assert len(pipeline.renamed) == 4
