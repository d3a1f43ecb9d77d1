"""A device that is slower than the loop that wrote the table: its readings stand for several rows."""

import csv

import numpy as np
import pytest
from palpate_logs.sample_hold import SampleHold, rows_per_reading

ELASTICITY, VISCOSITY, RADIUS = 112.5e3, 362.0, 5e-3


def record(seed):
    """Time [s], position [m] and force [N] of an approach and a sine of 2 Hz at 500 Hz."""
    rng = np.random.default_rng(seed)
    approach, sine = np.arange(-2.8, 0.0, 0.002), np.arange(0.0, 4.0, 0.002)
    time = np.concatenate([approach, sine])
    position = np.concatenate([1.8e-3 + 1e-3 * approach, 3e-3 - 1.2e-3 * np.cos(4 * np.pi * sine)])
    depth = np.maximum(position, 0.0)
    damping = 8 * VISCOSITY * np.sqrt(depth) * np.gradient(position, time)
    force = np.sqrt(RADIUS) * (16 / 9 * ELASTICITY * depth**1.5 + damping)
    noise = rng.normal(0.0, 1.0, (2, len(time)))
    return time - time[0], position + 2e-6 * noise[0], force + 5e-3 * noise[1]


def held(values, rows):
    return np.repeat(values[::rows], rows)[: len(values)]


@pytest.mark.parametrize("rows", [2, 3, 5, 10])
def test_held_readings_have_a_rhythm(rows):
    _, position, force = record(1)
    assert rows_per_reading(held(force, rows)) == rows
    assert rows_per_reading(held(position, rows)) == rows


def test_a_loop_that_jitters_reads_a_rhythm_all_the_same():
    _, _, force = record(1)
    steps = np.random.default_rng(2).choice([4, 5, 5, 5, 6], size=len(force) // 4)
    latest = np.searchsorted(np.cumsum(steps), np.arange(len(force)), side="right")
    assert rows_per_reading(force[::5][np.minimum(latest, len(force[::5]) - 1)]) == 5


@pytest.mark.parametrize("noise", [0.0, 5e-4, 2e-3, 5e-3])
@pytest.mark.parametrize("digit", [0.0, 1e-3, 1e-2, 5e-2])
def test_coarse_readings_are_not_held(noise, digit):
    """0 to 50 mN of the last digit: a slow force repeats, but goes on by one digit, or in no rhythm."""
    rng = np.random.default_rng(3)
    depth = np.linspace(0.0, 2e-3, 4000)
    force = 16 / 9 * 50e3 * np.sqrt(3e-3) * depth**1.5 + rng.normal(0.0, noise, len(depth)) if noise else depth * 600
    coarse = np.round(force / digit) * digit if digit else force
    assert rows_per_reading(coarse) == 1
    assert rows_per_reading(np.round(depth, 5)) == 1


def test_blocks_are_one_table():
    _, position, force = record(1)
    table = np.column_stack([position, held(force, 5)])
    whole = SampleHold().without_repeats(table)
    readings = SampleHold()
    parts = [readings.without_repeats(part) for part in np.split(table, [1000, 1003, 2500])]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    assert np.isfinite(whole[:, 0]).all()
    assert np.count_nonzero(np.isfinite(whole[:, 1])) == len(force) // 5


@pytest.mark.parametrize("column", ["position", "force"])
@pytest.mark.parametrize("rows", [2, 5, 10])
def test_a_held_column_moves_no_viscosity(palpate, tmp_path, column, rows):
    """By the repeats, 10 rows of the position made 693 of 362 Pa s, and 10 of the force 23."""
    time, position, force = record(rows)
    columns = {"position": 1e3 * (position + 1e-3), "force": force}
    columns[column] = held(columns[column], rows)
    table = np.column_stack([time, *columns.values()])
    header = "time (s),position (mm),force (N)"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=header, comments="", fmt="%.6f")
    palpate("fit", "log.csv", "--tip", "paraboloid 5 mm", "--delay", "0 ms +- 0.1 ms", "--out", "out", "--no-pictures")
    with (tmp_path / "out" / "fits.csv").open() as file:
        row = next(csv.DictReader(file))
    for name, truth in (("elasticity", ELASTICITY), ("viscosity", VISCOSITY)):
        assert row[f"{name}_verdict"] == "good"
        assert abs(float(row[name]) - truth) < 0.02 * truth
