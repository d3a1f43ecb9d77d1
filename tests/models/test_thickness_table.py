"""A thickness factor from a file, and finite elements that make one."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_engine.cli import call
from palpate_models import DimensionalityReduction, ExactSphere, Flat, Sphere
from palpate_models.rigid_tip import rounded_flat
from palpate_models.thickness import Thickness
from palpate_models.thickness_table import read_table, table_text, tip_facts
from palpate_testing import check_model

TIP = Sphere(radius=5e-3)
DEPTHS = 5e-3 * np.linspace(0.1, 1.0, 10) ** 2


def dimitriadis(depth):
    return Thickness(law="dimitriadis", height=22e-3).factor(TIP, depth)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "layer.csv"
    path.write_text(table_text({"tip": tip_facts(TIP), "height": 22e-3}, DEPTHS, dimitriadis(DEPTHS)[0]))
    return path


def test_a_table_of_a_known_law_is_that_law(file):
    found = Thickness(table=file)
    for depth in np.geomspace(1e-5, 5e-3, 20):
        value, slope = found.factor(TIP, depth)
        truth, rise = dimitriadis(depth)
        assert value == pytest.approx(truth, rel=1e-6)
        assert slope == pytest.approx(rise, rel=1e-4, abs=1e-6)
    assert not found.validity(TIP, 5e-3)
    assert "ends at 5 mm" in found.validity(TIP, 6e-3)


def test_a_model_with_a_table_passes_its_check(file):
    model = DimensionalityReduction(indenter=TIP, thickness={"table": str(file)})
    check_model(model, [1e5, 300.0], np.geomspace(1e-6, 5e-3, 30))


def test_a_table_of_another_tip_is_refused(file):
    with pytest.raises(ConfigurationError, match="not for"):
        DimensionalityReduction(indenter=ExactSphere(radius=5e-3), thickness={"table": str(file)})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "first line"),
        ("depth [m],factor\n1e-3,1.1\n", "rows"),
        ("depth [m],factor\n" + "1e-3,1.1\n" * 6, "rise"),
        ("depth [m],factor\n" + "".join(f"{k}e-3,nan\n" for k in range(1, 7)), "above 0"),
        ("depth [m],factor\n" + "".join(f"{k}e-3,{1 + k % 2}\n" for k in range(1, 9)), "smooth"),
        ("depth [m],factor\na,b\n", "float"),
    ],
)
def test_what_is_no_table_is_refused(text, words, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        read_table(path)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "needs a table"),
        ({"law": "dimitriadis"}, "needs the height"),
        ({"law": "garcia", "table": "layer.csv", "height": 0.02}, "law = "),
    ],
)
def test_a_law_has_what_belongs_to_it(settings, words):
    with pytest.raises(ConfigurationError, match=words):
        Thickness(**settings)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--diameter", "50 mm", "--height", "22 mm", "--depth", "12 mm"], "half of the height"),
        (["--diameter", "5 mm", "--height", "22 mm", "--depth", "4 mm"], "edge"),
        (["--diameter", "50 kg", "--height", "22 mm"], "--diameter"),
        (["--diameter", "50 mm", "--height", "22 mm", "--tip", "tilted-flat"], "sharp edge|angle"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_sentence(options, words, tmp_path):
    pytest.importorskip("skfem", reason="scikit-fem is not installed")
    with pytest.raises(ConfigurationError, match=words):
        call(["model", "thickness", *options, "--set", "radius=5 mm", "--out", str(tmp_path / "t.csv")])


@pytest.mark.slow
def test_compression_between_plates_that_hold():
    """1.705 at zero strain for D/H = 2.32; these few elements are 1 % stiffer."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed")
    from palpate_models.finite_elements import Cylinder, SoftCylinder

    height, diameter = 22e-3, 2.32 * 22e-3
    soft = SoftCylinder(Cylinder(diameter, height), diameter / 2, 16)
    factor = soft.compress(1e-4) / (1e-4 * math.pi * diameter**2 / 4)
    assert 1.705 < factor < 1.705 * 1.02


def finite_cylinder(depth):
    """Force over modulus [m^2] of a real sphere R 5 mm on the bonded cylinder of 50 by 22 mm."""
    law = Thickness(law="finite-cylinder", height=22e-3, diameter=50e-3, bonded=True)
    return 8 / 3 * TIP.profile_area(depth) * law.factor(TIP, depth)[0]


def told(tmp_path, *options):
    out = tmp_path / "table.csv"
    call(
        [
            "model",
            "thickness",
            "--diameter",
            "50mm",
            "--height",
            "22mm",
            "--set",
            "radius='5 mm'",
            "--out",
            str(out),
            *options,
        ]
    )
    return out


@pytest.mark.slow
def test_a_coarse_mesh_is_near_the_formula_and_a_model_takes_its_table(tmp_path):
    """The rows of eight elements are within 2.3 %; those of twenty within 0.6 %, down to 5 mm."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed")
    out = told(tmp_path, "--fine", "8", "--depth", "1.5 mm", "--points", "5")
    tip = ExactSphere(radius=5e-3)
    model = DimensionalityReduction(indenter=tip, thickness={"table": str(out)})
    for depth in (0.3e-3, 0.7e-3, 1.5e-3):
        assert model.force(depth, 0.0, [1.0, 0.0]) == pytest.approx(finite_cylinder(depth), rel=0.025)


@pytest.mark.slow
def test_a_flat_tip_on_a_wide_layer_is_garcias(tmp_path):
    """Radius over height 0.25: 1.372 at all depths; these twelve elements are within 2.5 %."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed")
    out, tip = tmp_path / "flat.csv", Flat(radius=5e-3)
    options = ["--tip", "flat", "--set", "radius='5 mm'", "--fine", "12", "--depth", "0.4 mm", "--points", "5"]
    call(["model", "thickness", "--diameter", "80 mm", "--height", "20 mm", "--out", str(out), *options])
    law = Thickness(law="garcia", height=20e-3).factor(tip, 0.4e-3)[0]
    table = read_table(out)
    assert table.at_touch == pytest.approx(law, rel=0.025)
    model = DimensionalityReduction(indenter=tip, thickness={"table": str(out)})
    for depth in (1e-5, 0.1e-3, 0.4e-3):
        assert model.force(depth, 0.0, [1.0, 0.0]) == pytest.approx(8 / 3 * 5e-3 * depth * law, rel=0.04)
    with pytest.raises(ValueError, match="not for"):
        table.refuse(Flat(radius=6e-3))


@pytest.mark.parametrize("depth", [1e-5, 1e-4, 1e-3])
def test_a_rounded_edge_touches_out_to_the_radius(depth):
    """By the reduced profile of its shape, integrated by quadrature, which knows nothing of its closed form."""
    profile, area = rounded_flat(5e-3, depth)
    x = np.linspace(0.0, 5e-3, 2001)[1:]
    angle = (np.arange(2000) + 0.5) / 2000 * np.pi / 2  # r = x sin(angle)
    reduced = np.array([one * np.mean(profile.slope(one * np.sin(angle))) * np.pi / 2 for one in x])
    assert reduced[-1] == pytest.approx(depth, rel=1e-3)
    assert area == pytest.approx(np.trapezoid(depth - reduced, x) + depth * x[0], rel=1e-3)


def without_equilibrium(rows):
    def pressed(cylinder, tip, depths, fine, until):
        from palpate_models.finite_elements import NoEquilibriumError

        yield from (finite_cylinder(depth) for depth in depths[:rows].tolist())
        raise NoEquilibriumError("no equilibrium was found at a depth of 4 mm")

    return pressed


def test_a_table_ends_where_no_equilibrium_is_found(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("palpate_models.finite_elements.press_cylinder", without_equilibrium(6))
    table = read_table(told(tmp_path))
    assert table.deepest == pytest.approx(5e-3 * (0.3 + 0.7 * 5 / 9) ** 2)
    assert "no equilibrium was found at a depth of 4 mm: the table ends at 2.37 mm" in capsys.readouterr().err


def test_too_few_rows_are_no_table(tmp_path, monkeypatch):
    monkeypatch.setattr("palpate_models.finite_elements.press_cylinder", without_equilibrium(4))
    with pytest.raises(ConfigurationError, match=r"no equilibrium .* 4 rows are not a table"):
        told(tmp_path)
    assert not list(tmp_path.iterdir())


def test_time_is_bounded(tmp_path):
    pytest.importorskip("skfem", reason="scikit-fem is not installed")
    with pytest.raises(ConfigurationError, match="the time limit was reached on the way"):
        told(tmp_path, "--fine", "8", "--limit", "1 us")


def test_rows_that_scatter_are_no_table(tmp_path, monkeypatch):
    def pressed(cylinder, tip, depths, fine, until):
        yield from ((1 + 0.1 * (-1) ** k) * finite_cylinder(depth) for k, depth in enumerate(depths.tolist()))

    monkeypatch.setattr("palpate_models.finite_elements.press_cylinder", pressed)
    with pytest.raises(ConfigurationError, match="scatter"):
        told(tmp_path)
