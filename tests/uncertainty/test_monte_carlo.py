"""Monte Carlo of a budget: against closed forms, and against the linear budget."""

import json
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_engine import load_pipeline, run_pipeline
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.budget_command import budget
from palpate_uncertainty.monte_carlo import cases, propagate_draws, with_number

PIPELINE = Path(__file__).parents[2] / "pipelines" / "filters.toml"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run whose uncertainty is nearly all the tip's radius, declared with 5 %."""
    folder = tmp_path_factory.mktemp("run") / "run"
    settings = ["trajectory.press.duration=3 s", 'estimator.fit={type="casadi-fit"}', 'run.tracks=["dr/fit"]']
    settings += ['run.uncertainties={radius="0.25 mm", poisson=1e-6}']
    run_pipeline(load_pipeline(PIPELINE, settings), folder)
    return folder


@pytest.mark.slow
def test_the_draws_agree_with_the_formula_and_with_the_budget(run):
    """E goes with R^-0.5: 5 % of the radius are 2.5 % of E; 48 draws know their std to 10 %."""
    (case,) = cases(run, ["dr/fit"])
    found = propagate_draws(case, 48, seed=1)
    row = found.table()["elasticity"]
    assert found.lost == 0
    assert row["std"] / row["value"] == pytest.approx(0.025, rel=0.35)
    assert row["std"] == pytest.approx(row["combined"], rel=0.35)
    assert abs(row["mean"] - row["value"]) < 3.5 * row["std"] / np.sqrt(48)
    again = propagate_draws(case, 10, seed=1, workers=1)
    np.testing.assert_array_equal(again.values, found.values[:10])  # however they are shared out
    assert not np.array_equal(propagate_draws(case, 2, seed=2, workers=1).values, found.values[:2])


@pytest.mark.gate
@pytest.mark.slow
def test_the_command_prints_both(run, capsys):
    budget(run, as_json=True, monte_carlo=4)
    (found,) = json.loads(capsys.readouterr().out).values()
    assert {"std", "combined", "low", "high"} <= set(found["monte_carlo"]["parameters"]["elasticity"])
    assert (found["monte_carlo"]["draws"], found["monte_carlo"]["seed"]) == (4, 0)
    budget(run, monte_carlo=4)
    assert "dr/fit elasticity: u" in capsys.readouterr().out.replace("\n", " ")


@pytest.mark.slow
def test_too_few_draws_and_a_run_without_a_log_are_refused(run, tmp_path):
    with pytest.raises(ConfigurationError, match="--monte-carlo"):
        budget(run, monte_carlo=1)
    (tmp_path / "result.json").write_text((run / "result.json").read_text())
    (tmp_path / "pipeline.toml").write_text((run / "pipeline.toml").read_text())
    with pytest.raises(Exception, match="log"):
        budget(tmp_path, monte_carlo=4)


def test_a_number_is_found_in_the_model_or_its_tip():
    model = DimensionalityReduction(indenter=Sphere(radius=5e-3), poisson=0.5)
    assert with_number(model, "radius", 1e-4).indenter.radius == pytest.approx(5.1e-3)
    assert with_number(model, "poisson", -0.01).poisson == pytest.approx(0.49)
    assert with_number(model, "nothing", 1.0) is model
