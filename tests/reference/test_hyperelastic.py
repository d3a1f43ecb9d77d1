"""Hyperelastic laws: stress from the strain energy itself, limits, and values with their uncertainty from curves."""

import json

import numpy as np
import pytest
from palpate_reference.hyperelastic.curve_fit import StressCurve, fit_curves
from palpate_reference.hyperelastic.strain_energies import HYPERELASTIC, energy_of, stable_stretches
from palpate_reference.law_fit import supported_fits

VALUES = {
    "neo-hookean": (4e4,),
    "mooney-rivlin": (1.2e4, 9e3),
    "yeoh": (2e4, -1.5e3, 300.0),
    "ogden": (4e4, 5.0),
}


def energy(name, p, principal):
    """W [Pa] of principal stretches, straight from the definitions."""
    i1 = sum(s**2 for s in principal) - 3
    i2 = sum(s**-2 for s in principal) - 3
    return {
        "neo-hookean": lambda: p[0] / 2 * i1,
        "mooney-rivlin": lambda: p[0] * i1 + p[1] * i2,
        "yeoh": lambda: sum(c * i1**k for k, c in enumerate(p, 1)),
        "ogden": lambda: 2 * p[0] / p[1] ** 2 * (sum(s ** p[1] for s in principal) - 3),
    }[name]()


@pytest.mark.parametrize("name", VALUES)
def test_stress_is_the_slope_of_the_energy(name):
    """Nominal stress dW/dlambda in tension and compression; shear stress dW/dgamma with stretches s, 1/s and 1."""
    law, p, step = energy_of(name), VALUES[name], 1e-5
    for stretch in (0.5, 0.9, 1.3, 2.5):
        above, below = (energy(name, p, (s, s**-0.5, s**-0.5)) for s in (stretch + step, stretch - step))
        assert law.uniaxial(np.array([stretch]), p)[0] == pytest.approx((above - below) / (2 * step), rel=1e-7)
    for shear in (0.2, 1.0):
        ends = [g / 2 + np.hypot(1, g / 2) for g in (shear + step, shear - step)]
        above, below = (energy(name, p, (s, 1 / s, 1.0)) for s in ends)
        assert law.shear(np.array([shear]), p)[0] == pytest.approx((above - below) / (2 * step), rel=1e-7)


@pytest.mark.parametrize("law", HYPERELASTIC, ids=lambda law: law.name)
def test_small_strains_are_those_of_the_linear_solid(law):
    """E = 3 G in tension, G in shear."""
    p, small = VALUES[law.name], np.array([1e-6])
    assert law.shear(small, p)[0] / 1e-6 == pytest.approx(law.shear_modulus(p), rel=1e-4)
    assert law.uniaxial(1 + small, p)[0] / 1e-6 == pytest.approx(3 * law.shear_modulus(p), rel=1e-4)


def test_all_laws_contain_the_neo_hookean_solid():
    stretch = np.array([0.4, 0.8, 1.5, 3.0])
    expected = energy_of("neo-hookean").uniaxial(stretch, (4e4,))
    for name, p in (("mooney-rivlin", (2e4, 0.0)), ("yeoh", (2e4, 0.0, 0.0)), ("ogden", (4e4, 2.0))):
        np.testing.assert_allclose(energy_of(name).uniaxial(stretch, p), expected, rtol=1e-12)


def test_where_a_solid_is_stable():
    """A neo-Hookean solid always; one with C01 < 0 not when it is compressed; a Yeoh solid that softens not beyond."""
    assert stable_stretches(energy_of("neo-hookean"), (1.0,)) == pytest.approx((0.2, 5.0))
    low, high = stable_stretches(energy_of("mooney-rivlin"), (2.0, -0.5))
    assert 0.2 < low < 0.6
    assert high == pytest.approx(5.0)
    low, high = stable_stretches(energy_of("yeoh"), (1.0, -0.1, 0.0))
    assert high < 3.0


def curve(name, loading="tension", noise=0.005, seed=0, most=1.5):
    """What a dynamometer reads."""
    law, x = energy_of(name), np.linspace(1.02, 1 + most, 40)
    x = {"tension": x, "compression": np.linspace(0.98, 0.5, 40), "shear": x - 1}[loading]
    stress = (law.shear if loading == "shear" else law.uniaxial)(x, VALUES[name])
    noisy = stress + noise * np.abs(stress).max() * np.random.default_rng(seed).standard_normal(len(x))
    return StressCurve(loading, loading, x, noisy)


@pytest.mark.parametrize("name", VALUES)
def test_values_come_back_with_their_uncertainty(name):
    """Over seeds, of tension and compression together."""
    errors = []
    for seed in range(8):
        curves = [curve(name, loading, seed=2 * seed + k) for k, loading in enumerate(("tension", "compression"))]
        fit = fit_curves(energy_of(name), curves, 0.0)
        errors += list((fit.values - VALUES[name]) / fit.stds)
    assert 0.5 < np.sqrt(np.mean(np.square(errors))) < 1.5


def test_the_law_of_the_curve_is_chosen():
    fits = [fit_curves(law, [curve("ogden", noise=0.002)], 0.0) for law in HYPERELASTIC]
    fits = sorted((fit for fit in fits if fit), key=lambda fit: fit.bic)
    assert fits[0].law.name == "ogden"
    assert {"neo-hookean", "mooney-rivlin"}.isdisjoint(fit.law.name for fit in supported_fits(fits))


def test_the_scale_moves_moduli_alone():
    fit = fit_curves(energy_of("ogden"), [curve("ogden", noise=1e-4)], 0.03)
    np.testing.assert_allclose(fit.budget["scale"] / fit.values, [0.03, 0.0], atol=1e-9)
    assert fit.stds[0] == pytest.approx(0.03 * fit.values[0], rel=0.02)


def test_shear_alone_does_not_part_mooneys_constants():
    assert fit_curves(energy_of("mooney-rivlin"), [curve("mooney-rivlin", "shear")], 0.0) is None


def written(folder, loading="tension", sign=1.0):
    one = curve("yeoh", loading)
    rows = [f"{sign * 100 * abs(x - 1):.6f},{sign * abs(s):.6f}" for x, s in zip(one.x, one.stress, strict=True)]
    (folder / "pull.csv").write_text("\n".join(["strain [%],stress [Pa]", *rows]) + "\n")


@pytest.mark.slow
def test_the_command_and_its_card(palpate, tmp_path):
    written(tmp_path)
    done = palpate("material", "fit", "pull.csv", "--loading", "tension", "--scale", "1 %", "-o", "m")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "m" / "material.json").read_text())
    assert found["laws"][0]["law"] == "yeoh"
    c10 = found["laws"][0]["parameters"]["C10"]
    assert abs(c10["value"] - 2e4) < 3 * c10["std"]
    assert c10["budget"]["scale"] == pytest.approx(0.01 * c10["value"])
    assert (tmp_path / "m" / "fit.png").stat().st_size > 5000
    card = palpate("material", "card", "m", "--to", "abaqus")
    assert "*HYPERELASTIC, YEOH" in card.stdout, card.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("sign", "words"), [(-1.0, ()), (1.0, ("--loading", "compression"))])
def test_a_compression_in_either_sign(palpate, tmp_path, sign, words):
    written(tmp_path, "compression", sign)
    found = json.loads(palpate("material", "fit", "pull.csv", "--law", "yeoh", *words, "-o", "m", "--json").stdout)
    c10 = found["laws"][0]["parameters"]["C10"]
    assert abs(c10["value"] - 2e4) < 4 * c10["std"]


@pytest.mark.parametrize(
    ("rows", "loading", "said"),
    [
        ("10,1\n50,2\n100,3\n", "compression", "a compression by 100 % is impossible"),
        ("1,-1\n2,-2\n3,-3\n4,-4\n5,-5\n", "tension", "the stress does not rise with the strain, in tension"),
        ("0,0\n0,0\n0,0\n0,0\n0,0\n", "tension", "the stress does not rise with the strain, in tension"),
        ("1,1\n2,nan\n", "tension", "pull.csv:3, column 2 'stress [Pa]': 'nan' is not a finite number"),
        ("1,1\n2\n", "tension", "pull.csv:3, column 2 'stress [Pa]': the line ends before it"),
        ("1,1\n2,2\n", "tension", "2 readings are too few for every law"),
    ],
)
def test_curves_that_no_solid_has(palpate, tmp_path, rows, loading, said):
    (tmp_path / "pull.csv").write_text(f"strain [%],stress [Pa]\n{rows}")
    done = palpate("material", "fit", "pull.csv", "--loading", loading)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
