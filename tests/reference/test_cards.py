"""Cards: each program's text says the same series, and is read back."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from palpate_kit.numerics.material_laws import law_of
from palpate_reference.cards.card_formats import FORMATS
from palpate_reference.cards.hyperelastic_cards import HYPERELASTIC_CARDS, HyperelasticSolid
from palpate_reference.cards.prony_series import PronySeries, series_of_law
from palpate_reference.hyperelastic.strain_energies import HYPERELASTIC

SERIES = PronySeries(20e3, ((10e3, 0.05), (6e3, 0.5), (3e3, 5.0), (1e3, 50.0)), 0.45, ("a law: E -- E_1", "u = 3"))


def fit_document(law="burgers", values=(1e5, 4e5, 5e4, 3e4), poisson=0.5):
    names = law_of(law).parameters
    return {
        "poisson": poisson,
        "laws": [
            {
                "law": law,
                "formula": "E*",
                "parameters": {
                    name: {"value": value, "std": 0.1 * value, "unit": unit}
                    for (name, unit), value in zip(names, values, strict=True)
                },
            }
        ],
    }


@pytest.mark.parametrize("program", FORMATS)
@pytest.mark.parametrize("poisson", [0.3, 0.45, 0.5])
@pytest.mark.parametrize("count", [1, 4])
def test_what_is_written_is_read(program, poisson, count):
    series = PronySeries(SERIES.lasting, SERIES.arms[:count], poisson, SERIES.remarks)
    text = FORMATS[program].text(series)
    back = FORMATS[program].series(text)
    np.testing.assert_allclose(back.arms, series.arms, rtol=1e-10)
    assert back.lasting == pytest.approx(series.lasting, rel=1e-9)
    known = min(poisson, 0.495) if program == "febio" else poisson  # FEBio's solid has a finite bulk modulus
    assert back.poisson == pytest.approx(known, rel=1e-9)
    assert "u = 3" in text


def test_numbers_of_the_keywords():
    """C10 = G_0/2, D1 = 2/K_0 with K = 2 G (1 + nu)/(3 (1 - 2 nu)); mu_0 and d of ANSYS are G_0 and 2/K_0."""
    bulk = 2 * 40e3 * 1.45 / (3 * 0.1)
    lines = FORMATS["abaqus"].text(SERIES).splitlines()
    first = lines[lines.index("*HYPERELASTIC, NEO HOOKE, MODULI=INSTANTANEOUS") + 1]
    np.testing.assert_allclose([float(cell) for cell in first.split(",")], [20e3, 2 / bulk])
    assert lines[-4] == "0.25, 0.25, 0.05"
    assert "TBDATA,1,40000," in FORMATS["ansys"].text(SERIES)
    assert "TB,PRONY,1,1,4,BULK" in FORMATS["ansys"].text(SERIES)
    root = ET.fromstring(FORMATS["febio"].text(SERIES))
    assert float(root.find("g0").text) == pytest.approx(0.5)
    assert float(root.find("elastic/E").text) == pytest.approx(2 * 1.45 * 40e3)


@pytest.mark.parametrize(
    ("law", "values"),
    [("maxwell", (1e5, 2e5)), ("standard-linear-solid", (8e4, 4e4, 0.7)), ("burgers", (1e5, 4e5, 5e4, 3e4))],
)
@pytest.mark.parametrize("poisson", [0.4, 0.5])
def test_a_series_relaxes_as_its_law(law, values, poisson):
    series = series_of_law(fit_document(law, values, poisson)["laws"][0], poisson)
    time = np.geomspace(0.03, 15.0, 9)
    shear = series.lasting + sum(g * np.exp(-time / tau) for g, tau in series.arms)
    np.testing.assert_allclose(2 * (1 + poisson) * shear, law_of(law).relaxation(time, values, poisson), rtol=1e-7)


def test_the_command_turns_a_fit_into_cards_and_one_card_into_another(palpate, tmp_path):
    (tmp_path / "material.json").write_text(json.dumps(fit_document()))
    done = palpate("material", "card", "material.json", "--to", "abaqus", "-o", "a.inp")
    assert done.returncode == 0, done.stderr
    assert "elasticity = 100000 Pa, u = 1e+04 Pa" in (tmp_path / "a.inp").read_text()
    printed = palpate("material", "card", "a.inp", "--to", "comsol").stdout
    direct = palpate("material", "card", ".", "--to", "comsol").stdout
    found, known = (FORMATS["comsol"].series(text).arms for text in (printed, direct))
    np.testing.assert_allclose(found, known, rtol=1e-9)


SOLIDS = {
    "neo-hookean": (4e4,),
    "mooney-rivlin": (1.5e4, -5e3),
    "yeoh": (2e4, -3e3, 800.0),
    "ogden": (4e4, -6.5),
}


@pytest.mark.parametrize("program", HYPERELASTIC_CARDS)
@pytest.mark.parametrize("law", [law.name for law in HYPERELASTIC])
def test_a_solid_is_handed_on(palpate, tmp_path, program, law):
    """Its values come back; and any program's card becomes any other's."""
    document = {"poisson": 0.5, "laws": [{"law": law, "formula": "W", "parameters": {
        f"p{k}": {"value": value, "std": 3.0, "unit": "Pa"} for k, value in enumerate(SOLIDS[law])}}]}  # fmt: skip
    (tmp_path / "material.json").write_text(json.dumps(document))
    done = palpate("material", "card", ".", "--to", program, "-o", "card.txt")
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "card.txt").read_text()
    assert "u = 3 Pa" in text
    solid = HYPERELASTIC_CARDS[program].solid(text)
    assert (solid.law, solid.values) == (law, pytest.approx(SOLIDS[law], rel=1e-10))
    for other in HYPERELASTIC_CARDS:
        turned = palpate("material", "card", "card.txt", "--to", other).stdout
        assert HYPERELASTIC_CARDS[other].solid(turned).values == pytest.approx(SOLIDS[law], rel=1e-9)


def test_constants_of_the_programs():
    """The same Ogden solid: 2 mu/alpha^2 (sum - 3) of Abaqus, mu/alpha (sum - 3) of ANSYS, c/m^2 (sum - 3) of FEBio."""
    solid = HyperelasticSolid("ogden", (3e4, 4.0))
    texts = {program: form.text(solid) for program, form in HYPERELASTIC_CARDS.items()}
    assert texts["abaqus"].endswith("*HYPERELASTIC, N=1, OGDEN\n30000, 4, 0.\n")
    assert texts["ansys"].endswith("TB,HYPER,1,1,1,OGDEN\nTBDATA,1,15000,4,0\n")
    root = ET.fromstring(texts["febio"])
    assert [float(root.find(name).text) for name in ("c1", "m1")] == [6e4, 4.0]
    assert float(root.find("k").text) == pytest.approx(2 * 3e4 * 1.495 / 0.03)


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        (json.dumps(fit_document()), ("--law", "burger"), "has no law 'burger'; did you mean 'burgers'?"),
        (json.dumps(fit_document("power-law", (1e5, 0.2))), (), "power-law is not a Prony series; fit one"),
        ("{}", (), "is not a material.json"),
        ("*HYPERELASTIC\n", (), "is not a whole card of abaqus"),
        ("", (), "is not a material.json"),
    ],
)
def test_mistakes(palpate, tmp_path, text, words, said):
    (tmp_path / "x.json").write_text(text)
    done = palpate("material", "card", "x.json", "--to", "febio", *words)
    assert done.returncode == 2
    assert said in done.stderr
