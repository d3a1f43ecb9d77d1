"""Which of several columns is the force or the position, where names and units alone mislead."""

import numpy as np
import pytest
from palpate_logs.csv_roles import suggest_csv
from palpate_records.tables.csv_names import role_by_words

DEPTH = np.interp(np.arange(600.0), [0, 100, 400, 500, 599], [-1.0, -1.0, 2.0, 2.0, -1.0])
FORCE = np.maximum(DEPTH, 0.0) ** 1.5


def written(path, head, *columns):
    np.savetxt(path, np.column_stack(columns), "%.6f", ",", header=head, comments="")
    return path


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_of_a_raw_force_and_an_estimated_one_that_of_less_noise_is_taken(tmp_path, sign):
    """The estimate of a robot has a noise of a third of a press; "torque" in the name of the other says nothing."""
    random = np.random.default_rng(3)
    raw, estimate = (FORCE + noise * random.standard_normal(600) for noise in (0.02, 0.9))
    head = "time (s),actual_tcp_position_2,raw_force_torque_2,external_tcp_force_2"
    path = written(tmp_path / "robot.csv", head, 0.01 * np.arange(600), 300.0 - DEPTH, sign * raw - 12.0, estimate)
    assert suggest_csv(path, {}).device["columns"]["force"]["column"] == "raw_force_torque_2"


@pytest.mark.parametrize(("element", "role"), [(0, "force"), (2, "force"), (3, "other"), (5, "other")])
def test_the_first_three_of_six_forces_and_torques_are_forces(element, role):
    assert role_by_words(f"raw_force_torque_{element}") == role
    assert role_by_words(f"force_torque[{element}]") == role


def test_an_indentation_of_zeros_is_no_position_and_the_beam_is_asked_for(tmp_path):
    """A bioindenter that works the indentation out later: its stage and what its cantilever yields are lengths."""
    bend = 1000.0 * FORCE
    columns = 0.01 * np.arange(600), FORCE, np.zeros(600), bend, 1000.0 * (DEPTH + 1.0) + bend
    path = written(tmp_path / "bio.csv", "Time (s),Load (uN),Indentation (nm),Cantilever (nm),Piezo (nm)", *columns)
    (blank,) = suggest_csv(path, {}).blanks
    assert blank.startswith("position-of: the force is one constant times Cantilever (nm)")
    found = suggest_csv(path, {"position-of": "stage"})
    assert found.device["columns"]["position"]["column"] == "Piezo (nm)"
    assert found.alignment["beam"] == "1 N/m"
