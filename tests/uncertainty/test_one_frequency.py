"""A viscosity of one frequency: what a stiffness that fades would be of it, against a rig whose material fades."""

import numpy as np
import pytest
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_uncertainty.budget_command import budget

E, ETA, TAU = 112.5e3, 362.0, 0.0796  # [Pa], [Pa s], 1/w [s] at 2 Hz
FADES = (
    "{ model = { type = 'dimensionality-reduction-maxwell', indenter = { type = 'sphere', radius = '5 mm' } }, "
    f"elasticity = '{E} Pa', viscosity = '{ETA} Pa*s', relaxing_elasticity = '{0.1 * E} Pa', "
    f"relaxation_time = '{TAU} s' }}"
)
SETS = ("trajectory.press.duration=6 s", 'run.tracks=["dr/kinematic"]')


@pytest.fixture(scope="module")
def runs(root, tmp_path_factory):
    """The same palpation of a material that fades, and of one that does not."""
    folder, file = tmp_path_factory.mktemp("one"), root / "pipelines" / "filters.toml"
    tables = {"fades": (*SETS, f"device.rig.specimen={FADES}"), "stays": SETS}
    return {name: run_pipeline(load_pipeline(file, list(sets)), folder / name) for name, sets in tables.items()}


@pytest.mark.slow
def test_what_it_says_is_what_a_fading_material_does(runs):
    said = runs["stays"].tracks["dr/kinematic"].diagnoses["one-frequency"]
    assert said["frequency"] == pytest.approx(2.0, abs=0.01)
    assert said["time"] == pytest.approx(TAU, rel=0.01)
    like = said["looks_like"]["viscosity"]["value"]
    assert like == pytest.approx(E / 3 * 0.1 / (2 * 2 * np.pi * 2.0), rel=0.02)  # G g/(2 w)
    values = [run.tracks["dr/kinematic"].parameters["viscosity"].value for run in runs.values()]
    assert values[0] - values[1] == pytest.approx(like, rel=0.15)


def test_the_budget_tells_it_to_people(runs, capsys):
    budget(runs["stays"].folder)
    shown = " ".join(capsys.readouterr().out.split())
    assert "this is the viscosity at 2 Hz" in shown
    assert "ms, that would be 149 Pa s of it" in shown
