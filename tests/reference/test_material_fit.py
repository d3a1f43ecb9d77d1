"""Laws: one expression gives moduli, relaxation and creep; fits to tables, alone and together with palpations."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from palpate_engine import registry
from palpate_kit.numerics.material_laws import LAWS, inverse_laplace, law_of
from palpate_reference.fit_command import material_fits
from palpate_reference.fit_problem import FitProblem, predictions
from palpate_reference.law_fit import supported_fits
from palpate_reference.material_table import MaterialTable
from palpate_reference.table_fit import fit_law

TIME = np.geomspace(0.03, 15.0, 12)
VALUES = {
    "kelvin-voigt": (1e5, 300.0),
    "maxwell": (1e5, 2e5),
    "standard-linear-solid": (8e4, 4e4, 0.7),
    "generalised-maxwell-2": (8e4, 4e4, 0.1, 2e4, 3.0),
    "generalised-maxwell-3": (8e4, 4e4, 0.1, 2e4, 1.0, 1e4, 9.0),
    "generalised-maxwell-4": (8e4, 4e4, 0.05, 2e4, 0.5, 1e4, 3.0, 5e3, 9.0),
    "burgers": (1e5, 4e5, 5e4, 3e4),
    "power-law": (1e5, 0.2),
    "fractional-kelvin-voigt": (5e4, 6e4, 0.3),
    "fractional-maxwell": (8e5, 0.67, 2e4, 0.11),
}


def test_every_law_has_values():
    assert [law.name for law in LAWS] == list(VALUES)


@pytest.mark.parametrize("name", [name for name in VALUES if name != "fractional-maxwell"])
def test_a_law_is_that_of_the_contact_model_of_its_name(name):
    """Same parameters by name; E(t) is the model's sum of exponentials, of fractional models within their 1 %."""
    law, parts = law_of(name), registry.load()
    kelvin_voigt = name == "kelvin-voigt"  # the contact model of this name is a spring and a damper at the tip
    model = parts.find("model", "dimensionality-reduction" if kelvin_voigt else name)
    assert [name for name, _ in law.parameters] == [parameter.name for parameter in model.parameters]
    assert [unit for _, unit in law.parameters] == [parameter.unit for parameter in model.parameters]
    if kelvin_voigt:
        return
    values = VALUES[name]
    tip = parts.find("indenter", "sphere")(radius=5e-3)
    spectrum = model(indenter=tip).spectrum(values)
    expected = (spectrum.lasting or 0.0) + sum(e * np.exp(-TIME * rate) for e, rate in spectrum.arms)
    tolerance = 0.01 if "fractional" in name or name == "power-law" else 1e-9
    np.testing.assert_allclose(law.relaxation(TIME, values, 0.5), expected, rtol=tolerance)


@pytest.mark.parametrize("name", VALUES)
def test_creep_and_relaxation_are_of_one_material(name):
    """int_0^t E(t - s) D(s) ds = t (Findley, Lai and Onaran 1976), by its transform: s^2 E~ D~ = 1 on the way back."""
    law, values = law_of(name), VALUES[name]
    if name == "kelvin-voigt":
        expected = (1 - np.exp(-TIME * values[0] / (3 * values[1]))) / values[0]
        np.testing.assert_allclose(law.creep(TIME, values, 0.5), expected, rtol=1e-9)
        return
    nodes, weights = np.polynomial.legendre.leggauss(60)
    share = (0.5 * (nodes + 1.0)) ** 6  # both ends may be singular: crowd the nodes there
    weight = 3.0 * weights * (0.5 * (nodes + 1.0)) ** 5
    for t in (0.3, 4.0):
        half = 0.5 * t
        first = law.relaxation(share * half, values, 0.5) * law.creep(t - share * half, values, 0.5)
        second = law.relaxation(t - share * half, values, 0.5) * law.creep(share * half, values, 0.5)
        assert half * float(weight @ (first + second)) == pytest.approx(t, rel=1e-5)


def test_two_springpots_creep_as_the_sum_of_their_powers():
    """D(t) = t^alpha/(V Gamma(1 + alpha)) + t^beta/(G Gamma(1 + beta)): Jaishankar and McKinley 2013."""
    v, alpha, g, beta = VALUES["fractional-maxwell"]
    expected = TIME**alpha / (v * math.gamma(1 + alpha)) + TIME**beta / (g * math.gamma(1 + beta))
    np.testing.assert_allclose(law_of("fractional-maxwell").creep(TIME, (v, alpha, g, beta), 0.5), expected, rtol=1e-9)


def test_relaxation_of_a_half_power_is_erfcx():
    """With alpha 1 (a dashpot) and beta 1/2, E(t) = G t^-1/2 E_{1/2,1/2}(-x), x = G sqrt(t)/V: by erfcx."""
    from scipy.special import erfcx

    v, g = 3.0, 2.0
    x = g / v * np.sqrt(TIME)
    expected = g / np.sqrt(TIME) * (1 / math.sqrt(math.pi) - x * erfcx(x))
    np.testing.assert_allclose(
        law_of("fractional-maxwell").relaxation(TIME, (v, 1.0, g, 0.5), 0.5), expected, rtol=1e-9
    )


@pytest.mark.parametrize("power", [0.0, 0.5, 1.0, 2.5])
def test_transforms_of_powers(power):
    found = inverse_laplace(lambda s: s ** -(power + 1.0), TIME)
    np.testing.assert_allclose(found, TIME**power / math.gamma(power + 1.0), rtol=1e-10)


def table(law, values, kind="oscillation", shear=True, noise=0.0, seed=1, std=None, poisson=0.5, scale=1.0):
    """What an instrument would write of a material."""
    x = np.geomspace(0.05, 20.0, 15)
    blank = MaterialTable("t", kind, "table", kind, shear, x, np.ones((15, 1)), None, None, None)
    y = predictions(law, blank, values, poisson)
    y = scale * y * np.exp(noise * np.random.default_rng(seed).standard_normal(y.shape))
    return replace(blank, y=y, std=None if std is None else std * y)


@pytest.mark.parametrize("kind", ["oscillation", "relaxation", "creep"])
@pytest.mark.parametrize("name", ["standard-linear-solid", "fractional-kelvin-voigt"])
def test_values_come_back_from_what_they_predict(name, kind):
    law = law_of(name)
    fit = fit_law(law, FitProblem((table(law, VALUES[name], kind),), 0.5, 0.0, (0.0,)))
    np.testing.assert_allclose(fit.values, VALUES[name], rtol=1e-4)


@pytest.mark.slow
def test_stated_uncertainties_cover():
    """Of 20 pairs of tables some 68 % of the values are within one standard uncertainty."""
    law, inside, count = law_of("standard-linear-solid"), 0, 20
    truth = np.array(VALUES[law.name])
    for seed in range(count):
        both = tuple(
            table(law, truth, kind, noise=0.02, seed=2 * seed + k)
            for k, kind in enumerate(("oscillation", "relaxation"))
        )
        fit = fit_law(law, FitProblem(both, 0.5, 0.0, (0.0, 0.0)))
        inside += int((np.abs(fit.values - truth) < fit.stds).sum())
    assert 0.5 < inside / (3 * count) < 0.87


def test_the_budget_is_the_uncertainty():
    """Sources add in squares; an error of the scale moves elasticities by itself, and no time."""
    law = law_of("standard-linear-solid")
    one = table(law, VALUES[law.name], noise=0.01, std=0.01)
    fit = fit_law(law, FitProblem((one,), 0.5, 0.0115, (0.03,)))
    together = np.sqrt(sum(share**2 for share in fit.budget.values()))
    np.testing.assert_allclose(together, fit.stds, rtol=1e-6)
    scale, poisson = fit.budget["scale of t: oscillation"] / fit.values, fit.budget["poisson"] / fit.values
    np.testing.assert_allclose(scale, [0.03, 0.03, 0.0], atol=1e-5)
    np.testing.assert_allclose(poisson[:2], 0.0115 / 1.5, rtol=1e-3)
    assert fit.p > 1e-3


@pytest.mark.parametrize("scale", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("kind", ["oscillation", "creep", "relaxation"])
@pytest.mark.parametrize("name", ["kelvin-voigt", "standard-linear-solid"])
def test_a_table_without_noise_keeps_the_uncertainty_of_its_scale(name, kind, scale):
    if (name, kind) == ("kelvin-voigt", "relaxation"):
        return  # an impulse, which no table has
    law = law_of(name)
    fit = fit_law(law, FitProblem((table(law, VALUES[name], kind=kind),), 0.5, 0.0, (scale,)))
    np.testing.assert_allclose(fit.values, VALUES[name], rtol=1e-5)
    expected = [scale * (unit != "s") for _, unit in law.parameters]
    np.testing.assert_allclose(fit.stds / fit.values, expected, rtol=1e-3, atol=1e-5)
    assert fit.undetermined == ()


def test_an_error_of_one_scale_is_shared_by_its_table_alone():
    """A rheometer that reads 6 % high with a scale known to 5 % gives way to a palpation that is known to 1 %."""
    law = law_of("standard-linear-solid")
    rheometer = table(law, VALUES[law.name], scale=1.06, noise=0.01)
    palpation = replace(table(law, VALUES[law.name], shear=False, std=0.01), source="run")
    fit = fit_law(law, FitProblem((rheometer, palpation), 0.5, 0.0, (0.05, 0.0)))
    np.testing.assert_allclose(fit.values, VALUES[law.name], rtol=0.01)


def test_the_law_of_the_data_is_chosen():
    law = law_of("power-law")
    fits = material_fits([table(law, VALUES[law.name], noise=0.01)], ["power-law", "kelvin-voigt", "maxwell"], 0.0, 0.5)
    assert fits[0].law is law
    assert [fit.law.name for fit in supported_fits(fits)] == ["power-law"]


def test_what_a_table_does_not_determine_is_said():
    """The lasting part of a material that flows."""
    maxwell = law_of("maxwell")
    fit = fit_law(
        law_of("standard-linear-solid"), FitProblem((table(maxwell, (1e5, 3e4), noise=0.01),), 0.5, 0.0, (0.0,))
    )
    assert "elasticity" in fit.undetermined


def test_an_arm_too_fast_for_a_table_has_no_values():
    """Only the product of strength and time shows of it: a Kelvin-Voigt material."""
    voigt = law_of("kelvin-voigt")
    fit = fit_law(
        law_of("standard-linear-solid"), FitProblem((table(voigt, (1e5, 3e2), noise=0.01),), 0.5, 0.0, (0.0,))
    )
    assert fit.undetermined == ("relaxing_elasticity", "relaxation_time")
    assert fit.stds[0] < 0.02 * fit.values[0]


def written(folder, law, values):
    one = table(law, values, noise=0.005)
    rows = [f"{f:.8g},{a:.8g},{b:.8g}" for f, (a, b) in zip(one.x, one.y, strict=True)]
    (folder / "sweep.csv").write_text("\n".join(["f [Hz],G' [Pa],G'' [Pa]", *rows]) + "\n")


@pytest.mark.gate
@pytest.mark.slow
def test_the_command(palpate, tmp_path):
    law = law_of("standard-linear-solid")
    written(tmp_path, law, VALUES[law.name])
    done = palpate(
        "material", "fit", "sweep.csv", "--law", law.name, "--law", "kelvin-voigt", "--scale", "2 %", "-o", "m"
    )
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "m" / "material.json").read_text())
    best = found["laws"][0]
    assert best["law"] == law.name
    assert best["parameters"]["elasticity"]["value"] == pytest.approx(VALUES[law.name][0], rel=0.02)
    assert best["parameters"]["elasticity"]["std"] > 0.02 * VALUES[law.name][0]
    assert (tmp_path / "m" / "fit.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--law", "maxwel"], "no law 'maxwel'; did you mean 'maxwell'?"),
        (["--scale", "much"], "--scale 'much': write for example '2 %'"),
        (["--scale", "200 %"], "must be from 0 to 100 %"),
        (["strain.csv"], "tension or compression? State --loading"),
        (["strain.csv", "--loading", "tension"], "2 readings are too few for every law"),
        (["strain.csv", "--law", "maxwell"], "no law 'maxwell' of stress over strain (there are: mooney-rivlin"),
        (["strain.csv", "--reference-temperature", "20 °C"], "stress over strain has no time that could be shifted"),
        (["amplitude.csv"], "no modulus over several frequencies or over time"),
        (["empty"], "is not a run folder with a result.json"),
    ],
)
def test_mistakes(palpate, tmp_path, words, said):
    written(tmp_path, law_of("maxwell"), VALUES["maxwell"])
    (tmp_path / "strain.csv").write_text("strain [%],stress [kPa]\n1,2\n2,4\n")
    (tmp_path / "amplitude.csv").write_text("f [Hz],G' [Pa],G'' [Pa],strain [%]\n1,2,3,1\n1,2,3,10\n")
    (tmp_path / "empty").mkdir()
    sources = [] if words[0] in ("strain.csv", "amplitude.csv", "empty") else ["sweep.csv"]
    done = palpate("material", "fit", *sources, *words)
    assert done.returncode == 2
    assert said in done.stderr
