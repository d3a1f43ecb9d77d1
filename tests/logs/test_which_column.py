"""Which of several columns is the force or the position, where names and units alone mislead."""

import re

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.role_evidence import on_grid
from palpate_logs.csv_roles import suggest_csv
from palpate_records.tables.csv_names import role_by_words, unit_text
from palpate_records.tables.table_text import encoding_of

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


@pytest.mark.parametrize(
    ("name", "unit"), [("Force N", "N"), ("Travel mm", "mm"), ("Cycle N", ""), ("Sample N", ""), ("N", "")]
)
def test_a_unit_behind_a_space_belongs_to_a_quantity(name, unit):
    assert unit_text(name) == unit


def test_a_height_that_grows_evenly_is_no_time(tmp_path):
    """A table of height and force from a simulation was read with the height as its time."""
    path = written(tmp_path / "model.csv", "z,force", np.linspace(0.0, 20.0, 401), np.linspace(0.0, 1.0, 401) ** 1.5)
    suggestion = suggest_csv(path, {})
    assert suggestion.device["columns"]["position"]["column"] == "z"
    assert [blank.partition(":")[0] for blank in suggestion.blanks] == ["rate"]


@pytest.mark.parametrize("name", ["F_std", "force error", "z_sd", "qx", "qw", "quaternion_2", "position_error"])
def test_deviations_errors_and_quaternions_are_no_force_and_no_height(name):
    assert role_by_words(name) == "other"


def test_forces_in_counts_have_the_scale_of_the_head(tmp_path):
    head = "Counts per Force: 500000\nForce Units: lbf\ntime (s),z (mm),Fz"
    path = written(tmp_path / "counts.csv", head, 0.01 * np.arange(600), -DEPTH, np.rint(1e5 * FORCE))
    suggestion = suggest_csv(path, {})
    assert suggestion.device["columns"]["force"] == {"column": "Fz", "unit": "lbf", "scale": 2e-6}
    assert not suggestion.blanks
    other = written(tmp_path / "newtons.csv", head, 0.01 * np.arange(600), -DEPTH, FORCE)
    assert suggest_csv(other, {}).device["columns"]["force"]["unit"] == "N"


@pytest.mark.parametrize(
    ("text", "encoding"),
    [("時間,荷重,変位", "cp932"), ("Prüfzeit;Größe;µm °C", "cp1252"), ("Éléments déformés àéè", "cp1252")],
)
def test_an_encoding_is_found_by_the_bytes_of_its_letters(tmp_path, text, encoding):
    (tmp_path / "text.csv").write_text(f"{text}\n1,2,3\n", encoding=encoding)
    assert encoding_of(tmp_path / "text.csv") == encoding


@pytest.mark.parametrize(("name", "has_note"), [("fx_N", False), ("force_estimate_N", True), ("load_N", True)])
def test_another_axis_of_the_force_is_no_other_force(tmp_path, name, has_note):
    random = np.random.default_rng(0)
    noise = 0.01 * random.standard_normal((2, 600))
    path = written(
        tmp_path / "axes.csv", f"time_s,z_mm,fz_N,{name}", 0.01 * np.arange(600), -DEPTH, FORCE + noise[0], noise[1]
    )
    suggestion = suggest_csv(path, {})
    assert suggestion.device["columns"]["force"]["column"] == "fz_N"
    assert any(f"not column {name}" in doubt for doubt in suggestion.doubts) is has_note


@pytest.mark.parametrize(("head", "size", "asks"), [("", 200, False), ("", 4e5, True), ("t,z,force", 4e5, True)])
def test_whole_numbers_without_a_unit_are_counts_where_they_go_far(tmp_path, head, size, asks):
    """Counts of a converter were taken in the unit that made a stiffness of 20 MPa likely."""
    path = written(tmp_path / "counts.csv", head, 0.01 * np.arange(600), DEPTH, np.rint(size * FORCE))
    blanks = [blank.partition(":")[0] for blank in suggest_csv(path, {}).blanks]
    assert blanks == (["columns.force.scale"] if asks else [])


@pytest.mark.parametrize("role", ["force", "position"])
def test_a_column_that_stands_still_is_no_force_and_no_position(tmp_path, role):
    """Stated as the position, the constant depth of a relaxation ended in a traceback."""
    columns = {"force": FORCE + 0.1, "position": DEPTH} | {role: np.full(600, 2.0)}
    path = written(tmp_path / "hold.csv", "time (s),force (N),depth (mm)", 0.01 * np.arange(600), *columns.values())
    name = {"force": "force (N)", "position": "depth (mm)"}[role]
    with pytest.raises(LogError, match=f"no column can be the {role}.*the same number in every row: {re.escape(name)}"):
        suggest_csv(path, {})
    with pytest.raises(LogError, match=rf"--{role}: column {re.escape(name)} has the same number in every row"):
        suggest_csv(path, {role: name})


def test_a_constant_column_is_on_the_grid():
    _, (constant,) = on_grid([np.arange(100.0)], [np.full(100, 2e-3)])
    assert (constant == 2e-3).all()
