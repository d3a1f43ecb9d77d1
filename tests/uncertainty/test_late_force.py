"""A force that is late is told by the work that the contact gives out, whatever the model makes of it."""

import numpy as np
import pytest
from palpate.evidence.track_tail import Tail
from palpate_uncertainty.delay.late_force import force_lateness

STIFFNESS, MASS = 1500.0, 0.14
TIME = np.arange(0.0, 3.0, 0.002)


def tail(late, damping=0.0, seed=0, frequency=2.0, approach=False, noise=0.04):
    """Palpation of F = 2e5 d^1.5 + damping d'; the force is late by so many seconds."""

    def motion(time):
        omega = 2 * np.pi * frequency
        depth, rate = 4e-3 + 1e-3 * np.sin(omega * time), 1e-3 * omega * np.cos(omega * time)
        bend = -1e-3 * omega**2 * np.sin(omega * time)
        if not approach:
            return depth, rate, bend
        down = time < 0.5
        return np.where(down, 8e-3 * time, depth), np.where(down, 8e-3, rate), np.where(down, 0.0, bend)

    depth, rate, _ = motion(TIME)
    then, speed, bend = motion(TIME - late)
    random = np.random.default_rng(seed).standard_normal(len(TIME))
    force = 2e5 * np.clip(then, 0, None) ** 1.5 * 0.1 + damping * speed + MASS * bend + noise * random
    nothing = np.zeros(len(TIME))
    return Tail(TIME, force, -depth, -rate, nothing[:, None], nothing[:, None], *[nothing] * 5)


def slope():
    return 2e4 * 1.5 * np.sqrt(4e-3)


@pytest.mark.parametrize("frequency", [1.0, 2.0, 8.0])
@pytest.mark.parametrize("late", [2e-3, 5e-3, 11.7e-3])
def test_it_is_as_late_as_it_was_made(late, frequency):
    found = force_lateness(tail(late, frequency=frequency), MASS)
    assert found == pytest.approx(late, rel=0.1 if frequency < 5 else 0.2, abs=3e-4)  # inertia is late, too


def test_what_the_material_takes_in_hides_so_much():
    """A force late by less than eta/G looks like a smaller viscosity, and nobody can tell."""
    damping = 5e-3 * slope()
    assert force_lateness(tail(3e-3, damping), MASS) is None
    assert force_lateness(tail(8e-3, damping), MASS) == pytest.approx(3e-3, abs=5e-4)


@pytest.mark.slow
def test_no_false_alarm():
    """Elastic contact, the hardest case: 300 records, in half of which the tip comes from above."""
    false = [force_lateness(tail(0.0, seed=seed, approach=bool(seed % 2)), MASS) for seed in range(300)]
    assert false == [None] * 300


def test_a_ramp_or_a_hold_or_a_force_of_the_wrong_sign_says_nothing():
    whole = tail(5e-3)
    nothing = np.zeros_like(TIME)
    table = nothing[:, None]
    for force, position, velocity in [
        (whole.force, -TIME, nothing - 1),
        (whole.force, nothing, nothing),
        (-whole.force, whole.position, whole.velocity),
        (nothing * np.nan, whole.position, whole.velocity),
    ]:
        assert force_lateness(Tail(TIME, force, position, velocity, table, table, *[nothing] * 5), MASS) is None


@pytest.mark.slow
@pytest.mark.parametrize("delay", ["8 ms", "11.7 ms"])
def test_a_run_names_the_timing(run_point, delay):
    """Before, nothing of a viscosity of -45 Pa*s named the 11.7 ms; eta/G is 9.65 ms."""
    for track in run_point("device.rig.force_delay=" + delay).tracks.values():
        found = [flag.message for flag in track.flags if flag.code == "force-late"]
        assert len(found) == (delay == "11.7 ms")
        assert all("at least" in message for message in found)
        viscosity, elasticity = track.parameters["viscosity"], track.parameters["elasticity"]
        assert np.isnan(viscosity.combined) == (delay == "11.7 ms")  # what is a bound for all of it is no uncertainty
        assert np.isfinite(elasticity.combined)


@pytest.mark.slow
def test_what_diverges_names_it_too():
    from palpate.estimation import Estimates, Samples, Status
    from palpate.registry import load
    from palpate_engine.alignment import AlignmentReport, AlignmentSettings
    from palpate_engine.result import TrackRecord, track_result
    from palpate_engine.result.diagnoses import Diagnosable, RunEvidence, apply_diagnoses
    from palpate_engine.track_name import TrackName
    from palpate_filters import KinematicFilter
    from palpate_models import DimensionalityReduction, Sphere

    model = DimensionalityReduction(indenter=Sphere(radius=5e-3))

    def flags(late):
        measured, n = tail(late), len(TIME)
        ones, contact = np.ones(n), np.ones(n, bool)
        stamp = np.rint(TIME * 1e9).astype(np.int64)
        motion = (measured.force, measured.position, measured.velocity)
        place = np.full((n, 2), np.nan)
        samples = Samples(stamp, TIME, np.diff(TIME, prepend=0.0), *motion, contact, contact, place)
        lost, table = np.full(n, np.nan), np.full((n, 2), np.nan)
        status = np.full(n, Status.DIVERGED, np.uint32)
        record = TrackRecord(3.0)
        record.add(samples, Estimates(TIME, table, table, lost, lost, lost, ones * np.nan, status), 0.0)
        report = AlignmentReport({}, None, 0.25, None, 1, None, n, 0, 0, 3.0, None)
        settings = AlignmentSettings.model_validate({"force": "f.f", "position": "r.z", "tip_mass": MASS})
        result = track_result(TrackName("dr", "kinematic"), model, record, report, settings, 1.0)
        track = Diagnosable(model, KinematicFilter(), record, result)
        found = apply_diagnoses({"t": track}, load().diagnoses, RunEvidence(settings, report, 1.0))["t"]
        return {flag.code: flag.message for flag in found.flags}

    assert flags(0.0) == {"diverged": "the estimates stopped being finite or plausible numbers; none can be used"}
    found = flags(11.7e-3)
    assert set(found) == {"diverged", "force-late"}
    assert "12 ms late, which is likely why the estimates diverged" in found["force-late"]
