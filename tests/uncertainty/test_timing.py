"""What a late force does to a model's parameters: predicted, and seen in a fit to such a force."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import Diagnosed, Tail, Term, force_over_time
from palpate.contact import force_slopes
from palpate.evidence.uncertain_value import UncertainValue, derived_values
from palpate_engine import registry
from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result import TrackResult
from palpate_engine.result.diagnoses import with_findings
from palpate_kit.budget.force_sensitivity import along
from palpate_kit.budget.influence import answer
from palpate_kit.budget.systematic_terms import systematic_terms
from palpate_models import (
    DimensionalityReduction,
    Flat,
    FreeHuntCrossley,
    HuntCrossley,
    KelvinVoigt,
    Maxwell,
    Sphere,
    StandardLinearSolid,
)
from palpate_uncertainty.delay.timing_shift import delay_shifts
from palpate_uncertainty.reading_faults import velocity_flags
from palpate_uncertainty.uncertainty_budget import compliance_flags, delays

SPHERE = Sphere(radius=0.005)
TIME = np.arange(0.0, 2.0, 0.002)
OMEGA = 2 * np.pi * 2.0
DEPTH, RATE = 0.003 + 0.0008 * np.sin(OMEGA * TIME), 0.0008 * OMEGA * np.cos(OMEGA * TIME)
REPORT = AlignmentReport({}, None, 0.25, None, 0, None, 0, 0, 0, 4.0, None)
LATE = 2e-4  # [s]
MODELS = {
    "hunt-crossley": (HuntCrossley(), [0.9, 6.0]),
    "hunt-crossley-free": (FreeHuntCrossley(), [0.9, 6.0, 1.5]),
    "standard-linear-solid": (StandardLinearSolid(indenter=SPHERE), [80e3, 30e3, 0.05]),
    "maxwell": (Maxwell(indenter=SPHERE), [80e3, 8e3]),
}


def tails(theta):
    """The whole motion, and its second half."""
    n, k = len(TIME), len(theta)
    nothing = np.zeros(n)
    values = np.tile(np.array(theta, float), (n, 1))
    whole = Tail(TIME, nothing, -DEPTH, -RATE, values, np.zeros((n, k)), *[nothing] * 5)
    return whole, whole.since(float(TIME[n // 2]))


def fitted(model, theta, force):
    """Least squares with unknown surface over the second half, where what came before is forgotten."""
    from scipy.optimize import least_squares

    half = slice(len(TIME) // 2, None)
    scale = np.array([*theta, 1e-3])

    def left(x):
        parameters = x * scale
        return (force_over_time(model, TIME, DEPTH + parameters[-1], RATE, parameters[:-1]) - force)[half]

    found = least_squares(left, np.array([*theta, 0.0]) / scale, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return (found.x * scale)[:-1]


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_a_late_force_shifts_a_fit_as_predicted(name):
    model, theta = MODELS[name]
    before = TIME - LATE
    late = force_over_time(
        model, before, 0.003 + 0.0008 * np.sin(OMEGA * before), 0.0008 * OMEGA * np.cos(OMEGA * before), theta
    )
    seen = (fitted(model, theta, late) - theta) / LATE
    predicted = delay_shifts(model, along(model, *tails(theta), np.array(theta)), np.array(theta))
    strong = np.abs(predicted * 1e-3) > 0.01 * np.abs(theta)
    assert strong.any(), "no parameter answers to timing"
    assert predicted[strong] == pytest.approx(seen[strong], rel=0.1)


@pytest.mark.parametrize(
    ("share", "motion", "codes"),
    [
        (3.0, "both", ["velocity-other"]),
        (-1.0, "velocity", ["velocity-other"]),
        (0.0, "both", ["velocity-other"]),
        (3.0, "position", []),
        (0.93, "both", []),
        (None, "both", []),
    ],
)
def test_a_velocity_that_is_not_the_motion_is_told_where_an_estimator_uses_it(share, motion, codes):
    track = SimpleNamespace(model=HuntCrossley(), estimator=SimpleNamespace(motion=motion), values=np.array([0.9, 6.0]))
    end = SimpleNamespace(report=replace(REPORT, velocity_share=share))
    flags = list(velocity_flags(track, end, None))
    assert [flag.code for flag in flags] == codes
    assert registry.load().judged(flags) == () or registry.load().judged(flags)[0].severity == "invalid"


def test_a_closed_form_stands():
    """For the viscosity; elasticity, which it leaves out, follows from the derivative."""
    model, theta = DimensionalityReduction(indenter=SPHERE), np.array([112.5e3, 362.0])
    shifts = delay_shifts(model, along(model, *tails(theta), theta), theta)
    assert shifts[1] == pytest.approx(-37.5e3)
    _, by_parameter, by_depth, by_rate = force_slopes(model, DEPTH, RATE, theta.tolist())
    change = by_depth * RATE - by_rate * OMEGA**2 * (DEPTH - 0.003)
    seen = answer(np.column_stack([by_parameter, by_depth]), -change)
    assert seen[1] == pytest.approx(-37.5e3, rel=0.01)
    assert abs(seen[0]) * 1e-3 < 0.01 * 112.5e3
    assert shifts[0] == pytest.approx(seen[0], rel=0.05)


def test_a_derived_viscosity_says_its_delay():
    """Under a flat tip eta/G follows from K and B, and timing shifts eta by G per second."""
    model, theta = KelvinVoigt(indenter=Flat(radius=0.003)), [900.0, 7.0]
    shifts = model.delay_shift(theta)
    parameters = {p.name: UncertainValue(v, 0.0, p.unit) for p, v in zip(model.parameters, theta, strict=True)}
    term = Term("timing", 1e-3, "s", np.array(shifts) * 1e-3)
    late = dict(delays(model, np.array(theta), np.array(shifts), [term]))
    nothing = UncertainValue(0.0, 0.0, "m")
    own = TrackResult("kv", "fit", 1, parameters, nothing, 0.0, 1.0, (), 0.0, derived=derived_values(model, parameters))
    made = with_findings(own, model, "budget", Diagnosed(sources=(term,), delays=late))
    derived = {value.name: value.found for value in made.derived}
    shear = derived["elasticity"].value / 3
    assert derived["viscosity"].budget["timing"] == pytest.approx(shear * 1e-3)
    assert derived["viscosity"].per_shear == pytest.approx(derived["viscosity"].value / shear)
    assert derived["elasticity"].systematic is None


def test_a_robot_that_gives_way_shifts_as_predicted():
    """The tip is F/k higher than the position says: E and eta seem lower, S1 R 5 mm by some 5 and 8 % at 100 N/mm."""
    model, theta = DimensionalityReduction(indenter=SPHERE), np.array([282.1e3, 860.0])
    stiffness = 2000e3
    depth, rate = DEPTH + 0.0, RATE + 0.0
    for _ in range(20):
        force = force_over_time(model, TIME, depth, rate, theta)
        depth, rate = DEPTH - force / stiffness, RATE - np.gradient(force, TIME) / stiffness
    seen = fitted(model, theta.tolist(), force) - theta
    settings = AlignmentSettings.model_validate({"force": "a.f", "position": "a.z", "series_stiffness": stiffness})
    half = tails(theta)[1]
    (term,) = systematic_terms(along(model, half, half, theta), np.zeros(2), None, settings, REPORT)
    assert term.cause == "compliance"
    assert term.shifts == pytest.approx(seen, rel=0.1)
    (flag,) = compliance_flags({"elasticity": 0.05, "viscosity": 0.001}, 100e3)
    assert flag.code == "series-compliance"
    assert "100 N/mm, which shifts elasticity by 5 %; it is not corrected" in flag.message
    assert not list(compliance_flags({"elasticity": 0.005}, 100e3))


def test_what_cannot_be_told_has_no_shift():
    model, theta = HuntCrossley(), np.array([0.9, 6.0])
    whole, half = tails(theta)
    half.position[:] = 0.01  # above the skin
    assert not delay_shifts(model, along(model, whole, half, theta), theta).any()
    unknown = np.array([np.nan, 1.0])
    assert not delay_shifts(model, along(model, *tails(theta), unknown), unknown).any()


@pytest.mark.parametrize(("model", "theta"), MODELS.values(), ids=MODELS)
def test_the_force_by_the_stiffness_of_a_beam_is_that_of_the_depth_behind_another_one(model, theta):
    """Also of a model that remembers, whose depth is another one all the time."""
    beam, change = 400.0, 0.4
    force = force_over_time(model, TIME, DEPTH, RATE, theta)
    deeper = force / beam - force / (beam + change)
    changed = force_over_time(model, TIME, DEPTH + deeper, RATE + np.gradient(deeper, TIME), theta)
    whole, half = tails(theta)
    found = along(model, whole, half, np.array(theta))
    expected = ((changed - force) / change)[np.searchsorted(TIME, found.time)]
    np.testing.assert_allclose(found.by_beam(beam), expected, rtol=0.02, atol=2e-3 * np.abs(expected).max())
    settings = AlignmentSettings(force="a.f", position="a.z", beam="400 N/m", beam_uncertainty="4 N/m")
    terms = systematic_terms(found, np.zeros(2), None, settings, REPORT)
    assert [term.std for term in terms if term.cause == "beam"] == [4.0]
