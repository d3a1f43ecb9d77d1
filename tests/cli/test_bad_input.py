"""Bad input on the real command line: one clear message, exit code 2, no traceback."""

import json

import pytest

REPLAY = """
[device.log]
type = "csv-replay"
file = "log.csv"
rate = "500 Hz"
columns = { z = { column = 0, unit = "mm" }, vz = { column = 1, unit = "mm/s" }, fz = { column = 2, unit = "N" } }
[alignment]
force = "log.fz"
position = "log.z"
velocity = "log.vz"
tip_mass = "140 g"
tare = "none"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.ekf]
type = "ekf"
"""

ROWS = "".join(f"{-4 - i * 1e-3:.4f},-0.5,{2 + i * 1e-3:.4f}\n" for i in range(600))


@pytest.fixture
def refused(palpate, tmp_path):
    """The message with which a command is refused."""

    def call(*arguments):
        done = palpate(*arguments)
        assert done.returncode == 2, done.stdout + done.stderr
        assert "Traceback" not in done.stderr
        assert done.stderr.startswith("palpate: ")
        assert not (tmp_path / "out" / "result.json").exists()
        return done.stderr

    return call


@pytest.fixture
def replay(tmp_path):
    """A pipeline on a CSV log with the given text."""

    def write(text, pipeline=REPLAY):
        (tmp_path / "log.csv").write_text(text)
        (tmp_path / "replay.toml").write_text(pipeline)
        return "replay.toml"

    return write


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("indenter.tip.radius=5 kPa", "'5 kPa' is a pressure, not a length; write for example \"5 mm\""),
        ("indenter.tip.radus=5 mm", "unknown key 'radus'; did you mean 'radius'?"),
        ("model.dr.type=dimensionality", "no model 'dimensionality'"),
        ("estimator.ekf.type=ekff", "no estimator 'ekff'; did you mean 'ekf'?"),
        ('run.plugins=["none.py"]', "plugin file none.py does not exist"),
        ("nonsense=1", "write table.key=value"),
    ],
)
def test_settings(refused, point_pipeline, given, words):
    assert words in refused("run", point_pipeline.name, "--set", given)


def test_several_mistakes_at_once_each_with_its_line(refused, point_pipeline):
    text = point_pipeline.read_text()
    text = text.replace('frequency = "2 Hz"', 'frequency = "2 mm"').replace('type = "ekf"', 'type = "ekg"')
    point_pipeline.write_text(text.replace('amplitude = "1 mm"', 'amplitud = "1 mm"'))
    shown = refused("run", point_pipeline.name)
    lines = text.splitlines()
    assert "point.toml: 3 mistakes" in shown
    frequency = next(i for i, line in enumerate(lines, 1) if line.startswith("frequency"))
    assert f"point.toml:{frequency}: [trajectory.press] frequency: '2 mm' is a length, not a frequency" in shown
    assert "unknown key 'amplitud'; did you mean 'amplitude'?" in shown
    assert "no estimator 'ekg'; did you mean 'ekf'?" in shown


def test_a_missing_table(refused, tmp_path):
    (tmp_path / "empty.toml").write_text("[run]\nname = 'nothing'\n")
    shown = refused("check", "empty.toml")
    assert "the table [alignment] is missing" in shown
    assert "a pipeline needs at least one [device.*] table" in shown


def test_files_that_are_not_there_or_no_pipeline(refused, tmp_path):
    assert "cannot read the pipeline file: No such file" in refused("run", "none.toml")
    assert "is not a pipeline file" in refused("run", ".")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8 text" in refused("run", "bytes.toml")
    (tmp_path / "broken.toml").write_text("[run\n")
    assert "not TOML" in refused("run", "broken.toml")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "log.csv: the file contains no rows of numbers"),
        (ROWS + "1,2,abc\n", "log.csv:601: column 2 holds 'abc', which is not a number"),
        ("1,2\n", "log.csv:1: no column 2; the line has 2, 0 to 1"),
    ],
)
def test_logs_that_cannot_be_read(refused, replay, text, words):
    assert words in refused("run", replay(text), "--out", "out")


def test_a_log_that_is_not_there(refused, replay, tmp_path):
    pipeline = replay("")
    (tmp_path / "log.csv").unlink()
    assert "log.csv: no such file" in refused("check", pipeline)


def test_a_log_with_nan_runs_and_says_so(palpate, replay):
    lines = ROWS.splitlines()
    lines[300] = "nan,-0.5,2.3"
    lines[310] = "-4.31,,2.31"
    done = palpate("run", replay("\n".join(lines) + "\n"), "--out", "out")
    assert done.returncode == 0
    assert "note[gaps] log has 2 invalid readings" in done.stdout.replace("\n", " ")


def test_a_log_of_zeros_and_a_log_of_one_row(palpate, replay, tmp_path):
    for count in (1, 600):
        done = palpate("run", replay("0,0,0\n" * count), "--out", f"out{count}")
        assert done.returncode == 0
        assert "invalid[no-contact] E, eta" in done.stdout
        flags = json.loads((tmp_path / f"out{count}" / "result.json").read_text())["tracks"]["dr/ekf"]["flags"]
    assert "stuck" in {flag["code"] for flag in flags}


@pytest.mark.slow
def test_a_truncated_mcap(refused, run_point, point_pipeline, tmp_path):
    log = run_point("trajectory.press.duration=1 s", name="recording").folder / "log.mcap"
    (tmp_path / "cut.mcap").write_bytes(log.read_bytes()[:400_000])
    replay = ["--set", 'device.rig={type = "mcap-replay", file = "cut.mcap"}']
    shown = refused("run", point_pipeline.name, *replay, "--out", "out")
    assert "cut.mcap: the log is cut" in shown
    assert "accept_cut = true" in shown


@pytest.mark.slow
def test_an_output_folder_that_cannot_be_used(refused, point_pipeline, tmp_path):
    assert "cannot make the output folder" in refused("run", point_pipeline.name, "--out", "/proc/none/out")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "precious.txt").write_text("keep")
    assert "is not empty, and nothing is ever overwritten" in refused("run", point_pipeline.name, "--out", "taken")
    (tmp_path / "file").write_text("")
    assert "cannot make the output folder" in refused("run", point_pipeline.name, "--out", "file")


def test_no_tip_mass_and_no_trajectory(refused, point_pipeline):
    text = point_pipeline.read_text()
    point_pipeline.write_text(text.replace('measuring = "rig.setpoint.measuring"\ntip_mass = "140 g"\n', ""))
    assert "[estimator.ekf]: the tip's mass is not declared" in refused("check", point_pipeline.name)
    start, end = text.index("[trajectory.press]"), text.index("[alignment]")
    point_pipeline.write_text(text[:start] + text[end:])
    assert "a device that moves needs one [trajectory.*] table, not 0" in refused("run", point_pipeline.name)


def test_unknown_commands_and_missing_arguments(palpate):
    for arguments in (("frobnicate",), ("run",), ("run", "x.toml", "--nonsense")):
        done = palpate(*arguments)
        assert done.returncode == 2
        assert "Traceback" not in done.stderr
