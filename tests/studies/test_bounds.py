"""Design: the Cramer-Rao bounds, against numbers found by other means."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import ConfigurationError, contact_force
from palpate.contact import force_slopes
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_models import DimensionalityReduction, Flat, Power, Sphere
from palpate_studies.design.bounds import Nuisances, cramer_rao
from palpate_studies.design.measurement_noise import MeasurementNoise, QuantityNoise
from palpate_studies.design.palpation import best, palpations
from palpate_studies.design.pipeline_design import run_design
from palpate_studies.design.settings import DesignLoop, DesignSettings
from palpate_studies.design.tip_path import sine_path

S1 = {"elasticity": 282.1e3, "viscosity": 860.0}
THETA = list(S1.values())
SENSING = MeasurementNoise(QuantityNoise(500.0, 0.05), QuantityNoise(500.0, 0.0), in_step=True)
SPHERE = DimensionalityReduction(indenter=Sphere(radius=0.005))
TIPS = [Sphere(radius=0.005), Flat(radius=0.002), Power(exponent=4, coefficient=1e7)]


def bound(frequency=2.0, amplitude=0.001, bias=0.005, skew=None, theta=THETA, mass=None):
    path = sine_path(0.004, [(frequency, amplitude)], 10.0, 500.0, DesignLoop())
    return cramer_rao(SPHERE, theta, path, 0.14, 0.05, Nuisances(bias, skew, mass))


def percent(found):
    return tuple(100 * std / S1[name] for name, std in found.parameters.items())


@pytest.mark.parametrize(
    ("frequency", "elasticity", "viscosity"),
    [(0.5, 0.054, 1.06), (1.0, 0.056, 0.56), (2.0, 0.063, 0.33), (3.0, 0.072, 0.26), (5.0, 0.089, 0.20)],
)
def test_known_bounds_over_frequency(frequency, elasticity, viscosity):
    """S1, sphere R 5 mm, 0.05 N at 500 Hz, 10 s, 1 mm commanded; offset from a tare (5 mN)."""
    assert percent(bound(frequency)) == pytest.approx((elasticity, viscosity), rel=0.05)


def test_known_bounds_with_a_larger_amplitude():
    assert percent(bound(amplitude=0.0015)) == pytest.approx((0.048, 0.22), rel=0.05)


def test_known_bounds_with_unknown_timing_and_unknown_offset():
    assert percent(bound(skew=0.3e-3))[1] == pytest.approx(3.24, rel=0.05)
    assert percent(bound(frequency=0.5, bias=1.0))[0] == pytest.approx(0.5, rel=0.05)
    assert percent(bound(frequency=5.0, bias=1.0))[0] == pytest.approx(1.4, rel=0.05)


def test_the_loop_passes_four_fifths_of_two_hertz():
    assert abs(DesignLoop().passes(2.0)) == pytest.approx(0.80, abs=0.01)
    path = sine_path(0.004, [(2.0, 0.001)], 10.0, 500.0, DesignLoop())
    assert np.abs(path.depth - 0.004).max() == pytest.approx(0.8e-3, rel=0.01)


@pytest.mark.slow
def test_a_path_is_the_integral_of_its_derivatives():
    path = sine_path(0.004, [(0.5, 0.0003), (2.0, 0.0005)], 2.0, 5000.0, DesignLoop())
    step = 2 / 5000.0
    for lower, higher in ((path.depth, path.rate), (path.rate, path.acceleration), (path.acceleration, path.jerk)):
        slope = (lower[2:] - lower[:-2]) / step
        assert slope == pytest.approx(higher[1:-1], abs=1e-5 * np.abs(higher).max())


@pytest.mark.parametrize("tip", TIPS, ids=lambda tip: type(tip).__name__)
def test_slopes_are_those_of_the_model(tip):
    model = DimensionalityReduction(indenter=tip)
    depth, rate = np.linspace(0.001, 0.005, 7), np.linspace(-0.01, 0.01, 7)
    force, by_parameter, by_depth, by_rate = force_slopes(model, depth, rate, THETA)
    assert force == pytest.approx(contact_force(model, depth, rate, THETA))

    def difference(**step):
        def at(sign):
            theta = [THETA[0] + sign * step.get("e", 0.0), THETA[1] + sign * step.get("n", 0.0)]
            return contact_force(model, depth + sign * step.get("d", 0.0), rate + sign * step.get("v", 0.0), theta)

        return (at(1) - at(-1)) / (2 * next(iter(step.values())))

    assert by_parameter[:, 0] == pytest.approx(difference(e=1.0), rel=1e-6)
    assert by_parameter[:, 1] == pytest.approx(difference(n=1.0), rel=1e-6)
    assert by_depth == pytest.approx(difference(d=1e-8), rel=1e-5)
    assert by_rate == pytest.approx(difference(v=1e-6), rel=1e-6)


@pytest.mark.slow
def test_least_squares_scatters_by_the_bound():
    """Monte Carlo: a Gauss-Newton fit of E, eta and surface, offset known to its prior."""
    path = sine_path(0.004, [(2.0, 0.001)], 4.0, 500.0, DesignLoop())
    expected = cramer_rao(SPHERE, THETA, path, 0.14, 0.05, Nuisances(1e-9, None))
    force, by_parameter, by_depth, _ = force_slopes(SPHERE, path.depth, path.rate, THETA)
    jacobian = np.column_stack([by_parameter, by_depth])
    rng, found = np.random.default_rng(1), []
    for _ in range(400):
        found.append(np.linalg.lstsq(jacobian / [1e5, 1e3, 1e3], 0.05 * rng.standard_normal(len(force)), rcond=None)[0])
    stds = np.std(found, axis=0) / [1e5, 1e3, 1e3]
    assert stds[0] == pytest.approx(expected.parameters["elasticity"], rel=0.12)
    assert stds[1] == pytest.approx(expected.parameters["viscosity"], rel=0.12)
    assert stds[2] == pytest.approx(expected.surface, rel=0.12)


def test_to_know_less_is_never_better():
    known = bound().parameters
    for worse in (bound(bias=1.0), bound(skew=1e-3), bound(mass=0.05), bound(bias=1.0, skew=1e-3, mass=0.05)):
        assert all(worse.parameters[name] >= known[name] * (1 - 1e-9) for name in known)


def test_an_unknown_skew_costs_the_shear_modulus_times_it():
    """E/(2 (1 + nu)) u(tau), added to what the noise leaves."""
    shear = S1["elasticity"] / 3.0
    worse, known = bound(skew=1e-5).parameters["viscosity"], bound().parameters["viscosity"]
    assert np.sqrt(worse**2 - known**2) == pytest.approx(shear * 1e-5, rel=0.02)


def test_what_cannot_be_told_is_infinite():
    """At rest a flat tip's force tells nothing of viscosity, and its stiffness not from its surface."""
    model = DimensionalityReduction(indenter=Flat(radius=0.002))
    path = sine_path(0.004, [(2.0, 1e-15)], 1.0, 500.0, DesignLoop())
    found = cramer_rao(model, THETA, path, 0.14, 0.05, Nuisances(1.0, None))
    assert {*found.parameters.values(), found.surface} == {np.inf}


@pytest.mark.slow
def test_the_recommendation_keeps_the_limits():
    settings = DesignSettings(
        frequencies=(1.0, 3.0, 5.0, 20.0), amplitudes=(0.0005, 0.0015, 0.005), top_acceleration=1.0
    )
    found = palpations(SPHERE, THETA, settings, 0.14, 0.004, 10.0, SENSING)
    chosen = best(found, S1)
    assert chosen is not None
    assert chosen.refused is None
    assert (2 * np.pi * chosen.frequencies[0]) ** 2 * chosen.amplitude <= 1.0
    allowed = [item for item in found if item.refused is None]
    assert {item.refused for item in found} >= {None, "leaves contact"}

    def cost(item):
        return sum(share**2 for share in item.relative_rmse("known", S1).values())

    assert cost(chosen) == min(map(cost, allowed))
    nothing = palpations(SPHERE, THETA, DesignSettings(top_speed=1e-6), 0.14, 0.004, 10.0, SENSING)
    assert best(nothing, S1) is None


def test_several_sines_share_the_amplitude_and_weaken_an_unknown_skew():
    settings = DesignSettings(frequencies=(2.0,), amplitudes=(0.0015,), multisines=((0.5, 2.0, 5.0),))
    one, several = palpations(SPHERE, THETA, settings, 0.14, 0.004, 10.0, SENSING)
    assert several.amplitude == pytest.approx(0.0005)
    skewed = "unknown skew"
    assert several.relative(skewed, S1)["viscosity"] < 0.6 * one.relative(skewed, S1)["viscosity"]


@pytest.mark.parametrize(("amplitude", "viscosity"), [(1e-3 / 3, 1.89), (0.4e-3, 1.66), (0.5e-3, 1.39)])
def test_a_multi_sine_weakens_an_unknown_skew_by_its_amplitude(amplitude, viscosity):
    """0.5, 2 and 5 Hz, 0.3 ms: 3.24 % of one sine; 1.69 % is reached at 0.39 mm each, whatever the phases are."""
    path = sine_path(0.004, [(f, amplitude) for f in (0.5, 2.0, 5.0)], 10.0, 500.0, DesignLoop())
    found = cramer_rao(SPHERE, THETA, path, 0.14, 0.05, Nuisances(0.005, 0.3e-3))
    assert percent(found)[1] == pytest.approx(viscosity, rel=0.01)


def test_half_the_effect_of_an_unknown_skew():
    path = sine_path(0.004, [(f, 0.394e-3) for f in (0.5, 2.0, 5.0)], 10.0, 500.0, DesignLoop())
    found = cramer_rao(SPHERE, THETA, path, 0.14, 0.05, Nuisances(0.005, 0.3e-3))
    assert percent(found)[1] == pytest.approx(1.69, rel=0.05)


def test_a_model_that_remembers_is_refused():
    with pytest.raises(ConfigurationError, match="remembers"):
        force_slopes(SimpleNamespace(memory=("branch",)), np.ones(2), np.ones(2), THETA)


def test_a_faster_force_tells_more_and_a_noisy_motion_less():
    """Twice the readings are worth the root of two; a position's noise is a force of the stiffness times that."""
    path = sine_path(0.004, [(2.0, 0.001)], 10.0, 500.0, DesignLoop())
    _, _, by_depth, by_rate = force_slopes(SPHERE, path.depth, path.rate, THETA)

    def noise(**changed):
        given = {"force": QuantityNoise(500.0, 0.05), "position": QuantityNoise(500.0, 0.0), **changed}
        return MeasurementNoise(**given).noise(path, by_depth, by_rate)

    np.testing.assert_allclose(noise(), 0.05, rtol=1e-6)
    np.testing.assert_allclose(noise(force=QuantityNoise(1000.0, 0.05)), 0.05 / np.sqrt(2), rtol=1e-6)
    shaky = noise(position=QuantityNoise(500.0, 5e-6))
    np.testing.assert_allclose(np.sqrt(shaky**2 - 0.05**2), 5e-6 * by_depth, rtol=0.02)  # and a little by the rate
    helped = noise(position=QuantityNoise(500.0, 5e-6), velocity=QuantityNoise(500.0, 1e-6))
    assert (helped < shaky).all()


@pytest.mark.parametrize(("frequency", "rate"), [(2.0, 800.0), (5.0, 800.0), (5.0, 640.0)])
def test_what_a_straight_line_between_readings_moves(frequency, rate):
    """Least squares on a force that was interpolated from readings between the positions, no noise."""
    loop = DesignLoop()
    path = sine_path(0.004, [(frequency, 0.0015)], 10.0, 500.0, loop)
    fine = sine_path(0.004, [(frequency, 0.0015)], 10.01, rate, loop)
    force = contact_force(SPHERE, fine.depth, fine.rate, THETA)
    read = np.interp(path.time, fine.time, force)
    exact, by_parameter, by_depth, by_rate = force_slopes(SPHERE, path.depth, path.rate, THETA)
    jacobian = np.column_stack([by_parameter / [1e-5, 1e-3], by_depth * 1e-3])
    moved = np.linalg.lstsq(jacobian, read - exact, rcond=None)[0] / [1e-5, 1e-3, 1e3]
    sensing = MeasurementNoise(QuantityNoise(rate, 0.05), QuantityNoise(500.0, 0.0))
    error = sensing.interpolation(path, exact, by_rate, 0.0)
    found = cramer_rao(SPHERE, THETA, path, 0.0, 0.05, Nuisances(0.005, None), error=error)
    assert found.bias["elasticity"] == pytest.approx(moved[0], rel=0.1)
    assert found.bias["viscosity"] == pytest.approx(moved[1], rel=0.1)
    assert found.rmse("elasticity") == pytest.approx(np.hypot(found.parameters["elasticity"], moved[0]), rel=0.02)
    assert (
        not MeasurementNoise(QuantityNoise(500.0, 0.05), QuantityNoise(500.0, 0.0), in_step=True)
        .interpolation(path, exact, by_rate, 0.01)
        .any()
    )


@pytest.mark.slow
def test_the_bias_of_a_design_is_the_one_that_a_run_has(root, tmp_path):
    """The fit at 5 Hz and 1.5 mm, no noise, a tip of no weight: E and eta are low by what `design` says."""
    theta = {"elasticity": 282.1e3, "viscosity": 860.0}
    settings = ["device.rig.force_std=0 N", "device.rig.position_std=0 m", "device.rig.velocity_std=0 m/s"]
    settings += ["device.rig.tip_mass=1 g", "alignment.tip_mass=1 g", "device.rig.drift=0 N/h"]
    settings += [f"device.rig.specimen.{name}={value}" for name, value in theta.items()]
    settings += ["trajectory.press.frequency=5 Hz", "trajectory.press.amplitude=1.5 mm"]
    settings += ['estimator.fit={type="casadi-fit"}', 'run.tracks=["dr/fit"]']
    settings += ["design.frequencies=[5.0]", 'design.amplitudes=["1.5 mm"]']
    pipeline = replace(load_pipeline(root / "pipelines" / "filters.toml", settings), sinks={})
    (said,) = run_design(pipeline, "dr").palpations
    found = run_pipeline(pipeline, tmp_path / "run").tracks["dr/fit"].parameters
    for name, share in said.relative_bias(theta).items():
        assert share < -5e-4
        assert found[name].value / theta[name] - 1 == pytest.approx(share, rel=0.15)
