"""Formulas of docstrings as LaTeX, and as the MathML of the site."""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

import pytest
from palpate.registry import load

DOCS = Path(__file__).parent.parent / "docs"
_SPEC = importlib.util.spec_from_file_location("formulas", DOCS / "formulas.py")
formulas = importlib.util.module_from_spec(_SPEC)
sys.modules["formulas"] = formulas
_SPEC.loader.exec_module(formulas)
PARTS = [(kind, name) for kind, entries in load().parts.items() for name in entries]


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("a(d) = sqrt(R d)", r"a\left(d\right) = \sqrt{R\,d}"),
        ("A(d) = (2/3) sqrt(R) d^1.5", r"A\left(d\right) = \frac{2}{3}\,\sqrt{R}\,d^{1.5}"),
        ("2 E/(1 - nu^2) A(d)", r"\frac{2\,E}{1 - \nu^{2}}\,A\left(d\right)"),
        ("4 eta/(1 - nu) a(d) d'", r"\frac{4\,\eta}{1 - \nu}\,a\left(d\right)\,\dot{d}"),
        ("u = m d''", r"u = m\,\ddot{d}"),
        ("dq/dt = -q/tau", r"\frac{\mathrm{d}q}{\mathrm{d}t} = \frac{-q}{\tau}"),
        ("z = r tan(t)", r"z = r\,\tan \left(t\right)"),
        ("d^2/(pi tan t)", r"\frac{d^{2}}{\pi\,\tan t}"),
        ("(f2/f1)^(t/T)", r"\left(\frac{f_{2}}{f_{1}}\right)^{\frac{t}{T}}"),
        ("2 R E* d", r"2\,R\,E^{*}\,d"),
        ("E*^2 R", r"{E^{*}}^{2}\,R"),
        ("c_4 = 1e7", r"c_{4} = 10^{7}"),
        ("a >= b", r"a \ge b"),
        ("max(r - b, 0)", r"\max \left(r - b, 0\right)"),
        ("(a + b)/((c) (d))", r"\frac{a + b}{\left(c\right)\,\left(d\right)}"),
        ("a +", None),
        ("(a", None),
        ("mean value", None),
        ("", None),
    ],
)
def test_a_formula_is_latex(text, latex):
    assert formulas.latex_of(text) == latex


@pytest.mark.parametrize(
    "prose",
    [
        "A sphere of radius R has a face, and an axis.",
        "K [N/m] and B [N s/m] belong to the tip.",
        "It costs 0.1 %, 1 % and 10 % (see above).",
        "`a = b` stays code, and so does ``x^2``.",
        "ATI's Net F/T box",
        "in N/mm^n, in a unit",
    ],
)
def test_prose_stays_prose(prose):
    assert formulas.with_math(prose).replace("\\", "") == prose


def test_a_formula_within_a_sentence_is_found():
    found = formulas.with_math("The force F = K d + B d', by `kelvin-voigt` [N]; at d/R = 0.01 it is *not* so.")
    assert found == (
        r"The force $F = K\,d + B\,\dot{d}$, by `kelvin-voigt` \[N\]; at $\frac{d}{R} = 0.01$ it is \*not\* so."
    )


@pytest.mark.parametrize(("kind", "name"), PARTS)
def test_every_part_has_formulas_that_can_be_drawn(kind, name):
    """And what is between them has lost no letter."""
    convert = pytest.importorskip("latex2mathml.converter").convert
    text = inspect.getdoc(load().find(kind, name)) or ""
    shown = formulas.with_math(text)
    found = re.findall(r"(?<!\\)\$(.+?)(?<!\\)\$", shown, re.DOTALL)
    for latex in found:
        assert convert(latex).startswith("<math")
        assert "\n" not in latex
        assert latex.count("{") == latex.count("}")
    if kind == "model":
        assert any("=" in latex for latex in found), shown
    words = set(re.findall(r"[A-Za-z]{4,}", re.sub(r"(?<!\\)\$.+?(?<!\\)\$", " ", shown, flags=re.DOTALL)))
    known = set(re.findall(r"[A-Za-z]{4,}", text))
    assert words <= known
    assert (
        known - words <= {"sqrt", "atan", "acos", "Gamma", "sphere", "surf", "tan"} | formulas._WORDS | formulas._GREEK
    )
