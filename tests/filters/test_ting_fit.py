"""One loading and one unloading after Ting: what the rig makes is found again, and what is left out shows."""

import numpy as np
import pytest
from palpate import ConfigurationError, Problem, Samples
from palpate.config import load_pipeline
from palpate.pipeline import run_pipeline
from palpate_filters import TingFit
from palpate_models import DimensionalityReduction, Poroelastic, PowerLaw, Sphere, StandardLinearSolid
from palpate_models.ting import ting_force

TIP = Sphere(radius=5e-3)
PIPELINE = """
[run]
seed = 4
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "sls"
elasticity = "100 kPa"
relaxing_elasticity = "60 kPa"
relaxation_time = "300 ms"
surface = "0.3 mm"
unloading = "{unloading}"
[trajectory.press]
type = "{motion}"
{settings}
[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = {{ channel = "rig.tip.z", uncertainty = "0.1 ms" }}
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.sls]
type = "standard-linear-solid"
indenter = "tip"
[estimator.ting]
type = "ting-fit"
"""
CYCLE = 'depth = "3 mm"\nspeeds = ["6 mm/s"]'


def run(tmp_path, unloading, motion="load-unload", settings=CYCLE):
    (tmp_path / "p.toml").write_text(PIPELINE.format(unloading=unloading, motion=motion, settings=settings))
    return run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / f"out-{unloading}")


def record(model, theta, seed, surface=1e-4):
    """A triangle in and out of a material, with the rig's noise, from air to air."""
    random, time = np.random.default_rng(seed), np.arange(0, 2.2, 2e-3)
    depth = 3e-3 * np.clip(1 - np.abs(time - 1.1) / 0.8, -0.1, 1)
    depth = np.convolve(np.pad(depth, 10, "edge"), np.ones(21) / 21, "valid")  # no corners
    force = ting_force(model, time, depth, theta) + 0.05 * random.standard_normal(len(time))
    contact = depth > 0
    position = surface - depth + 5e-6 * random.standard_normal(len(time))
    steps = np.diff(time, prepend=0.0)
    return Samples(
        (1e9 * time).astype(np.int64), time, steps, force, position, np.gradient(position, time), contact, contact
    )


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        (StandardLinearSolid(indenter=TIP), (100e3, 60e3, 0.3)),
        (DimensionalityReduction(indenter=TIP), (100e3, 800.0)),
        (PowerLaw(indenter=TIP), (100e3, 0.15)),
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


def test_what_the_rig_makes_is_found_again(tmp_path):
    found = run(tmp_path, "ting").tracks["sls/ting"]
    for name, true in (("elasticity", 100e3), ("relaxing_elasticity", 60e3), ("relaxation_time", 0.3)):
        assert abs(found.parameters[name].value - true) < 4 * found.parameters[name].combined, name
    assert found.force_rms < 0.06
    assert "unloading" not in {flag.code for flag in found.flags}


def test_a_fit_whose_contact_follows_the_way_out_is_flagged(tmp_path):
    (tmp_path / "p.toml").write_text(
        PIPELINE.format(unloading="ting", motion="load-unload", settings=CYCLE).replace("ting-fit", "casadi-fit")
    )
    track = run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / "out").tracks["sls/ting"]
    assert "unloading" in {flag.code for flag in track.flags}
    assert track.parameters["elasticity"].value > 108e3  # what is made by leaving it out


def test_a_second_maximum_is_refused_by_name_in_rig_and_fit(tmp_path):
    sine = 'bias = "3 mm"\nduration = "2 s"'
    with pytest.raises(ConfigurationError, match="more than one maximum"):
        run(tmp_path, "ting", "point", sine)
    track = run(tmp_path, "following", "point", sine).tracks["sls/ting"]
    assert "more than one maximum" in {flag.code: flag.message for flag in track.flags}["not-fitted"]


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


def test_the_authors_load_and_unload(shared, tmp_path):
    """A real press to 13.5 mm and back: soft silicone's modulus by a power law, which relaxes weakly, and doubts."""
    import gzip

    (tmp_path / "log.db3").write_bytes(
        gzip.decompress((shared / "rosbag2/ur3e_load_unload_soft_1.db3.gz").read_bytes())
    )
    (tmp_path / "p.toml").write_text(REAL)
    track = run_pipeline(load_pipeline(tmp_path / "p.toml"), tmp_path / "out").tracks["pl/fit"]
    assert 50e3 < track.parameters["elasticity"].value < 250e3
    assert 0 < track.parameters["power"].value < 0.3
    assert {"beyond-model-range", "thickness-undeclared"} <= {flag.code for flag in track.flags}


REAL = """
[device.log]
type = "rosbag2-replay"
file = "log.db3"
time = { field = "data", index = 0, unit = "s" }
signals.z = { topic = "/data_control", field = "data", index = 3, unit = "m" }
signals.v = { topic = "/data_control", field = "data", index = 4, unit = "m/s" }
signals.f = { topic = "/data_control", field = "data", index = 5, unit = "N" }
[alignment]
force = { channel = "log.data_control.f", sign = -1 }
position = "log.data_control.z"
velocity = "log.data_control.v"
tare_duration = "0.2 s"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.pl]
type = "power-law"
indenter = "tip"
[estimator.fit]
type = "ting-fit"
"""
