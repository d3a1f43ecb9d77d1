"""Models that remember, against closed forms of linear viscoelasticity."""

from __future__ import annotations

import math

import numpy as np
import pytest
from palpate import force_over_time
from palpate.contact.force_history import memory_over_time
from palpate_models import DimensionalityReduction, ExactSphere, Flat, Maxwell, StandardLinearSolid

RADIUS, NU = 5e-3, 0.5
E0, E1, TAU = 1e5, 4e4, 0.08
FLAT = Flat(radius=RADIUS)
STIFFNESS = 2 * RADIUS / (1 - NU**2)  # of a flat tip, per Young's modulus [m]


class NonlinearSolid(StandardLinearSolid):
    """A solid whose arm fades the faster the more force it carries."""

    def memory_rate(self, depth, rate, theta, memory):
        (slope,) = super().memory_rate(depth, rate, theta, memory)
        return (slope - memory[0] ** 3 / theta[2],)


@pytest.mark.parametrize("tau", [TAU, 1e-3, 1e-6])
def test_standard_linear_solid_on_a_ramp(tau):
    """An arm that fades much faster than the samples come is a damper, E_1 tau."""
    time = np.arange(80) / 800
    depth = 1e-12 + 0.02 * time  # in contact from the first instant
    force = force_over_time(StandardLinearSolid(indenter=FLAT), time, depth, np.full(80, 0.02), [E0, E1, tau])
    exact = STIFFNESS * 0.02 * (E0 * time + E1 * tau * (1 - np.exp(-time / tau)))
    np.testing.assert_allclose(force[1:], exact[1:], rtol=1e-7)


def test_an_interval_in_which_the_tip_touches_does_little_harm():
    time = np.arange(801) / 800
    model = StandardLinearSolid(indenter=ExactSphere(radius=RADIUS))
    depth = 0.01 * (time - 0.10033)
    force = force_over_time(model, time, depth, np.full(801, 0.01), [E0, E1, TAU])
    fine = np.linspace(0.10033, 1.0, 20001)
    exact = force_over_time(model, fine, 0.01 * (fine - 0.10033), np.full(20001, 0.01), [E0, E1, TAU])
    later = time > 0.11
    np.testing.assert_allclose(force[later], np.interp(time[later], fine, exact), rtol=1e-4)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 8.0])
def test_maxwell_answers_a_sine_with_its_complex_modulus(frequency):
    omega, eta, rate = 2 * math.pi * frequency, 5e3, 800.0
    tau = 3 * eta / E0
    time = np.arange(round((12 * tau + 4 / frequency) * rate)) / rate
    swing = 1e-3
    depth, speed = 3e-3 + swing * np.sin(omega * time), swing * omega * np.cos(omega * time)
    force = force_over_time(Maxwell(indenter=FLAT), time, depth, speed, [E0, eta])
    ratio = 1j * omega * tau / (1 + 1j * omega * tau)
    exact = STIFFNESS * E0 * swing * np.imag(ratio * np.exp(1j * omega * time))
    late = time > 12 * tau
    np.testing.assert_allclose(force[late], exact[late], atol=2e-5 * np.max(np.abs(exact)))


@pytest.mark.slow
def test_slow_motion_of_a_solid_is_kelvin_voigt():
    tip, tau = ExactSphere(radius=RADIUS), 1e-3
    solid = StandardLinearSolid(indenter=tip)
    theta = [E0, E1, tau]
    elasticity, viscosity = (value.value for value in solid.material(theta))
    time = np.arange(1600) / 800
    omega = 2 * math.pi * 0.5
    depth, speed = 3e-3 + 1e-3 * np.sin(omega * time), 1e-3 * omega * np.cos(omega * time)
    found = force_over_time(solid, time, depth, speed, theta)
    slow = force_over_time(DimensionalityReduction(indenter=tip), time, depth, speed, [elasticity, viscosity])
    viscous = slow - force_over_time(DimensionalityReduction(indenter=tip), time, depth, speed, [elasticity, 0.0])
    # What is left is of second order in omega tau = 0.003.
    assert np.max(np.abs(found - slow)[200:]) < 0.02 * np.max(np.abs(viscous))


@pytest.mark.parametrize("kind", [StandardLinearSolid, NonlinearSolid])
def test_the_integration_does_not_depend_on_the_samples(kind):
    model, theta = kind(indenter=ExactSphere(radius=RADIUS)), [E0, E1, 0.02]
    forces = []
    for rate in (400, 1600):
        time = np.arange(rate + 1) / rate
        depth = 2e-3 * np.sin(np.pi * 2 * time) ** 2 + 1e-4
        speed = 2e-3 * 2 * np.pi * np.sin(4 * np.pi * time)
        forces.append(force_over_time(model, time, depth, speed, theta)[:: rate // 400])
    np.testing.assert_allclose(forces[0], forces[1], atol=1e-5 * np.max(forces[1]))


def test_out_of_contact_a_material_forgets():
    model, theta = Maxwell(indenter=FLAT), [E0, 5e3]
    tau = 3 * 5e3 / E0
    time = np.arange(801) / 800
    force = force_over_time(model, time, np.full(801, -1e-3), np.zeros(801), theta, memory=[2.0])
    assert (force == 0).all()
    states = memory_over_time(model, time, np.full(801, -1e-3), np.zeros(801), theta, [2.0])
    np.testing.assert_allclose(states[:, 0], 2.0 * np.exp(-time / tau), rtol=1e-5)


def test_a_material_that_does_not_stick_never_pulls():
    model = Maxwell(indenter=FLAT)
    time = np.arange(800) / 800
    depth, speed = 3e-3 + 1e-3 * np.sin(12 * time), 12e-3 * np.cos(12 * time)
    assert force_over_time(model, time, depth, speed, [E0, 5e3]).min() < 0
    assert force_over_time(model, time, depth, speed, [E0, 5e3], pulls=False).min() == 0


def test_too_fast_a_memory_for_the_samples_is_refused():
    """Where a state's rate depends on the state, no step is exact, and the samples are too far apart."""
    time = np.arange(10) / 10.0
    with pytest.raises(ValueError, match="too fast for samples every 100 ms"):
        force_over_time(NonlinearSolid(indenter=FLAT), time, np.full(10, 1e-3), np.zeros(10), [E0, E1, 1e-4])


def test_no_samples_no_forces():
    empty = np.zeros(0)
    assert len(force_over_time(Maxwell(indenter=FLAT), empty, empty, empty, [E0, 5e3])) == 0
