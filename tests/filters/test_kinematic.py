"""The kinematic filter and its smoother."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import ContactModel, Problem, Samples, contact_force
from palpate_filters import filter_tracker, filtered_rows, smoother
from palpate_filters.kinematic_filter import KinematicFilter
from palpate_filters.process_models import KinematicProcess
from palpate_filters.smoother import KinematicSmoother
from palpate_filters.starting_fit import fit_start
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere
from palpate_testing import synthetic_samples

MODEL = DimensionalityReduction(indenter=Sphere(radius=5e-3))
PROBLEM, TRUTH = Problem(MODEL, 0.14), [1.1e5, 360.0]


def record(seed: int = 0, duration: float = 5.0) -> Samples:
    return synthetic_samples(MODEL, TRUTH, duration=duration, seed=seed)


@pytest.mark.slow
def test_its_errors_are_as_large_as_it_says():
    """NEES of surface, E and eta over 50 runs: 3 on average, 95 % band 2.4 to 3.7."""
    found = []
    for seed in range(50):
        estimates = KinematicFilter().start(PROBLEM).run(record(seed))
        errors = np.array([estimates.surface[-1], *(estimates.values[-1] - TRUTH)])
        found.append(np.sum((errors / [estimates.surface_std[-1], *estimates.std[-1]]) ** 2))
    assert 2.4 < np.mean(found) < 3.7


@pytest.mark.slow
def test_it_finds_the_truth_of_every_model(contact_models: dict[str, tuple[ContactModel, list[float]]]):
    for name, (model, theta) in contact_models.items():
        if name == "relaxing":
            continue
        samples = synthetic_samples(model, theta)
        found = KinematicFilter().start(Problem(model, 0.14)).run(samples)
        assert (np.abs(found.values[-1] - theta) < 4 * found.std[-1]).all(), name
        assert found.values[-1, 0] == pytest.approx(theta[0], rel=0.15), name


def test_the_chart_is_undone(contact_models: dict[str, tuple[ContactModel, list[float]]]):
    for model, theta in contact_models.values():
        process = KinematicProcess(model, 0.14)
        chart = process.on_chart(theta, np.log)
        assert process.parameters(chart, np.exp) == pytest.approx(theta, rel=1e-12)


def test_a_force_bias_is_found():
    samples = record(duration=10.0)
    biased = replace(samples, force=samples.force + 0.3)
    plain = KinematicFilter().start(PROBLEM).run(biased).values[-1]
    found = KinematicFilter(bias_std="1 N").start(PROBLEM).run(biased)
    assert abs(found.values[-1, 0] - TRUTH[0]) < 3 * found.std[-1, 0]
    assert abs(plain[0] - TRUTH[0]) > abs(found.values[-1, 0] - TRUTH[0])


@pytest.mark.slow
def test_outliers_do_less_harm_to_students_t():
    errors = {4.0: [], None: []}
    for seed in range(6):
        samples = record(seed)
        struck = np.random.default_rng(seed).uniform(size=len(samples)) < 0.01
        samples.force[struck] += 2.0
        for student, found in errors.items():
            estimates = KinematicFilter(student=student).start(PROBLEM).run(samples)
            found.append(estimates.values[-1, 0] / TRUTH[0] - 1)
    rms = {student: np.sqrt(np.mean(np.square(found))) for student, found in errors.items()}
    assert rms[4.0] < 0.6 * rms[None]


def sweep() -> tuple[Samples, np.ndarray]:
    """A palpation over a stretch that is half as stiff again."""
    samples = record(duration=12.0)
    true = TRUTH[0] * (1 + 0.5 * np.exp(-0.5 * ((samples.time - 7.0) / 0.9) ** 2))
    depth, rate = 3e-3 + 1e-3 * np.sin(4 * np.pi * samples.time), 4e-3 * np.pi * np.cos(4 * np.pi * samples.time)
    more = contact_force(MODEL, depth, rate, [true - TRUTH[0], 0.0])
    return replace(samples, force=samples.force + more), true


def test_the_smoother_is_better_than_the_filter():
    samples, true = sweep()
    errors = {}
    for name, estimator in {
        "filter": KinematicFilter(sweep_speed=4e-3),
        "lag": KinematicSmoother(sweep_speed=4e-3, lag=0.5),
        "smoother": KinematicSmoother(sweep_speed=4e-3),
    }.items():
        found = estimator.start(PROBLEM).run(samples).values[:, 0]
        errors[name] = np.sqrt(np.nanmean((found - true)[600:] ** 2))
    assert errors["lag"] < 0.75 * errors["filter"]
    assert errors["smoother"] < 0.75 * errors["filter"]


def test_a_lag_as_long_as_the_record_is_no_lag():
    samples, _ = sweep()
    whole = KinematicSmoother(sweep_speed=4e-3).start(PROBLEM).run(samples)
    lagged = KinematicSmoother(sweep_speed=4e-3, lag=60.0).start(PROBLEM).run(samples)
    assert np.array_equal(whole.values, lagged.values)


@pytest.mark.parametrize("settings", [{"sweep_speed": 4e-3}, {"sweep_speed": 4e-3, "lag": 0.5}, {}])
def test_states_that_are_not_kept_are_made_again_to_the_bit(monkeypatch, settings):
    samples = sweep()[0][:3000]
    kept = KinematicSmoother(**settings).start(PROBLEM).run(samples)
    made = []

    def again(self, stretch, before=filtered_rows.OutputStore.of):
        made.append(id(stretch) in self._kept)
        return before(self, stretch)

    monkeypatch.setattr(filtered_rows.OutputStore, "of", again)
    monkeypatch.setattr(filtered_rows.OutputStore.__init__, "__defaults__", (2,))
    for module in (filter_tracker, smoother):
        monkeypatch.setattr(module, "PIECE", 170)
    found = KinematicSmoother(**settings).start(PROBLEM).run(samples)
    for name in ("values", "std", "surface", "surface_std", "force", "nis", "innovation", "status"):
        assert np.array_equal(getattr(found, name), getattr(kept, name), equal_nan=True), name
    assert made.count(False) >= 3000 // 170 - 3


def test_the_smoother_ends_where_the_filter_ends_and_begins_at_the_first_sample():
    samples = record()
    filtered = KinematicFilter().start(PROBLEM).run(samples)
    smoothed = KinematicSmoother(passes=1).start(PROBLEM).run(samples)
    assert np.array_equal(smoothed.values[-1], filtered.values[-1])
    assert np.isfinite(smoothed.values).all()
    assert (smoothed.status == 0).all()
    # What does not change is known at the end as well as anywhere.
    assert smoothed.values[0] == pytest.approx(smoothed.values[-1], rel=1e-3)


def faint(seed: int) -> Samples:
    """A viscosity that the record hardly tells: 0.15 mm at 0.7 Hz around 0.8 mm; 0.02 N of it in 0.05 N of noise."""
    random = np.random.default_rng(seed)
    time = np.arange(4000) / 500.0
    angle = 1.4 * np.pi * time + random.uniform(0, 2 * np.pi)
    depth, rate = 0.8e-3 + 0.15e-3 * np.sin(angle), 0.15e-3 * 1.4 * np.pi * np.cos(angle)
    bend = -0.15e-3 * (1.4 * np.pi) ** 2 * np.sin(angle)
    force = 16 / 9 * 5e4 * np.sqrt(5e-3 * depth**3) + 8 * 1500.0 * np.sqrt(5e-3 * depth) * rate + 0.14 * bend
    noise, always = random.standard_normal((3, len(time))), np.ones(len(time), bool)
    return Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0), force + 0.05 * noise[0],
        -depth + 5e-6 * noise[1], -rate + 0.67e-3 * noise[2], always, always,
    )  # fmt: skip


@pytest.mark.slow
def test_a_relinearised_smoother_ends_where_least_squares_do_with_their_uncertainty():
    """A single pass stays where its first linearisations, in logarithms, have led it: too far, and too certain."""
    apart: dict[int, list[np.ndarray]] = {1: [], 3: []}
    for seed in range(4):
        fit = CasadiFit(profile=False).start(PROBLEM).run(faint(seed))
        for passes, found in apart.items():
            smoothed = KinematicSmoother(passes=passes).start(PROBLEM).run(faint(seed))
            found.append(np.abs(smoothed.values[-1] - fit.values[-1]) / fit.std[-1])
    assert np.max(apart[3]) < 0.6
    assert np.max(apart[1]) > 2.0


def test_the_fit_finds_a_surface_within_the_motion():
    samples = record(duration=1.0)
    samples = replace(samples, position=samples.position + 2.5e-3)  # the tip leaves a surface at 0
    depth, rate = -samples.position, -samples.velocity
    random = np.random.default_rng(2)
    samples = replace(samples, force=contact_force(MODEL, depth, rate, TRUTH) + 0.01 * random.standard_normal(500))
    found = fit_start(MODEL, 1e-6, samples, np.array([1e4, 10.0]))
    assert found is not None
    assert found.surface == pytest.approx(0.0, abs=3e-5)
    assert found.theta[0] == pytest.approx(TRUTH[0], rel=0.05)


def test_readings_of_50_hz_are_no_pauses():
    """The interval of a stamp may be a nanosecond above 20 ms."""
    samples = record(duration=5.0)[::10]
    samples = replace(samples, interval=np.diff(samples.time, prepend=samples.time[0]))
    fit = fit_start(MODEL, 0.14, samples[:60], np.array([1e4, 10.0]))
    assert fit is not None
    assert fit.theta[0] == pytest.approx(TRUTH[0], rel=0.1)
    estimates = KinematicFilter().start(PROBLEM).run(samples)
    assert (np.abs(estimates.values[-1] - TRUTH) < 4 * estimates.std[-1]).all()


def test_a_fit_of_noise_is_none():
    samples = record(duration=1.0)
    noise = np.random.default_rng(4).standard_normal(len(samples))
    assert fit_start(MODEL, 0.14, replace(samples, force=noise), np.array([1e4, 10.0])) is None


def test_a_model_without_roles_has_no_fit(contact_models: dict[str, tuple[ContactModel, list[float]]]):
    class Branch(type(contact_models["kelvin-voigt"][0])):
        parameters = tuple(replace(p, role=None, upper=1e4) for p in contact_models["kelvin-voigt"][0].parameters)

    assert fit_start(Branch(), 0.14, record(duration=1.0), np.array([800.0, 10.0])) is None
    estimates = KinematicFilter().start(Problem(Branch(), 0.14)).run(record(duration=1.0))
    assert np.isfinite(estimates.values[-1]).all()
