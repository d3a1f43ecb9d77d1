"""``palpate calibrate control``: from a run on a reference to the line of every later run."""

import json
import shutil
import tomllib
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from palpate import OutputError
from palpate_control import chart_file
from palpate_control.chart_file import ChartReference, ControlChart, RecordedCheck, append_check, read_chart

from tests.processes import start

SHORT = ("--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*/kinematic"]')
STATED = ("--reference", "112.5 kPa", "--uncertainty", "1.5 kPa")
SPRING = """
[device.rig]
type = "sim"
tip_mass = "140 g"
[device.rig.specimen]
model = "spring"
stiffness = "3 N/mm"
damping = "1 N*s/m"
[trajectory.press]
type = "point"
bias = "4 mm"
amplitude = "1 mm"
frequency = "2 Hz"
duration = "1 s"
[alignment]
force = { channel = "rig.wrench.z", uncertainty = "0.1 ms" }
position = "rig.tip.z"
velocity = { channel = "rig.twist.z", uncertainty = "0.1 ms" }
measuring = "rig.setpoint.measuring"
tip_mass = "140 g"
[model.spring]
type = "kelvin-voigt"
[estimator.kinematic]
type = "kinematic-ekf"
"""


@pytest.fixture(scope="module")
def measured(tmp_path_factory, root):
    """A run on the reference, and its pipeline file."""
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    folder = tmp_path_factory.mktemp("measured")
    file = shutil.copy(root / "pipelines" / "filters.toml", folder / "point.toml")
    run_pipeline(load_pipeline(Path(file), SHORT[1::2]), folder / "run")
    return folder


@pytest.fixture
def place(measured, tmp_path):
    """A folder with the run and its pipeline file."""
    return shutil.copytree(measured, tmp_path / "lab")


def changed(folder, name, days=0, factor=1.0, **tip):
    """A copy of the run that began later and found another elasticity, or had another tip."""
    copy = shutil.copytree(folder / "run", folder / name)
    document = json.loads((copy / "result.json").read_text())
    began = datetime.fromisoformat(document["run"]["started"]) + timedelta(days=days)
    document["run"]["started"] = began.isoformat()
    for track in document["tracks"].values():
        track["parameters"]["elasticity"]["value"] *= factor
    (copy / "result.json").write_text(json.dumps(document))
    if tip:
        text = (copy / "pipeline.toml").read_text()
        (copy / "pipeline.toml").write_text(text.replace("radius = 0.005", f"radius = {tip['radius']}"))
    return copy


def control(palpate, folder, *arguments):
    return palpate("calibrate", "control", *arguments, "--chart", folder / "chart.toml", cwd=folder)


def codes(folder):
    return {
        flag["code"]
        for track in json.loads((folder / "result.json").read_text())["tracks"].values()
        for flag in track["flags"]
    }


@pytest.mark.gate
@pytest.mark.slow
def test_a_run_on_the_reference_becomes_a_check_and_stands_behind_later_runs(palpate, place):
    done = control(palpate, place, "run", *STATED)
    assert done.returncode == 0, done.stderr
    table = tomllib.loads((place / "chart.toml").read_text())
    assert table["reference"] == {"name": "reference", "value": 112.5e3, "unit": "Pa", "std": 1.5e3}
    assert table["tip"] == {"type": "sphere", "radius": 0.005}
    assert table["sensor"] == {"serial_number": "SIM-0001"}
    found = json.loads((place / "run" / "result.json").read_text())["tracks"]["dr/kinematic"]["parameters"][
        "elasticity"
    ]
    e_n = (found["value"] - 112.5e3) / (2 * np.hypot(found["combined"], 1.5e3))
    assert abs(e_n) < 1
    assert f"E_n {e_n:.2f}: in control" in done.stdout
    done = palpate("run", "point.toml", *SHORT, "--set", "run.control=chart.toml", "--out", "later", cwd=place)
    assert f"control: E_n {e_n:.2f} on " in done.stdout, done.stderr
    assert "of this hour, in control" in done.stdout
    check = json.loads((place / "later" / "result.json").read_text())["run"]["control"]
    assert check["e_n"] == pytest.approx(e_n)
    assert check["in_control"]
    assert not check["old"]
    assert check["checks"] == 1
    assert "out-of-control" not in codes(place / "later")


@pytest.mark.slow
def test_what_speaks_against_the_check_is_a_flag_of_every_later_run(palpate, place):
    changed(place, "gain", days=0, factor=1.08)
    assert control(palpate, place, "gain", *STATED).returncode == 0
    again = ("--set", "run.control=chart.toml", "--out")
    done = palpate("run", "point.toml", *SHORT, *again, "later", cwd=place)
    assert "out of control" in done.stdout
    assert "out-of-control" in codes(place / "later")
    assert json.loads((place / "later" / "result.json").read_text())["tracks"]["dr/kinematic"]["verdict"] == "doubtful"
    assert palpate("report", "later", cwd=place).returncode == 0
    assert "control: E_n" in (place / "later" / "report.html").read_text()
    (place / "chart.toml").unlink()
    control(palpate, place, "run", *STATED)
    for number, (key, word) in enumerate(
        {"indenter.tip.radius=6 mm": "tip", "device.rig.serial_number=B": "sensor"}.items()
    ):
        done = palpate("run", "point.toml", *SHORT, "--set", key, *again, f"other-{number}", cwd=place)
        assert f"the check was made with another {word}" in " ".join(done.stdout.split()), done.stderr
        assert "out-of-control" in codes(place / f"other-{number}")
    done = palpate("run", "point.toml", *SHORT, "--set", "run.control_valid=1 ms", *again, "old", cwd=place)
    assert "older than [run] control_valid allows, in control" in " ".join(done.stdout.split())
    assert "out-of-control" not in codes(place / "old")


def test_a_gain_of_8_percent_is_out_of_control_and_the_next_good_check_is_not(palpate, place):
    assert control(palpate, place, "run", *STATED).returncode == 0
    for name, days, factor in (("gain", 1, 1.08), ("mended", 2, 1.0)):
        done = control(palpate, place, changed(place, name, days, factor).name)
        assert done.returncode == 0, done.stderr
    said = json.loads(control(palpate, place, "--json").stdout)
    assert [check["in_control"] for check in said["checks"]] == [True, False, True]
    assert said["checks"][1]["state"]["e_n"] > 1
    assert "out of control" in control(palpate, place).stdout


def test_a_reference_in_a_file_with_its_tip(palpate, place):
    file = place / "silicone.toml"
    text = '[reference]\nname = "S2, cast of May"\nvalue = "112.5 kPa"\nuncertainty = "1.5 kPa"\n'
    file.write_text(f'{text}tip = {{ type = "sphere", radius = "6 mm" }}\n')
    done = control(palpate, place, "run", "--reference", "silicone.toml")
    assert done.returncode == 2
    assert "its tip is type sphere, radius 0.005; the reference is for type sphere, radius 0.006" in done.stderr
    file.write_text(f'{text}tip = {{ type = "sphere", radius = "5 mm" }}\n')
    done = control(palpate, place, "run", "--reference", "silicone.toml")
    assert done.returncode == 0, done.stderr
    assert "S2, cast of May, elasticity 112.5 ± 1.5 kPa" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--reference", "112.5", "--uncertainty", "1 kPa"), "--reference: '112.5' has no unit"),
        (("--reference", "112.5 kPa"), "--uncertainty is missing: the reference needs its standard uncertainty"),
        (("--reference", "112.5 kPa", "--uncertainty", "2 N"), "--uncertainty: '2 N' is a force, not a pressure"),
        (("--reference", "112.5 kPa", "--uncertainty", "1.5"), "--uncertainty: '1.5' has no unit"),
        (("--reference", "112.5 kPa", "--uncertainty", "0 kPa"), "--uncertainty: '0 kPa' must be larger than 0"),
        (("--reference", "5 mm", "--uncertainty", "1 mm"), "--reference: '5 mm' is not one of pressure, stiffness"),
        (("--reference", "3 N/mm", "--uncertainty", "1 N/mm"), 'is palpated with [model.*] type = "kelvin-voigt"'),
        ((), "--reference is missing"),
        ((*STATED, "--track", "dr/kinematc"), "did you mean 'dr/kinematic'?"),
        (("--reference", "none.toml"), "none.toml: cannot read the reference: No such file"),
    ],
)
def test_a_reference_without_value_unit_or_uncertainty_is_named(palpate, place, arguments, text):
    done = control(palpate, place, "run", *arguments)
    assert done.returncode == 2
    assert text in done.stderr
    assert not (place / "chart.toml").exists()


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ('nam = "x"', "[reference] nam: no such key; did you mean 'name'?"),
        ('value = "1 kPa"\nuncertainty = "1 Pa"', "[reference] name is missing: what the reference is"),
        ('name = "x"\nuncertainty = "1 Pa"', "[reference] value is missing"),
        ('name = "x"\nvalue = "1 kPa"', "[reference] uncertainty is missing: its standard uncertainty"),
        ('name = "x"\nvalue = 1000\nuncertainty = "1 Pa"', "[reference] value: 1000 has no unit"),
    ],
)
def test_a_mistake_in_the_table_of_a_reference_is_named(palpate, place, table, text):
    (place / "silicone.toml").write_text(f"[reference]\n{table}\n")
    done = control(palpate, place, "run", "--reference", "silicone.toml")
    assert done.returncode == 2
    assert f"silicone.toml: {text}" in done.stderr


def test_a_run_that_does_not_belong_into_the_chart_is_refused(palpate, place):
    control(palpate, place, "run", *STATED)
    before = (place / "chart.toml").read_bytes()
    for arguments, text in (
        (("run",), "run: is check 1 of"),
        ((changed(place, "old", days=-1).name,), "is older than the last check"),
        (
            (changed(place, "tip", days=1, radius=0.01).name,),
            "tip: another tip than the chart's: type sphere, radius 0.01",
        ),
        (
            (changed(place, "other", days=1).name, "--reference", "113 kPa", "--uncertainty", "1 kPa"),
            "of another reference",
        ),
    ):
        done = control(palpate, place, *arguments)
        assert done.returncode == 2
        assert text in done.stderr
    assert (place / "chart.toml").read_bytes() == before


@pytest.mark.parametrize(
    ("damage", "text"),
    [
        (lambda text: text[: text.index("[sensor]") + 4], "is a damaged control chart, not TOML"),
        (lambda text: text.replace("repeat_std", "repeat"), "is not a control chart: check 1, repeat"),
        (lambda text: text.replace("std = 1500.0", 'std = "much"'), "is not a control chart: reference, std"),
        (
            lambda text: text + text[text.index("[[check]]") :].replace("20", "19", 1),
            "check 2 is older than the one before",
        ),
        (lambda text: text[: text.index("[[check]]")], "holds no check yet"),
        (lambda text: "", "is not a control chart: quantity: Field required"),
    ],
)
def test_a_damaged_chart_is_refused_by_control_and_by_a_run(palpate, place, damage, text):
    control(palpate, place, "run", *STATED)
    chart = place / "chart.toml"
    chart.write_text(damage(chart.read_text()))
    for done in (
        control(palpate, place),
        palpate("check", "point.toml", "--set", "run.control=chart.toml", cwd=place),
    ):
        assert done.returncode == 2
        assert text in done.stderr
        assert "chart.toml" in done.stderr
        assert "Traceback" not in done.stderr


def test_a_spring_is_a_reference(palpate, tmp_path):
    (tmp_path / "spring.toml").write_text(SPRING)
    assert palpate("run", "spring.toml", "--out", "run", cwd=tmp_path).returncode == 0
    done = control(palpate, tmp_path, "run", "--reference", "3 N/mm", "--uncertainty", "0.01 N/mm")
    assert done.returncode == 0, done.stderr
    assert "in control" in done.stdout
    assert read_chart(tmp_path / "chart.toml").quantity == "stiffness"


@pytest.mark.slow
def test_the_picture_is_the_same_file_each_time(palpate, place):
    control(palpate, place, "run", *STATED, "--plot", "first.svg")
    control(palpate, place, "--plot", "second.svg")
    assert (place / "first.svg").read_bytes() == (place / "second.svg").read_bytes()


def chart_of(count=0):
    reference = ChartReference(name="spring", value=3000.0, unit="N/m", std=10.0)
    return ControlChart(
        quantity="stiffness", track="kv/ekf", reference=reference, check=tuple(check(i) for i in range(count))
    )


def check(number):
    return RecordedCheck(
        date=datetime(2026, 1, 1, tzinfo=UTC),
        run=f"run-{number}",
        digest=f"{number}",
        value=3000.0,
        std=5.0,
        repeat_std=1.0,
    )


def test_what_a_person_has_written_into_the_chart_stays(tmp_path):
    file = tmp_path / "chart.toml"
    append_check(file, chart_of(), check(1))
    file.write_text(file.read_text() + "# the sensor was sent in\n")
    append_check(file, chart_of(), check(2))
    assert "# the sensor was sent in" in file.read_text()
    assert [one.run for one in read_chart(file).check] == ["run-1", "run-2"]


def test_two_that_append_at_once_lose_nothing(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: append_check(tmp_path / "chart.toml", chart_of(), check(number)), range(24)))
    assert {one.run for one in read_chart(tmp_path / "chart.toml").check} == {f"run-{i}" for i in range(24)}


def test_a_disk_that_fails_while_a_check_is_appended_leaves_the_chart_as_it_was(tmp_path, monkeypatch):
    file = tmp_path / "chart.toml"
    append_check(file, chart_of(), check(1))
    before = file.read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("palpate_engine.atomic_files.os.fsync", full)
    with pytest.raises(OutputError, match="No space left"):
        append_check(file, chart_of(), check(2))
    assert file.read_bytes() == before
    assert chart_file.read_chart(file).check[-1].run == "run-1"


APPENDING = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from tests.control.test_control_command import append_check, chart_of, check
print("begun", flush=True)
for number in range(100000):
    append_check(Path(sys.argv[1]), chart_of(), check(number))
"""


@pytest.mark.slow
def test_a_kill_while_appending_leaves_a_chart_that_can_be_read(tmp_path, root):
    """Five kills at different moments; each chart ends with a whole check."""
    for number in range(5):
        file = tmp_path / f"{number}" / "chart.toml"
        file.parent.mkdir()
        process = start(APPENDING, file, root, stdout=-1, text=True)
        with process:
            assert process.stdout.readline() == "begun\n"
            while not file.exists() or file.stat().st_size < 1000 + 777 * number:
                assert process.poll() is None
            process.kill()
        runs = [one.run for one in read_chart(file).check]
        assert runs == [f"run-{i}" for i in range(len(runs))]
        append_check(file, chart_of(), check(len(runs)))
        assert len(read_chart(file).check) == len(runs) + 1
