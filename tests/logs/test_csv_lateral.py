"""Which columns of a table are the place along the skin: by name, as stated, or asked for."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_roles import suggest_csv

RATE = 100.0


def sweep(path, names, *places):
    """A table of a sine in contact, with further columns behind time, height [mm] and force [N]."""
    time = np.arange(0.0, 12.0, 1 / RATE)
    height = np.where(time < 1.0, 1.0, -3.0 + np.sin(2 * np.pi * 2 * time))
    force = np.maximum(-height, 0.0) ** 1.5
    noise = np.random.default_rng(0).standard_normal((len(time), len(places)))
    columns = [
        time,
        height,
        force,
        *(place(time, height) + 1e-9 * row for place, row in zip(places, noise.T, strict=True)),
    ]
    header = "time [s],height [mm],force [N]" + "".join(f",{name}" for name in names)
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def along(time, height):
    return 4.0 * np.maximum(time - 2.0, 0.0)


def still(time, height):
    return 0.001 * np.sin(7 * time)


@pytest.mark.parametrize("name", ["x [mm]", "tool y [mm]", "pos_x [mm]", "Y (mm)"])
def test_a_column_that_is_named_so_and_moves_is_the_place(tmp_path, name):
    suggestion = suggest_csv(sweep(tmp_path / "a.csv", [name], along), {})
    axis = "x" if "x" in name.lower() else "y"
    assert suggestion.device["columns"][axis] == {"column": name, "unit": "mm"}
    assert suggestion.alignment[f"lateral_{axis}"] == f"log.{axis}"


def test_elements_of_a_pose_are_x_and_y(tmp_path):
    names = [f"actual_TCP_pose_{k} [mm]" for k in (0, 1)]
    suggestion = suggest_csv(sweep(tmp_path / "a.csv", names, along, along), {})
    assert {key for key in suggestion.alignment if key.startswith("lateral")} == {"lateral_x", "lateral_y"}


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("x [mm]", still),  # a point: it does not move
        ("x [mm]", lambda time, height: 2 * height),  # the height again
        ("target x [mm]", along),  # a command
        ("x force [N]", along),
        ("y [deg]", along),
    ],
)
def test_what_is_no_place_is_left(tmp_path, name, place):
    alignment = suggest_csv(sweep(tmp_path / "a.csv", [name], place), {}).alignment
    assert not [key for key in alignment if key.startswith("lateral")]


def test_a_column_is_stated_with_the_unit_that_makes_it_a_sweep(tmp_path):
    path = sweep(tmp_path / "a.csv", ["way"], lambda time, height: 1e-3 * along(time, height))
    suggestion = suggest_csv(path, {"lateral": "way"})
    assert suggestion.device["columns"]["x"] == {"column": "way", "unit": "m"}
    assert any("way in m is a guess: it goes 40 mm" in doubt for doubt in suggestion.doubts)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ("other", "--lateral: no column 'other'"),
        ("way", "does not move like a place along the skin"),
        ("way,way,way", "3 columns; name one"),
    ],
)
def test_a_stated_column_that_is_no_place_is_refused(tmp_path, stated, message):
    with pytest.raises(LogError, match=message):
        suggest_csv(sweep(tmp_path / "a.csv", ["way [mm]"], still), {"lateral": stated.replace("way", "way [mm]")})


def test_a_column_without_a_name_that_moves_like_a_place_is_asked_for(tmp_path):
    path = sweep(tmp_path / "a.csv", ["way"], lambda time, height: along(time, height) + 0.02 * np.sin(300 * time))
    path.write_text("\n".join(path.read_text().splitlines()[1:]) + "\n")
    suggestion = suggest_csv(path, {"time": "0", "position": "1", "force": "2"})
    assert any("--lateral sets it" in doubt for doubt in suggestion.doubts)


def test_a_length_that_moves_like_a_place_is_asked_for_by_its_name(tmp_path):
    """A column "way [mm]" is no x; one of another unit, or that goes on with the height, is nothing."""
    names = ["way [mm]", "stage [mm]", "drift [degC]"]
    path = sweep(tmp_path / "a.csv", names, lambda time, height: 4 * time, lambda time, height: 2 * height, along)
    suggestion = suggest_csv(path, {})
    (asked,) = [doubt for doubt in suggestion.doubts if "--lateral sets it" in doubt]
    assert "column way [mm] goes on" in asked
    assert suggestion.sweep_speed is None


@pytest.mark.parametrize(("choices", "speed"), [({}, 4e-3), ({"time": "time [s]"}, 4e-3), ({"rate": "200 Hz"}, 8e-3)])
def test_the_speed_along_the_skin_is_that_of_the_way_not_of_the_stays(tmp_path, choices, speed):
    path = sweep(tmp_path / "a.csv", ["x [mm]"], lambda time, height: along(time, height) + 1e-3 * np.sin(900 * time))
    if "rate" in choices:  # of rows without a time
        rows = [line.partition(",")[2] for line in path.read_text().splitlines()]
        path.write_text("\n".join(rows) + "\n")
    assert suggest_csv(path, choices).sweep_speed == pytest.approx(speed, rel=0.02)


def test_a_twist_is_a_velocity_and_its_other_axes_are_no_places(tmp_path):
    """As in a log that was exported: columns have the fields of their messages for names, and no units."""

    def wander(time, height):
        return 0.02 * np.sin(3 * time)

    names = ["tip:pose.position.x", "twist:twist.linear.x", "twist:twist.linear.z"]
    path = sweep(tmp_path / "a.csv", names, still, wander, lambda time, height: np.gradient(height, time))
    suggestion = suggest_csv(path, {"velocity": names[2]})
    assert suggestion.device["columns"]["velocity"] == {"column": names[2], "unit": "mm/s"}
    assert not [key for key in suggestion.alignment if key.startswith("lateral")]
