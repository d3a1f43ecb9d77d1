"""What `info LOG --suggest` takes for force and motion, which way they count, and what it says that it only guesses."""

import json
import re
import tomllib
import tracemalloc

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.delay_from_free_air import air_delay
from palpate_kit.logs.role_evidence import contact_law, derivative, force_sign, on_grid
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.rosbag2_replay import Rosbag2Replay
from palpate_records.field_statistics import FieldStatistics, sparkline
from palpate_records.survey import _MAX_HELD, SampleOfRow
from palpate_records.tables.csv_sheet import Sheet

from tests.records.bags import array_message, press, write_bag

ARRAY = "std_msgs/msg/Float64MultiArray"


def swinging(seconds=6.0, rate=500.0):
    """Time, height, velocity and force of a record that begins and ends in contact: nothing of it is in free air."""
    time = np.arange(int(seconds * rate)) / rate
    depth = 0.003 + 0.0015 * np.sin(4 * np.pi * time)
    noise = np.random.default_rng(4).standard_normal((3, len(time)))
    force = 1.2e4 * depth**1.5 + 3.0 * np.gradient(depth, time) + 0.02 * noise[2]
    return time, -depth - 0.1 + 3e-6 * noise[0], -np.gradient(depth, time) + 1e-4 * noise[1], force


def written(path, columns, header=None):
    rows = [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    path.write_text("\n".join([*([",".join(header)] if header else []), *rows]) + "\n")
    return path


def roles(suggestion):
    """Column and sign of each role."""
    columns = {role: entry["column"] for role, entry in suggestion.device["columns"].items()}
    return {role: (column, suggestion.alignment[role]["sign"]) for role, column in columns.items()}


@pytest.mark.parametrize("record", [press, swinging], ids=["from free air", "in contact all the time"])
@pytest.mark.parametrize("f", [1, -1])
@pytest.mark.parametrize("z", [1, -1])
@pytest.mark.parametrize("v", [1, -1])
def test_signs_from_what_a_contact_is(tmp_path, record, f, z, v):
    time, height, speed, force = record()
    path = written(tmp_path / "log.csv", [time, v * speed, f * force, z * height])
    suggestion = CsvReplay.suggest(path, {})
    assert roles(suggestion) == {"force": (2, f), "position": (3, z), "velocity": (1, v)}
    assert not [text for text in suggestion.doubts if text.startswith("sign")]


@pytest.mark.parametrize("record", [press, swinging])
def test_a_setpoint_is_not_taken_for_the_measurement(tmp_path, record):
    time, height, speed, force = record()
    smooth = np.convolve(height - height[0], np.ones(15) / 15, "same") + height[0]
    setpoint = np.interp(time - 0.01, time, smooth)
    path = written(tmp_path / "log.csv", [time, setpoint, height, speed, force, np.full(len(time), 0.97)])
    assert roles(CsvReplay.suggest(path, {})) == {"position": (2, 1), "velocity": (3, 1), "force": (4, 1)}
    path = written(tmp_path / "log.csv", [time, setpoint, height, force], ["t", "z_desired [m]", "z [m]", "fz [N]"])
    assert roles(CsvReplay.suggest(path, {})) == {"position": ("z [m]", 1), "force": ("fz [N]", 1)}


@pytest.mark.parametrize(("scale", "unit", "speed_unit"), [(1, "m", "m/s"), (1e3, "mm", "mm/s"), (1e6, "um", "um/s")])
@pytest.mark.parametrize(("force_scale", "force_unit"), [(1, "N"), (1e3, "mN")])
def test_units_that_nothing_states_are_guessed_and_said(tmp_path, scale, unit, speed_unit, force_scale, force_unit):
    time, height, speed, force = swinging()
    path = written(tmp_path / "log.csv", [time, force_scale * force, scale * height, scale * speed])
    suggestion = CsvReplay.suggest(path, {})
    units = {role: entry["unit"] for role, entry in suggestion.device["columns"].items()}
    assert units == {"force": force_unit, "position": unit, "velocity": speed_unit}
    for role in units:
        assert any(text.startswith(f"unit of the {role}: {units[role]} is a guess") for text in suggestion.doubts)


@pytest.mark.parametrize(
    ("time", "header", "used"),
    [
        ("even", "t_s,force_N,height_mm", "time"),
        ("even", "a,force_N,height_mm", "time"),  # a guess, of which no rate is suggested
        ("none", "force_N,height_mm", "rate"),
        ("still", "t_s,force_N,height_mm", "rate"),  # the time of whole seconds is none
    ],
)
def test_a_rate_is_for_files_without_a_time(tmp_path, time, header, used):
    stamps = {"even": np.arange(800) / 400.0, "still": np.arange(800) // 400}.get(time)
    depth = np.maximum(np.sin(np.arange(800) / 250.0) - 0.3, 0.0)
    columns = [depth**1.5, -depth] if stamps is None else [stamps, depth**1.5, -depth]
    np.savetxt(tmp_path / "a.csv", np.column_stack(columns), delimiter=",", header=header, comments="")
    found = CsvReplay.suggest(tmp_path / "a.csv", {"rate": "100 Hz"})
    assert {"time", "rate"} & found.device.keys() == {used}
    assert found.has_time == (used == "time")
    assert not any("--rate" in text for text in found.doubts)


@pytest.mark.parametrize("role", ["force", "position", "velocity", "time"])
@pytest.mark.parametrize(
    ("cells", "words"),
    [
        (["RUN"] * 800, r"contains text \('RUN'\), no numbers"),
        (["RUN"] * 796 + ["1.5"] * 4, r"contains text \('RUN'\) and 4 numbers"),
        ([""] * 800, "contains empty cells, no numbers"),
    ],
)
def test_a_column_without_numbers_that_is_named_is_refused(tmp_path, role, cells, words):
    rows = [f"{k / 100},{-k % 7},{k % 11},{cell}" for k, cell in enumerate(cells)]
    (tmp_path / "a.csv").write_text("\n".join(["time (s),height (mm),force (N),state", *rows]))
    with pytest.raises(LogError, match=rf"a\.csv: --{role}: column state {words} \(there are: time"):
        CsvReplay.suggest(tmp_path / "a.csv", {role: "state"})


@pytest.mark.parametrize("rate", [500.0, 125.0])
def test_the_rate_of_a_table_without_time_is_told_by_its_velocity(tmp_path, rate):
    _, height, speed, force = swinging(rate=rate)
    path = written(tmp_path / "log.csv", [height, speed, force])
    suggestion = CsvReplay.suggest(path, {})
    assert suggestion.device["rate"] == f"{rate:g} Hz"
    assert any(text.startswith(f"rate: {rate:g} Hz is a guess") for text in suggestion.doubts)
    path = written(tmp_path / "log.csv", [height, force])
    suggestion = CsvReplay.suggest(path, {})
    assert suggestion.device["rate"] == "? Hz"
    assert len(suggestion.blanks) == 1


def test_a_spike_does_not_turn_the_signs(tmp_path):
    time, height, speed, force = swinging()
    height[2000], force[1000], force[1500] = 1e155, -900.0, np.nan
    path = written(tmp_path / "log.csv", [time, force, height, speed])
    assert roles(CsvReplay.suggest(path, {})) == {"force": (1, 1), "position": (2, 1), "velocity": (3, 1)}


def test_a_record_that_begins_in_contact_has_no_tare(tmp_path):
    time, height, speed, force = swinging()
    assert CsvReplay.suggest(written(tmp_path / "a.csv", [time, force, height]), {}).alignment["tare"] == "none"
    still = time < 1.5  # at rest, but pressed in
    height[still], speed[still], force[still] = height[750], 0.0, force[750]
    force[still] += 0.02 * np.random.default_rng(1).standard_normal(int(still.sum()))
    suggestion = CsvReplay.suggest(written(tmp_path / "b.csv", [time, force, height]), {})
    assert suggestion.alignment["tare"] == "none"
    assert any("the tip touches in the first" in text for text in suggestion.reasons)
    time, height, _, force = press()
    assert "tare" not in CsvReplay.suggest(written(tmp_path / "c.csv", [time, force, height]), {}).alignment


@pytest.mark.slow
def test_what_cannot_be_known_is_never_said_as_if_it_were(tmp_path):
    """A force that is proportional to the depth, on both sides of zero, has no sign that anything tells."""
    time, height, _, _ = swinging()
    force = -1e3 * (height - height.mean()) + 0.01 * np.random.default_rng(2).standard_normal(len(time))
    suggestion = CsvReplay.suggest(written(tmp_path / "log.csv", [time, force, height], ["t", "fz", "z"]), {})
    assert any(text.startswith("sign of the force") for text in suggestion.doubts)
    noise = np.random.default_rng(5).standard_normal((3, 3000))
    suggestion = CsvReplay.suggest(written(tmp_path / "log.csv", [time, *noise]), {})
    assert {"force", "position"} <= {text.split(":")[0] for text in suggestion.doubts}
    with pytest.raises(LogError, match="no two columns can be force and position"):
        CsvReplay.suggest(written(tmp_path / "log.csv", [time, np.ones(len(time)), height]), {})


def test_numbers_without_names_in_a_bag(tmp_path):
    time, height, speed, force = swinging()
    rows = np.column_stack([np.full(len(time), 3.0), -1e3 * height, -force, -1e3 * speed])
    messages = [(round(t * 1e9), array_message(row)) for t, row in zip(time, rows, strict=True)]
    suggestion = Rosbag2Replay.suggest(write_bag(tmp_path / "bag.db3", [("/data", ARRAY, messages)]), {})
    signals = suggestion.device["signals"]
    assert {r: (s["index"], s["unit"]) for r, s in signals.items()} == {
        "force": (2, "N"),
        "position": (1, "mm"),
        "velocity": (3, "mm/s"),
    }
    assert [suggestion.alignment[role]["sign"] for role in ("force", "position", "velocity")] == [-1, -1, -1]


@pytest.mark.slow
def test_the_authors_recordings(shared):
    """No header, no time, no units, a setpoint, constants; two of them in contact from the first row on."""
    for name in ("d10mm_soft", "d10mm_sphere", "d5mm_soft", "tran_4mms"):
        suggestion = CsvReplay.suggest(shared / "ur3e-bota-2024" / f"{name}.csv.gz", {})
        found = roles(suggestion)
        assert found["force"] == (4, 1)
        assert found["position"] in ((0, 1), (2, -1))
        assert found["velocity"] == (3, -1)
        assert suggestion.device["rate"] == "500 Hz"
        assert {entry["unit"] for entry in suggestion.device["columns"].values()} == {"N", "mm", "mm/s"}
    for name, force, position, velocity in (("ur3e_load_unload_soft_1", 5, 3, 4), ("foam_white_1_p", 5, 2, 4)):
        suggestion = Rosbag2Replay.suggest(shared / "rosbag2" / f"{name}.db3.gz", {})
        indices = {role: signal["index"] for role, signal in suggestion.device["signals"].items()}
        assert indices == {"force": force, "position": position, "velocity": velocity}
        assert [suggestion.alignment[role]["sign"] for role in indices] == [-1, 1, 1]


@pytest.mark.parametrize("true", [0.008, -0.005, 0.0])
def test_the_delay_of_a_force_that_swings_in_air(true):
    """F = -m a(t - tau) with m = 0.2 kg, then a press."""
    time = np.arange(6000) / 500
    swing = np.where(time < 8, 0.01 * np.sin(2 * np.pi * 3.0 * time), -0.05 * np.clip(time - 8, 0, 1) ** 2)

    def acceleration(t):
        return np.where(t < 8, -0.01 * (6 * np.pi) ** 2 * np.sin(2 * np.pi * 3.0 * t), 0.0)

    noise = np.random.default_rng(6).standard_normal((2, len(time)))
    depth = np.maximum(-swing - 0.012, 0.0) * (time > 8)
    force = -0.2 * acceleration(time - true) * (time < 8) + 5e3 * depth**1.2 + 0.02 * noise[0]
    delay, std, mass = air_delay(time, force, time, swing + 2e-6 * noise[1])
    assert delay == pytest.approx(true, abs=max(4 * std, 4e-4))
    assert std < 1e-3
    assert mass == pytest.approx(0.2, rel=0.05)


def test_no_delay_is_told_in_contact():
    time, height, _, force = swinging()
    assert air_delay(time, force, time, height) is None


def test_derivatives_and_laws():
    time, height, speed, force = swinging()
    step, (height, speed, force) = 0.002, on_grid([time] * 3, [height, speed, force])[1]
    found = derivative(height, -1e3 * speed, step)
    assert found.share > 0.99
    assert found.gain == pytest.approx(-1e3, rel=0.03)
    assert derivative(height, force, step).share < 0.5
    law = contact_law(height, force)
    assert (law.share > 0.99, law.slope < 0, law.bend > 5) == (True, True, True)
    assert [force_sign(force, law).value, force_sign(-force, contact_law(height, -force)).value] == [1, -1]


def test_statistics_do_not_depend_on_the_blocks():
    rng = np.random.default_rng(7)
    values = np.column_stack([1e6 + rng.standard_normal(5000), np.sin(np.arange(5000) / 300), np.full(5000, np.nan)])
    values[17, 0] = np.inf
    found = []
    for size in (5000, 777):
        gathered = FieldStatistics(["a", "b", "c"])
        for at in range(0, 5000, size):
            gathered.add(values[at : at + size])
        found.append(gathered.surveys())
    for whole, cut in zip(*found, strict=True):
        assert (whole.name, whole.low, whole.high, whole.odd, whole.course) == (
            cut.name,
            cut.low,
            cut.high,
            cut.odd,
            cut.course,
        )
        assert cut.std == pytest.approx(whole.std, rel=1e-9)
    a, b = found[0]
    assert (a.odd, a.std, a.noise) == (1, pytest.approx(1.0, rel=0.05), pytest.approx(1.0, rel=0.05))
    assert b.noise < 1e-5
    assert len(set(b.course)) > 5
    assert sparkline(np.zeros(50)) == "▁" * 24


def test_what_is_kept_of_a_long_row_does_not_grow():
    sampled = SampleOfRow()
    steps = np.arange(1_000_000, dtype=float)
    for part in np.array_split(steps, 37):
        sampled.add(part)
    assert len(sampled.values) <= _MAX_HELD
    assert np.median(sampled.values) == pytest.approx(500_000, rel=0.01)
    assert np.percentile(sampled.values, 99) == pytest.approx(990_000, rel=0.01)


def test_what_is_kept_of_a_long_row_holds_nothing_else():
    """32 million values, 256 MB: a few of each block are kept, and a view of them would keep the block."""
    sampled = SampleOfRow()
    tracemalloc.start()
    for _ in range(320):
        sampled.add(np.arange(100_000, dtype=float))
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 8 * _MAX_HELD + 1_000_000


@pytest.mark.slow
def test_a_pipeline_file_elsewhere_and_a_picture(palpate, tmp_path):
    time, height, speed, force = press(4.0)
    (tmp_path / "logs").mkdir()
    (tmp_path / "pipelines").mkdir()
    written(tmp_path / "logs" / "log.csv", [time, force, height, speed], ["time_s", "force_N", "position_m", "v [m/s]"])
    pytest.importorskip("matplotlib", reason="pictures need matplotlib")
    done = palpate("info", "logs/log.csv", "-o", "pipelines/log.toml", "--picture", "log.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "log.png").read_bytes()[:4] == b"\x89PNG"
    assert 'file = "../logs/log.csv"' in (tmp_path / "pipelines" / "log.toml").read_text()
    assert palpate("check", "pipelines/log.toml").returncode == 0
    assert "exists already" in palpate("info", "logs/log.csv", "-o", "pipelines/log.toml").stderr


@pytest.mark.slow
def test_a_force_that_counts_the_other_way_is_asked_for(palpate, tmp_path):
    time, height, _, force = press(4.0)
    written(tmp_path / "log.csv", [time, force, height], ["time_s", "force_N", "position_m"])
    palpate("info", "log.csv", "-o", "log.toml")
    text = (tmp_path / "log.toml").read_text().replace('"log.force", sign = 1', '"log.force", sign = -1')
    (tmp_path / "log.toml").write_text(text)
    done = palpate("run", "log.toml")
    assert "should force have sign = -1 in [alignment]?" in " ".join(done.stdout.split())


@pytest.mark.slow
def test_what_nobody_has_stated_is_flagged_until_somebody_does(palpate, tmp_path):
    time, height, _, force = press(4.0)
    written(tmp_path / "log.csv", [time, force, height], ["time_s", "force_N", "z_m"])

    def said(*arguments):
        done = palpate(*arguments, "--set", 'run.tracks=["*/ekf"]')
        assert done.returncode == 0, done.stderr
        folder = max(tmp_path.glob("runs/*"), key=lambda path: path.stat().st_ctime_ns)
        (track,) = json.loads((folder / "result.json").read_text())["tracks"].values()
        return " ".join(one["message"] for one in track["conditions"] if one.get("code") == "assumed"), track["verdict"]

    assert palpate("info", "log.csv", "--suggest", "-o", "own.toml").returncode == 0
    told, verdict = said("run", "own.toml")
    for text in ("indenter.tip.radius = 5 mm", "model.dr.poisson = 0.5", "alignment.tip_mass"):
        assert text in told
    assert verdict != "good"
    stated, _ = said("run", "own.toml", "--set", "indenter.tip.radius=5 mm", "--set", "alignment.tip_mass=0.1 kg")
    assert "radius" not in stated
    assert "tip_mass" not in stated
    assert "indenter.tip.type" in stated
    text = (tmp_path / "own.toml").read_text()
    (tmp_path / "own.toml").write_text(re.sub(r"(?m)^assumed = .*$", 'assumed = ["indenter.tp.radius"]', text))
    assert said("run", "own.toml")[0] == "indenter.tp.radius = ? (no such setting)"
    (tmp_path / "own.toml").write_text(re.sub(r"(?m)^assumed = .*$", "", text))
    assert said("run", "own.toml")[0] == ""


@pytest.mark.slow
def test_names_that_command_terminals_are_spelled_out(palpate, tmp_path):
    time, height, _, force = press(2.0)
    written(tmp_path / "log.csv", [time, force, height], ["time_s", "\x1b[2Jf [N]", "z\x07 [m]"])
    for words in ((), ("--suggest",), ("--suggest", "--force", "x")):
        done = palpate("info", "log.csv", *words)
        assert "\x1b[2J" not in done.stdout + done.stderr
        assert "\x07" not in done.stdout + done.stderr
        assert "\\u001b[2Jf" in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("header", "unit", "newton"),
    [
        ("Force [g]", "gf", 9.80665e-3),
        ("load_kg", "kgf", 9.80665),
        ("force_gf", "gf", 9.80665e-3),
        ("Kraft in mN", "mN", 1e-3),
        ("Force, N", "N", 1.0),
        ("F / N", "N", 1.0),
    ],
)
def test_a_load_in_grams_is_a_weight_and_no_newton(palpate, tmp_path, header, unit, newton):
    time, z, _, f = press()
    file = tmp_path / "own.csv"
    written(file, [time, 1e3 * z, f / newton], ["t [s]", "height / mm", f'"{header}"'])
    pipeline = tomllib.loads(palpate("info", file, "--suggest").stdout)
    columns = pipeline["device"]["log"]["columns"]
    assert columns["force"] == {"column": header, "unit": unit}
    assert columns["position"]["unit"] == "mm"


def test_an_acceleration_in_g_is_no_weight(tmp_path):
    sheet = Sheet(tmp_path / "x.csv", ("acc [g]", "Force [g]"))
    assert (sheet.unit(0), sheet.unit(1)) == (None, "gf")
