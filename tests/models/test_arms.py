"""Materials with several relaxation times, of a power of time, and poroelastic ones: ramps, holds, sines."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, force_over_time
from palpate.registry import load
from palpate_kit.numerics.material_laws import law_of
from palpate_models import (
    Burgers,
    Cone,
    DimensionalityReduction,
    Flat,
    FractionalKelvinVoigt,
    GeneralisedMaxwell2,
    Paraboloid,
    Poroelastic,
    Power,
    PowerLaw,
    StandardLinearSolid,
)
from palpate_models.fractional import reciprocal_gamma
from scipy.special import beta, gamma

R = 5e-3
TIP = Paraboloid(curvature_radius=R)


def exact_modulus(model, theta, t):
    law = model.spectrum(theta)
    return (law.lasting or 0.0) + sum(strength * np.exp(-t * rate) for strength, rate in law.arms)


def test_burgers_is_its_springs_and_dampers():
    """The complex modulus of the arms is that of a Maxwell and a Kelvin-Voigt element in series."""
    model, theta = Burgers(indenter=TIP), (1e5, 2e5, 2e5, 2e3)
    omega = np.geomspace(1e-3, 1e3, 50)
    law = model.spectrum(theta)
    found = sum(e * 1j * omega / (1j * omega + rate) for e, rate in law.arms)
    compliance = 1 / theta[0] + 1 / (1j * omega * 3 * theta[1]) + 1 / (theta[2] + 1j * omega * 3 * theta[3])
    np.testing.assert_allclose(found, 1 / compliance, rtol=1e-10)


@pytest.mark.parametrize(
    "name",
    sorted(name for name, entry in load().parts["model"].items() if law_of(name) and hasattr(entry.part, "spectrum")),
)
def test_a_contact_model_and_the_law_of_its_name_are_one_material(name):
    """The arms of the model make the law's complex modulus: within 1 % for powers of time, else exactly."""
    law, model = law_of(name), load().parts["model"][name].part.model_validate({"indenter": TIP})
    values = {"Pa": 2e4, "Pa*s": 300.0, "s": 0.3, "1": 0.2}
    theta = [values[parameter.unit] * (1.0 + 0.1 * k) for k, parameter in enumerate(model.parameters)]
    assert [parameter.name for parameter in model.parameters] == [parameter for parameter, _ in law.parameters]
    frequency = np.geomspace(0.05, 5.0, 20)
    omega, found = 2 * np.pi * frequency, model.spectrum(theta)
    arms = (found.lasting or 0.0) + 3j * omega * (found.damper or 0.0)
    arms = arms + sum(e * 1j * omega / (1j * omega + rate) for e, rate in found.arms)
    powers = "power" in [parameter.name for parameter in model.parameters]
    np.testing.assert_allclose(arms, law.complex_modulus(frequency, theta, 0.5), rtol=0.01 if powers else 1e-10)


@pytest.mark.parametrize("power", [0.01, 0.1, 0.3, 0.5, 0.8, 0.9])
def test_ten_exponentials_are_a_power_of_time_within_a_percent(power):
    assert reciprocal_gamma(power) * gamma(power) == pytest.approx(1.0, abs=1e-12)
    model = PowerLaw(indenter=TIP)
    t = np.geomspace(model.shortest, model.longest, 200)
    np.testing.assert_allclose(exact_modulus(model, (1.0, power), t), t**-power, rtol=0.01)
    law, omega = model.spectrum((1.0, power)), 1 / t
    found = law.lasting + 3j * omega * law.damper + sum(e * 1j * omega / (1j * omega + x) for e, x in law.arms)
    np.testing.assert_allclose(found, gamma(1 - power) * (1j * omega) ** power, rtol=0.01)
    both = FractionalKelvinVoigt(indenter=TIP)
    np.testing.assert_allclose(exact_modulus(both, (2.0, 1.0, power), t), 2.0 + t**-power, rtol=0.01)


def test_a_power_law_on_a_ramp_is_its_closed_form():
    """F = 4 sqrt(R)/(3 (1 - nu^2)) E t1^alpha v^1.5 1.5 B(1.5, 1 - alpha) t^(1.5 - alpha)."""
    model, elasticity, power, speed = PowerLaw(indenter=TIP), 1e5, 0.2, 2e-3
    time = np.arange(0, 1.5, 2e-3)
    found = force_over_time(model, time, speed * time, np.full(len(time), speed), (elasticity, power))
    exact = 4 * math.sqrt(R) / (3 * 0.75) * elasticity * speed**1.5 * 1.5 * beta(1.5, 1 - power) * time ** (1.5 - power)
    late = time > 0.1
    np.testing.assert_allclose(found[late], exact[late], rtol=0.01)


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        (GeneralisedMaxwell2(indenter=Flat(radius=3e-3)), (1e5, 3e4, 0.05, 2e4, 0.6)),
        (Burgers(indenter=Flat(radius=3e-3)), (1e5, 2e4, 2e5, 2e3)),
        (PowerLaw(indenter=Flat(radius=3e-3)), (1e5, 0.2)),
    ],
)
def test_a_hold_after_a_ramp_is_the_integral_of_the_modulus(model, theta):
    """Flat tip: F = 2 R/(1 - nu^2) v int E over the ramp, here by its arms' own integrals."""
    rise, speed = 0.1, 0.01
    time = np.arange(0, 2.0, 2e-3)
    depth, rate = speed * np.minimum(time, rise), np.where(time < rise, speed, 0.0)
    law = model.spectrum(theta)
    since = np.maximum(time - rise, 0.0)
    exact = (law.lasting or 0.0) * depth + sum(
        e / x * speed * (np.exp(-x * since) - np.exp(-x * time)) for e, x in law.arms
    )
    found = force_over_time(model, time, depth, rate, theta)
    late = time > rise + 0.02
    np.testing.assert_allclose(found[late], 2 * 3e-3 / 0.75 * exact[late], rtol=2e-3)


@pytest.mark.parametrize(
    ("tip", "radius", "g"),
    [
        (TIP, math.sqrt(R * 2e-3), lambda x: 0.491 * np.exp(-0.908 * np.sqrt(x)) + 0.509 * np.exp(-1.679 * x)),
        (Flat(radius=3e-3), 3e-3, lambda x: 1.304 * np.exp(-np.sqrt(x)) - 0.304 * np.exp(-0.254 * x)),
        (
            Cone(angle=math.radians(30)),
            2 * 2e-3 / (math.pi * math.tan(math.radians(30))),
            lambda x: 0.493 * np.exp(-0.822 * np.sqrt(x)) + 0.507 * np.exp(-1.348 * x),
        ),
    ],
)
def test_a_gel_relaxes_by_the_master_curve_of_its_tip(tip, radius, g):
    model, (elasticity, poisson, diffusivity) = Poroelastic(indenter=tip), (1e5, 0.2, 1e-6)
    law, x = model.spectrum((elasticity, poisson, diffusivity)), np.geomspace(3e-3, 10, 100)
    fading = sum(e for e, _ in law.arms)
    np.testing.assert_allclose(sum(e * np.exp(-x * rate) for e, rate in law.arms) / fading, g(x), atol=0.02)
    assert float(model.pace(radius, (elasticity, poisson, diffusivity))) == pytest.approx(diffusivity / radius**2)
    # At once 8 G A, in the end 2 E/(1 - nu^2) A.
    area, shear = tip.profile_area(2e-3), elasticity / 2.4
    assert 2 / 0.75 * (law.lasting + fading) * area == pytest.approx(8 * shear * area)
    assert model.force(2e-3, 0.0, (elasticity, poisson, diffusivity)) == pytest.approx(2 * elasticity / 0.96 * area)


def test_a_gel_may_relax_faster_than_the_samples_come():
    """A small contact relaxes within 20 us: the forces at samples every 2 ms are those of fine ones."""
    model, theta, forces = Poroelastic(indenter=TIP), (1e5, 0.2, 2.4e-5), []
    for rate in (500, 20000):
        time = np.arange(rate // 2 + 1) / rate
        phase = 2 * np.pi * time
        depth, speed = 1.5e-3 * (1 - np.cos(phase)), 3e-3 * np.pi * np.sin(phase)
        forces.append(force_over_time(model, time, depth, speed, theta)[:: rate // 500])
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-4 * np.max(forces[1]))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"indenter": Power(exponent=3.0, coefficient=2e4)}, "spheres, cones and flat"),
        ({"indenter": TIP, "poisson": 0.4}, "drained_poisson"),
    ],
)
def test_poroelastic_refuses_what_it_does_not_know(settings, said):
    with pytest.raises(ConfigurationError, match=said):
        Poroelastic(**settings)


def test_a_power_law_over_too_many_decades_is_refused():
    with pytest.raises(ConfigurationError, match="decades"):
        PowerLaw(indenter=TIP, shortest=1e-3, longest=100.0)


# ---- Ting

REVERSAL = 1e-6  # [m]


def triangle(points=2000, peak=1.0, depth=2e-3):
    time = np.linspace(0, 2 * peak, 2 * points + 1)
    return time, depth * (1 - np.abs(time - peak) / peak)


@pytest.mark.parametrize("model", [StandardLinearSolid(indenter=TIP), StandardLinearSolid(indenter=Cone(angle=0.5))])
def test_loading_is_lee_and_radok(model):
    time, depth = triangle()
    theta = (1e5, 5e4, 0.3)
    found = model.loading_cycle_force(time, depth, theta, REVERSAL)
    rate = np.where(time < 1.0, 2e-3, -2e-3)
    way_in = time < 1.0
    expected = force_over_time(model, time[way_in], depth[way_in], rate[way_in], theta)
    np.testing.assert_allclose(found[way_in], expected, rtol=1e-4, atol=1e-5)


def test_an_elastic_material_comes_back_as_it_went():
    time, depth = triangle()
    model = DimensionalityReduction(indenter=TIP)
    np.testing.assert_allclose(
        model.loading_cycle_force(time, depth, (1e5, 0.0), REVERSAL),
        model.force(np.maximum(depth, 1e-12), 0.0, (1e5, 0.0)),
        atol=2e-6,
    )


def test_unloading_solves_tings_integral():
    """A one-arm solid on a triangle: t1 and F against scipy's quadrature and root."""
    from scipy.integrate import quad
    from scipy.optimize import brentq

    model, theta, t, v = StandardLinearSolid(indenter=TIP), (1e5, 5e4, 0.3), 1.4, 2e-3

    def modulus(s):
        return 1e5 + 5e4 * math.exp(-s / 0.3)

    def left(t1):
        return v * quad(lambda s: modulus(t - s), t1, 1.0)[0] - v * quad(lambda s: modulus(t - s), 1.0, t)[0]

    t1 = brentq(left, 0.0, 1.0)
    exact = 2 / 0.75 * quad(lambda s: modulus(t - s) * math.sqrt(R * v * s) * v, 0, t1)[0]
    time, depth = triangle()
    found = np.interp(t, time, model.loading_cycle_force(time, depth, theta, REVERSAL))
    assert found == pytest.approx(exact, rel=1e-4)
    rate = np.where(time < 1.0, v, -v)
    following = np.interp(t, time, force_over_time(model, time, depth, rate, theta))
    assert abs(following - exact) > 0.02 * exact  # what is made by leaving it out


def test_more_than_one_maximum_is_refused_by_name():
    time = np.linspace(0, 2, 1001)
    with pytest.raises(ValueError, match="more than one maximum"):
        StandardLinearSolid(indenter=TIP).loading_cycle_force(
            time, 2e-3 + 1e-3 * np.sin(8 * time), (1e5, 5e4, 0.3), REVERSAL
        )
    with pytest.raises(ValueError, match="Poroelastic"):
        Poroelastic(indenter=TIP).loading_cycle_force(*triangle(), (1e5, 0.2, 1e-6), REVERSAL)
