"""G* from recordings: identities, then the rig, then noise."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, contact_force
from palpate_models import Cone, DimensionalityReduction, Flat, Paraboloid, Sphere, StandardLinearSolid
from palpate_models.thickness import Thickness
from palpate_spectra.complex_moduli import measure_moduli
from palpate_spectra.consistency import harmonics, kramers_kronig, unexplained_harmonics
from palpate_spectra.law_fits import law_fits, supported_laws
from scipy.stats import binom

from tests.spectra import rig

SPHERE = Sphere(radius=5e-3)
SOFT = DimensionalityReduction(indenter=SPHERE)
E, ETA = 112.5e3, 362.0
SINES = {0.5: 0.5e-3, 2.0: 0.3e-3, 5.0: 0.2e-3}


@pytest.mark.parametrize("compliance", [0.0, 1 / 35e3])
@pytest.mark.parametrize(
    ("tip", "radius"),
    [
        (Paraboloid(curvature_radius=5e-3), math.sqrt(5e-3 * 4e-3)),
        (Flat(radius=2.5e-3), 2.5e-3),
        (Cone(angle=math.radians(40)), 2 * 4e-3 / (math.pi * math.tan(math.radians(40)))),
    ],
)
def test_small_oscillations_have_the_modulus_of_the_textbooks(tip, radius, compliance):
    """G* = (1 - nu) K*/(4 a), K* = m w^2 + 1/(D/U - C), as PyFMRheo and others have it."""
    model = DimensionalityReduction(indenter=tip)
    recording = rig.recorded(model, (E, ETA), {5.0: 1e-7}, compliance=compliance)
    found = measure_moduli(recording, [5.0]).lines[0]
    force, arm = recording.force, -recording.height
    turning = np.exp(-2j * np.pi * 5.0 * recording.time)
    stiffness = 0.14 * (10 * np.pi) ** 2 + 1 / ((arm @ turning) / (force @ turning) - compliance)
    assert found.shear == pytest.approx(0.5 * stiffness / (4 * radius), rel=1e-6)
    assert found.shear == pytest.approx(E / 3 + 10j * np.pi * ETA, rel=1e-6)


@pytest.mark.parametrize(("amplitude", "change"), [(1e-3, -0.002), (2e-3, -0.008)])
def test_a_large_amplitude_takes_the_radius_of_the_whole_cycle(amplitude, change):
    recording = rig.recorded(SOFT, (E, ETA), {5.0: amplitude})
    line = measure_moduli(recording, [5.0]).lines[0]
    assert line.area / line.amplitude / math.sqrt(5e-3 * 4e-3) - 1 == pytest.approx(change, abs=5e-4)
    assert line.shear == pytest.approx(E / 3 + 10j * np.pi * ETA, rel=1e-6)


def with_approach(seconds=12.0, approach=1.0, rise=1.5, seed=4):
    """A recording of three sines that begins with the approach: down to 4 mm, then sines that grow smoothly."""
    time = np.arange(int(seconds * rig.RATE)) / rig.RATE
    down = 4e-3 * np.clip(time / approach, 0.02, 1) ** 0.8
    share = np.clip((time - approach) / rise, 0, 1)
    sines = sum(a * np.sin(2 * np.pi * f * (time - approach)) for f, a in SINES.items())
    depth = down + (3 * share**2 - 2 * share**3) * sines
    speed = np.gradient(depth, time)
    force = contact_force(SOFT, depth, speed, (E, ETA)) + rig.MASS * np.gradient(speed, time)
    return rig.made(SOFT, time, depth, force, seed)


@pytest.mark.parametrize("frequencies", [None, list(SINES)])
def test_an_approach_and_a_smooth_start_are_left_out(frequencies):
    found = measure_moduli(with_approach(), frequencies)
    assert [line.frequency for line in found.lines] == pytest.approx(list(SINES), abs=2e-3)
    assert len(found.recording.time) > 4000
    for line in found.lines:
        truth = E / 3 + 2j * np.pi * line.frequency * ETA
        assert abs(line.shear.real - truth.real) < 4 * line.std_of("storage") + 1e-3 * truth.real
        assert abs(line.shear.imag - truth.imag) < 4 * line.std_of("loss") + 2e-3 * abs(truth)


def test_frequencies_that_the_motion_does_not_have_are_refused():
    with pytest.raises(ConfigurationError, match=r"--frequencies: sines at 0.7, 3 Hz explain \d"):
        measure_moduli(with_approach(), [0.7, 3.0])


@pytest.mark.slow
@pytest.mark.parametrize(
    "model", [SOFT, DimensionalityReduction(indenter=SPHERE, thickness=Thickness(law="dimitriadis", height=22e-3))]
)
def test_several_large_sines_at_once_are_exact(model):
    found = measure_moduli(rig.recorded(model, (E, ETA), {0.5: 1e-3, 2.0: 1e-3, 5.0: 0.7e-3}))
    assert [line.frequency for line in found.lines] == pytest.approx([0.5, 2, 5], abs=1e-6)
    for line in found.lines:
        assert line.shear == pytest.approx(E / 3 + 2j * np.pi * line.frequency * ETA, rel=1e-5)
    assert all(one.excess < 1e-4 for one in harmonics(found))


def test_a_material_that_relaxes_has_its_own_spectrum():
    model = StandardLinearSolid(indenter=SPHERE)
    for line in measure_moduli(rig.recorded(model, (100e3, 40e3, 0.1), SINES)).lines:
        turned = 2j * np.pi * line.frequency * 0.1
        assert line.young == pytest.approx(100e3 + 40e3 * turned / (1 + turned), rel=1e-4)


def test_a_timing_uncertainty_is_in_the_loss_tangent():
    """u(tan delta) = (1 + tan^2) w u(tau) |U/D|/|K*|; 0.0031 at 5 Hz and 0.1 ms."""
    recording = rig.recorded(SOFT, (E, ETA), {5.0: 1e-6}, timing=1e-4)
    line = measure_moduli(recording, [5.0]).lines[0]
    stiffness = line.shear * 8 * math.sqrt(5e-3 * 4e-3)
    felt = abs(stiffness - 0.14 * (10 * np.pi) ** 2) / abs(stiffness)
    assert line.std_of("tan") == pytest.approx((1 + line.loss_tangent**2) * 10e-4 * np.pi * felt, rel=1e-3)
    assert (1 + 0.0) * 10 * np.pi * 1e-4 == pytest.approx(0.0031, abs=1e-4)


@pytest.mark.slow
def test_the_noise_interval_holds_the_truth_as_often_as_it_says():
    """Two quadratures of three lines of 120 records; exact binomial bounds at 99.9 % of each line's own count."""
    clean = rig.recorded(SOFT, (E, ETA), SINES)
    inside, tries = np.zeros((3, 2)), 120
    for seed in range(tries):
        noisy = rig.made(SOFT, clean.time, -clean.height, clean.force, seed)
        for i, line in enumerate(measure_moduli(noisy, list(SINES)).lines):
            error = line.shear - (E / 3 + 2j * np.pi * line.frequency * ETA)
            inside[i] += np.abs([error.real, error.imag]) < 1.99 * line.noise
    low, high = binom.ppf([5e-4, 1 - 5e-4], tries, 0.95)
    assert ((low <= inside) & (inside <= high)).all(), inside


@pytest.mark.slow
def test_a_delay_and_a_solid_are_told_apart_and_other_laws_refuted():
    recording = rig.recorded(SOFT, (E, ETA), {0.5: 0.5e-3, 2.0: 0.4e-3, 5.0: 0.4e-3, 10.0: 0.3e-3}, seed=1, delay=2e-3)
    fits = {fit.law.name: fit for fit in law_fits(measure_moduli(recording).lines)}
    solid = fits["kelvin-voigt"]
    assert solid.delay == pytest.approx(2e-3, abs=4 * solid.delay_std)
    assert solid.delay_std < 0.3e-3
    assert abs(solid.values[1] - ETA) < 4 * solid.stds[1]
    assert fits["kelvin-voigt"] in supported_laws(list(fits.values()))
    assert fits["power-law"].p < 1e-3


def test_a_single_sine_cannot_tell_a_delay():
    assert law_fits(measure_moduli(rig.recorded(SOFT, (E, ETA), {2.0: 1e-3}, seed=1)).lines) == []


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "failed"), [(0.14, False), (0.45, True)])
def test_a_wrong_mass_is_against_kramers_and_kronig(mass, failed):
    sines = {1.0: 0.3e-3, 3.0: 0.3e-3, 8.0: 0.3e-3, 16.0: 0.2e-3}
    lines = measure_moduli(rig.recorded(SOFT, (E, ETA), sines, seed=3, tip_mass=mass)).lines
    # A mass that is too large lets G' rise by w^2: faster than any passive material.
    assert kramers_kronig(lines).failed == failed


@pytest.mark.parametrize(
    ("model", "flagged"), [(SOFT, False), (DimensionalityReduction(indenter=Flat(radius=4.5e-3)), True)]
)
def test_harmonics_beyond_those_of_the_tip_are_found(model, flagged):
    recording = rig.recorded(SOFT, (E, ETA), {2.0: 1e-3}, seed=5)
    other = rig.made(model, recording.time, -recording.height, recording.force)
    assert bool(unexplained_harmonics(measure_moduli(other))) == flagged


@pytest.mark.slow
def test_a_chirp_is_a_spectrum():
    time = np.arange(0, 20, 1 / rig.RATE)
    growth = math.log(10.0) / 20
    omega = 2 * np.pi * 0.5 * np.exp(growth * time)
    phase = omega / growth
    depth = 4e-3 + 0.5e-3 * np.sin(phase)
    rate, bend = 0.5e-3 * omega * np.cos(phase), 0.5e-3 * (growth * omega * np.cos(phase) - omega**2 * np.sin(phase))
    force = SOFT.force(depth, rate, (E, ETA)) + rig.MASS * bend
    found = measure_moduli(rig.made(SOFT, time, depth, force, seed=2))
    assert found.sweep
    assert len(found.lines) >= 8
    for line in found.lines:
        error = line.shear - (E / 3 + 2j * np.pi * line.frequency * ETA)
        assert abs(error) < 5 * line.noise + 2e-3 * abs(line.shear)
    assert found.lines[0].frequency < 0.8
    assert found.lines[-1].frequency > 4.0


@pytest.mark.slow
def test_steps_of_the_frequency_are_a_spectrum():
    parts = [rig.recorded(SOFT, (E, ETA), {f: 0.5e-3}, seed=i) for i, f in enumerate((1.0, 3.0, 6.0))]
    force, height = (np.concatenate([getattr(part, key) for part in parts]) for key in ("force", "height"))
    found = measure_moduli(rig.made(SOFT, np.arange(len(force)) / rig.RATE, -height, force))
    assert {round(line.frequency) for line in found.lines} == {1, 3, 6}
    for line in found.lines:
        assert line.shear == pytest.approx(E / 3 + 2j * np.pi * line.frequency * ETA, rel=0.02)


def test_noise_alone_is_no_motion():
    random = np.random.default_rng(0)
    time = np.arange(0, 4, 1 / rig.RATE)
    still = rig.made(SOFT, time, np.full(len(time), 4e-3), random.standard_normal(len(time)), seed=1)
    assert measure_moduli(still).lines == ()
