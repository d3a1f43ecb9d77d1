"""What was measured, in the first line of fits and on the page: rate, depths, and where a half-space holds."""

import csv

import numpy as np
import pytest
from palpate_kit.terminal.motion_text import measured_text, motion_numbers, row_motion

from tests.fits.test_two_tips import RIG, write

SINE = {"frequency": 2.0, "shallowest": 2.2e-3, "deepest": 4.31e-3}
PRESS = {"speed": 1.01e-3, "shallowest": 0.0, "deepest": 2e-3}


@pytest.mark.parametrize(
    ("motions", "words"),
    [
        ([], ""),
        ([{}], ""),
        ([SINE], "2 Hz, 2.2 to 4.3 mm deep"),
        ([PRESS | {"half_space_from": 0.161}], "press 1 mm/s, 0 to 2 mm deep; half-space: above 160 mm thick"),
        ([PRESS, PRESS | {"speed": 2e-3, "deepest": 3e-3}], "press 1 or 2 mm/s, 0 to 3 mm deep"),
        ([PRESS, SINE, SINE], "2 Hz (2 curves) or press 1 mm/s (1 curve), 0 to 4.3 mm deep"),
        ([{"shallowest": 1e-6, "deepest": 2e-6}], "in contact, 1 to 2 um deep"),
    ],
)
def test_motions_of_records_are_one_phrase(motions, words):
    assert measured_text(motions) == words


def test_a_row_and_a_result_hold_the_same_motion():
    table = {"speed": 1e-3, "depth": [0.0, 2e-3]}
    numbers = motion_numbers(table)
    assert numbers == {"speed": 1e-3, "shallowest": 0.0, "deepest": 2e-3}
    assert row_motion({key: repr(value) for key, value in numbers.items()} | {"frequency": ""}) == numbers
    assert motion_numbers({}) == {}


def half_space(path, oscillates):
    """A press of 1 mm/s to 2 mm, or an oscillation of 3 Hz about 2 mm, on 50 kPa, after air; noise 1 mN."""
    time = np.arange(1500) / 300.0
    depth = np.interp(time, [0.0, 0.5, 3.0, 5.0], [-0.5e-3, -0.5e-3, 2e-3, 2e-3])
    if oscillates:
        depth = np.where(time < 0.5, -1e-3, 2e-3 + 0.5e-3 * np.sin(6 * np.pi * time))
    force = 16 / 9 * 50e3 * np.sqrt(6e-3) * np.maximum(depth, 0.0) ** 1.5
    write(path, np.column_stack([time, force + 1e-3 * np.random.default_rng(1).standard_normal(1500), -1e3 * depth]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("oscillates", "words"),
    [
        (False, "press 1 mm/s, 0 to 2 mm deep"),
        (True, "3 Hz, 1.5 to 2.5 mm deep"),
    ],
)
def test_the_first_line_says_what_was_measured(palpate, tmp_path, oscillates, words):
    half_space(tmp_path / "press.csv", oscillates)
    (tmp_path / "rig.toml").write_text(RIG)
    done = palpate("fit", tmp_path / "press.csv", "--thickness", "half-space", "-o", tmp_path / "fits")
    assert "half-space if above " in " ".join(done.stdout.split())
    assert words in " ".join(done.stdout.split())
    (row,) = csv.DictReader((tmp_path / "fits" / "fits.csv").read_text().splitlines())
    # A bonded layer of that height would be as much stiffer as the value is uncertain (Dimitriadis, first order).
    radius = np.sqrt(6e-3 * (2e-3 if oscillates else 1.5e-3))
    share = 1.133 * radius / float(row["half_space_from"])
    assert share == pytest.approx(float(row["elasticity_combined"]) / float(row["elasticity"]), rel=0.2)
    page = palpate(
        "fit", tmp_path / "press.csv", "--pipeline", tmp_path / "fits" / "pipeline.toml", "-o", tmp_path / "p"
    )
    assert words in " ".join(page.stdout.split())
