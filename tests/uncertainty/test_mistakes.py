"""Mistakes of laboratories: what the record shows of them is told, with its effect."""

import importlib
import itertools
import sys
from pathlib import Path

import numpy as np
import palpate
import pytest
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.delay.commanded_motion import share_of_command

E, ETA = 112e3, 362.0  # [Pa], [Pa s]
MODEL = DimensionalityReduction(indenter=Sphere(radius=5e-3), thickness="half-space")


@pytest.fixture(scope="module")
def laboratory():
    """Kinds of mistakes by name, and the modules that make logs of them and judge."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    try:
        yield {name: importlib.import_module(f"laboratory.{name}") for name in ("kinds", "sensing", "judgement")}
    finally:
        sys.path.pop(0)


@pytest.fixture(scope="module")
def estimated(laboratory):
    """The track of an estimator on a palpation with a mistake."""
    kinds = {mistake.name: mistake for mistake in laboratory["kinds"].KINDS}
    known = {}

    def track(name, estimator="casadi-fit", seed=0, **alignment):
        key = name, estimator, seed, str(alignment)
        if key not in known:
            log = laboratory["sensing"].make_log(kinds[name].palpation(), seed)
            record = palpate.record(
                time=log.stamp, force=log.force, height=log.height, velocity=log.velocity, measuring=log.measuring,
                timing="0.14 ms", tip_mass=0.14, alignment=alignment,
            )  # fmt: skip
            run = palpate.compare(record, models=[MODEL], estimators=[estimator])
            known[key] = run.document["tracks"][f"dimensionality-reduction/{estimator}"]
        return known[key]

    return track


def signs(track):
    """Codes of the flags of a track and of their evidence."""
    flags = [*track["flags"], *track.get("immaterial", ())]
    return {flag["code"] for flag in flags} | {sign["code"] for flag in flags for sign in flag.get("evidence", ())}


@pytest.mark.slow
def test_at_least_sixty_kinds_each_with_its_own_name(laboratory):
    kinds = laboratory["kinds"].KINDS
    assert len(kinds) >= 61
    assert len({mistake.name for mistake in kinds}) == len(kinds)
    assert [mistake.name for mistake in kinds if mistake.palpation() == kinds[0].palpation()] == ["nothing"]


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["casadi-fit", "kinematic-ekf"])
def test_without_a_mistake_nothing_is_in_doubt(estimated, estimator):
    track = estimated("nothing", estimator)
    assert track["verdict"] in ("good", "note")
    assert track["parameters"]["elasticity"]["value"] == pytest.approx(E, rel=0.02)
    assert track["parameters"]["viscosity"]["value"] == pytest.approx(ETA, rel=0.02)
    assert not signs(track) & {"force-in-air", "pull-off", "commanded-motion", "lack-of-fit"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "code", "rough"),
    [
        ("alias", "force-in-air", 0.764),
        ("oil", "force-in-air", 0.384),
        ("adhesion", "pull-off", 0.134),
    ],
)
def test_what_moves_the_viscosity_is_told_with_its_size(estimated, kind, code, rough):
    """The viscosity is off by `rough` of its value."""
    track = estimated(kind)
    viscosity = track["parameters"]["viscosity"]
    assert abs(viscosity["value"] / ETA - 1) == pytest.approx(rough, abs=0.05)
    assert code in signs(track)
    assert viscosity["verdict"] == "doubtful"
    assert abs(viscosity["value"] - ETA) < 2 * viscosity["combined"]


@pytest.mark.slow
def test_a_tare_taken_in_contact_shows_after_the_contact(estimated):
    track = estimated("tare-loaded")
    assert "force-in-air" in signs(track)
    assert track["verdict"] == "doubtful"
    assert abs(track["parameters"]["elasticity"]["value"] - E) < 2 * track["parameters"]["elasticity"]["combined"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "off"),
    [
        pytest.param("base-5", -0.279, marks=pytest.mark.slow),
        ("layer-40", 0.227),
        ("two-layers", -0.122),
    ],
)
def test_the_way_in_shows_what_the_sine_does_not(estimated, kind, off):
    """The sine alone is described to the noise; the depths and speeds of the approach are not."""
    track = estimated(kind)
    elasticity = track["parameters"]["elasticity"]
    assert elasticity["value"] / E - 1 == pytest.approx(off, abs=0.02)
    assert "lack-of-fit" in signs(track)
    assert track["verdict"] == "doubtful"


@pytest.mark.slow
def test_a_material_that_relaxes_fast_has_its_discrepancy(estimated):
    track = estimated("relaxing-fast")
    elasticity = track["parameters"]["elasticity"]
    assert elasticity["value"] / E - 1 == pytest.approx(0.058, abs=0.02)
    assert "model-discrepancy" in signs(track)
    assert elasticity["systematic_model_discrepancy"] > 3.0 * elasticity["std"]


@pytest.mark.slow
def test_a_kinematic_filter_tells_a_material_that_relaxes(estimated):
    track = estimated("relaxing", "kinematic-ekf")
    assert track["parameters"]["elasticity"]["value"] > 1.3 * E
    assert "model-discrepancy" in signs(track)
    assert track["verdict"] == "doubtful"


@pytest.mark.slow
def test_a_position_whose_timing_is_declared_is_taken_at_its_word(estimated):
    declared = {"position": {"channel": "record.height", "uncertainty": "0.1 ms"}}
    assert "commanded-motion" not in signs(estimated("commanded", **declared))


@pytest.mark.parametrize("way", [1e-3, 4e-3])
def test_records_that_differ_in_their_noise_alone_do_not_jump(way):
    """The bound is where a position counts as measured: the noise of a few hundred readings is known to some 4 %."""
    bound = min(2e-7, 1e-4 * way)
    shares = [share_of_command(noise * bound, way) for noise in np.geomspace(0.25, 1.5, 60)]
    assert shares[0] == 1.0
    assert shares[-1] == 0.0
    assert all(-0.06 < after - before <= 0.0 for before, after in itertools.pairwise(shares))
    assert share_of_command(0.0, way) == 1.0
    assert share_of_command(1e-8, 1e-4) == share_of_command(float("nan"), way) == 0.0


@pytest.mark.slow
def test_what_the_record_does_not_show_is_not_told(laboratory, estimated):
    """A tip of twice the radius: the same force with another modulus."""
    kinds = {mistake.name: mistake for mistake in laboratory["kinds"].KINDS}
    assert laboratory["judgement"].shown(kinds["radius-double"]) < 3.0
    assert laboratory["judgement"].shown(kinds["alias"]) > 30.0
    track = estimated("radius-double")
    assert track["verdict"] in ("good", "note")
    assert track["parameters"]["elasticity"]["value"] == pytest.approx(np.sqrt(2) * E, rel=0.02)


def test_a_track_is_right_reported_or_silent(laboratory):
    outcome, truth = laboratory["judgement"].outcome, (100.0, 10.0)

    def of(verdict, elasticity, viscosity, std=1.0):
        values = {"elasticity": (elasticity, std), "viscosity": (viscosity, 0.1 * std)}
        found = {name: {"value": value, "combined": spread} for name, (value, spread) in values.items()}
        return outcome({"verdict": verdict, "parameters": found}, truth)

    assert of("good", 101.0, 10.1) == "right"
    assert of("good", 105.0, 10.0, std=3.0) == "covered"
    assert of("note", 105.0, 10.0) == "silent"
    assert of("doubtful", 105.0, 10.0) == "reported"
    assert of("doubtful", 101.0, 10.0) == "false alarm"
