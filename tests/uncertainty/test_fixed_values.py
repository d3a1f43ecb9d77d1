"""Numbers that a fit holds fixed: tested by freeing them, without a shift, with the uncertainty that is stated."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from palpate import ConfigurationError, Problem
from palpate_fits import CasadiFit
from palpate_kit.budget.force_sensitivity import at_samples, free_columns
from palpate_kit.budget.influence import answer
from palpate_models import DimensionalityReduction, Sphere

from tests.uncertainty.presses import ELASTICITY, facts, write_press, zeroed_press

MODEL = DimensionalityReduction(indenter=Sphere(radius=3e-3))


def fit_with(palpate, tmp_path, *settings, **others):
    """What is printed of a press, and its row of fits.csv."""
    folder = tmp_path / "curves"
    folder.mkdir()
    write_press(folder / "press.csv", zeroed_press(4, 0.5e-3, **others))
    words = [word for setting in settings for word in ("--set", f"estimator.fit.{setting}")]
    done = palpate("fit", folder, "-o", "fits", "--no-pictures", *facts(), *words)
    with (tmp_path / "fits" / "fits.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    return done.stdout, SimpleNamespace(**row)


@pytest.mark.slow
@pytest.mark.parametrize("surface", ["0.2 mm", "0.01 mm"])
def test_a_fixed_surface_that_is_wrong_is_doubted(palpate, tmp_path, surface):
    _, row = fit_with(palpate, tmp_path, f"fixed.surface={surface}")
    assert row.verdict == row.elasticity_verdict == "doubtful"
    assert "lack-of-fit" in row.flags


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [["fixed.surface=0 mm"], ["fixed.surface=0.01 mm", "systematic.surface=10 um"]], ids=["right", "stated"]
)
def test_a_fixed_surface_is_good_where_it_is_right_or_its_uncertainty_is_stated(palpate, tmp_path, settings):
    _, row = fit_with(palpate, tmp_path, *settings)
    assert row.verdict == "good"
    assert abs(float(row.elasticity) - ELASTICITY) < 2.0 * float(row.elasticity_combined)
    assert float(row.surface_std) == pytest.approx(1e-5 if len(settings) > 1 else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("viscosity", [0.0, 60.0])
def test_a_viscosity_fixed_at_none_reads_so_and_leaves_the_elasticity_good(palpate, tmp_path, viscosity):
    printed, row = fit_with(palpate, tmp_path, "fixed.viscosity=0 Pa*s", viscosity=viscosity)
    assert "0 (fixed)" in printed
    assert row.verdict == row.elasticity_verdict == "good"
    assert float(row.viscosity_combined) == 0.0
    assert abs(float(row.elasticity) - ELASTICITY) < 2.0 * float(row.elasticity_combined) < 0.05 * ELASTICITY


def test_what_is_held_fixed_does_not_answer_to_an_error_of_the_force():
    time = np.arange(400) / 200.0
    depth, rate, second = 1e-3 * (1.1 + np.sin(3 * time)), 3e-3 * np.cos(3 * time), 9e-3 * np.sin(3 * time)
    course = at_samples(MODEL, (time, depth, rate, second), np.array([25e3, 60.0]))
    held = at_samples(MODEL, (time, depth, rate, second), np.array([25e3, 60.0]), held=frozenset({"surface"}))
    error = 1e-3 * np.ones(len(time))
    assert free_columns(MODEL, {"surface"}).tolist() == [True, True, False]
    assert course.answer(error)[2] != 0.0
    assert held.answer(error)[2] == 0.0
    np.testing.assert_allclose(held.answer(error)[:2], answer(course.jacobian[:, :2], error))


def test_an_uncertainty_is_stated_of_what_is_fixed_and_not_of_what_is_free():
    problem = Problem(MODEL, 0.0)
    CasadiFit(fixed={"viscosity": "60 Pa*s"}, systematic={"viscosity": "5 Pa*s"}).start(problem)
    with pytest.raises(ConfigurationError, match="viscosity is an unknown of the fit"):
        CasadiFit(systematic={"viscosity": "5 Pa*s"}).start(problem)
