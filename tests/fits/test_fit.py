"""Offline fits: identities, solvers, segments, uncertainty, refusals."""

import json

import casadi as ca
import numpy as np
import pytest
from palpate import ConfigurationError, ContactModel, Parameter, Problem, Samples, contact_force
from palpate_fits import CasadiFit
from palpate_fits.residual import reading
from palpate_kit.numerics.normal_equations import scaled_inverse
from palpate_models import DimensionalityReduction, Flat, Power, Sphere
from palpate_testing import check_estimator, synthetic_samples
from palpate_testing.truth_records import PressMotion
from scipy.signal import lfilter

SPHERE = Sphere(radius=0.005)
TIPS = {"sphere": SPHERE, "flat": Flat(radius=0.005), "quartic": Power(exponent=4.0, coefficient=1e7)}
E, ETA, SURFACE = 112.5e3, 362.0, 0.3e-3


class KelvinVoigt(ContactModel):
    """Spring and damper in parallel."""

    parameters = (
        Parameter("stiffness", "K", "N/m", "spring", role="elastic"),
        Parameter("damping", "B", "N*s/m", "damper", role="viscous"),
    )

    def force(self, depth, rate, theta, memory=()):
        return theta[0] * depth + theta[1] * rate


class HuntCrossley(ContactModel):
    """(K + B d') d^n, with d in mm so that K is of the size of a newton."""

    parameters = (
        Parameter("stiffness", "K", "1", "force at 1 mm", role="elastic"),
        Parameter("damping", "B", "1", "damping at 1 mm", role="viscous"),
        Parameter("exponent", "n", "1", "exponent", lower=1.0, upper=4.0),
    )

    def force(self, depth, rate, theta, memory=()):
        return (theta[0] + theta[1] * rate) * (depth / 1e-3) ** theta[2]


class Relaxing(ContactModel):
    """Hertz's sphere with one Maxwell branch of known time: a model that remembers."""

    parameters = (
        Parameter("elasticity", "E", "Pa", "at rest", role="elastic"),
        Parameter("branch", "E1", "Pa", "of the branch", role="viscous"),
    )
    memory = ("branch_indentation",)
    tau: float = 0.2

    def force(self, depth, rate, theta, memory=()):
        (relaxed,) = memory
        return 16 / 9 * 0.005**0.5 * (theta[0] * depth**1.5 + theta[1] * (1e6 * depth**1.5 - relaxed) / 1e6)

    def memory_rate(self, depth, rate, theta, memory):
        return ((1e6 * depth**1.5 - memory[0]) / self.tau,)


def ramp(model, theta, *, speed=50e-3 / 60, deep=2.2e-3, air=2e-3, back=False, rate=500.0, seed=0, noise=0.05, bias=0.0,
         drift=0.0, colour=0.0, cycles=1):  # fmt: skip
    """Samples of a press at constant speed from air to a depth, and back again if wanted."""
    random = np.random.default_rng(seed)
    n = int((air + deep) / speed * rate)
    down = SURFACE + air - speed * np.arange(n) / rate
    height = np.concatenate([down, down[::-1]] if back else [down])
    velocity = np.concatenate([np.full(n, -speed), np.full(n, speed)] if back else [np.full(n, -speed)])
    height, velocity = np.tile(height, cycles), np.tile(velocity, cycles)
    stamp = np.arange(len(height), dtype=np.int64) * round(1e9 / rate)
    time = stamp / 1e9
    white = random.standard_normal(len(time) + 300)
    coloured = lfilter([np.sqrt(1 - colour**2)], [1.0, -colour], white)
    force = contact_force(model, SURFACE - height, -velocity, theta) + noise * coloured[300:] + bias + drift * time
    contact = height < SURFACE
    interval = np.concatenate([[0.0], np.diff(time)])
    measured = height + 5e-6 * random.standard_normal(len(time))
    return Samples(
        stamp, time, interval, force, measured, velocity + 0.67e-3 * random.standard_normal(len(time)), contact, contact
    )


def fitted(model, samples, mass=None, timing=None, **settings):
    return CasadiFit(**settings).start(Problem(model, mass, timing)).run(samples)


def last(estimates):
    """Parameters, their std, and the surface."""
    row = int(np.flatnonzero(estimates.status == 0)[-1])
    return estimates.values[row], estimates.std[row], float(estimates.surface[row])


def unknown(estimates, name):
    return estimates.details["unknowns"][name]


DR = DimensionalityReduction(indenter=SPHERE)


@pytest.mark.parametrize("settings", [{}, {"solver": "trf"}, {"loss": "huber"}, {"weights": "depth"}], ids=str)
@pytest.mark.parametrize("tip", TIPS)
def test_it_keeps_the_promises_of_an_estimator(tip, settings):
    check_estimator(CasadiFit(**settings), DimensionalityReduction(indenter=TIPS[tip]), (E, ETA))


@pytest.mark.parametrize(
    ("model", "theta"), [(KelvinVoigt(), (600.0, 8.0)), (HuntCrossley(), (0.5, 6.0, 1.3))], ids=str
)
def test_it_keeps_them_for_other_models(model, theta):
    check_estimator(CasadiFit(), model, theta)


@pytest.mark.parametrize("solver", ["lm", "trf"])
@pytest.mark.parametrize("tip", TIPS)
def test_without_noise_the_truth_is_found(tip, solver):
    model = DimensionalityReduction(indenter=TIPS[tip])
    samples = synthetic_samples(model, (E, ETA))
    time = samples.time
    omega = 4 * np.pi
    depth, rate = 3e-3 + 1e-3 * np.sin(omega * time), 1e-3 * omega * np.cos(omega * time)
    exact = Samples(
        samples.stamp, time, samples.interval, contact_force(model, depth, rate, (E, ETA)), -depth, -rate,
        samples.contact, samples.active,
    )  # fmt: skip
    estimates = fitted(model, exact, solver=solver, unknowns=(), profile=False, smoothing=0.01)
    # The local cubic bends a sine of 2 Hz by some 1e-6 over 10 ms.
    np.testing.assert_allclose(estimates.values[-1], (E, ETA), rtol=1e-4)
    assert abs(estimates.surface[-1]) < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_every_solver_reaches_the_same_minimum(seed):
    samples = ramp(DR, (E, ETA), seed=seed)
    found = {s: fitted(DR, samples, segment="load", solver=s, profile=False) for s in ("lm", "trf")}
    for estimates in found.values():
        std = found["trf"].std[-1]
        np.testing.assert_allclose(estimates.details["rss"], found["trf"].details["rss"], rtol=1e-9)
        assert np.all(np.abs(estimates.values[-1] - found["trf"].values[-1]) < 1e-3 * std)
        assert abs(estimates.surface[-1] - found["trf"].surface[-1]) < 1e-3 * found["trf"].surface_std[-1]


@pytest.mark.parametrize(("model", "theta"), [(DR, (E, ETA)), (HuntCrossley(), (0.8, 20.0, 1.37))], ids=["dr", "hc"])
@pytest.mark.parametrize("unknowns", [(), ("bias", "delay")], ids=str)
def test_the_minimum_is_exact_by_the_gradient_that_casadi_evaluates(model, theta, unknowns):
    samples = ramp(model, theta, back=True, speed=6e-3, seed=7)
    fit = CasadiFit(segment="cycle", unknowns=unknowns).start(Problem(model, None)).fit(samples)
    free = list(fit.residual.free)
    row, x = ca.SX.sym("w", 6), ca.SX.sym("x", len(fit.solution.least))
    error = row[5] * (reading(model, ca.vertsplit(x), ca.vertsplit(row), fit.record.transition) - row[3])
    slopes = ca.horzcat(*[ca.jacobian(error, x[i]) for i in free])
    whole = ca.Function("whole", [row, x], [error, slopes.T]).map(len(fit.record))
    found = whole(np.array(fit.record.parts), fit.solution.least)
    error, jacobian = np.array(found[0]).ravel(), np.array(found[1]).T
    step = np.linalg.lstsq(jacobian, -error, rcond=None)[0]
    sigma = error.std() * np.sqrt(np.diag(scaled_inverse(jacobian.T @ jacobian)))
    assert fit.solver == "lm"
    assert fit.solution.converged
    assert np.all(np.abs(step) < 1e-9 * sigma)
    np.testing.assert_allclose(fit.solution.cost, 0.5 * error @ error, rtol=1e-12)


@pytest.mark.parametrize("loss", ["huber", "soft-l1"])
def test_robust_losses_have_one_minimum_for_both_solvers_and_shrug_off_outliers(loss):
    samples = ramp(DR, (E, ETA), seed=4)
    samples.force[::50] += 3.0
    settings = {"segment": "load", "fixed": {"viscosity": ETA}, "profile": False}
    found = [fitted(DR, samples, loss=loss, solver=s, **settings) for s in ("lm", "trf")]
    assert found[0].values[-1, 0] == pytest.approx(found[1].values[-1, 0], rel=1e-6)
    plain = fitted(DR, samples, **settings)
    assert abs(found[0].values[-1, 0] - E) < 0.25 * abs(plain.values[-1, 0] - E)
    assert abs(found[0].values[-1, 0] - E) < 3 * found[0].std[-1, 0]


def test_the_exponent_is_found():
    samples = ramp(HuntCrossley(), (0.8, 20.0, 1.37), speed=6e-3, deep=5e-3, back=True)
    estimates = fitted(HuntCrossley(), samples, segment="cycle")
    theta, std = estimates.values[-1], estimates.std[-1]
    assert np.all(np.abs(theta - (0.8, 20.0, 1.37)) < 4 * std)
    assert std[2] < 0.02


def test_a_model_that_remembers_is_fitted_through_its_memory():
    model, theta = Relaxing(), (100e3, 40e3)
    n = 2000
    time = np.arange(n) * 2e-3
    depth = np.where(time < 1, -1e-3 + 4e-3 * time, 3e-3 + 1e-3 * np.sin(4 * np.pi * (time - 1)))
    rate = np.where(time < 1, 4e-3, 4e-3 * np.pi * np.cos(4 * np.pi * (time - 1)))
    inside, memory = np.maximum(depth, 0.0), np.zeros(n)
    for i in range(1, n):  # the branch by the exact solution for a drive that is linear over the interval
        a, b = 1e6 * inside[i - 1] ** 1.5, 1e6 * inside[i] ** 1.5
        decay, slope = np.exp(-2e-3 / model.tau), (b - a) / 2e-3
        memory[i] = b - slope * model.tau + (memory[i - 1] - a + slope * model.tau) * decay
    force = model.force(inside, rate, theta, (memory,)) + 0.01 * np.random.default_rng(0).standard_normal(n)
    contact = depth > 0
    samples = Samples(
        np.arange(n, dtype=np.int64) * 2_000_000, time, np.concatenate([[0.0], np.diff(time)]), force,
        SURFACE - depth, -rate, contact, contact & (time > 1),
    )  # fmt: skip
    estimates = fitted(model, samples, unknowns=())
    assert np.all(np.abs(estimates.values[-1] - theta) < 4 * estimates.std[-1] + 1e-3 * np.array(theta))
    assert abs(estimates.surface[-1] - SURFACE) < 4 * estimates.surface_std[-1]
    assert np.isfinite(unknown(estimates, "elasticity")["interval"]).all()


def test_bias_slope_mass_and_delay_are_found_where_the_record_tells_them():
    samples = ramp(DR, (E, ETA), bias=0.4, drift=0.02, seed=2)
    estimates = fitted(DR, samples, segment="load", unknowns=("bias", "slope"), fixed={"viscosity": ETA})
    middle = 0.5 * (samples.time[0] + samples.time[-1])
    for name, truth in (("bias", 0.4 + 0.02 * middle), ("slope", 0.02)):
        known = unknown(estimates, name)
        assert abs(known["value"] - truth) < 4 * known["std"]
        assert known["std"] < 0.1 * truth
    shaken = synthetic_samples(DR, (E, ETA), duration=10.0)
    known = unknown(fitted(DR, shaken, unknowns=("tip_mass",)), "tip_mass")
    assert abs(known["value"] - 0.14) < 4 * known["std"]
    delayed = Samples(**{**vars(shaken), "force": np.roll(shaken.force, 3)})[slice(10, None)]
    found = fitted(DR, delayed, mass=0.14, unknowns=("delay",), fixed={"viscosity": ETA})
    assert unknown(found, "delay")["value"] == pytest.approx(6e-3, abs=3e-4)
    assert found.timing_included


def test_a_late_force_moves_viscosity_by_the_shear_modulus_and_the_budget_says_so():
    samples = synthetic_samples(DR, (E, ETA), duration=10.0)
    timing = fitted(DR, samples, mass=0.14, timing=0.5e-3).report.budget[-1]
    assert timing.source == "timing of force against motion"
    assert timing.effects["viscosity"].sensitivity == pytest.approx(E / 3, rel=0.02)
    assert timing.effects["viscosity"].contribution == pytest.approx(0.5e-3 * E / 3, rel=0.02)
    undeclared = fitted(DR, samples, mass=0.14).report.budget[-1]
    assert undeclared.effects["viscosity"].contribution is None
    assert "not declared" in undeclared.source


@pytest.mark.parametrize(
    ("name", "u", "expected"),
    [
        ("radius", "20 um", 0.5 * 20e-6 / 5e-3),  # E ~ R^-1/2
        ("force_scale", 0.005, 0.005),
        ("poisson", 0.01, 0.01 * 2 * 0.5 / (1 - 0.25)),  # E ~ 1 - nu^2
    ],
)
def test_declared_systematic_terms_follow_the_formula(name, u, expected):
    samples = ramp(DR, (E, ETA))
    settings = {"segment": "load", "fixed": {"viscosity": 0.0}, "unknowns": ("bias",)}
    plain, with_term = fitted(DR, samples, **settings), fitted(DR, samples, systematic={name: u}, **settings)
    effect = with_term.report.budget[1].effects["elasticity"]
    assert effect.percent == pytest.approx(100 * expected, rel=0.02)
    assert with_term.values[-1, 0] == plain.values[-1, 0]
    total = np.hypot(plain.std[-1, 0], effect.contribution)
    assert with_term.std[-1, 0] == pytest.approx(total, rel=1e-9)


def test_a_refit_confirms_the_linear_budget():
    samples = ramp(DR, (E, ETA))
    settings = {"segment": "load", "fixed": {"viscosity": 0.0}, "unknowns": ("bias",)}
    row = fitted(DR, samples, systematic={"radius": "50 um"}, **settings).report.budget[1]
    larger = DimensionalityReduction(indenter=Sphere(radius=0.00505))
    moved = fitted(larger, samples, **settings).values[-1, 0] - fitted(DR, samples, **settings).values[-1, 0]
    assert row.effects["elasticity"].sensitivity * 50e-6 == pytest.approx(moved, rel=0.02)


def test_the_force_constraint_is_the_interval_of_heights_that_it_allows():
    samples = ramp(DR, (E, ETA), noise=0.01)
    free = fitted(DR, samples, segment="load, depth 1 mm..2 mm", unknowns=(), fixed={"viscosity": 2e4})
    assert last(free)[2] < SURFACE - 0.2e-3  # a viscous term that is too large pulls the surface down
    found = {}
    for solver in ("lm", "trf"):
        estimates = fitted(
            DR, samples, segment="load, depth 1 mm..2 mm", unknowns=(), fixed={"viscosity": 2e4},
            force_uncertainty=0.05, solver=solver,
        )  # fmt: skip
        found[solver] = last(estimates)[2]
        assert any(str(flag).startswith("at-bound: surface") for flag in estimates.flags)
    at = np.abs(samples.position - found["trf"]) < 20e-6
    assert abs(np.mean(samples.force[at])) < 0.06
    assert found["trf"] == pytest.approx(found["lm"], abs=1e-8)


def test_a_force_constraint_below_the_bias_is_called_tight():
    samples = ramp(DR, (E, ETA), bias=0.2)
    estimates = fitted(DR, samples, segment="load", force_uncertainty=0.05)
    assert any(flag.code == "force-constraint-tight" for flag in estimates.flags)


@pytest.mark.parametrize("method", ["threshold", "deviation-from-baseline", "gradient"])
def test_other_contact_points_are_used_and_budgeted(method):
    samples = ramp(DR, (E, ETA), noise=0.01)
    estimates = fitted(DR, samples, segment="load", contact_point=method, fixed={"viscosity": ETA})
    point = estimates.details["contact_points"][method]
    assert estimates.surface[-1] == point["surface"]
    assert estimates.surface_std[-1] == point["std"] > 0
    assert not unknown(estimates, "surface")["free"]
    assert abs(point["surface"] - SURFACE) < 0.5e-3
    assert any(row.source == "contact point" for row in estimates.report.budget)


def test_the_fitted_surface_lies_before_the_threshold():
    estimates = fitted(DR, ramp(DR, (E, ETA)), segment="load", fixed={"viscosity": ETA})
    late = estimates.surface[-1] - estimates.details["contact_points"]["threshold"]["surface"]
    assert 0.05e-3 < late < 1.5e-3
    assert abs(estimates.surface[-1] - SURFACE) < 4 * estimates.surface_std[-1]


@pytest.mark.parametrize(
    ("segment", "rows"),
    [
        ("all", lambda s: np.ones(len(s), bool)),
        ("contact", lambda s: s.contact),
        ("active", lambda s: s.active),
        ("1 s..3 s", lambda s: (s.time >= 1) & (s.time <= 3)),
        ("load, 1 s..3 s", lambda s: (s.time >= 1) & (s.time <= 3)),
    ],
)
def test_segments_choose_samples(segment, rows):
    samples = ramp(DR, (E, ETA))
    estimates = fitted(DR, samples, segment=segment, fixed={"viscosity": ETA}, profile=False)
    chosen = rows(samples)
    np.testing.assert_array_equal(estimates.status == 0, chosen)
    assert np.isnan(estimates.values[~chosen]).all()
    assert len(np.unique(estimates.values[chosen, 0])) == 1


def test_load_unload_and_single_cycles():
    samples = ramp(DR, (E, ETA), speed=6e-3, back=True, cycles=3)
    inwards = samples.velocity < 0
    load, unload = (fitted(DR, samples, segment=s, profile=False) for s in ("load", "unload"))
    assert inwards[load.status == 0].mean() > 0.98
    assert inwards[unload.status == 0].mean() < 0.02
    second = fitted(DR, samples, segment="cycle, cycles 2..2", profile=False)
    assert second.details["cycles"] == 3
    third = len(samples) // 3
    rows = np.flatnonzero(second.status == 0)
    assert rows[0] >= third - 10
    assert rows[-1] <= 2 * third + 10


def test_what_cannot_be_told_apart_is_named():
    shaken = synthetic_samples(DR, (E, ETA), duration=5.0)
    pairs = fitted(DR, shaken, mass=0.14).details["identifiability"]["pairs"]
    named = {frozenset((pair["first"], pair["second"])): pair["correlation"] for pair in pairs}
    assert abs(named[frozenset(("viscosity", "delay"))]) > 0.98
    assert abs(named[frozenset(("elasticity", "surface"))]) > 0.9
    estimates = fitted(DR, shaken, mass=0.14, unknowns=("delay",))
    assert any(str(flag).startswith("hard-to-tell-apart: viscosity and delay") for flag in estimates.flags)
    shallow = ramp(HuntCrossley(), (0.8, 0.0, 1.5), deep=1e-3)
    known = fitted(HuntCrossley(), shallow, segment="contact").details["identifiability"]["pairs"]
    assert any({pair["first"], pair["second"]} == {"exponent", "surface"} for pair in known)


def test_where_the_skin_is_what_is_not_known_stating_it_is_the_remedy():
    """0.05 mm about 3 mm, in contact alone: E and the skin are one number, until the skin is stated."""
    shaken = PressMotion(amplitude=5e-5, duration=5.0).samples(DR, (E, ETA), 0.14, 0)
    unclear = fitted(DR, shaken, mass=0.14, profile=False)
    flags = [flag for flag in unclear.flags if flag.code in ("hard-to-tell-apart", "not-identifiable")]
    assert flags
    assert all("surface" in flag.remedy for flag in flags if "elasticity" in flag.message)
    stated = fitted(DR, shaken, mass=0.14, profile=False, fixed={"surface": 0.0})
    assert not [flag for flag in stated.flags if flag.code in ("hard-to-tell-apart", "not-identifiable")]
    row = np.flatnonzero(stated.status == 0)[0]
    assert stated.std[row, 0] < 0.2 * unclear.std[row, 0]


def test_a_record_of_very_many_samples_is_added_up_in_pieces(monkeypatch):
    """Of three samples each, over which noise of 0.9 hardly changes: the same standard deviations."""
    settings = {"segment": "load", "fixed": {"viscosity": ETA}, "profile": False}
    record = ramp(DR, (E, ETA), seed=3, colour=0.9)
    whole = fitted(DR, record, **settings)
    monkeypatch.setattr("palpate_fits.uncertainty._MAX_ROWS", whole.details["samples"] // 3 + 1)
    pieces = fitted(DR, record, **settings)
    assert pieces.std[-1] == pytest.approx(whole.std[-1], rel=0.1)
    worth = [found.details["autocorrelation"]["effective_samples"] for found in (pieces, whole)]
    assert worth[0] == pytest.approx(worth[1], rel=0.2)


def test_correlated_noise_widens_the_std_as_it_must():
    settings = {"segment": "load", "fixed": {"viscosity": ETA}, "profile": False}
    white = fitted(DR, ramp(DR, (E, ETA), seed=3), **settings)
    coloured = fitted(DR, ramp(DR, (E, ETA), seed=3, colour=0.9), **settings)
    assert white.details["autocorrelation"]["effective_samples"] > 0.6 * white.details["samples"]
    # An AR(1) process of 0.9 is worth (1 - 0.9)/(1 + 0.9) of its samples.
    share = coloured.details["autocorrelation"]["effective_samples"] / coloured.details["samples"]
    assert 0.03 < share < 0.09
    assert 3.0 < coloured.std[-1, 0] / white.std[-1, 0] < 6.5


def test_profile_and_bootstrap_agree_with_the_std_where_the_model_is_nearly_linear():
    samples = ramp(DR, (E, ETA), seed=5)
    estimates = fitted(DR, samples, segment="load", fixed={"viscosity": ETA}, bootstrap=60, seed=1)
    for name in ("elasticity", "surface"):
        known = unknown(estimates, name)
        assert known["interval_by"] == "profile"
        low, high = known["interval"]
        assert low < known["value"] < high
        assert high - low == pytest.approx(2 * 1.96 * known["random"], rel=0.05)
        assert estimates.details["bootstrap"]["unknowns"][name]["std"] == pytest.approx(known["random"], rel=0.35)
    again = fitted(DR, samples, segment="load", fixed={"viscosity": ETA}, bootstrap=60, seed=1)
    assert json.dumps(again.details) == json.dumps(estimates.details)


def test_earlier_fits_leave_no_trace():
    one, other = ramp(DR, (E, ETA), seed=1), ramp(DR, (2 * E, ETA), seed=2, back=True, speed=6e-3)
    tracker = CasadiFit(segment="load").start(Problem(DR, None))
    first = tracker.run(one)
    tracker.run(other)
    again = tracker.run(one)
    np.testing.assert_array_equal(first.values, again.values)
    assert json.dumps(first.details) == json.dumps(again.details)


def _silent(samples):
    samples.contact[:] = False


def _zero(samples):
    samples.force[:] = 0.0


def _constant(samples):
    samples.force[:] = 3.0


def _stopped(samples):
    samples.time[:] = 0.0


def _missing(samples):
    samples.force[:] = np.nan


@pytest.mark.parametrize(
    ("spoil", "settings", "code"),
    [
        (_silent, {}, "no-contact"),
        (_zero, {}, "no-force"),
        (_missing, {}, "no-force"),
        (_constant, {}, "no-force: the force never changes"),
        (_stopped, {}, "no-time"),
        (lambda s: None, {"segment": "depth 3 mm..5 mm"}, "segment-empty: depth 3..5 mm is never reached"),
        (lambda s: None, {"segment": "100 s..200 s"}, "segment-empty"),
        (lambda s: None, {"segment": "cycles 4..5"}, "segment-empty"),
        (lambda s: None, {"segment": "3 s..3.01 s"}, "too-few-samples"),
    ],
)
def test_what_cannot_be_fitted_is_refused_with_a_reason(spoil, settings, code):
    samples = ramp(DR, (E, ETA))
    spoil(samples)
    estimates = fitted(DR, samples, **settings)
    assert str(estimates.flags[0]).startswith(code)
    assert np.isnan(estimates.values).all()
    assert (estimates.status != 0).all()


def test_a_saturated_force_is_left_out_and_flagged():
    samples = ramp(DR, (E, ETA))
    top = 0.6 * samples.force.max()
    np.minimum(samples.force, top, out=samples.force)
    estimates = fitted(DR, samples, segment="load", fixed={"viscosity": ETA})
    assert any(flag.code == "saturated" for flag in estimates.flags)
    values, std, _ = last(estimates)
    assert abs(values[0] - E) < 4 * std[0]


def test_coarse_readings_at_the_top_are_no_saturation():
    samples = ramp(DR, (E, ETA))
    step = 0.05 * samples.force.max()
    samples.force[:] = step * np.round(samples.force / step)
    estimates = fitted(DR, samples, segment="load", fixed={"viscosity": ETA})
    assert np.count_nonzero(samples.force == samples.force.max()) > 10
    assert not any(flag.code == "saturated" for flag in estimates.flags)


def test_missing_positions_are_left_out():
    samples = ramp(DR, (E, ETA))
    samples.position[100::40] = np.nan
    estimates = fitted(DR, samples, segment="load", fixed={"viscosity": ETA})
    values, std, _ = last(estimates)
    assert abs(values[0] - E) < 4 * std[0]
    assert np.isnan(estimates.values[100::40]).all()


@pytest.mark.parametrize("spoil", ["no motion", "noise", "upside down"])
@pytest.mark.parametrize("model", [DR, HuntCrossley()], ids=["dr", "hc"])
def test_nonsense_gives_a_flag(model, spoil):
    samples = ramp(DR, (E, ETA))
    if spoil == "no motion":
        samples.position[:], samples.velocity[:] = 1.0, 0.0
    else:
        samples.force[:] = (
            np.random.default_rng(0).standard_normal(len(samples)) if spoil == "noise" else -samples.force
        )
    assert fitted(model, samples).flags


def test_a_wrong_model_is_flagged():
    samples = ramp(DR, (E, ETA), noise=0.005)
    codes = {flag.code for flag in fitted(KelvinVoigt(), samples, segment="load").flags}
    assert codes & {"misfit", "correlated-residuals"}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"segment": "loading"}, "'loading' is not one of"),
        ({"segment": "depth 2 mm..1 mm"}, "is empty"),
        ({"segment": "depth 2 s..3 s"}, "not a length"),
        ({"bounds": {"elasticity": (2e5, 1e5)}}, "leaves nothing"),
        ({"bounds": {"elasticity": ("-5 kPa", "-1 kPa")}}, "outside what is possible"),
        ({"bounds": {"stiffness": (1.0, 2.0)}}, "no unknown 'stiffness'"),
        ({"fixed": {"viscosity": "5 mm"}}, "not a viscosity"),
        ({"fixed": {"bias": 0.0}, "unknowns": ("bias",)}, "bias is fixed and among the unknowns"),
        ({"start_at": {"elasticity": 1e7}, "bounds": {"elasticity": (1e3, 1e6)}}, "outside its bounds"),
        ({"systematic": {"radios": 1e-5}}, "'radios' is not a number of"),
        ({"systematic": {"delay": 1e-3}}, "[alignment]"),
        ({"contact_point": "threshold", "fixed": {"surface": 0.0}}, "neither fixed nor bounded"),
    ],
)
def test_contradictory_settings_are_refused(settings, words):
    with pytest.raises(ConfigurationError) as caught:
        CasadiFit(**settings).start(Problem(DR, None))
    assert words in str(caught.value)


def test_a_minimum_needs_no_contact_points(monkeypatch):
    """They are of the report, and looked for where that is made."""
    looked = []
    monkeypatch.setattr("palpate_fits.approach.first_approach", lambda *given: looked.append(given))
    model = DimensionalityReduction(indenter=SPHERE)
    CasadiFit(profile=False).start(Problem(model, None)).fit(synthetic_samples(model, (E, ETA)))
    assert not looked
