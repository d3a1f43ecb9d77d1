"""E(t) from a ramp and a hold: identities, then noise, then what is refused."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from palpate import LogError, force_over_time
from palpate_kit.numerics.holds import holds_of
from palpate_models import (
    DimensionalityReduction,
    Flat,
    GeneralisedMaxwell2,
    Poroelastic,
    PowerLaw,
    Sphere,
    StandardLinearSolid,
)
from palpate_models.thickness import Thickness
from palpate_spectra.recorded_oscillation import replay
from palpate_spectra.transient.conversion import relaxation_of_creep
from palpate_spectra.transient.hereditary_integrals import fading_integrals
from palpate_spectra.transient.recorded_press import longest_press
from palpate_spectra.transient.relaxation_modulus import modulus_curve
from palpate_spectra.transient.spectrum_of_times import decades, density, flags_of, p_value
from scipy.stats import chi2

from tests.real_bags import pipeline_of
from tests.simulated import pipeline, solid
from tests.spectra import rig

TIP = Sphere(radius=5e-3)
LAYER = Thickness(law="dimitriadis", height=22e-3)
TWO = (100e3, 40e3, 0.3, 30e3, 4.0)


def found(model, theta, **known):
    """The curve of a simulated press."""
    return modulus_curve(longest_press(rig.press(model, theta, **known), "run"))


def two_times(t):
    """E(t) of TWO."""
    return TWO[0] + TWO[1] * np.exp(-t / TWO[2]) + TWO[3] * np.exp(-t / TWO[4])


def test_a_fading_sum_is_the_integral():
    """x = t: int_0^t exp(-(t - s)/tau) ds = tau (1 - exp(-t/tau)), at uneven instants."""
    time = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.02, 300)) - 0.001
    time -= time[0]
    taus = np.array([0.01, 0.5, 20.0])
    assert fading_integrals(time, time, taus) == pytest.approx(
        taus * -np.expm1(-time[:, None] / taus), rel=1e-9, abs=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "theta", "modulus"),
    [
        (DimensionalityReduction(indenter=TIP), (100e3, 0.0), lambda t: 100e3 + 0 * t),
        (StandardLinearSolid(indenter=TIP, poisson=0.4), (80e3, 60e3, 0.7), lambda t: 80e3 + 60e3 * np.exp(-t / 0.7)),
        (GeneralisedMaxwell2(indenter=TIP, thickness=LAYER), TWO, two_times),
        (GeneralisedMaxwell2(indenter=Flat(radius=3e-3)), TWO, two_times),
        (PowerLaw(indenter=TIP), (100e3, 0.15), lambda t: 100e3 * t**-0.15),
    ],
)
def test_the_modulus_of_every_law_comes_back(model, theta, modulus):
    """Without noise the points are E(t) within 0.5 % from the ramp's end on, and the skin within 10 um."""
    one = found(model, theta)
    assert one.time[0] < 0.6 * 0.3
    assert one.time[-1] > 4.5
    assert one.value == pytest.approx(modulus(one.time), rel=5e-3)
    assert one.rig.surface == pytest.approx(2e-4, abs=1e-5)


@pytest.mark.slow
def test_a_slow_ramp_is_taken_off():
    """A ramp of 1.5 s: a step from its end would be up to 10 % off, the curve is not."""
    one = found(GeneralisedMaxwell2(indenter=TIP), TWO, speed=2e-3)
    seen = one.press.force[one.press.holds[0].begin] / (2 / 0.75 * one.fit.columns[-1, 0])
    assert abs(seen / two_times(1e-3) - 1) > 0.15
    assert one.value == pytest.approx(two_times(one.time), rel=5e-3)


@pytest.mark.slow
def test_noise_is_what_it_says_and_a_drift_is_taken_off():
    """Over 12 records with 0.05 N of noise and a drift of 0.1 N: squares of errors over their noise, by chi^2."""
    z = []
    for seed in range(12):
        one = found(GeneralisedMaxwell2(indenter=TIP), TWO, seed=seed, drift=0.1)
        std = np.sqrt(one.noise**2 + one.shifts["surface"] ** 2 + one.shifts["offset"] ** 2)
        error = (one.value - two_times(one.time)) / std
        z.append(error[[1, 4, -1]])
    assert np.sum(np.square(z), axis=0).max() < chi2.ppf(0.9995, 12)
    assert np.mean(np.square(z)) > 0.15  # nor are they far too wide
    assert one.press.drift == pytest.approx(0.1, rel=0.5)


@pytest.mark.slow
def test_the_spectrum_has_its_two_times_and_the_strength_of_its_decades():
    one = found(GeneralisedMaxwell2(indenter=TIP), TWO, hold=20.0, seed=3)
    times, height, std = density(one)
    peaks = times[1:-1][(height[1:-1] >= height[:-2]) & (height[1:-1] > height[2:]) & (height[1:-1] > 3 * std[1:-1])]
    assert peaks == pytest.approx([0.3, 4.0], rel=0.35)
    assert (std > 0).all()
    told = decades(one)
    for time, strength in ((0.3, 40e3), (4.0, 30e3)):
        (one,) = [decade for decade in told if decade.low <= time <= decade.high]
        assert abs(one.strength - strength) < 3 * one.std < 0.5 * strength


@pytest.mark.slow
def test_a_material_that_relaxes_by_the_depth_is_flagged():
    """A poroelastic gel held at two depths is no linear material; a generalised Maxwell solid there is one."""
    time = np.arange(0.0, 14.0, 0.005)
    d = np.interp(time, [0, 1, 1.15, 6, 6.4, 12, 12.05], [-1e-3, 0, 1e-3, 1e-3, 4e-3, 4e-3, -2e-3])
    told = {}
    for model, theta in (
        (Poroelastic(indenter=TIP), (1.5e6, 0.2, 3e-6)),
        (GeneralisedMaxwell2(indenter=TIP), TWO),
    ):
        force = force_over_time(model, time, d, np.gradient(d, time), theta, pulls=False)
        one = modulus_curve(longest_press(rig.samples_of(model, time, d, force, 5, 2e-4, 0.0, {}), "run"))
        assert len(one.press.holds) == 2
        told[type(model).__name__] = p_value(one), {flag.code for flag in flags_of(one)}
        doubts = [flag for flag in flags_of(one) if flag.code in ("not-linear-viscoelastic", "surface-mismatch")]
        assert all("--surface" in flag.message for flag in doubts)
    assert told["Poroelastic"][1] & {"not-linear-viscoelastic", "surface-mismatch"}
    assert told["GeneralisedMaxwell2"][0] > 1e-3
    assert told["GeneralisedMaxwell2"][1] <= {"ramp-long"}


@pytest.mark.parametrize(
    ("depth", "force", "kind"),
    [
        (lambda t: np.minimum(t / 0.3, 1), lambda t: np.minimum(t / 0.3, 1) * (0.7 + 0.3 * np.exp(-t)), "relaxation"),
        (lambda t: np.minimum(t / 0.3, 1) * (1.3 - 0.3 * np.exp(-t)), lambda t: np.minimum(t / 0.3, 1), "creep"),
        (lambda t: 1 + 0.3 * np.sin(12 * t), lambda t: 1 + 0.4 * np.sin(12 * t), None),
    ],
)
def test_what_is_held_is_found(depth, force, kind):
    t = np.arange(0, 6, 0.002)
    random = np.random.default_rng(0)
    held = holds_of(t, 3e-3 * depth(t) + 5e-6 * random.standard_normal(len(t)), 5 * force(t))
    if kind is None:
        assert held == []
        return
    (one,) = held
    assert one.kind == kind
    assert t[one.begin] == pytest.approx(0.3, abs=0.05)
    assert t[one.end - 1] > 5.9


@pytest.mark.parametrize("depth", [0.5e-3, 1e-3])
def test_a_shallow_depth_that_is_held_is_no_creep(depth):
    """With 5 um of noise, 1 % of the depth is less than the noise, whose size smoothed heights would hide."""
    time = np.arange(0.0, 14.0, 0.005)
    motion = np.interp(time, [0, 1, 1.15, 12, 12.05], [-1e-3, 0, depth, depth, -2e-3])
    model = StandardLinearSolid(indenter=TIP)
    force = force_over_time(model, time, motion, np.gradient(motion, time), (1.5e6, 3e5, 2.0), pulls=False)
    for seed in range(3):
        (hold,) = longest_press(rig.samples_of(model, time, motion, force, seed, 2e-4, 0.0, {}), "run").holds
        assert hold.kind == "relaxation"
        assert (hold.end - hold.begin) * 0.005 > 10.5


def test_a_record_that_begins_in_contact_is_refused():
    whole = rig.press(StandardLinearSolid(indenter=TIP), (80e3, 60e3, 0.7))
    with pytest.raises(LogError, match="begins in contact"):
        longest_press(replace(whole, samples=whole.samples[230:]), "run")
    with pytest.raises(LogError, match="never touches"):
        longest_press(replace(whole, samples=whole.samples[:150]), "run")


RAMP = 'type = "ramp-hold"\ndepths = ["3 mm"]\nhold = "3 s"'
PIPELINE = pipeline(
    solid("80 kPa", "40 kPa", "0.5 s"),
    RAMP,
    'type = "casadi-fit"\nsegment = "hold"\nfixed = { surface = "0 mm" }',
)
TARE = 'tare_duration = "0.4 s"'
LED = """
type = "force-hold"
force = "2 N"
depth = "6 mm"
speed = "8 mm/s"
stiffness = "1.5 N/mm"
duration = "4 s"
standstill = "0.5 s"
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 5])
def test_a_short_creep_is_one_linear_material(tmp_path, seed):
    """Half a second held, and half as much noise as force in the beginning: J(t), and no flag."""
    text = pipeline(solid("80 kPa", "60 kPa", "1 s"), LED, 'type = "kinematic-ekf"', seed=seed, alignment=TARE)
    (tmp_path / "creep.toml").write_text(text)
    one = modulus_curve(longest_press(replay(tmp_path / "creep.toml", None), "run"))
    assert one.creeps
    assert {flag.code for flag in flags_of(one)} <= {"thickness-undeclared"}
    assert abs(one.rig.surface) < 2.5 * one.surface_std < 2e-4
    true = 1 / 80e3 - (1 / 80e3 - 1 / 140e3) * np.exp(-one.time * 80 / 140)
    assert (np.abs(one.value - true) < 3 * one.std).all()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a run."""
    from palpate_engine import load_pipeline, run_pipeline

    where = tmp_path_factory.mktemp("relaxation")
    (where / "hold.toml").write_text(PIPELINE)
    result = run_pipeline(load_pipeline(where / "hold.toml"), where / "run")
    track = result.tracks["sls/fit"]
    assert track.parameters["elasticity"].value == pytest.approx(80e3, rel=0.02)
    assert track.parameters["relaxation_time"].value == pytest.approx(0.5, rel=0.1)
    return where


@pytest.mark.slow
def test_the_command_on_a_run_folder(palpate, folder, tmp_path):
    done = palpate("fit", "relaxation", folder / "run", "--json", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["held"] == "depth"
    assert told["flags"] == []
    for point in told["curve"]:
        assert abs(point["E_Pa"] - 80e3 - 40e3 * math.exp(-point["time_s"] / 0.5)) < 3 * point["E_std_Pa"]
    with (tmp_path / "out" / "modulus.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["E_Pa"]) == pytest.approx(told["curve"][0]["E_Pa"])
    assert (tmp_path / "out" / "relaxation.png").stat().st_size > 5000
    assert (tmp_path / "out" / "relaxation.csv").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "nowhere"),
        (["{run}", "--surface", "3 N"], "--surface"),
        (["{run}", "--track", "sl/fit"], "sls/fit"),
    ],
)
def test_mistakes_are_one_clear_message(palpate, folder, tmp_path, arguments, said):
    done = palpate(
        "fit",
        "relaxation",
        *(a.replace("{run}", str(folder / "run")) for a in arguments),
        "--out",
        tmp_path / "out",
    )
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_sine_has_no_hold(palpate, root, tmp_path):
    done = palpate("fit", "relaxation", root / "pipelines" / "filters.toml", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "nothing is held" in done.stderr


@pytest.mark.slow
def test_a_slow_press_of_foam_holds_nothing(palpate, shared, tmp_path):
    """A real press at 50 mm/min: its first, light touch is no hold, and this is said."""
    settings = {"radius": "10 mm", "model": "dimensionality-reduction", "estimator": "kinematic-ekf"}
    bag = shared / "rosbag2/foam_white_1_p.db3.gz"
    path = pipeline_of(bag, tmp_path, height=2, mass='tip_mass = "140 g"', **settings)
    done = palpate("fit", "relaxation", path.name, "--out", tmp_path / "out")
    assert done.returncode == 2
    assert "nothing is held" in done.stderr


def test_a_creep_spectrum_becomes_the_modulus_of_the_same_material():
    """SLS and Maxwell by their textbook pairs: tau_E = tau_J E/(E + E_1), and E exp(-t E/n)."""
    t = np.geomspace(0.01, 10, 30)
    instant, rest, tau = 1 / 140e3, 1 / 80e3, 1.75
    found = relaxation_of_creep(instant, 0.0, np.array([rest - instant, 0.0]), np.array([tau, 5.0]), t)
    assert found == pytest.approx(80e3 + 60e3 * np.exp(-t / (tau * 80 / 140)), rel=1e-9)
    assert relaxation_of_creep(1 / 1e5, 1 / 2e5, np.zeros(2), np.ones(2), t) == pytest.approx(
        1e5 * np.exp(-t / 2), rel=1e-9
    )


def test_a_converted_modulus_is_the_inverse_operator():
    """int E(t - s) dJ(s) = 1 for any spectrum, by trapezoids."""
    t = np.linspace(0, 20, 4001)
    strengths, times = np.array([2e-6, 5e-6, 1e-6]), np.array([0.3, 2.0, 9.0])
    creep = 6e-6 + 1e-7 * t + (strengths * (1 - np.exp(-t[:, None] / times))).sum(axis=1)
    modulus = relaxation_of_creep(6e-6, 1e-7, strengths, times, t)
    middle = 0.5 * (modulus[1:] + modulus[:-1])
    assert modulus[-1] * creep[0] + middle[::-1] @ np.diff(creep) == pytest.approx(1.0, rel=1e-4)
