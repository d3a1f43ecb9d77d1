"""Several recordings as one spectrum: what they share moves all of them alike, and they scatter."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_models import DimensionalityReduction, Sphere
from palpate_spectra.complex_moduli import measure_moduli
from palpate_spectra.consistency import kramers_kronig
from palpate_spectra.flags import evidence_sentence
from palpate_spectra.joint_covariance import shared_covariance
from palpate_spectra.law_fits import LAWS, fit_law, law_fits

from tests.spectra import rig

SOFT = DimensionalityReduction(indenter=Sphere(radius=5e-3))
ONE, THREE = {2.0: 1e-3}, {0.5: 1e-3, 2.0: 1e-3, 5.0: 0.7e-3}


def lines_of(values, sines, viscosity=362.0, **known):
    """Lines of a recording for each elasticity [Pa], with the default uncertainties of tip and material."""
    found = []
    for seed, elasticity in enumerate(values):
        one = rig.recorded(SOFT, (elasticity, viscosity), sines, seed=seed, name=f"run{seed}", timing=3e-4, **known)
        found += measure_moduli(replace(one, uncertainties={}), list(sines)).lines
    return found


@pytest.mark.slow
@pytest.mark.parametrize("sines", [ONE, pytest.param(THREE, marks=pytest.mark.slow)])
@pytest.mark.parametrize("values", [(112.6e3, 118.0e3, 106.6e3), (71e3, 74e3, 78e3, 81e3)])
def test_a_joint_value_lies_within_its_recordings(values, sines):
    """Peelle's puzzle: scaled by each measured value, common factors made 9 to 16 kPa of the first three."""
    lines = lines_of(values, sines)
    solid = fit_law(LAWS[0], lines)
    assert min(values) < solid.values[0] < max(values)
    assert solid.values[0] == pytest.approx(np.mean(values), rel=0.02)
    scatter = np.std(values, ddof=1) / np.sqrt(len(values))
    common = lines[0].std_of("storage") * 3 * solid.values[0] / lines[0].young.real
    assert solid.stds[0] > np.hypot(scatter, 0.9 * common)  # few recordings tell their scatter: Student's factor
    assert solid.stds[0] < 3 * np.hypot(scatter, common)
    assert solid.scatter.storage == pytest.approx(np.std(values, ddof=1) / np.mean(values), rel=0.15)
    assert not kramers_kronig(lines).failed
    assert f"the {len(values)} recordings scatter by" in evidence_sentence(law_fits(lines), lines)


@pytest.mark.slow
def test_recordings_that_agree_do_not_scatter_and_keep_what_they_share():
    lines = lines_of((112.5e3, 112.5e3, 112.5e3, 112.5e3), THREE)
    solid = fit_law(LAWS[0], lines)
    alone = fit_law(LAWS[0], lines[:3])
    assert solid.scatter.storage < 2e-3
    assert abs(solid.values[0] - 112.5e3) < 1.96 * solid.stds[0]
    assert 0.8 * alone.stds[0] < solid.stds[0] < 1.2 * alone.stds[0]  # radius and Poisson's ratio do not average out


def test_tips_of_their_own_have_radii_of_their_own():
    """The same radius is one error; of two tips it is two."""
    lines = lines_of((112.5e3, 112.5e3), ONE)
    shear = np.array([line.shear for line in lines])
    of_one = shared_covariance(lines, shear, without=["poisson", "surface", "mass", "timing"])
    apart = [replace(line, error_groups={**line.error_groups, "radius": f"{k}"}) for k, line in enumerate(lines)]
    of_two = shared_covariance(apart, shear, without=["poisson", "surface", "mass", "timing"])
    assert of_one[0, 1] == pytest.approx(0.0025**2 * shear[0].real * shear[1].real, rel=1e-2)
    assert of_two[0, 1] == 0.0


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of 60 draws of four recordings 95 % are 52 to 60 in 99.9 of 100 cases (exact binomial)."""
    import importlib.util
    from pathlib import Path

    path = Path(__file__).parents[2] / "benchmarks" / "joint_spectra.py"
    specification = importlib.util.spec_from_file_location("joint_spectra", path)
    bench = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(bench)
    for scatter in (0.0, 0.05):
        elasticity, viscosity, *_ = bench.covered(60, 4, scatter, 2, seed=1)
        assert min(elasticity, viscosity) >= 50


@pytest.mark.slow
def test_two_tips_on_the_authors_soft_silicone(palpate, authors_log, tmp_path):
    """127 and 105 kPa of one specimen by two tips (without its height): the joint value is between, and says so."""
    import json

    tracks = '[model.dr]\ntype = "dimensionality-reduction"\nindenter = "tip"\n[estimator.fit]\ntype = "casadi-fit"\n'
    (tmp_path / "large.toml").write_text(authors_log("d10mm_soft") + tracks)
    small = authors_log("d5mm_soft", radius="2.5 mm", motion="0 ms", force="12 ms")
    (tmp_path / "small.toml").write_text(small + tracks)
    done = palpate(
        "fit", "spectrum", tmp_path / "large.toml", tmp_path / "small.toml", "--frequencies", "2 Hz", "--json"
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    storage = [line["E_storage_Pa"] for line in found["lines"]]
    solid = next(law for law in found["laws"] if law["law"] == "kelvin-voigt")
    joint = solid["parameters"]["elasticity"]
    assert min(storage) < joint["value"] < max(storage)
    assert joint["std"] > 0.3 * (max(storage) - min(storage))
    assert solid["scatter"]["recordings"] == 2
