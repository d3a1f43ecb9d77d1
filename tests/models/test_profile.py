"""Tips from points and from formulas."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_models import BluntCone, Cone, ExactSphere, Profile, Quartic, TruncatedCone
from palpate_models.indenters.profile.formula import parse_formula
from palpate_testing import check_indenter

R, T = 5e-3, math.radians(30)
DEPTHS = np.geomspace(1e-6, 6e-3, 60)
CUT = 1e-3


def sphere(r):
    return R - np.sqrt(R**2 - r**2)


def written(folder, radii, heights, name="tip.csv", heading="r,z"):
    path = folder / name
    rows = [f"{1e3 * r!r},{1e3 * z!r}" for r, z in zip(radii.tolist(), heights.tolist(), strict=True)]
    path.write_text("\n".join([heading, *rows]) + "\n")
    return path


@pytest.mark.parametrize("count", [50, *(pytest.param(count, marks=pytest.mark.slow) for count in (200, 500))])
def test_sampled_sphere_is_the_exact_one(tmp_path, count):
    radii = np.linspace(0.0, 4.9e-3, count)
    tip, exact = Profile(points=written(tmp_path, radii, sphere(radii))), ExactSphere(radius=R)
    check_indenter(tip)
    np.testing.assert_allclose(tip.profile_area(DEPTHS), exact.profile_area(DEPTHS), rtol=1e-4)
    np.testing.assert_allclose(tip.contact_radius(DEPTHS), exact.contact_radius(DEPTHS), rtol=1e-4)


@pytest.mark.slow
def test_sampled_sphere_with_uneven_points_and_rounded_numbers(tmp_path):
    radii = np.concatenate([[0.0], np.sort(np.random.default_rng(3).uniform(0.0, 4.9e-3, 300))])
    tip = Profile(points=written(tmp_path, radii, np.round(sphere(radii), 9)))  # a scan to one micrometre in ten
    exact = ExactSphere(radius=R)
    deep = DEPTHS[DEPTHS > 2e-4]
    np.testing.assert_allclose(tip.profile_area(deep), exact.profile_area(deep), rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("formula", "constants", "exact", "tolerance"),
    [
        ("R - sqrt(R^2 - r^2)", {"R": R}, ExactSphere(radius=R), 1e-9),
        ("1e7 * r**4", {}, Quartic(), 1e-12),
        ("r * tan(t)", {"t": T}, Cone(angle=T), 1e-9),
        ("tan(t) * max(r - b, 0)", {"t": T, "b": CUT}, TruncatedCone(angle=T, face_radius=CUT), 1e-8),
        pytest.param(
            "R - sqrt(R**2 - min(r, b)**2) + tan(t) * max(r - b, 0)",
            {"R": CUT, "t": T, "b": CUT * math.sin(T)},
            BluntCone(angle=T, tip_radius=CUT),
            2e-6,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_formula_is_the_tip_it_writes_down(formula, constants, exact, tolerance):
    tip = Profile(formula=formula, constants=constants, radius=4.95e-3)
    check_indenter(tip)
    depths = DEPTHS[DEPTHS < 4e-3]
    np.testing.assert_allclose(tip.profile_area(depths), exact.profile_area(depths), rtol=tolerance)


@pytest.mark.slow
def test_beyond_its_edge_a_tip_is_a_shaft_and_says_so():
    tip = Profile(formula="r**2 / (2 * R)", constants={"R": R}, radius=2e-3)
    end = 2e-3**2 / R
    assert tip.validity(0.99 * end) == ""
    assert "ends at a depth of 0.8 mm" in tip.validity(1.01 * end)
    assert tip.contact_radius(3 * end) == pytest.approx(2e-3, rel=1e-9)
    inside = 2 / 3 * 2e-3 * end
    assert tip.profile_area(3 * end) == pytest.approx(inside + 2 * end * 2e-3, rel=1e-9)


def test_kinks_in_points_make_no_dips(tmp_path):
    radii = np.linspace(0.0, 5e-3, 60)
    heights = math.tan(T) * np.maximum(radii - 1e-3, 0.0)
    check_indenter(Profile(points=written(tmp_path, radii, heights)))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("r,z\n0,0\n1,0.1\n2,nan\n3,0.5\n", 4, "not finite"),
        ("r,z\n0,0.1\n1,0.2\n2,0.3\n3,0.5\n", 2, "must begin at the apex"),
        ("0.5,0\n1,0.2\n2,0.3\n3,0.5\n", 1, "must begin at the apex"),
        ("0,0\n1,0.2\n2,0.1\n3,0.5\n", 3, "must not fall"),
        ("0,0\n1,0.2\n1,0.3\n3,0.5\n", 3, "radius must grow"),
        ("# scan\n0,0\n1,0.2\nx,0.3\n3,0.5\n", 4, "is not a radius and a height"),
        ("0,0\n1,0.2\n2,0.3,7\n3,0.5\n", 3, "is not a radius and a height"),
    ],
)
def test_bad_points_are_refused_with_file_and_line(tmp_path, text, line, words):
    path = tmp_path / "tip.csv"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=f"tip.csv:{line}: .*{words}"):
        Profile(points=path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "at least 4 points, there are 0"),
        ("0,0\n1,1\n", "at least 4 points, there are 2"),
        ("0,0\n1,0\n2,0\n3,0\n", "tip 'flat'"),
    ],
)
def test_a_file_that_is_no_profile_is_refused(tmp_path, text, words):
    path = tmp_path / "tip.csv"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=words):
        Profile(points=path)
    with pytest.raises(ConfigurationError, match=r"gone\.csv: cannot read"):
        Profile(points=tmp_path / "gone.csv")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "either points or a formula"),
        ({"formula": "r**2"}, "needs the radius"),
        ({"formula": "r**2 + 1e-3", "radius": R}, "must begin at the apex"),
        ({"formula": "-r**2", "radius": R}, "falls at r ="),
        ({"formula": "sin(2000 * r)**2", "radius": R}, "falls at r = 0.000"),
        ({"formula": "1 / r", "radius": R}, "is inf at r = 0 m"),
        ({"formula": "log(r)", "radius": R}, "is -inf at r = 0 m"),
        ({"formula": "sqrt(r - 1e-3)", "radius": R}, "is nan at r = 0 m"),
        ({"formula": "0 * r", "radius": R}, "tip 'flat'"),
        ({"formula": "R - sqrt(R**2 - r**2)", "constants": {"R": R}, "radius": R}, "is vertical at r = 0.005 m"),
        ({"formula": "9**9**9 * r", "radius": R}, "inf at r|nan at r"),
    ],
)
def test_a_formula_that_is_no_profile_is_refused(settings, words):
    with pytest.raises(ConfigurationError, match=words):
        Profile(**settings)


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("__import__('os').system('true')", "is not allowed; there are sqrt, exp"),
        ("r.real", "'r.real' is not allowed"),
        ("(lambda: r)()", "is not allowed"),
        ("[r for r in (1,)]", "is not allowed"),
        ("r if r else 0", "is not allowed"),
        ("open('x')", "is not allowed"),
        ("r[0]", "is not allowed"),
        ("'a' * 9", "\"'a'\" is not allowed"),
        ("True * r", "'True' is not allowed"),
        ("sqrt(r, key=1)", "is not allowed"),
        ("sqrt(*r)", "'*r' is not allowed"),
        ("sqrt()", "'sqrt()' is not allowed"),
        ("sqrt(r, r)", "sqrt takes one argument"),
        ("eval('r')", "is not allowed"),
        ("f'{r}'", "is not allowed"),
        ("r @ r", "is not allowed"),
        ("r < 1", "is not allowed"),
        ("(r := 1)", "is not allowed"),
        ("x * r", "'x' is unknown; there are pi, r"),
        ("", "is not a formula"),
        ("r +", "is not a formula"),
        ("1j * r", "'1j' is not allowed"),
        ("((((" * 200 + "r", "has 801 characters; 500 are allowed"),
        ("-" * 400 + "r", "is nested too deeply"),
        ("r" * 501, "has 501 characters; 500 are allowed"),
        ("r;r", "is not a formula"),
        ("r\x00", "is not a formula"),
    ],
)
def test_nothing_but_a_formula_is_let_through(formula, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        parse_formula(formula, {})


def test_formula_functions():
    formula = parse_formula("abs(-r) + min(r, 2, 3) * max(1, r)^2 - exp(log(r)) / pi + atan(tan(r/9))", {})
    r = np.array([0.5, 1.5, 4.0])
    expected = r + np.minimum(r, 2) * np.maximum(1, r) ** 2 - r / math.pi + r / 9
    np.testing.assert_allclose(formula(r), expected, rtol=1e-14)
