"""What goes wrong is said: by a refusal, or by the status of each estimate."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError, Estimates, LogError, Problem, Samples, Status
from palpate.offers import import_target
from palpate_filters import palpate_estimators
from palpate_models import DimensionalityReduction, Sphere
from palpate_testing import synthetic_samples

MODEL = DimensionalityReduction(indenter=Sphere(radius=5e-3))
TRUTH = [1.1e5, 360.0]
FILTERS = ("ekf", "afekf", "ukf", "afukf", "filterpy", "kinematic-ekf", "kinematic-smoother")
UNBOUNDED = {"theta": 0.0, "alpha_max": 1.5, "covariance_cap": 1e12}
ESTIMATORS = {name: import_target(palpate_estimators()[name]) for name in FILTERS}


def run(name: str, samples: Samples, mass: float | None = 0.14, **settings: object) -> Estimates:
    return ESTIMATORS[name](**settings).start(Problem(MODEL, mass)).run(samples)


def told(estimates: Estimates) -> bool:
    """Every estimate is a finite number with its uncertainty, or its status says why not."""
    finite = np.isfinite(estimates.values).all(axis=1) & np.isfinite(estimates.std).all(axis=1)
    return bool((finite | (estimates.status != 0)).all())


def record(duration: float = 2.0) -> Samples:
    return synthetic_samples(MODEL, TRUTH, duration=duration)


ABUSES = {
    "zeros": lambda s: replace(s, force=0 * s.force, velocity=0 * s.velocity, position=0 * s.position),
    "noise": lambda s: replace(s, force=np.random.default_rng(1).standard_normal(len(s)), velocity=0 * s.velocity),
    "no force": lambda s: replace(s, force=np.nan * s.force),
    "no velocity": lambda s: replace(s, velocity=np.nan * s.velocity),
    "huge force": lambda s: replace(s, force=1e9 * s.force),
    "infinite force": lambda s: replace(s, force=np.where(np.arange(len(s)) == 700, np.inf, s.force)),
    "out of the material": lambda s: replace(s, position=s.position + 0.1),
    "pauses": lambda s: replace(s, interval=np.where(np.arange(len(s)) % 100 == 50, 0.5, s.interval)),
    "standing time": lambda s: replace(s, interval=0 * s.interval),
    "one sample": lambda s: s[:1],
    "none": lambda s: s[:0],
}


@pytest.mark.parametrize("abuse", ABUSES)
@pytest.mark.parametrize("name", ESTIMATORS)
def test_abuse_is_survived_and_told(name, abuse):
    samples = ABUSES[abuse](record(1.6))
    estimates = run(name, samples)
    assert len(estimates) == len(samples)
    assert told(estimates)
    assert not (estimates.std < 0).any()


@pytest.mark.parametrize("name", ["afekf", "afukf"])
def test_fading_without_end_is_contained(name):
    """A threshold below the noise keeps alpha at its maximum for ever."""
    samples = record(10.0)
    contained = run(name, samples, fading={"theta": 0.0, "alpha_max": 1.5})
    assert told(contained)
    assert np.nanmax(contained.std[:, 0]) < 1e6


def test_winding_up_ends_in_a_status_not_in_a_number():
    unbounded = run("afukf", record(10.0), fading=UNBOUNDED)
    assert unbounded.status[-1] & Status.DIVERGED
    assert np.isnan(unbounded.values[-1]).all()


def test_what_has_diverged_stays_so():
    samples = record(10.0)
    tracker = ESTIMATORS["afukf"](fading=UNBOUNDED).start(Problem(MODEL, 0.14))
    status = tracker.run(samples).status & Status.DIVERGED
    assert (np.diff(status.astype(int)) >= 0).all()
    assert (tracker.run(record()).status & Status.DIVERGED).all()


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_tip_whose_mass_is_not_declared_is_refused(name):
    with pytest.raises(ConfigurationError, match="mass is not declared"):
        run(name, record(), None)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_what_the_force_accelerates_has_a_mass(name):
    """A filter that measures the motion takes a tip without mass; one that lets the force make it does not."""
    if name.startswith("kinematic"):
        assert np.isfinite(run(name, record(), 0.0).values[-1]).all()
    else:
        with pytest.raises(ConfigurationError, match="the tip's mass is 0"):
            run(name, record(), 0.0)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("settings", [{"force_std": 0.0}, {"velocity_std": -1.0}, {"start_depth": float("nan")}])
def test_impossible_settings_are_refused(name, settings):
    with pytest.raises(ConfigurationError):
        ESTIMATORS[name](**settings)


@pytest.mark.parametrize("name", [name for name in FILTERS if name != "filterpy"])
def test_a_start_from_a_fit_is_right_from_the_first_estimate(name):
    estimates = run(name, record(), start_from="fit", start_duration=0.5)
    if ESTIMATORS[name].online:
        assert (estimates.status[:250] == (Status.IDLE | Status.WAITING)).all()
    first = estimates.values[250]
    assert first[0] == pytest.approx(TRUTH[0], rel=0.06)
    if name != "afukf":  # whose free derivatives leave viscosity open for longer
        assert first[1] == pytest.approx(TRUTH[1], rel=0.25)


def test_contact_shorter_than_the_fit_is_told():
    estimates = run("kinematic-ekf", record(0.3))
    assert (estimates.status & Status.WAITING).all()
    assert np.isnan(estimates.values).all()


def in_air(samples: Samples, count: int) -> Samples:
    """The same, with so many samples of free air before it."""
    random = np.random.default_rng(7)
    air = replace(
        samples[:count],
        force=0.02 * random.standard_normal(count),
        velocity=1e-3 * random.standard_normal(count),
        contact=np.zeros(count, bool),
        active=np.zeros(count, bool),
    )
    return Samples.joined([air, samples])


def test_noise_is_measured_in_free_air():
    samples = in_air(record(), 600)
    measured = run("ekf", samples, noise="measure")
    tracker = ESTIMATORS["ekf"](noise="measure").start(Problem(MODEL, 0.14))
    tracker.run(samples)
    force_std, velocity_std = tracker.noise
    assert force_std == pytest.approx(0.02, rel=0.15)
    assert velocity_std == pytest.approx(1e-3, rel=0.15)
    same = run("ekf", samples, force_std=force_std, velocity_std=velocity_std)
    assert np.array_equal(measured.values, same.values, equal_nan=True)


@pytest.mark.parametrize("name", ["ekf", "afukf", "kinematic-ekf"])
def test_noise_of_the_rest_is_taken_where_there_was_one(name):
    """What shakes the tip on its way to the material is not the noise of the standstill; blocks change nothing."""
    samples = in_air(record(), 600)
    rng = np.random.default_rng(3)
    shaken = slice(250, 600)
    force, position = samples.force.copy(), samples.position.copy()
    force[shaken] += 0.5 * rng.standard_normal(350)
    position[:250] = 0.005
    samples = replace(samples, force=force, position=position)
    standstill = float(samples.time[250])
    found = []
    for blocks in ([samples], [samples[i : i + 17] for i in range(0, len(samples), 17)]):
        tracker = ESTIMATORS[name](noise="measure").start(Problem(MODEL, 0.14, standstill=standstill))
        details = [block.details for block in map(tracker.run, blocks) if block.details]
        found.append(details[-1]["noise"])
    assert found[0] == found[1]
    assert found[0]["from"] == "standstill"
    assert found[0]["force"] == pytest.approx(samples.force[:250].std(ddof=1))
    assert found[0]["velocity"] == pytest.approx(samples.velocity[:250].std(ddof=1))


def test_a_rest_that_was_none_is_not_taken_for_one():
    samples = in_air(record(), 600)
    start = np.where(np.arange(len(samples)) < 600, np.interp(np.arange(len(samples)), [0, 599], [1e-3, 0]), 0.0)
    samples = replace(samples, position=samples.position + start)
    tracker = ESTIMATORS["ekf"](noise="measure").start(Problem(MODEL, 0.14, standstill=float(samples.time[400])))
    assert tracker.run(samples).details["noise"]["from"] == "free air"


@pytest.mark.parametrize("name", ["afukf", "kinematic-ekf"])
def test_noise_cannot_be_measured_without_free_air(name):
    with pytest.raises(LogError, match="50 samples of free air"):
        run(name, record(), noise="measure")


@pytest.mark.parametrize("name", ["ekf", "afukf", "kinematic-ekf"])
def test_a_second_touch_resumes(name):
    samples = record(3.0)
    samples.active[800:900] = samples.contact[800:900] = False
    estimates = run(name, samples)
    assert estimates.status[900] & Status.RESUMED
    assert estimates.values[900, 0] == pytest.approx(estimates.values[799, 0], rel=0.05)
    assert (estimates.status[800:900] == Status.IDLE).all()
