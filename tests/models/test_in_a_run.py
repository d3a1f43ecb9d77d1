"""Every model through a whole run: on the simulated rig, in the paper's filter, and on the authors' logs."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

import pytest
from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import run_pipeline

ROOT = Path(__file__).parents[2]
PIPELINE = """
[run]
seed = 2

[device.rig]
type = "sim"

[device.rig.specimen]
model = "truth"
surface = "0.2 mm"
{truth}

[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "8 s"

[alignment]
force = {{ channel = "rig.wrench.z", uncertainty = "0.1 ms" }}
position = "rig.tip.z"
velocity = {{ channel = "rig.twist.z", uncertainty = "0.1 ms" }}
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"

[indenter.tip]
type = "exact-sphere"
radius = "5 mm"

[indenter.face]
type = "flat"
radius = "3 mm"

[model.truth]
{model}

[estimator.ekf]
type = "ekf"
{estimator}
"""
THICK = 'thickness = { law = "dimitriadis", height = "22 mm", bonded = false }'


def run(folder, model, truth, estimator=""):
    text = PIPELINE.format(model=model, truth=truth, estimator=estimator)
    return run_pipeline(build_pipeline(Source(text, Path("pipeline.toml"))), folder / "run").tracks["truth/ekf"]


@pytest.mark.parametrize(
    ("model", "truth", "tolerance"),
    [
        (
            f'type = "dimensionality-reduction"\nindenter = "tip"\n{THICK}',
            {"elasticity": '"112 kPa"', "viscosity": '"362 Pa*s"'},
            0.12,
        ),
        pytest.param(
            'type = "dimensionality-reduction"\nindenter = { type = "profile", formula = "r**2/(2*R)", '
            'constants = { R = "5 mm" }, radius = "8 mm" }',
            {"elasticity": '"112 kPa"', "viscosity": '"362 Pa*s"'},
            0.12,
            marks=pytest.mark.slow,
        ),
        ('type = "kelvin-voigt"', {"stiffness": '"0.9 N/mm"', "damping": '"3 N*s/m"'}, 0.4),
        ('type = "hunt-crossley"', {"reference_force": '"0.6 N"', "reference_damping": '"1.5 N*s/m"'}, 0.2),
    ],
)
def test_what_went_into_the_rig_comes_out_of_the_filter(tmp_path, model, truth, tolerance):
    track = run(tmp_path, model, "\n".join(f"{name} = {value}" for name, value in truth.items()))
    for name, given in truth.items():
        number = float(given.strip('"').split()[0]) * {"kPa": 1e3, "N/mm": 1e3}.get(given.strip('"').split()[1], 1.0)
        assert track.parameters[name].value == pytest.approx(number, rel=tolerance), name
        assert track.parameters[name].std > 0


@pytest.mark.slow
def test_a_material_that_relaxes_is_found_when_its_time_is_known(tmp_path):
    truth = 'elasticity = "100 kPa"\nrelaxing_elasticity = "40 kPa"\nrelaxation_time = "80 ms"'
    known = 'first_guess = { relaxation_time = "80 ms" }\nfirst_guess_std = { relaxation_time = "0.001 ms" }'
    track = run(tmp_path, 'type = "standard-linear-solid"\nindenter = "tip"', truth, known)
    assert track.parameters["elasticity"].value == pytest.approx(100e3, rel=0.1)
    assert track.parameters["relaxing_elasticity"].value == pytest.approx(40e3, rel=0.2)
    derived = {value.name: value for value in track.derived}
    assert set(derived) == {"viscosity"}
    assert derived["viscosity"].found.value == pytest.approx(40e3 * 0.08 / 3, rel=0.2)
    assert derived["viscosity"].found.std > 0
    assert "slow against the relaxation time" in track.table()["derived"]["viscosity"]["caveat"]


@pytest.mark.slow
def test_a_flat_tip_makes_e_of_a_linear_spring(tmp_path):
    model = 'type = "kelvin-voigt"\nindenter = "face"'
    track = run(tmp_path, model, 'stiffness = "0.9 N/mm"\ndamping = "3 N*s/m"')
    table = track.table()["derived"]
    stiffness = track.parameters["stiffness"]
    assert table["elasticity"]["value"] == pytest.approx(stiffness.value * 0.75 / 6e-3, rel=1e-12)
    assert table["elasticity"]["std"] == pytest.approx(stiffness.std * 0.75 / 6e-3, rel=1e-12)
    assert table["viscosity"]["systematic"] == pytest.approx(track.parameters["damping"].systematic / 24e-3, rel=1e-12)
    assert "flat tip only" in table["elasticity"]["caveat"]


@pytest.mark.slow
def test_a_range_that_is_left_is_flagged(tmp_path):
    thin = THICK.replace("22 mm", "12 mm").replace(", bonded = false", "")  # of a base that nobody states
    model = f'type = "dimensionality-reduction"\nindenter = "tip"\n{thin}'
    track = run(tmp_path, model, 'elasticity = "112 kPa"\nviscosity = "362 Pa*s"')
    assert any(str(flag).startswith("beyond-model-range: the depth is 4") for flag in track.immaterial)
    others = track.diagnoses["thickness"]
    assert track.parameters["elasticity"].budget["thickness"] > 0.1 * track.parameters["elasticity"].value, others


@pytest.mark.slow
def test_geometry_explains_the_authors_soft_silicone():
    shared = Path(os.environ.get("PALPATE_SHARED", ROOT.parent / "shared"))
    if not (shared / "data" / "ur3e-bota-2024").is_dir():
        pytest.skip("the authors' logs are not here")
    script = runpy.run_path(str(ROOT / "benchmarks" / "thickness_on_logs.py"))
    for name, radius, motion, force, published in script["LOGS"]:
        found = script["elasticities"](shared / "data", name, radius, motion, force)
        assert found["paper"][0] == pytest.approx(published, rel=0.03)
        assert found["exact-thin"][0] == pytest.approx(script["TRUTH"], rel=0.06)
        assert all(std > 0 for _, std in found.values())
