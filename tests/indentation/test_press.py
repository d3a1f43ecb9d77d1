"""One press as a whole: truth within its uncertainty, methods side by side, adhesion, and records that are no press."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, LogError, Samples, contact_force
from palpate_engine.cli import call
from palpate_indentation.adhesion import tabor
from palpate_indentation.approach_fit import fit_curve
from palpate_indentation.contact_points import contact_points
from palpate_indentation.elastic_law import law_of
from palpate_indentation.press import press_of
from palpate_indentation.press_analysis import PressSettings, analyse_press
from palpate_models import (
    DerjaguinMullerToporov,
    DimensionalityReduction,
    HuntCrossley,
    JohnsonKendallRoberts,
    NeoHookeanSphere,
    Sphere,
)

from tests.real_bags import pipeline_of

RADIUS, RATE = 5e-3, 500.0
HERTZ = DimensionalityReduction(indenter=Sphere(radius=RADIUS))


def record(model, theta, *, deep=2e-3, air=2e-3, speed=2e-3, noise=0.0, tilt=0.0, seed=0, surface=0.0):
    """A press at constant speed and the way out, as samples."""
    way = int((deep + air) / speed * RATE)
    down = np.linspace(air, -deep, way)
    height = surface + np.concatenate([down, down[::-1]])
    rate = np.repeat([speed, -speed], way)
    depth = surface - height
    force = np.asarray(contact_force(model, depth, rate, theta), float) + tilt * height
    force = force + noise * np.random.default_rng(seed).standard_normal(len(force))
    time = np.arange(len(height)) / RATE
    stamp = np.arange(len(height), dtype=np.int64) * 2_000_000
    no = np.zeros(len(height), bool)
    return Samples(stamp, time, np.full(len(height), 1 / RATE), force, height, -rate, no, no)


def look(model, theta, fitted=HERTZ, parameters=None, settings=None, **how):
    return analyse_press(
        law_of(fitted, "dr", parameters or {}), press_of(record(model, theta, **how)), settings or PressSettings()
    )


@pytest.mark.slow
def test_without_noise_everything_is_found():
    found = look(HERTZ, [1e5, 0.0], noise=1e-9, surface=0.3e-3, tilt=2.0)
    assert found.fit.modulus == pytest.approx(1e5, rel=1e-6)
    assert found.fit.surface == pytest.approx(0.3e-3, abs=1e-9)
    assert found.fit.tilt == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(found.secant.modulus, 1e5, rtol=1e-5)
    np.testing.assert_allclose(found.tangent.modulus, 1e5, rtol=1e-5)
    assert abs(found.rise[0]) < 1e-5
    assert not found.flags


@pytest.mark.gate
@pytest.mark.slow
def test_the_truth_is_within_the_uncertainty():
    """Over 60 records; a binomial of 0.95 stays within 50 to 60 in 99.9 % (scipy.stats.binom)."""
    inside = contact = 0
    for seed in range(60):
        samples = record(HERTZ, [6e4, 0.0], noise=0.03, seed=seed, speed=8e-3)
        press = press_of(samples)
        fit = fit_curve(law_of(HERTZ, "dr", {}), press.approach, press.noise, tilt=True)
        inside += abs(fit.modulus - 6e4) < 1.96 * fit.modulus_std
        contact += abs(fit.surface) < 1.96 * fit.surface_std
    assert 50 <= inside <= 60
    assert 50 <= contact <= 60


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_profiles_and_spread_hold_the_truth(seed):
    found = look(HERTZ, [1e5, 0.0], noise=0.03, seed=seed)
    assert abs(found.fit.modulus - 1e5) < 3 * found.combined
    for profile in (found.secant, found.tangent):
        good = np.isfinite(profile.modulus)
        assert np.mean(np.abs(profile.modulus[good] - 1e5) < 2.6 * profile.std[good]) > 0.9
    assert len(found.points) >= 6
    assert not found.flags


@pytest.mark.slow
def test_viscosity_that_is_known_is_taken_off():
    without, known = (look(HERTZ, [1e5, 800.0], noise=1e-3, parameters=p) for p in ({}, {"viscosity": "800 Pa*s"}))
    assert abs(known.fit.modulus / 1e5 - 1) < 5e-3
    assert abs(without.fit.modulus / 1e5 - 1) > abs(known.fit.modulus / 1e5 - 1)


@pytest.mark.slow
def test_a_robust_fit_bears_outliers():
    samples = record(HERTZ, [1e5, 0.0], noise=0.01, seed=3)
    hit = np.random.default_rng(5).choice(len(samples) // 2, 40, replace=False)
    samples.force[hit] += 1.0
    law, press = law_of(HERTZ, "dr", {}), press_of(samples)
    plain, robust = (analyse_press(law, press, PressSettings(robust=robust)).fit for robust in (False, True))
    assert abs(robust.modulus - 1e5) < 0.2 * abs(plain.modulus - 1e5)
    assert abs(robust.modulus - 1e5) < 4 * robust.modulus_std


@pytest.mark.slow
def test_large_strain_is_told_from_a_paraboloid():
    large = DimensionalityReduction(indenter=NeoHookeanSphere(radius=RADIUS))
    found = look(large, [1e5, 0.0], noise=2e-3, deep=4e-3)
    best = min(found.spheres, key=lambda one: one.fit.rms)
    assert best.tip == "neo-hookean-sphere"
    assert best.fit.modulus == pytest.approx(1e5, rel=0.01)
    chosen = next(one for one in found.spheres if one.chosen)
    assert chosen.fit.modulus < 0.95e5


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("model", "name", "theta"),
    [(JohnsonKendallRoberts, "jkr", [3e4, 20.0]), (DerjaguinMullerToporov, "dmt", [1e6, 10.0])],
)
def test_modulus_and_work_of_adhesion_are_told_from_the_way_out(model, name, theta, seed):
    found = look(model(radius=RADIUS), theta, noise=0.02, seed=seed, air=4e-3)
    assert found.pull is not None
    assert "adhesion" in [flag.code for flag in found.flags]
    best = min(found.theories, key=lambda one: one.rms)
    assert best.name == name
    assert abs(best.modulus - theta[0]) < 4 * best.modulus_std
    assert abs(best.work - theta[1]) < 4 * best.work_std


def test_tabors_parameter_is_of_the_tip_and_the_material():
    assert tabor(1e-3, 0.05, 1e5, 0.5) > 5
    assert tabor(1e-8, 0.05, 1e11, 0.5) < 0.1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: s[:20], "holds no press"),
        (lambda s: s[np.asarray(s.position > 1e-4)], "never rises"),
    ],
)
def test_what_is_no_press_is_refused(change, words):
    with pytest.raises(LogError, match=words):
        press_of(change(record(HERTZ, [1e5, 0.0], noise=0.01)))


def test_a_record_that_begins_in_contact_is_refused():
    samples = record(HERTZ, [1e5, 0.0], noise=0.01)
    with pytest.raises(LogError, match=r"air|begins in contact"):
        analyse_press(law_of(HERTZ, "dr", {}), press_of(samples[np.asarray(samples.position < -1e-4)]), PressSettings())


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.0, 60.0])
def test_a_tilt_that_no_air_tells_is_held_at_zero_and_counts(tilt):
    """0.1 mm of air for 2 mm of depth; 60 N/m over it are 0.12 N of 0.67."""
    covered = 0
    for seed in range(4):
        found = look(HERTZ, [6e4, 0.0], noise=0.03, air=1e-4, speed=8e-3, tilt=tilt, seed=seed)
        assert found.fit.tilt == 0
        assert found.baseline_fit.undetermined is not None
        assert "baseline-unclear" in [flag.code for flag in found.flags]
        assert found.combined > 3 * found.fit.modulus_std
        covered += abs(found.fit.modulus - 6e4) < 2 * found.combined
    assert covered == 4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_tilt_that_air_tells_is_taken_off_as_before(seed):
    found = look(HERTZ, [6e4, 0.0], noise=2e-3, air=8e-4, tilt=60.0, seed=seed)
    assert found.baseline_fit.undetermined is None
    assert abs(found.fit.tilt - 60.0) < 4 * found.fit.tilt_std
    assert abs(found.fit.modulus - 6e4) < 4 * found.combined
    codes = {flag.code for flag in found.flags}
    assert "baseline-unclear" not in codes


def test_a_press_that_hardly_bends_is_no_tilt():
    """A force as the power 1.05 of the depth: a sphere's law would take most of it for a tilted baseline."""
    with pytest.raises(LogError, match="bends less"):
        look(HuntCrossley(exponent=1.05), [2.0, 0.0], noise=0.01, air=3e-4, deep=6e-3, speed=4e-3)


@pytest.mark.slow
def test_a_real_record_without_air_is_refused(tmp_path):
    """What least squares makes of it: a baseline tilted by 9.5 N of 13."""
    bag = Path(__file__).parents[2].parent / "shared/data/rosbag2/ur3e_load_unload_soft_1.db3.gz"
    if not bag.is_file():
        pytest.skip(f"{bag} is absent")
    settings = {"model": "dimensionality-reduction", "estimator": "kinematic-ekf", "radius": "10 mm", "height": 3}
    path = pipeline_of(bag, tmp_path, mass="tip_mass = 0.0", **settings)
    with pytest.raises(LogError, match="begins in contact"):
        call(["fit", "indentation", str(path), "--out", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


def test_a_fit_of_the_way_out_has_its_own_contact_point_only():
    press, law = press_of(record(HERTZ, [1e5, 0.0], noise=0.01, speed=8e-3)), law_of(HERTZ, "dr", {})
    assert press.retract is not None
    fit = fit_curve(law, press.retract, press.noise, tilt=False)
    assert set(contact_points(press, fit, press.retract)) == {"fit"}


@pytest.mark.slow
@pytest.mark.parametrize("retract", [False, True])
def test_either_way_can_be_fitted(retract):
    """The way in has 375 samples, the way out one more."""
    settings = PressSettings(retract=retract)
    found = look(HERTZ, [1e5, 0.0], noise=0.01, speed=4e-3, deep=1e-3, settings=settings)
    assert len(found.branch) == (376 if retract else 375)
    assert abs(found.fit.modulus - 1e5) < 3 * found.combined
    assert (set(found.points) == {"fit"}) == retract


@pytest.mark.slow
def test_gaps_in_the_force_are_left_out():
    samples = record(HERTZ, [1e5, 0.0], noise=1e-3)
    samples.force[100:140] = np.nan
    found = analyse_press(law_of(HERTZ, "dr", {}), press_of(samples), PressSettings())
    assert found.fit.modulus == pytest.approx(1e5, rel=5e-3)


@pytest.mark.parametrize(
    ("model", "parameters", "words"),
    [
        (JohnsonKendallRoberts(radius=RADIUS), {}, "not proportional to a modulus"),
        (HERTZ, {"viscousity": "1 Pa*s"}, "viscosity"),
        (HERTZ, {"viscosity": "1 mm"}, "viscosity"),
    ],
)
def test_a_law_that_cannot_be_is_refused(model, parameters, words):
    with pytest.raises(ConfigurationError, match=words):
        law_of(model, "dr", parameters)


@pytest.mark.slow
def test_a_model_without_a_tip_has_its_own_modulus_over_depth():
    model = HuntCrossley(exponent=1.5)
    theta = [1.0 if p.role == "elastic" else 0.0 for p in model.parameters]
    found = look(model, theta, fitted=model, noise=1e-3)
    assert found.fit.modulus == pytest.approx(1.0, rel=0.01)
    assert not found.spheres


PIPELINE = """
[run]
seed = 3
[device.rig]
type = "sim"
specimen = { model = "dr", elasticity = "100 kPa", viscosity = "0 Pa*s" }
[trajectory.press]
type = "load-unload"
depth = "3 mm"
speeds = ["4 mm/s"]
[alignment]
force = "rig.wrench.z"
position = "rig.tip.z"
velocity = "rig.twist.z"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
"""


@pytest.mark.gate
@pytest.mark.slow
def test_the_command_writes_tables_and_a_picture(tmp_path, capsys):
    path, out = tmp_path / "press.toml", tmp_path / "out"
    path.write_text(PIPELINE)
    call(["fit", "indentation", str(path), "--out", str(out), "--json", "--windows", "5"])
    document = json.loads(capsys.readouterr().out)
    assert abs(document["value"] - 1e5) < 4 * document["combined"]
    assert document["contact_points"].keys() >= {"fit", "threshold", "change-point", "line-and-parabola"}
    assert {p.name for p in out.iterdir()} == {
        "indentation.json", "indentation.png", "depth.csv", "windows.csv", "contact_points.csv",
    }  # fmt: skip
    rows = list(csv.reader((out / "windows.csv").read_text().splitlines()))
    assert len(rows) == 6
    assert rows[0][2] == "modulus [Pa]"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--model", "dx"], "dr"),
        (["--between", "3 s..2 s"], "ends before it begins"),
        (["--between", "3..x"], "--between"),
        (["--parameter", "viscosity"], "NAME=VALUE"),
    ],
)
def test_a_mistake_is_one_sentence(options, words, tmp_path):
    path = tmp_path / "press.toml"
    path.write_text(PIPELINE)
    with pytest.raises(ConfigurationError, match=words):
        call(["fit", "indentation", str(path), *options])
