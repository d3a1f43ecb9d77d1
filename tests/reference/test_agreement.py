"""Agreement: statistics by published examples and closed identities, and the command over runs and tables."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from palpate import Indenter
from palpate_engine import registry
from palpate_kit.numerics.precision import method_correlation, precision, repeat_correlation
from palpate_reference.agreement.bland_altman import deming_line, limits_of_agreement
from palpate_reference.run_values import conditions_of

# Peak expiratory flow [l/min] of 17 subjects by two meters, first readings: Bland and Altman 1986, table 1.
LARGE = [494, 395, 516, 434, 476, 557, 413, 442, 650, 433, 417, 656, 267, 478, 178, 423, 427]
MINI = [512, 430, 520, 428, 500, 600, 364, 380, 658, 445, 432, 626, 260, 477, 259, 350, 451]
# Six targets rated by four judges: Shrout and Fleiss 1979, table 2.
RATINGS = np.array([[9, 2, 5, 8], [6, 1, 3, 2], [8, 4, 6, 8], [7, 1, 2, 6], [10, 5, 6, 9], [6, 2, 4, 7]], float)
# The paper's tables of elasticity, spheres, flat and quartic tip on two silicones against a dynamometer.
PAPER = """specimen,tip,value [kPa],std [kPa],reference [kPa],reference_std [kPa]
S1,flat,302.3,0.7,282.1,0.3
S2,flat,131.7,0.6,112.5,0.2
S1,sphere 5 mm,311.0,2.1,282.1,0.3
S2,sphere 5 mm,122.1,0.4,112.5,0.2
S1,quartic,283.9,0.9,282.1,0.3
S2,quartic,117.5,0.5,112.5,0.2
S1,sphere 2 mm,276.8,1.4,282.1,0.3
S2,sphere 2 mm,109.7,1.1,112.5,0.2
S1,sphere 10 mm,377.1,1.3,282.1,0.3
S2,sphere 10 mm,175.8,0.8,112.5,0.2
"""


def alone(values):
    return [np.array([float(value)]) for value in values]


def test_limits_of_agreement_as_published():
    """Mean difference -2.1, standard deviation 38.8, limits -79.7 and 75.5 l/min; intervals -22.0 to 17.8, -114.3 to
    -45.1, 40.9 to 110.1 (Bland and Altman 1986; the last two with the standard error sqrt(3 s^2/n), and 2 s).
    """
    found = limits_of_agreement(alone(LARGE), alone(MINI))
    assert found.bias.value == pytest.approx(-2.1, abs=0.05)
    assert found.std == pytest.approx(38.8, abs=0.05)
    assert (found.bias.low, found.bias.high) == pytest.approx((-22.0, 17.8), abs=0.1)
    assert found.lower.value == pytest.approx(-2.1 - 1.96 * 38.8, abs=0.1)
    assert found.upper.value == pytest.approx(-2.1 + 1.96 * 38.8, abs=0.1)
    assert found.lower.high - found.lower.low == pytest.approx(114.3 - 45.1, abs=1.5)
    assert found.upper.high - found.upper.low == pytest.approx(110.1 - 40.9, abs=1.5)


def test_limits_cover_differences_of_single_values():
    """Of 3 repeats with s_w 2 and 1 about differences of s 3, single differences have s^2 = 9 + 4 + 1."""
    random = np.random.default_rng(3)
    level = 100.0 + 20.0 * random.standard_normal(4000)
    own = [one + random.normal(0, 3) + 2.0 * random.standard_normal(3) for one in level]
    other = [one + random.standard_normal(3) for one in level]
    found = limits_of_agreement(own, other)
    assert found.std == pytest.approx(np.sqrt(14.0), rel=0.03)
    assert limits_of_agreement(alone([1, 2]), alone([1, 2])) is None


def test_differences_that_grow_are_found():
    reference = np.linspace(10.0, 100.0, 12)
    assert limits_of_agreement(alone(1.2 * reference), alone(reference)).trend_p < 1e-6


def test_deming_with_equal_errors_is_the_principal_axis():
    x, y = np.array(MINI, float), np.array(LARGE, float)
    values, vectors = np.linalg.eigh(np.cov(x, y))
    slope = vectors[1, np.argmax(values)] / vectors[0, np.argmax(values)]
    assert deming_line(y, x, 1.0).slope.value == pytest.approx(slope, rel=1e-12)


def test_deming_between_the_two_regressions():
    """Exact reference: the regression of y on x; exact values: that of x on y; exchanged methods: its inverse."""
    x, y = np.array(MINI, float), np.array(LARGE, float)
    assert deming_line(y, x, 1e9).slope.value == pytest.approx(np.polyfit(x, y, 1)[0], rel=1e-6)
    assert deming_line(y, x, 1e-9).slope.value == pytest.approx(1 / np.polyfit(y, x, 1)[0], rel=1e-6)
    there, back = deming_line(y, x, 2.0), deming_line(x, y, 0.5)
    assert there.slope.value * back.slope.value == pytest.approx(1.0)
    assert there.slope.low < 1.0 < there.slope.high
    assert deming_line(y[:2], x[:2], 1.0) is None


def test_a_line_that_is_exact():
    x = np.array([1.0, 2.0, 5.0, 7.0])
    found = deming_line(3.0 + 2.0 * x, x, 1.0)
    assert (found.intercept.value, found.slope.value) == pytest.approx((3.0, 2.0))
    assert found.slope.high - found.slope.low == pytest.approx(0.0, abs=1e-9)


def test_intraclass_correlations_as_published():
    """ICC(1,1) 0.17 with -0.13 to 0.72, ICC(2,1) 0.29: Shrout and Fleiss 1979, table 4; McGraw and Wong's interval."""
    found = repeat_correlation(list(RATINGS))
    assert found.value == pytest.approx(0.17, abs=0.005)
    assert (found.low, found.high) == pytest.approx((-0.13, 0.72), abs=0.005)
    assert method_correlation(RATINGS) == pytest.approx(0.29, abs=0.005)
    assert method_correlation(np.column_stack([MINI, MINI]).astype(float)) == pytest.approx(1.0)


def test_precision_of_balanced_groups_by_hand():
    """Groups (1, 3) and (5, 7): MS within 2, between 16; s_r^2 = 2, s_L^2 = (16 - 2)/2 = 7, s_R^2 = 9."""
    found = precision([[np.array([1.0, 3.0]), np.array([5.0, 7.0])]])
    assert found.repeatability**2 == pytest.approx(2.0)
    assert found.between**2 == pytest.approx(7.0)
    assert found.reproducibility == pytest.approx(3.0)
    assert found.detectable == pytest.approx(1.96 * np.sqrt(2) * 3.0, rel=1e-4)


def test_precision_is_that_of_a_simulation_and_of_anova():
    """Operators with s 2 and repeats with s 1 on five specimens; F is that of scipy on one of them."""
    from scipy.stats import f_oneway

    random = np.random.default_rng(5)
    levels = [[random.normal(0, 2) + random.standard_normal(2 + k % 3) for k in range(40)] for _ in range(5)]
    found = precision(levels)
    assert found.repeatability == pytest.approx(1.0, rel=0.06)
    assert found.between == pytest.approx(2.0, rel=0.1)
    even = [one[:2] for one in levels[0]]
    one = precision([even])
    assert 1 + 2 * one.between**2 / one.repeatability**2 == pytest.approx(f_oneway(*even).statistic)
    assert precision([alone([1, 3])]).reproducibility == pytest.approx(np.sqrt(2.0))  # of groups of one value
    assert precision([alone([1])]) is None


@pytest.mark.slow
def test_the_paper_against_its_dynamometer(palpate, tmp_path):
    """From its published numbers: only the sphere of 2 mm reads less; no tip agrees within the stated scatter."""
    (tmp_path / "paper.csv").write_text(PAPER)
    done = palpate("material", "agree", "paper.csv", "-o", "out")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "out" / "agreement.json").read_text())
    errors = {(p["specimen"], p["factors"]["tip"]): p["difference"] / p["reference"] for p in found["pairs"]}
    assert errors["S1", "quartic"] == pytest.approx(0.006, abs=0.001)
    assert errors["S2", "sphere 10 mm"] == pytest.approx(0.563, abs=0.001)
    assert [name for name, error in errors.items() if error < 0] == [("S1", "sphere 2 mm"), ("S2", "sphere 2 mm")]
    scores = {(p["specimen"], p["factors"]["tip"]): p["e_n"] for p in found["pairs"]}
    assert [name for name, score in scores.items() if abs(score) <= 1] == [("S1", "quartic")]
    assert found["limits_of_agreement"] is None  # two specimens only
    assert "need three specimens" in done.stdout
    assert found["icc_2_1"] == pytest.approx(0.98146, abs=1e-4)  # mean squares 30356, 551.8 and 21.4 by hand
    assert "repeats" not in found["precision"]  # each tip once
    assert found["precision"]["tip"]["reproducibility"] == pytest.approx(33.67e3, rel=1e-3)
    assert (tmp_path / "out" / "agreement.png").stat().st_size > 5000


@pytest.mark.slow
def test_a_table_with_decimal_commas(palpate, tmp_path):
    """As a spreadsheet of another country writes it, with a comment above."""
    text = "# by Anna\n" + PAPER.replace(",", ";").replace(".", ",")
    (tmp_path / "paper.csv").write_text(text, encoding="utf-16")
    found = json.loads(palpate("material", "agree", "paper.csv", "--json", "-o", "out").stdout)
    assert found["pairs"][0]["value"] == pytest.approx(302.3e3)
    (tmp_path / "paper.csv").write_text(text.replace("302,3", "high"), encoding="utf-16")
    assert "paper.csv:3, column 'value': 'high' is not a number" in palpate("material", "agree", "paper.csv").stderr


def many(count=8):
    rows = ["specimen,operator,value_kPa,std_kPa,reference_kPa,reference_std_kPa"]
    random = np.random.default_rng(1)
    for k in range(count):
        truth = 50.0 + 20.0 * k
        for operator in "AB":
            rows += [f"s{k},{operator},{1.02 * truth + random.normal(0, 1):.4f},1,{truth},1.5" for _ in range(2)]
    return "\n".join(rows) + "\n"


@pytest.mark.slow
def test_many_specimens(palpate, tmp_path):
    (tmp_path / "many.csv").write_text(many())
    found = json.loads(palpate("material", "agree", "many.csv", "-o", "out", "--json").stdout)
    assert found["deming"]["slope"]["low"] < 1.02 < found["deming"]["slope"]["high"]
    assert found["precision"]["repeats"]["repeatability"] == pytest.approx(1e3, rel=0.5)
    assert found["precision"]["operator"]["groups"] == 2
    assert found["limits_of_agreement"]["trend_p"] < 0.05


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("specimen,value [kPa],std [kPa],reference [kPa]\na,1,1,1\n", "column 'reference_std' is missing"),
        (PAPER.replace("value [kPa]", "value"), "paper.csv:1, column 3 'value': has no unit"),
        (PAPER.replace("value [kPa]", "value [mm]"), "column 3 'value [mm]': '1 mm' is a length, not a pressure"),
        (PAPER.replace("302.3", "high"), "paper.csv:2, column 'value': 'high' is not a number"),
        (PAPER.replace(",0.7,", ",0,"), "paper.csv:2, column 'std': '0' is not a number above zero"),
        (PAPER.replace("302.3", "nan"), "paper.csv:2, column 'value': 'nan' is not a number above zero"),
        ("specimen\n", "has no rows"),
    ],
)
def test_mistakes_in_a_table(palpate, tmp_path, text, said):
    (tmp_path / "paper.csv").write_text(text)
    done = palpate("material", "agree", "paper.csv")
    assert done.returncode == 2
    assert said in done.stderr


def test_conditions_of_a_pipeline():
    """Speed is the largest of the sine, strain Tabor's 0.2 a/R."""
    settings = {
        "trajectory": {"p": {"type": "point", "frequency": 2.0, "bias": 0.004, "amplitude": 0.001}},
        "indenter": {"tip": {"type": "sphere", "radius": 0.005}},
    }
    found = conditions_of(settings, {"indenter": "tip"})
    assert found.frequency == 2.0
    assert found.strain == pytest.approx(0.2 * np.sqrt(0.8))
    assert found.speed == pytest.approx(2 * np.pi * 2 * 0.001)


@pytest.fixture(scope="module")
def measured(tmp_path_factory, root):
    """A run of 112.5 kPa and 362 Pa s, one of a sine of 2 Hz."""
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    folder = tmp_path_factory.mktemp("agree")
    file = shutil.copy(root / "pipelines" / "filters.toml", folder / "point.toml")
    run_pipeline(
        load_pipeline(Path(file), ["trajectory.press.duration=1 s", 'run.tracks=["*/kinematic"]']), folder / "run"
    )
    return folder


SWEEP = "f [Hz],G' [kPa],G'' [kPa],shear strain [%]\n0.2,37.5,0.455,1\n20,37.5,45.5,1\n"  # E 112.5 kPa, eta 362 Pa s


@pytest.mark.gate
@pytest.mark.slow
def test_a_run_against_a_value_and_a_table(measured, palpate, tmp_path):
    """G'' = 2 pi f eta: 4.55 kPa at 2 Hz; the strain of the rheometer is another, which is said, in the report, too."""
    run = shutil.copytree(measured / "run", tmp_path / "run")
    done = palpate("material", "agree", "run", "--reference", "112.5 kPa", "--uncertainty", "1.5 kPa", "-o", "a")
    assert done.returncode == 0, done.stderr
    assert "frequency and speed of the reference are not stated" in " ".join(done.stdout.split())
    (tmp_path / "sweep.csv").write_text(SWEEP)
    for quantity, unit in (("elasticity", 112.5e3), ("viscosity", 362.0)):
        words = ("--reference", "sweep.csv", "--uncertainty", "2 %", "--quantity", quantity)
        found = json.loads(palpate("material", "agree", "run", *words, "--json", "-o", quantity).stdout)
        (pair,) = found["pairs"]
        assert pair["reference"] == pytest.approx(unit, rel=2e-3)
        assert abs(pair["e_n"]) < 1
        assert any(remark.startswith("strain: 17.9 %, reference 1 %") for remark in pair["remarks"])
    assert json.loads((run / "agreement.json").read_text())["quantity"] == "viscosity"
    report = palpate("report", "run", "-o", "page.html")
    assert report.returncode == 0, report.stderr
    assert "agreement: viscosity" in (tmp_path / "page.html").read_text()


PRESS = "\n".join(
    ["strain [%],stress [kPa]", *(f"{0.5 * k},{0.5625 * k + 0.02 * (-1) ** k:.4f}" for k in range(1, 60))]
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("head", "factor", "said"),
    [
        ("strain [%],stress [kPa]", 1.0, "taken as uniaxial: bonded specimens read more"),
        ("shear strain [%],shear stress [kPa]", 3.0, "in shear"),
    ],
)
def test_a_run_against_a_dynamometer(measured, palpate, tmp_path, head, factor, said):
    """112.5 kPa over strain, alternating by 20 Pa; the slope up to Tabor's 17.9 %, of shear times 2 (1 + nu)."""
    run = shutil.copytree(measured / "run", tmp_path / "run")
    (tmp_path / "press.csv").write_text(PRESS.replace("strain [%],stress [kPa]", head))
    words = ("--reference", "press.csv", "--uncertainty", "1 %", "--speed", "25 mm/s")
    done = palpate("material", "agree", run, *words, "--json", "-o", "a")
    assert done.returncode == 0, done.stderr
    (pair,) = json.loads(done.stdout)["pairs"]
    assert pair["reference"] == pytest.approx(factor * 112.5e3, rel=2e-3)
    assert pair["reference_std"] == pytest.approx(0.01 * factor * 112.5e3, rel=0.05)
    assert any("up to 17.9 %" in remark and said in remark for remark in pair["remarks"])
    assert not any("not stated" in remark for remark in pair["remarks"])
    assert (abs(pair["e_n"]) < 1) is (factor == 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--reference", "few.csv", "--uncertainty", "2 %"), "has 2 rows up to a strain of 17.9 %, fewer than 3"),
        (("--reference", "falls.csv", "--uncertainty", "2 %"), "the stress does not rise up to a strain"),
        (("--reference", "few.csv", "--uncertainty", "2 %", "--quantity", "viscosity"), "gives no viscosity"),
        (("--reference", "unit.csv", "--uncertainty", "2 %"), "unit.csv:1, column 1 'strain': has no unit"),
        (("--reference", "negative.csv", "--uncertainty", "2 %"), 'negative.csv:2, column 2 "G\' [kPa]": -3.75e+04 is'),
        (("--reference", "radians.csv", "--uncertainty", "2 %"), "are they rad/s? State which with --unit"),
        (
            ("--reference", "fraction.csv", "--uncertainty", "2 %"),
            "fraction.csv:3, column 1 'strain [1]': a strain of 20",
        ),
        (("--reference", "1 kPa", "--uncertainty", "1 Pa", "--strain", "0.1"), "in per cent, such as '10 %'"),
        (("--reference", "1 kPa", "--uncertainty", "1 Pa", "--speed", "1 N"), "--frequency, --speed: '1 N'"),
        ((), "--reference is missing"),
        (("--reference", "112.5 kPa"), "--uncertainty is missing"),
        (("--reference", "112.5 mm", "--uncertainty", "1 kPa"), "'112.5 mm' is a length, not a pressure"),
        (("--reference", "far.csv", "--uncertainty", "2 %"), "goes from 5 to 50 Hz, and the run is at 2 Hz"),
        (("--reference", "far.csv"), "states no uncertainty: --uncertainty '2 %'"),
        (("--reference", "nope.csv", "--uncertainty", "2 %"), "no such file"),
        (("--reference", "far.csv", "--uncertainty", "2 kPa"), "of a table in per cent"),
        (("--reference", "1 kPa", "--uncertainty", "1 Pa", "--track", "dr/x"), "no track 'dr/x'"),
    ],
)
def test_mistakes_with_a_run(measured, palpate, tmp_path, words, said):
    tables = {
        "far": SWEEP.replace("0.2,", "5,").replace("20,", "50,"),
        "few": "strain [%],stress [kPa]\n1,1\n2,2\n40,50\n",
        "falls": "strain [%],stress [kPa]\n1,3\n2,2\n3,1\n",
        "unit": "strain,stress [kPa]\n1,3\n2,2\n3,1\n",
        "negative": SWEEP.replace("0.2,37.5", "0.2,-37.5"),
        "radians": SWEEP.replace("0.2,", "0.62832,").replace("20,", "62.832,"),
        "fraction": "strain [1],stress [kPa]\n10,3\n20,5\n",
    }
    for name, text in tables.items():
        (tmp_path / f"{name}.csv").write_text(text)
    done = palpate("material", "agree", measured / "run", *words)
    assert done.returncode == 2
    assert said in done.stderr


@pytest.mark.parametrize("name", registry.load().parts["indenter"])
def test_a_representative_strain_is_known_under_spheres_alone(name):
    """Every tip that is a sphere by its own word has one, shipped now or later."""
    table = {"type": name, "radius": 5e-3}
    settings = {"indenter": {"tip": table}, "trajectory": {"press": {"bias": 2e-3}}}
    part = registry.load().find("indenter", name)
    is_sphere = part.sphere_radius is not Indenter.sphere_radius
    strain = conditions_of(settings, {"indenter": "tip"}).strain
    assert strain == (pytest.approx(0.2 * math.sqrt(2 / 5)) if is_sphere else None)
