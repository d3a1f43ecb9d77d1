"""One loading and one unloading after Ting: what the rig makes is found again, and what is left out shows."""

import numpy as np
import pytest
from palpate import ConfigurationError, Problem
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_fits import TingFit
from palpate_models import DimensionalityReduction, Poroelastic, PowerLaw, Sphere, StandardLinearSolid

from tests.real_bags import pipeline_of
from tests.simulated import pipeline, samples, solid, triangle

TIP = Sphere(radius=5e-3)
CYCLE = 'type = "load-unload"\ndepth = "3 mm"\nspeeds = ["6 mm/s"]'


def run(tmp_path, unloading, trajectory=CYCLE, estimator="ting-fit"):
    specimen = solid("100 kPa", "60 kPa", "300 ms", f'surface = "0.3 mm"\nunloading = "{unloading}"')
    (tmp_path / "p.toml").write_text(pipeline(specimen, trajectory, f'type = "{estimator}"', seed=4))
    return run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / f"out-{unloading}")


def record(model, theta, seed):
    """A triangle in and out of a material, with the rig's noise, from air to air."""
    time, depth = triangle(2e-3)
    return samples(time, depth, model.loading_cycle_force(time, depth, theta, 1e-6), seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "theta"),
    [
        pytest.param(StandardLinearSolid(indenter=TIP), (100e3, 60e3, 0.3), marks=pytest.mark.slow),
        (DimensionalityReduction(indenter=TIP), (100e3, 800.0)),
        pytest.param(PowerLaw(indenter=TIP), (100e3, 0.15), marks=pytest.mark.slow),
    ],
)
def test_the_truth_is_within_the_intervals(model, theta):
    """Every parameter of 6 records within 3.5 standard deviations, and the mean of their squares plausible."""
    apart = []
    for seed in range(6):
        found = TingFit().start(Problem(model, 0.0)).run(record(model, theta, seed))
        row = np.flatnonzero(np.isfinite(found.values[:, 0]))[0]
        apart.append((found.values[row] - theta) / found.std[row])
        assert found.report.rms == pytest.approx(0.05, rel=0.1)
    assert np.abs(apart).max() < 4.5
    assert np.mean(np.square(apart)) < 3.0


@pytest.mark.slow
def test_what_the_rig_makes_is_found_again(tmp_path):
    found = run(tmp_path, "ting").tracks["sls/fit"]
    for name, true in (("elasticity", 100e3), ("relaxing_elasticity", 60e3), ("relaxation_time", 0.3)):
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].combined, name
    assert found.force_rms < 0.06
    assert "unloading" not in {flag.code for flag in found.flags}


@pytest.mark.slow
def test_a_fit_whose_contact_follows_the_way_out_is_flagged(tmp_path):
    track = run(tmp_path, "ting", estimator="casadi-fit").tracks["sls/fit"]
    assert "unloading" in {flag.code for flag in track.flags}
    assert track.parameters["elasticity"].value > 108e3  # what is made by leaving it out


def test_a_second_maximum_is_refused_by_name_in_rig_and_fit(tmp_path):
    sine = 'type = "point"\nbias = "3 mm"\nduration = "2 s"'
    with pytest.raises(ConfigurationError, match="more than one maximum"):
        run(tmp_path, "ting", sine)
    track = run(tmp_path, "following", sine).tracks["sls/fit"]
    assert "more than one maximum" in {flag.code: flag.message for flag in track.flags}["no-estimate"]


@pytest.mark.parametrize(
    ("settings", "model", "said"),
    [
        ({}, Poroelastic(indenter=TIP), "Poroelastic"),
        ({"fixed": {"elastic": 1.0}}, StandardLinearSolid(indenter=TIP), "elasticity"),
        ({"fixed": {"elasticity": "3 N"}}, StandardLinearSolid(indenter=TIP), "fixed: elasticity"),
    ],
)
def test_what_it_cannot_do_is_said_before_anything_runs(settings, model, said):
    with pytest.raises(ConfigurationError, match=said):
        TingFit(**settings).start(Problem(model, 0.14))


@pytest.mark.slow
def test_the_authors_load_and_unload(shared, tmp_path):
    """A real press to 13.5 mm and back: soft silicone's modulus by a power law, which relaxes weakly, and doubts."""
    settings = {"height": 3, "radius": "5 mm", "model": "power-law", "estimator": "ting-fit"}
    path = pipeline_of(shared / "rosbag2/ur3e_load_unload_soft_1.db3.gz", tmp_path, **settings)
    track = run_pipeline(load_pipeline(path), tmp_path / "out").tracks["m/e"]
    assert 50e3 < track.parameters["elasticity"].value < 250e3
    assert 0 < track.parameters["power"].value < 0.3
    assert "beyond-model-range" in {flag.code for flag in track.flags}
    assert "thickness" in {one.fact for one in track.conditions}
