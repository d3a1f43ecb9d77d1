"""Master curves: shifts and their uncertainty from a known truth, laws of the shift, and what does not superpose."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_kit.numerics.material_laws import law_of
from palpate_reference.fit_problem import FitProblem, predictions
from palpate_reference.material_table import MaterialTable
from palpate_reference.superposition.master_command import curve_at
from palpate_reference.superposition.shift_laws import shift_laws
from palpate_reference.superposition.temperature_sweeps import temperature_of, temperature_sweeps
from palpate_reference.table_fit import fit_law

SOLID = (4e4, 2e5, 1e-2, 8e4, 1.0)  # two arms
TEMPERATURES = (-10.0, 0.0, 10.0, 20.0, 30.0)
C1, C2 = 8.0, 100.0


def wlf(temperature, at=10.0):
    return -math.log(10) * C1 * (temperature - at) / (C2 + temperature - at)


def arrhenius(temperature, at=10.0):
    return 80e3 / 8.314462618 * (1 / (temperature + 273.15) - 1 / (at + 273.15))


def sweep(
    temperature, shift, kind="oscillation", noise=0.01, seed=0, law="generalised-maxwell-2", values=SOLID, up=0.0
):
    """What an instrument reads at a temperature: the law of the reference at f a_T, or t/a_T, over b_T."""
    x = np.geomspace(0.05, 20.0, 21)
    sign = 1.0 if kind == "oscillation" else -1.0
    there = MaterialTable("t", "", "table", kind, True, x * math.exp(sign * shift), x[:, None], None, None, None)
    y = predictions(law_of(law), there, values, 0.5) * math.exp(up if kind == "creep" else -up)
    y = y * np.exp(noise * np.random.default_rng([seed, round(temperature) + 100]).standard_normal(y.shape))
    return MaterialTable(
        f"{temperature:g}.csv", "", "table", kind, True, x, y, None, None, np.full(len(x), temperature)
    )


@pytest.mark.parametrize("kind", ["oscillation", "relaxation", "creep"])
def test_shifts_come_back(kind):
    """ln a_T of the truth, for times as for frequencies: a warm material is faster."""
    curve = curve_at([sweep(t, wlf(t), kind, noise=1e-3) for t in TEMPERATURES], "10 °C", False)
    np.testing.assert_allclose(curve.shifts[:, 0], [wlf(t) for t in TEMPERATURES], atol=0.03)
    assert curve.shifts[2, 0] == 0.0
    assert not curve.strange
    table = curve.table()
    there = predictions(law_of("generalised-maxwell-2"), table, SOLID, 0.5)
    assert np.sqrt(np.mean(np.log(table.y / there) ** 2)) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("vertical", [False, True])
def test_their_uncertainty_covers(vertical):
    """Over seeds and temperatures the errors are those of a standard normal."""
    errors = []
    for seed in range(6):
        ups = [0.002 * (t - 10) if vertical else 0.0 for t in TEMPERATURES]
        tables = [sweep(t, wlf(t), seed=seed, up=up) for t, up in zip(TEMPERATURES, ups, strict=True)]
        curve = curve_at(tables, "10 °C", vertical)
        free = [0, 1, 3, 4]
        errors += list((curve.shifts[free, 0] - [wlf(TEMPERATURES[k]) for k in free]) / curve.stds[free, 0])
        if vertical:
            errors += list((curve.shifts[free, 1] - np.array(ups)[free]) / curve.stds[free, 1])
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("truth", "name"), [(wlf, "WLF"), (arrhenius, "Arrhenius")])
def test_the_law_of_the_shift_is_found(truth, name):
    curve = curve_at([sweep(t, truth(t)) for t in TEMPERATURES], "10 °C", False)
    best = shift_laws(curve)[0]
    known = {"C1": C1, "C2": C2, "activation_energy": 80e3}
    found = {law.name: law for law in shift_laws(curve)}[name]
    assert found.p > 1e-3
    for key, (value, std, _) in found.values.items():
        assert abs(value - known[key]) < 3 * std
    assert best.name == name or best.p > 1e-3  # WLF bends as Arrhenius does over 40 K
    if name == "WLF":
        assert {law.name: law for law in shift_laws(curve)}["Arrhenius"].p < 1e-3


def test_moduli_that_depend_on_temperature_are_named():
    """A rise of 10 % without `vertical` leaves more than the sweeps scatter; with it, nothing."""
    tables = [sweep(t, wlf(t), noise=2e-3, up=-0.005 * (t - 10)) for t in TEMPERATURES]
    assert curve_at(tables, "10 °C", False).strange
    curve = curve_at(tables, "10 °C", True)
    assert not curve.strange
    np.testing.assert_allclose(curve.shifts[:, 1], [-0.005 * (t - 10) for t in TEMPERATURES], atol=0.02)


def test_a_loss_that_is_that_of_the_instrument():
    """A loss that grows with the frequency at every temperature; the storage modulus alone has the shifts."""
    tables = [sweep(t, wlf(t), noise=1e-3) for t in TEMPERATURES]
    tables = [replace(one, y=one.y + np.outer(one.x, [0.0, 2e2])) for one in tables]
    assert curve_at(tables, "10 °C", False).strange
    curve = curve_at(tables, "10 °C", False, storage=True)
    assert not curve.strange
    np.testing.assert_allclose(curve.shifts[:, 0], [wlf(t) for t in TEMPERATURES], atol=0.05)


def test_one_table_is_parted_by_its_temperatures():
    """Sweeps one below the other, the temperature drifting by some tenths; a repeat joins its temperature."""
    parts = [sweep(t, wlf(t)) for t in (0.0, 20.0, 0.0)]
    drift = np.linspace(-0.3, 0.3, 21)
    one = MaterialTable(
        "all.csv", "", "table", "oscillation", True, np.concatenate([p.x for p in parts]),
        np.concatenate([p.y for p in parts]), None, None, np.concatenate([p.temperature + drift for p in parts]),
    )  # fmt: skip
    cold, warm = temperature_sweeps([one])
    assert (round(cold.temperature), len(cold.tables), round(warm.temperature), len(warm.tables)) == (0, 2, 20, 1)


def test_a_shift_of_all_readings_is_one_of_the_times():
    """u(ln tau) is that of ln a_T, and elasticities do not feel it; that of ln b_T is one of the elasticities."""
    law, table = law_of("standard-linear-solid"), sweep(20.0, 0.0, noise=1e-4, law="standard-linear-solid",
                                                        values=(4e4, 8e4, 0.1))  # fmt: skip
    rows = np.ones((len(table.x), 1))
    root = np.stack([np.hstack([0.1 * rows, 0 * rows]), np.hstack([0 * rows, 0.03 * rows])])
    fit = fit_law(law, FitProblem((table,), 0.5, 0.0, (0.0,), root))
    share = fit.budget["time-temperature shift"] / fit.values
    np.testing.assert_allclose(share, [0.03, 0.03, 0.1], rtol=1e-3)
    np.testing.assert_allclose(fit.values, (4e4, 8e4, 0.1), rtol=1e-2)


@pytest.mark.parametrize(("text", "value"), [("25 °C", 25.0), ("-40C", -40.0), ("298.15 K", 25.0)])
def test_temperatures(text, value):
    assert temperature_of(text) == pytest.approx(value)


def test_neighbours_that_do_not_meet():
    """Liquid and glass without anything in between."""
    tables = [sweep(t, shift) for t, shift in ((0.0, -14.0), (50.0, 9.0))]
    with pytest.raises(ConfigurationError, match=r"0 °C and 50 °C do not meet.*measure a temperature in between"):
        curve_at(tables, None, False)


def written(folder, temperatures=TEMPERATURES, up=0.0):
    for t in temperatures:
        one = sweep(t, wlf(t), up=up * (t - 10))
        rows = [f"{f:.8g},{a:.8g},{b:.8g},{t}" for f, (a, b) in zip(one.x, one.y, strict=True)]
        (folder / f"{t:g}.csv").write_text("\n".join(["f [Hz],G' [Pa],G'' [Pa],T [°C]", *rows]) + "\n")
    return [f"{t:g}.csv" for t in temperatures]


@pytest.mark.slow
def test_the_command(palpate, tmp_path):
    """What it writes is a table that is read again, at the reference temperature."""
    names = [f"./{name}" for name in written(tmp_path)]
    done = palpate("material", "master", *names, "--reference-temperature", "10 °C", "-o", "m")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "m" / "shifts.json").read_text())
    warm = found["sweeps"][-1]
    assert abs(warm["ln_a"] - wlf(30.0)) < 4 * warm["ln_a_std"]
    assert (tmp_path / "m" / "master.png").stat().st_size > 5000
    (table,) = json.loads(palpate("material", "m/master.csv", "--json").stdout)["tables"]
    assert len(table["x"]) == 5 * 21
    assert max(table["x"]) == pytest.approx(20.0 * math.exp(found["sweeps"][0]["ln_a"]), rel=1e-6)


@pytest.mark.slow
def test_a_law_of_several_temperatures(palpate, tmp_path):
    names = [f"./{name}" for name in written(tmp_path)]
    words = ("--law", "generalised-maxwell-2", "--reference-temperature", "10 °C", "-o", "m", "--json")
    found = json.loads(palpate("material", "fit", *names, *words).stdout)["laws"][0]["parameters"]
    for name, truth in zip(found, SOLID, strict=True):
        assert abs(found[name]["value"] - truth) < 4 * found[name]["std"], name
    assert found["arm_time_2"]["budget"]["time-temperature shift"] > 0


@pytest.mark.slow
def test_a_law_of_sweeps_that_do_not_superpose(palpate, tmp_path):
    """It is said with the law, too."""
    names = written(tmp_path, up=-0.01)
    words = ("--law", "kelvin-voigt", "--reference-temperature", "10 °C", "-o", "m", "--json")
    found = json.loads(palpate("material", "fit", *(f"./{name}" for name in names), *words).stdout)
    assert any("do not superpose" in remark for remark in found["remarks"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--reference-temperature", "15 °C"), "no sweep is at it; there are sweeps at 0.0, 10.0 °C"),
        (("--reference-temperature", "warm"), "write for example '25 °C'"),
        (("plain.csv",), "states no temperature of its rows"),
        (("kelvin.csv",), "kelvin.csv:1, column 4 'T [F]'"),
    ],
)
def test_mistakes(palpate, tmp_path, words, said):
    names = written(tmp_path, (0.0, 10.0))
    text = (tmp_path / names[0]).read_text()
    (tmp_path / "plain.csv").write_text("\n".join(line.rpartition(",")[0] for line in text.splitlines()) + "\n")
    (tmp_path / "kelvin.csv").write_text(text.replace("T [°C]", "T [F]"))
    done = palpate("material", "master", *names, *words)
    assert done.returncode == 2, done.stdout
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_kelvin_is_read(palpate, tmp_path):
    (tmp_path / "k.csv").write_text("f [Hz],G' [Pa],G'' [Pa],T [K]\n1,2,3,293.15\n2,2,3,293.15\n")
    (table,) = json.loads(palpate("material", "k.csv", "--json").stdout)["tables"]
    assert table["temperature"] == pytest.approx([20.0, 20.0])
