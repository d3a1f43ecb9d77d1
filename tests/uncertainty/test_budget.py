"""Budgets of tracks against records whose force is computed here, by Hertz and the paper's damper."""

import numpy as np
import pytest
from palpate.alignment_report import Tare
from palpate.estimation import Estimates, Samples
from palpate.registry import load
from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.config.declared_uncertainties import unknown_sources
from palpate_engine.result import Diagnosable, RunEvidence, TrackRecord, apply_diagnoses, track_result
from palpate_engine.track_name import TrackName
from palpate_fits import CasadiFit
from palpate_kit.budget.uncertainty_sources import sources_of
from palpate_models import DimensionalityReduction, Flat, KelvinVoigt, Sphere
from scipy.optimize import least_squares

RADIUS, NU, MASS, E, ETA = 5e-3, 0.5, 0.14, 112.5e3, 362.0
TIME = np.arange(0.0, 3.0, 0.002)
OMEGA = 4 * np.pi
REPORT = AlignmentReport({}, None, 0.25, None, 1, None, 0, 0, 0, 3.0, None)


def motion(late=0.0):
    """Depth, its rate and acceleration, `late` seconds ago."""
    phase = OMEGA * (TIME - late)
    return 4e-3 + 1e-3 * np.sin(phase), 1e-3 * OMEGA * np.cos(phase), -1e-3 * OMEGA**2 * np.sin(phase)


def force(elasticity, viscosity, surface=0.0, late=0.0, radius=RADIUS, nu=NU, mass=MASS):
    """What the sensor reads [N]."""
    depth, rate, acceleration = motion(late)
    depth = depth + surface
    elastic = 4 / 3 * elasticity / (1 - nu**2) * np.sqrt(radius) * depth**1.5
    return elastic + 4 * viscosity / (1 - nu) * np.sqrt(radius * depth) * rate + mass * acceleration


def shift_of(reading):
    """What a fit that believes in the nominal numbers finds more than E and eta."""
    scale = np.array([E, ETA, 1e-3])
    found = least_squares(lambda x: force(*(x * scale)) - reading, [1.0, 1.0, 0.0], xtol=1e-14, ftol=1e-14)
    return (found.x * scale)[:2] - [E, ETA]


def result(model=None, declared=None, tare=None, theta=(E, ETA), details=None, **settings):
    """The result of a track that has found the truth, with the settings of its alignment."""
    model = model or DimensionalityReduction(indenter=Sphere(radius=RADIUS))
    n = len(TIME)
    depth, rate, _ = motion()
    stamp = np.rint(TIME * 1e9).astype(np.int64)
    contact = np.ones(n, bool)
    samples = Samples(stamp, TIME, np.diff(TIME, prepend=0.0), force(E, ETA), -depth, -rate, contact, contact)
    full = np.ones(n)
    estimates = Estimates(
        TIME, np.tile(theta, (n, 1)), np.tile(1e-3 * np.array(theta), (n, 1)), 0 * full, 1e-6 * full, force(E, ETA),
        full, np.zeros(n, np.uint32), details or {},
    )  # fmt: skip
    record = TrackRecord(10.0)
    record.add(samples, estimates, 0.0)
    table = {"force": "rig.f", "position": "rig.z", **settings}
    report = AlignmentReport({}, tare, 0.25, None, 1, None, n, 0, 0, 3.0, None)
    made = AlignmentSettings.model_validate(table)
    own = track_result(TrackName("dr", "fit"), model, record, report, made, 1.0, False)
    diagnoses = {"budget": load().diagnoses["budget"]}
    track = Diagnosable(model, CasadiFit(), record, own)
    return apply_diagnoses({"dr/fit": track}, diagnoses, RunEvidence(made, report, 1.0, declared or {}))["dr/fit"]


def budget(found, cause):
    return [found.parameters[name].budget[cause] for name in found.parameters]


def test_timing_moves_elasticity_too():
    """2 ms: the damper's force comes into phase with the spring's."""
    found = result(force={"channel": "rig.f", "uncertainty": "2 ms"}, tip_mass=0.14)
    seen = shift_of(force(E, ETA, late=2e-3))
    assert abs(seen[0]) / E > 0.002
    assert budget(found, "timing")[0] == pytest.approx(abs(seen[0]), rel=0.15)  # to first order
    assert budget(found, "timing")[1] == pytest.approx(abs(seen[1]), rel=0.03)


@pytest.mark.parametrize(
    ("cause", "declared", "changed"),
    [
        ("radius", {"radius": "50 um"}, {"radius": RADIUS + 50e-6}),
        ("poisson", {"poisson": 0.01}, {"nu": NU + 0.01}),
    ],
)
def test_numbers_of_model_and_tip_count_as_declared(cause, declared, changed):
    found = result(declared=declared)
    seen = shift_of(force(E, ETA, **changed))
    assert budget(found, cause) == pytest.approx(np.abs(seen), rel=0.03)


def test_mass_tare_and_force_scale_count_as_declared():
    tare = Tare(0.0, 0.02, 0.05)
    found = result(tare=tare, declared={"force_scale": 0.01}, tip_mass=MASS, tip_mass_uncertainty=0.02)
    assert budget(found, "mass") == pytest.approx(np.abs(shift_of(force(E, ETA, mass=MASS + 0.02))), rel=0.03)
    assert budget(found, "tare") == pytest.approx(np.abs(shift_of(force(E, ETA) + 0.02)), rel=0.03)
    assert budget(found, "force_scale")[0] == pytest.approx(0.01 * E, rel=0.02)


def test_what_is_not_declared_has_a_default_that_is_stated_as_such():
    found = result(tip_mass=MASS)
    rows = {row.source: row for row in found.budget}
    assert rows["radius (not declared)"].std == pytest.approx(0.005 * RADIUS)
    assert rows["poisson (not declared)"].std == pytest.approx(0.02 / np.sqrt(3))
    assert rows["mass (not declared)"].std == pytest.approx(0.05 * MASS)
    # E goes with R^-1/2 and 1 - nu^2, eta with R^-1/2 and 1 - nu.
    assert rows["radius (not declared)"].effects["elasticity"].percent == pytest.approx(0.25, rel=0.01)
    assert rows["poisson (not declared)"].effects["elasticity"].percent == pytest.approx(
        100 * 4 / 3 * 0.01155, rel=0.01
    )
    assert rows["poisson (not declared)"].effects["viscosity"].percent == pytest.approx(200 * 0.01155, rel=0.01)


@pytest.mark.slow
def test_a_tare_that_nobody_knows_is_no_row_of_the_budget():
    unknown = result(tare=Tare(0.0, None, None))
    assert not [row for row in unknown.budget if row.source.startswith("tare")]
    assert [row for row in result(tare=Tare(0.0, 0.001, None)).budget if row.source == "tare"]


@pytest.mark.slow
def test_a_derived_value_has_one_cause_for_both_parameters():
    """E under a flat tip is K (1 - nu^2)/(2 R); a force scale moves E as much as K, and eta beside it."""
    model = KelvinVoigt(indenter=Flat(radius=3e-3))
    covariance = {"names": ["stiffness", "damping"], "matrix": [[1.0, 0.5], [0.5, 1.0]]}
    found = result(model, {"force_scale": 0.01}, theta=(900.0, 7.0), details={"covariance": covariance})
    derived = {value.name: value.found for value in found.derived}
    assert derived["elasticity"].budget["force_scale"] / derived["elasticity"].value == pytest.approx(
        found.parameters["stiffness"].budget["force_scale"] / 900.0
    )


def test_every_source_is_a_row_and_adds_up():
    found = result(tare=Tare(0.0, 0.02, 0.05), tip_mass=MASS, force={"channel": "rig.f", "uncertainty": "1 ms"})
    for name, value in found.parameters.items():
        total = sum((row.effects[name].contribution or 0.0) ** 2 for row in found.budget) ** 0.5
        assert value.combined == pytest.approx(total, rel=1e-9)
    json = found.table()["budget"]
    assert {row["source"] for row in json} >= {"estimator", "timing", "tare"}


def test_an_uncertainty_of_nothing_is_a_mistake():
    models = {"dr": DimensionalityReduction(indenter=Sphere(radius=RADIUS))}
    assert not unknown_sources(models, {"radius": "20 um", "indenter.radius": 1e-5, "force_scale": 0.01})
    assert "radius" in unknown_sources(models, {"radios": "20 um"})["radios"]
    assert "kPa" in unknown_sources(models, {"radius": "3 kPa"})["radius"]
    assert "negative" in unknown_sources(models, {"poisson": -0.1})["poisson"]
    assert [source.name for source in sources_of(models["dr"], {})] == ["radius", "poisson"]
