"""What the speed of a press adds to its force, and what is taken for known: both in the uncertainty of the modulus."""

import json

import numpy as np
import pytest
from palpate import ConfigurationError, to_si
from palpate_engine.alignment import AlignmentSettings
from palpate_engine.cli import call
from palpate_indentation.approach_fit import fit_curve
from palpate_indentation.elastic_law import law_of
from palpate_indentation.press import press_of
from palpate_indentation.press_analysis import PressSettings, analyse_press
from palpate_indentation.press_budget import Declared
from palpate_indentation.press_table import second_best
from palpate_indentation.viscosity import PressViscosity, viscosity_of_run
from palpate_models import DimensionalityReduction, HuntCrossley, JohnsonKendallRoberts, Sphere

from tests.indentation.test_press import HERTZ, RADIUS, record
from tests.result_documents import result, track, value

STIFF, ETA = 1e5, 400.0


def looked_at(samples, model=HERTZ, **given):
    return analyse_press(law_of(model, "dr", {}), press_of(samples), PressSettings(), **given)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_press_tells_its_viscosity_by_the_way_out(seed):
    """At 8 mm/s the viscosity makes 20 % of the force 1 mm deep: taken for elastic, it moves the modulus by 12 %."""
    found = looked_at(record(HERTZ, [STIFF, ETA], noise=0.02, speed=8e-3, seed=seed))
    assert found.viscosity.source == "press"
    assert abs(found.viscosity.value - ETA) < 3 * found.viscosity.std
    assert found.viscosity.std < 0.1 * ETA
    assert abs(found.fit.modulus - STIFF) < 2.5 * found.combined
    assert found.combined < 0.02 * STIFF
    assert not found.flags


@pytest.mark.slow
def test_speed_that_changes_on_the_way_in_tells_it_too():
    samples = record(HERTZ, [STIFF, 0.0], speed=4e-3, air=2e-3)
    half = samples[: len(samples) // 2]
    depth = -half.position
    rate = 4e-3 * (1.0 + 0.8 * np.sin(2 * np.pi * 8.0 * half.time))
    depth = depth[0] + np.concatenate([[0.0], np.cumsum(rate[:-1] * np.diff(half.time))])
    noise = 0.01 * np.random.default_rng(3).standard_normal(len(half))
    inside = np.maximum(depth, 0.0)
    half.position[:], half.velocity[:] = -depth, -rate
    half.force[:] = 16 / 9 * STIFF * RADIUS**0.5 * inside**1.5 + 8 * ETA * np.sqrt(RADIUS * inside) * rate + noise
    found = looked_at(half)
    assert found.viscosity.source == "press"
    assert abs(found.viscosity.value - ETA) < 3 * found.viscosity.std
    assert abs(found.fit.modulus - STIFF) < 2.5 * found.combined


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_way_in_at_one_speed_bounds_it_and_says_so(seed):
    """At one speed the viscous force has the shape of a surface that lies higher; the modulus is 60 % too large."""
    samples = record(HERTZ, [STIFF, 1500.0], noise=0.02, speed=20e-3, deep=1e-3, seed=seed)
    found = looked_at(samples[: len(samples) // 2])
    assert (found.viscosity.source, found.viscosity.value) == ("bound", 0.0)
    assert found.fit.modulus > 1.4 * STIFF
    assert abs(found.fit.modulus - STIFF) < 2 * found.combined
    (flag,) = (flag for flag in found.flags if flag.code == "viscosity-unclear")
    assert flag.effects["elasticity"] > 0.3 * STIFF


@pytest.mark.slow
@pytest.mark.parametrize("eta", [0.0, 400.0, 1500.0])
@pytest.mark.parametrize("speed", [8e-3, 20e-3])
def test_the_truth_is_within_the_uncertainty_of_a_way_in(eta, speed):
    inside = 0
    for seed in range(4):
        samples = record(HERTZ, [STIFF, eta], noise=0.02, speed=speed, deep=1e-3, seed=seed)
        found = looked_at(samples[: len(samples) // 2])
        inside += abs(found.fit.modulus - STIFF) < 2 * found.combined
    assert inside >= 3


@pytest.mark.slow
def test_adhesion_on_the_way_out_is_not_taken_for_viscosity():
    """A pull of jkr makes the way out lower, as viscosity would, and no law of both ways explains it."""
    found = looked_at(record(JohnsonKendallRoberts(radius=RADIUS), [3e4, 20.0], noise=0.02, air=4e-3))
    assert found.viscosity.source == "bound"
    assert found.viscosity.value == 0.0


@pytest.mark.slow
def test_an_elastic_material_keeps_its_modulus():
    found = looked_at(record(HERTZ, [STIFF, 0.0], noise=0.02, speed=8e-3))
    assert abs(found.fit.modulus - STIFF) < 2.5 * found.combined
    assert abs(found.viscosity.value) <= 2.5 * found.viscosity.std
    assert not found.flags


@pytest.mark.slow
def test_a_viscosity_that_is_stated_comes_before_all_others():
    samples = record(HERTZ, [STIFF, ETA], noise=0.02, speed=8e-3)
    law = law_of(HERTZ, "dr", {"viscosity": f"{ETA} Pa*s"})
    other = PressViscosity(9.0, 1.0, "Pa*s", "run", "elsewhere")
    found = analyse_press(law, press_of(samples), PressSettings(), viscosity=other)
    assert (found.viscosity.source, found.viscosity.value, found.viscosity.std) == ("stated", ETA, 0.0)
    assert looked_at(samples, viscosity=other).viscosity == other


@pytest.mark.slow
def test_the_tip_ranks_first_or_none_does():
    """Of a viscous material; without the way out its viscosity could be anything, and the laws are not told apart."""
    samples = record(HERTZ, [STIFF, ETA], noise=0.02, deep=4e-3, speed=4e-3, seed=1)
    for found in (looked_at(samples), looked_at(samples[: len(samples) // 2])):
        first = min(found.spheres, key=lambda one: one.log_squares)
        assert first.tip == "sphere" or second_best(found) < 10.0
    assert min(looked_at(samples).spheres, key=lambda one: one.log_squares).tip == "sphere"


@pytest.mark.slow
def test_a_model_without_viscosity_needs_none():
    model = HuntCrossley(exponent=1.5)
    law = law_of(model, "hc", {})
    samples = record(model, [1.0 if p.role == "elastic" else 0.0 for p in model.parameters], noise=1e-3)
    found = analyse_press(law, press_of(samples), PressSettings())
    assert (found.viscosity is None) == (law.viscosity is None)
    assert found.fit.modulus == pytest.approx(1.0, rel=0.01)


@pytest.mark.parametrize(
    ("tracks", "expected"),
    [
        ({"dr/ekf": ("doubtful", 391.0, 35.0), "dr/kinematic": ("good", 362.0, 40.0)}, 362.0),
        ({"dr/ekf": ("good", 391.0, 35.0), "dr/kinematic": ("note", 362.0, 10.0)}, 362.0),
        ({"dr/ekf": ("good", 391.0, 35.0), "dr/kinematic": ("good", 362.0, 10.0)}, 362.0),
        ({"dr/ekf": ("invalid", 391.0, 35.0)}, None),
        ({"dr/ekf": ("good", 391.0, None)}, None),
        ({}, None),
    ],
)
def test_the_viscosity_of_a_run_is_that_of_its_best_track(tracks, expected, tmp_path):
    made = {
        name: track(verdict, parameters={"elasticity": value(1e5), "viscosity": value(eta, "Pa*s", std)})
        for name, (verdict, eta, std) in tracks.items()
    }
    (tmp_path / "result.json").write_text(json.dumps(result(made)))
    found = viscosity_of_run(tmp_path, "dr", "viscosity")
    assert (found.value if found else None) == expected
    assert viscosity_of_run(tmp_path, "other", "viscosity") is None
    assert viscosity_of_run(tmp_path / "mine.toml", "dr", "viscosity") is None
    again = viscosity_of_run(tmp_path / "log.mcap", "dr", "viscosity")
    assert (again.value if again else None) == expected


def declared(**uncertainties):
    return Declared(AlignmentSettings(force="a.f", position="a.z", tip_mass=0.14, series_stiffness=3e4), uncertainties)


@pytest.mark.slow
def test_rows_of_the_budget_are_what_another_analysis_finds():
    """Each number of tip, model and readings changed by its uncertainty, and the press fitted again."""
    samples = record(HERTZ, [STIFF, ETA], noise=1e-4, speed=8e-3, deep=3e-3)
    law, given = law_of(HERTZ, "dr", {"viscosity": f"{ETA} Pa*s"}), press_of(samples)
    stds = {"radius": 5e-5, "poisson": 5e-3, "force_scale": 0.01, "position_scale": 0.01}
    rows = {row.source: row for row in analyse_press(law, given, PressSettings(), declared=declared(**stds)).budget}

    def refitted(model, branch):
        again = law_of(model, "dr", {"viscosity": f"{ETA} Pa*s"})
        return fit_curve(again, branch, given.noise, tilt=True).modulus

    way = given.approach
    part = [way.time, way.height, way.force, way.rate, way.acceleration]
    moved = {
        "radius": (DimensionalityReduction(indenter=Sphere(radius=RADIUS + 5e-5)), part),
        "poisson": (DimensionalityReduction(indenter=Sphere(radius=RADIUS), poisson=0.495), part),
        "force_scale": (HERTZ, [*part[:2], 1.01 * way.force, *part[3:]]),
        "position_scale": (HERTZ, [way.time, 1.01 * way.height, way.force, 1.01 * way.rate, way.acceleration]),
    }
    for source, (model, columns) in moved.items():
        change = abs(refitted(model, type(way)(*columns)) - refitted(HERTZ, way))
        assert rows[source].effects["elasticity"].contribution == pytest.approx(change, rel=0.05), source
        assert rows[source].std == stds[source]
    assert rows["mass (not declared)"].std == pytest.approx(0.007)
    assert rows["compliance"].effects["elasticity"].contribution > 0.01 * STIFF


@pytest.mark.slow
def test_what_is_not_declared_has_the_defaults_of_a_track():
    found = looked_at(record(HERTZ, [STIFF, 0.0], noise=0.02))
    rows = {row.source: row for row in found.budget}
    assert rows["radius (not declared)"].effects["elasticity"].contribution == pytest.approx(0.0025 * STIFF, rel=0.05)
    assert rows["poisson (not declared)"].effects["elasticity"].contribution == pytest.approx(0.0154 * STIFF, rel=0.05)
    assert found.combined == pytest.approx(
        np.sqrt(sum(row.effects["elasticity"].contribution ** 2 for row in found.budget))
    )


def test_an_uncertainty_that_is_none_is_refused():
    with pytest.raises(ConfigurationError, match="uncertainties"):
        looked_at(record(HERTZ, [STIFF, 0.0], noise=0.02), declared=declared(radius="5 kg"))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The README's first run."""
    folder = tmp_path_factory.mktemp("readme") / "point"
    call(["run", "pipelines/filters.toml", "--out", str(folder)])
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_press_of_the_readmes_run_has_the_truth(seed, tmp_path):
    """112.5 kPa within two uncertainties, the true tip first, no flag; by the run's viscosity and the press's."""
    folder = tmp_path / "point"
    call(["run", "pipelines/filters.toml", "--set", f"run.seed={seed}", "--out", str(folder)])
    call(["fit", "indentation", str(folder), "--out", str(tmp_path / "of_run")])
    (folder / "result.json").unlink()
    call(["fit", "indentation", str(folder), "--out", str(tmp_path / "of_press")])
    for name, source in (("of_run", "run"), ("of_press", "press")):
        found = json.loads((tmp_path / name / "indentation.json").read_text())
        assert found["viscosity"]["source"] == source
        assert abs(found["viscosity"]["value"] - to_si("362 Pa*s", "Pa*s")) < 3 * found["viscosity"]["std"]
        assert abs(found["value"] - 112.5e3) < 2 * found["combined"]
        assert found["combined"] < 0.03 * found["value"]
        assert min(found["spheres"], key=lambda tip: found["spheres"][tip]["bic_above_best"]) == "sphere"
        assert found["flags"] == []
        rows = {row["source"] for row in found["budget"]}
        assert {"fit", "viscosity", "radius (not declared)", "poisson (not declared)"} <= rows


@pytest.mark.slow
def test_another_tip_is_not_given_the_runs_viscosity(run, tmp_path):
    words = ["fit", "indentation", str(run), "--out", str(tmp_path / "out"), "--set"]
    call([*words, "indenter.tip.radius=4 mm"])
    assert json.loads((tmp_path / "out" / "indentation.json").read_text())["viscosity"]["source"] == "press"


@pytest.mark.slow
def test_uncertainties_of_the_pipeline_are_rows(run, tmp_path):
    words = ["fit", "indentation", str(run), "--out", str(tmp_path / "out"), "--set"]
    call([*words, "run.uncertainties={ poisson = 0.001, force_scale = 0.01, radius = '10 um' }"])
    found = json.loads((tmp_path / "out" / "indentation.json").read_text())
    rows = {row["source"]: row["effects"]["elasticity"] for row in found["budget"]}
    assert rows["force_scale"]["percent"] == pytest.approx(1.0, rel=0.05)
    assert rows["radius"]["percent"] == pytest.approx(0.1, rel=0.1)
    assert rows["poisson"]["percent"] < 0.2
