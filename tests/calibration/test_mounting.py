"""The sensor's mounting on the tool: found from the weight in the arm's poses, as far as these tell it."""

import math

import numpy as np
import pytest
from palpate import LogError
from palpate_calibration.mounting import find_mounting, mounting_fit
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector

WEIGHT, BIAS, NOISE = 0.14 * 9.80665, np.array([0.3, -0.2, 0.6]), 2e-3
DOWN = np.array([0.0, 0.0, -1.0])
LOOKS_AT_SKIN = np.diag([1.0, -1.0, -1.0])
TURNS = np.radians([[0, 0, 0], [0, 40, 0], [40, 0, 0], [0, -40, 0]])
HALF = (math.pi, 0.0, 0.0)


def readings(mounting, turns=TURNS, reaction=False, noise=0.0, down=DOWN, seed=0):
    """Mean forces of a sensor in orientations of the tool, and these orientations."""
    tools = np.array([LOOKS_AT_SKIN @ rotation_matrix(turn) for turn in turns])
    sensor = tools @ rotation_matrix(mounting)
    forces = (-1 if reaction else 1) * WEIGHT * np.einsum("nij,i->nj", sensor, down) + BIAS
    return forces + noise * np.random.default_rng(seed).standard_normal(forces.shape), tools


def apart(one, other):
    return np.linalg.norm(rotation_vector(rotation_matrix(one).T @ other))


@pytest.mark.parametrize("mounting", [HALF, (0.0, 0.0, 0.0), (3.0, 0.4, -0.9), (0.1, 0.0, 2.0), (0.0, -1.2, 0.3)])
@pytest.mark.parametrize("reaction", [False, True])
def test_every_mounting_and_convention_is_found(mounting, reaction):
    forces, tools = readings(mounting, reaction=reaction)
    fit = mounting_fit(forces, tools, DOWN, NOISE, 1)
    assert apart(mounting, fit.rotation) < 1e-7
    assert fit.tells_reaction
    assert fit.convention == (-1 if reaction else 1)


def test_three_orientations_leave_open_whether_the_force_or_its_reaction_is_read():
    forces, tools = readings(HALF, TURNS[:3])
    fit = mounting_fit(forces, tools, DOWN, NOISE, 1)
    assert not fit.tells_reaction
    assert apart(HALF, fit.rotation) < 1e-7  # as `sign` says
    found = find_mounting([(forces, tools, NOISE)], DOWN, 0.0, 1, HALF)
    assert "reaction" in found.note
    assert found.values["mounting_x"].value == pytest.approx(math.pi)


@pytest.mark.parametrize("turns", [[[0, 0, 0], [0, 40, 0], [0, 40, 0]], [[0, 0, 0], [0, 0, 40], [0, 0, -40]]])
def test_directions_on_a_line_leave_a_turn_about_it_open(turns):
    """As do two of them, and a tool that was turned about the vertical."""
    forces, tools = readings(HALF, np.radians(turns))
    with pytest.raises(LogError, match="lie on a line"):
        mounting_fit(forces, tools, DOWN, NOISE, 1)


def test_readings_of_another_tool_are_refused():
    forces, tools = readings(HALF)
    with pytest.raises(LogError, match="do not follow the arm's poses"):
        find_mounting([(forces[[0, 2, 1, 3]] * [1, 2, 1], tools, NOISE)], DOWN, math.radians(0.5), 1, HALF)


@pytest.mark.slow
def test_intervals_hold_the_truth_ninety_to_a_hundred_times_of_a_hundred():
    """With noise, and a base that stands half a degree off; the vector of a half turn does not jump to its negative."""
    angle, mounting, inside = math.radians(0.5), np.array([3.1, 0.1, -0.2]), np.zeros(3)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        down = rotation_matrix((angle * np.array([*rng.standard_normal(2), 0.0])).tolist()) @ DOWN
        repeats = [(*readings(mounting, noise=NOISE, down=down, seed=10 * seed + i), NOISE) for i in range(3)]
        values = find_mounting(repeats, DOWN, angle, 1, HALF).values
        for i, axis in enumerate("xyz"):
            low, high = values[f"mounting_{axis}"].interval
            inside[i] += low <= mounting[i] <= high
    assert (inside >= 90).all(), inside
