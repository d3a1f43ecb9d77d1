"""A gel by one hold may be a solid that relaxes: its condition has that modulus, and two depths settle it."""

import json
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
MEMORY = Path(__file__).parents[2] / "pipelines/parts/memory.toml"
GEL = (
    'device.rig.specimen={ model = "gel", elasticity = "80 kPa", drained_poisson = 0.3, diffusivity = "2e-6 m^2/s" }',
)
TWO_DEPTHS = ('trajectory.hold.depths=["1 mm", "4 mm"]',)


def gel_track(palpate, *settings):
    options = [option for text in ('run.tracks=["gel/fit"]', *settings) for option in ("--set", text)]
    done = palpate("run", MEMORY, *options, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["tracks"]["gel/fit"]


def conditions_of(track):
    return [condition for condition in track["conditions"] if condition["fact"] == "relaxation"]


def test_a_solid_of_two_arms_has_the_modulus_of_the_condition(palpate):
    """E/(1 - nu^2) is that of the lasting force, whichever of the two relaxes; 80 kPa is that of the solid."""
    track = gel_track(palpate)
    (condition,) = conditions_of(track)
    elasticity = track["parameters"]["elasticity"]
    assert abs(elasticity["value"] - 80e3) > 3 * elasticity["combined"]
    assert abs(elasticity["value"] + condition["shifts"]["elasticity"] - 80e3) < 2 * elasticity["combined"]
    assert condition["needed_by"] == []


@pytest.mark.parametrize(("settings", "count"), [(GEL, 1), ((*GEL, *TWO_DEPTHS), 0)])
def test_two_depths_tell_a_gel_from_a_solid(palpate, settings, count):
    track = gel_track(palpate, *settings)
    assert len(conditions_of(track)) == count
    elasticity = track["parameters"]["elasticity"]
    assert abs(elasticity["value"] - 80e3) < 2 * elasticity["combined"]
