"""Model discrepancy: the covariance of a misfit that is spread over patterns, and which causes are a finding."""

import math

import numpy as np
import pytest
from palpate import Parameter
from palpate_uncertainty.causes import CAUSES, cause_of
from palpate_uncertainty.discrepancy import Explanation, Misfit, judge_misfit, spread_of
from palpate_uncertainty.residual_rows import JudgedRows

LAW = (
    Parameter("elasticity", "E", "Pa", "", role="elastic"),
    Parameter("viscosity", "eta", "Pa*s", "", role="viscous"),
)
TIME = np.linspace(0.0, 10.0, 2000)
JACOBIAN = np.column_stack([1e-5 * np.ones_like(TIME), 1e-4 * np.cos(TIME), 1e3 * (1.0 + TIME / 10.0)])


def misfit(explanations=(), excess=1e-4, is_fitted=(True, True, True), pattern=1000.0):
    return Misfit(1e-30, excess, 1.0, pattern, JACOBIAN, is_fitted, dict(explanations))


def explanation(gain, shifts=(0.0, 0.0), numbers=1):
    return Explanation(gain, numbers, 1e-30, len(TIME), np.array(shifts))


def test_of_one_number_the_row_is_the_misfit_over_the_force_and_the_root_of_the_patterns():
    """F = E j: a part 1/sqrt(m) of the misfit along j moves E by as much of E as the misfit is of the force."""
    force, modulus, size = 2.0, 1e5, 0.1
    derivative = np.full((500, 1), force / modulus)
    law = Misfit(1e-30, size**2, 1.0, 1e3, derivative, (True,), {})
    assert spread_of(derivative)[0] == pytest.approx(modulus / force)
    assert law.uncertainty(())[0] / modulus == pytest.approx(size / force / 2.0)


def test_parameters_that_are_hard_to_distinguish_hide_more_of_a_misfit():
    """By the root of 1 - r^2 of their correlation r, as they hide more of a noise."""
    first = np.cos(TIME)
    for r in (0.0, 0.6, 0.96):
        second = r * np.cos(TIME) + math.sqrt(1.0 - r * r) * np.sin(TIME)
        basis = np.linalg.qr(np.column_stack([first, second]))[0]
        columns = np.column_stack([basis[:, 0], r * basis[:, 0] + math.sqrt(1.0 - r * r) * basis[:, 1]])
        assert spread_of(columns)[0] == pytest.approx(math.sqrt(len(TIME)) / math.sqrt(1.0 - r * r), rel=1e-6)


def test_the_row_follows_the_unit_of_a_parameter_and_the_size_of_the_misfit():
    of_one = misfit().uncertainty(LAW)
    np.testing.assert_allclose(misfit(excess=4e-4).uncertainty(LAW), 2.0 * of_one)
    in_kilopascal = Misfit(1e-30, 1e-4, 1.0, 1e3, JACOBIAN * [1e3, 1.0, 1.0], (True,) * 3, {})
    np.testing.assert_allclose(in_kilopascal.uncertainty(LAW) * [1e3, 1.0, 1.0], of_one)


def test_what_is_fixed_has_no_row_and_takes_none_of_the_others():
    free = misfit().uncertainty(LAW)
    fixed = misfit(is_fitted=(True, True, False)).uncertainty(LAW)
    assert fixed[2] == 0.0
    assert fixed[0] < 0.5 * free[0]  # a surface that is known leaves less open


def test_longer_records_of_the_same_misfit_have_the_same_row():
    """It repeats, so that more readings do not average it out."""
    twice = Misfit(1e-30, 1e-4, 1.0, 1e3, np.repeat(JACOBIAN, 2, axis=0), (True,) * 3, {})
    np.testing.assert_allclose(twice.uncertainty(LAW), misfit().uncertainty(LAW))


@pytest.mark.parametrize(
    ("explanations", "code"),
    [
        ({}, "model-discrepancy"),
        ({"memory of 0.3 s": explanation(500.0)}, "model-discrepancy"),
        ({"thickness": explanation(500.0, (5e3, 0.0))}, "lack-of-fit"),
        # A cause of the material rivals one of the rig from 0.7 of its evidence on.
        ({"thickness": explanation(500.0, (5e3, 0.0)), "memory of 0.3 s": explanation(300.0)}, "lack-of-fit"),
        ({"thickness": explanation(500.0, (5e3, 0.0)), "memory of 0.3 s": explanation(400.0)}, "model-discrepancy"),
        # Eight numbers follow anything.
        ({"thickness": explanation(500.0, (5e3, 0.0)), "drift in steps": explanation(500.0, numbers=8)}, "lack-of-fit"),
        # A finding explains a tenth of what is visible.
        ({"thickness": explanation(90.0, (5e3, 0.0))}, "model-discrepancy"),
    ],
)
def test_a_fact_of_the_rig_is_a_finding_where_no_material_rivals_it(explanations, code):
    flags = judge_misfit(misfit(explanations), LAW, {}, "").flags
    assert [flag.code for flag in flags] == [code]


def test_the_finding_has_the_largest_shift_of_the_facts_that_explain_as_much():
    facts = {"another tip": explanation(500.0, (-1e3, 0.0)), "thickness": explanation(490.0, (-2e3, 0.0))}
    (flag,) = judge_misfit(misfit(facts), LAW, {}, "").flags
    assert flag.effects["elasticity"] == 2e3
    assert flag.causes == ()  # compared with the whole uncertainty, the row included


def test_what_acts_with_the_speed_leaves_the_viscosity_in_doubt_and_the_elasticity_its_row():
    flags = judge_misfit(misfit({"friction": explanation(500.0)}), LAW, {}, "").flags
    assert [flag.code for flag in flags] == ["model-discrepancy", "lack-of-fit"]
    assert flags[1].effects == {"viscosity": math.inf}


def test_a_misfit_of_a_third_of_the_force_is_no_fit_of_the_law():
    (flag,) = judge_misfit(misfit(excess=0.1), LAW, {}, "").flags
    assert "does not describe the record" in flag.message
    assert all(math.isinf(size) for size in flag.effects.values())


def test_every_cause_that_is_tested_has_a_class():
    import inspect
    import re

    source = inspect.getsource(JudgedRows)
    names = re.findall(r'yield f?"([^"{]+)', source)
    causes = {name.removesuffix(" of ").strip() for name in names} - {"time", "depth", "speed", "air"}
    assert len(causes) > 15
    assert causes <= CAUSES.keys()
    assert cause_of("second contact of 0.5").of_rig


def test_laws_are_named_that_describe_the_material_and_none_for_a_wrong_fact():
    remembering = judge_misfit(misfit({"memory of 0.3 s": explanation(500.0)}), LAW, {}, "").table
    assert remembering["better_laws"] == ("standard-linear-solid", "generalised-maxwell-2")
    for cause in ("thickness", "drift", "friction"):
        assert "better_laws" not in judge_misfit(misfit({cause: explanation(500.0)}), LAW, {}, "").table
