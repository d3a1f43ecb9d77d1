"""`palpate info`: from a log nobody has described to a fit."""

import json
import re

import numpy as np
import pytest
from palpate_engine import registry
from palpate_kit.runs.result_file import estimate_of
from palpate_records.recording import Recording

from tests.records.bags import array_message, press, transforms_message, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"


@pytest.fixture
def bag(tmp_path):
    """A bag with one array of numbers without names."""
    time, height, speed, force = press(8.0)
    rows = np.column_stack([time, height, speed, force])
    messages = [(round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
    return write_bag(tmp_path / "bag.db3", [("/data_control", ARRAY, messages)])


@pytest.mark.slow
def test_devices_that_read_logs_are_called_replays():
    """By this name they are known before any device is imported; a robot is not asked whether it reads a file."""
    devices = [(name, entry) for name, entry in registry.load().parts["device"].items() if entry.plugin.own]
    readers = {name for name, entry in devices if entry.problem is None and issubclass(entry.part, Recording)}
    assert readers == {name for name, _ in devices if name.endswith("-replay")}


def test_what_a_log_holds(palpate, bag):
    done = palpate("info", bag.name)
    assert done.returncode == 0, done.stderr
    for text in ("/data_control", ARRAY, "4000", "500.0", "data[3]", "not finite", "▁", "4000 messages over 7.998 s"):
        assert text in done.stdout


def test_the_frames_of_transforms_are_named(palpate, tmp_path):
    """Their numbers stand in one row, of whichever frame comes, and nothing said of which."""
    numbers = (0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0)
    names = ("tool0", "camera_link")
    messages = [(10**6 * i, transforms_message([(10**6 * i, "base", names[i % 2], numbers)])) for i in range(40)]
    write_bag(tmp_path / "bag.db3", [("/tf", "tf2_msgs/msg/TFMessage", messages)])
    assert "/tf: its transforms are of camera_link, tool0: select = NAME" in palpate("info", "bag.db3").stdout


@pytest.mark.gate
@pytest.mark.slow
def test_a_suggested_pipeline_runs_as_it_is(palpate, bag, tmp_path):
    suggested = palpate("info", bag.name, "--suggest")
    assert suggested.returncode == 0, suggested.stderr
    (tmp_path / "log.toml").write_text(suggested.stdout)
    done = palpate("run", "log.toml", "--json")
    assert done.returncode == 0, done.stderr
    track = json.loads(done.stdout)["tracks"]["dr/ekf"]
    # A force of 1.2e4 d^1.5 on the 5 mm tip: E = 3/4 (1 - 1/4) kappa / sqrt(R), without viscosity.
    truth = 0.75 * 0.75 * 1.2e4 / np.sqrt(0.005)
    found = track["parameters"]["elasticity"]
    assert found["verdict"] == "needs indenter.tip.type"  # which the pipeline only supposes
    assert found["value"] == pytest.approx(truth, rel=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur3e_load_unload_soft_1", "foam_white_1_p"])
def test_the_authors_bags_from_a_first_look_to_a_fit(palpate, shared, tmp_path, name):
    """The commands of docs/logs.md, as a new user types them."""
    bag = shared / "rosbag2" / f"{name}.db3.gz"
    looked = palpate("info", bag)
    assert looked.returncode == 0, looked.stderr
    assert "/data_control" in looked.stdout
    suggested = palpate("info", bag, "--suggest")
    assert suggested.returncode == 0, suggested.stderr
    (tmp_path / "bag.toml").write_text(suggested.stdout)
    done = palpate("run", "bag.toml", "--json")
    assert done.returncode == 0, done.stderr
    tracks = json.loads(done.stdout)["tracks"]
    assert tracks.keys() == {"dr/ekf", "dr/fit"}
    for track in tracks.values():
        found = track["parameters"]["elasticity"]
        assert 10e3 < estimate_of(found) < 500e3
        assert found["combined"] > 0
    fitted = palpate("fit", "bag.toml", "--no-pictures")
    assert fitted.returncode == 0, fitted.stderr
    assert re.search(r"^ +E +\d.* kPa ", fitted.stdout, re.MULTILINE), fitted.stdout


def table(path, header, columns, delimiter=","):
    lines = [delimiter.join(header)] if header else []
    lines += [delimiter.join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    path.write_text("\n".join(lines) + "\n")


def from_suggestion_to_elasticity(palpate, tmp_path, *arguments):
    suggested = palpate("info", *arguments, "--suggest")
    assert suggested.returncode == 0, suggested.stderr
    (tmp_path / "log.toml").write_text(suggested.stdout)
    done = palpate("run", "log.toml", "--json")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["tracks"]["dr/ekf"]["parameters"]["elasticity"]
    return suggested.stdout, estimate_of(found)


TRUTH = 0.75 * 0.75 * 1.2e4 / np.sqrt(0.005)  # of the force that `press` answers with, on a tip of 5 mm


@pytest.mark.slow
@pytest.mark.parametrize(
    ("header", "scales", "delimiter"),
    [
        (["time_s", "force_N", "position_m", "velocity_m_s"], (1, 1, 1, 1), ","),
        (["t [ms]", "load [mN]", "height (mm)", "v [mm/s]"], (1e3, 1e3, 1e3, 1e3), ";"),
        (["stamp", "Fz", "z", "vz"], (1e3, 1, 1, 1), "\t"),
        (None, (1, 1, 1, 1), ","),
        (None, (1e3, 1, 1e3, 1e3), ","),
    ],
)
def test_a_table_of_numbers_from_its_names_units_or_motion_to_the_elasticity(
    palpate, tmp_path, header, scales, delimiter
):
    time, height, speed, force = press(8.0)
    columns = [scale * column for scale, column in zip(scales, (time, force, height, speed), strict=True)]
    table(tmp_path / "log.csv", header, columns, delimiter)
    shown = palpate("info", "log.csv")
    assert shown.returncode == 0, shown.stderr
    for text in ("4000", "500.0", "(time?)", "(force?)", "(position?)"):
        assert text in shown.stdout
    _, found = from_suggestion_to_elasticity(palpate, tmp_path, "log.csv")
    assert found == pytest.approx(TRUTH, rel=0.08)


@pytest.mark.slow
def test_a_table_without_time_needs_the_rate(palpate, tmp_path):
    _, height, _, force = press(8.0)
    table(tmp_path / "log.csv", ["force_N", "position_m"], [force, height])
    blank = palpate("info", "log.csv", "--suggest")
    assert blank.returncode == 0
    assert "fill in: rate: rows per second" in blank.stderr
    assert 'rate = "? Hz"    # FILL IN' in blank.stdout
    (tmp_path / "blank.toml").write_text(blank.stdout)
    refused = palpate("check", "blank.toml")
    assert (refused.returncode, "? Hz" in refused.stderr) == (2, True)
    blank = palpate("fit", "choose", "log.csv", "--models", "dr,kelvin-voigt")
    assert (blank.returncode, "palpate info log.csv --suggest -o log.toml" in blank.stderr) == (2, True)
    assert "no column is the time" in palpate("info", "log.csv").stdout
    text, found = from_suggestion_to_elasticity(palpate, tmp_path, "log.csv", "--rate", "500 Hz")
    assert 'rate = "500 Hz"' in text
    assert found == pytest.approx(TRUTH, rel=0.08)


@pytest.mark.slow
def test_columns_that_are_not_clear_are_named_and_can_be_chosen(palpate, tmp_path):
    time, height, _, force = press(8.0)
    columns = [np.arange(len(time)), time, np.sin(time), force, height]
    table(tmp_path / "log.csv", ["n", "t", "fx_N", "fz_N", "z_m"], columns)
    for choice in ((), ("--force", "fz_N")):
        text, found = from_suggestion_to_elasticity(palpate, tmp_path, "log.csv", *choice)
        assert found == pytest.approx(TRUTH, rel=0.08)
        assert "CHECK" not in text
    wrong = palpate("info", "log.csv", "--suggest", "--force", "fy")
    assert "no column 'fy' (there are: n, t, fx_N, fz_N, z_m)" in wrong.stderr


@pytest.mark.slow
def test_a_real_table_by_its_columns(palpate, shared, tmp_path):
    log = shared / "ur3e-bota-2024" / "d10mm_soft.csv.gz"
    chosen = ("--rate", "500 Hz", "--force", "4", "--position", "0", "--velocity", "3")
    text, found = from_suggestion_to_elasticity(palpate, tmp_path, log, *chosen)
    assert 'velocity = { column = 3, unit = "mm/s" }' in text
    assert 90e3 < found < 140e3  # without the delays, which the file does not say


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.csv", "", "the file is empty"),
        ("a.csv", "force,z\n", "contains no rows of numbers"),
        ("a.csv", "t;z\n0,1;1,5\n0,2;1,6\n", "no two columns can be force and position"),
        ("a.csv", "t,z\n0,1,1,5\n0,2,1,6\n", "decimal commas"),
        ("a.csv.gz", "no gzip", "cannot be read"),
        ("a.csv", "\xff\xfe", "the file is empty"),
        ("a.csv", "\xff\x81", "is a binary file and no text"),
        ("a.csv", "PK\x03\x04\x14\x00\x06\xff", "is a zip archive and no text: a workbook is named .xlsx"),
        ("a.csv", "%PDF-1.7\n%\xe2\xe3\xcf\xd3\x00\x81\x8d", "is a PDF and no text"),
        ("a.csv", "\x89HDF\r\n\x1a\n\x00\x81", "is an HDF5 file and no text: name it .h5"),
        ("a.csv", "t,z\n0.1,1\n", "no two columns can be force and position"),
    ],
)
def test_tables_that_are_none(palpate, tmp_path, name, text, words):
    (tmp_path / name).write_bytes(text.encode("latin-1"))
    refused = palpate("info", name, "--suggest")
    assert refused.returncode == 2
    assert words in refused.stderr
    assert "Traceback" not in refused.stderr


def test_rate_and_time_are_for_tables(palpate, bag):
    refused = palpate("info", bag.name, "--suggest", "--time", "t")
    assert "--time is for CSV files" in refused.stderr
    done = palpate("info", bag.name, "--suggest", "--rate", "500 Hz")
    assert done.returncode == 0
    assert "--rate is ignored for 1 file that has a time" in done.stderr
    assert done.stdout == palpate("info", bag.name, "--suggest").stdout


def test_what_cannot_be_looked_into(palpate, tmp_path):
    (tmp_path / "notes.txt").write_text("no log")
    for name, words in (("none.db3", "no such file"), ("notes.txt", "neither a text with rows of numbers")):
        done = palpate("info", name)
        assert done.returncode == 2
        assert words in done.stderr
        assert "Traceback" not in done.stderr


def test_names_from_a_log_do_not_break_the_pipeline(palpate, tmp_path):
    time, height, speed, force = press()
    rows = np.column_stack([time, height, speed, force])
    messages = [(round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
    write_bag(tmp_path / 'odd "name".db3', [('/a "b" \\ \n[c]', ARRAY, messages)])
    suggested = palpate("info", 'odd "name".db3', "--suggest")
    (tmp_path / "log.toml").write_text(suggested.stdout)
    assert palpate("check", "log.toml").returncode == 0
