"""The authors' sweep over a sphere and a horseshoe: what a right implementation gets from it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from palpate import Estimates, Problem, Samples, Status
from palpate_filters.ekf import AdaptiveFadingEkf, ExtendedKalmanFilter
from palpate_filters.kinematic_filter import KinematicFilter
from palpate_filters.ukf import AdaptiveFadingUkf
from palpate_models import Sphere
from palpate_models.dimensionality_reduction import DimensionalityReduction

Recording = Callable[[str, int], tuple[Samples, np.ndarray]]


def sphere(radius: float) -> Problem:
    return Problem(DimensionalityReduction(indenter=Sphere(radius=radius)), 0.14)


def smooth(estimates: Estimates) -> np.ndarray:
    """Elasticity [kPa], mean over half a second around each sample: one period of the palpation."""
    return np.convolve(np.nan_to_num(estimates.values[:, 0]) / 1e3, np.ones(250) / 250, "same")


def test_fading_filters_find_what_lies_under_the_sweep(recording: Recording) -> None:
    samples, table = recording("tran_4mms", 11)
    along = table[:, 10] * 1e3 - 450.0  # [mm]
    found = {
        name: smooth(filter_.start(sphere(5e-3)).run(samples))
        for name, filter_ in {
            "ekf": ExtendedKalmanFilter(),
            "afekf": AdaptiveFadingEkf(),
            "afukf": AdaptiveFadingUkf(),
        }.items()
    }
    before = (samples.time > 5.0) & (along < 4.5)
    lump, horseshoe = (along > 10.0) & (along < 35.0), (along > 38.0) & (along < 54.0)
    afukf = found["afukf"]
    assert afukf[before].mean() == pytest.approx(104.5, rel=0.05)
    assert afukf[lump].max() == pytest.approx(163.0, rel=0.05)
    peak = along[lump][np.argmax(afukf[lump])]
    assert peak == pytest.approx(20.0, abs=2.0)
    assert afukf[horseshoe].max() == pytest.approx(122.0, rel=0.05)
    assert 40.0 < along[horseshoe][np.argmax(afukf[horseshoe])] < 50.0
    late = along[lump][np.argmax(found["afekf"][lump])] - peak
    assert found["afekf"][lump].max() < afukf[lump].max()
    assert 0.0 < late < 4.0
    end = (along > 58.0) & (along < 61.0)
    assert afukf[end].mean() < 108.0 < found["ekf"][end].mean()  # the EKF never returns


@pytest.mark.parametrize(
    ("name", "lateness", "radius", "elasticity"),
    [("d10mm_soft", 11, 5e-3, 125.0e3), ("d10mm_sphere", 11, 5e-3, 170.9e3), ("d5mm_soft", -6, 2.5e-3, 102.7e3)],
)
def test_kinematic_filter_starts_on_recordings_that_begin_in_contact(
    recording: Recording, name: str, lateness: int, radius: float, elasticity: float
) -> None:
    """Half a second of the second one does not tell its viscosity: a filter that starts from a guess there diverges."""
    samples, _ = recording(name, lateness)
    found = KinematicFilter().start(sphere(radius)).run(samples)
    assert not (found.status & Status.DIVERGED).any()
    assert found.values[-500:, 0].mean() == pytest.approx(elasticity, rel=0.06)  # least squares on the same samples
