"""`palpate calibrate` step by step."""

import tomllib

import pytest
import typer
from palpate.errors import ConfigurationError, LogError, UserError
from palpate_calibration.calibrate_command import _ask
from palpate_calibration.guided_calibration import Guide, run_calibration
from palpate_calibration.plan import load_plan

QUICK = (
    "calibration.repeats=2",
    "calibration.standstill.trajectory.duration=3 s",
    "calibration.orientations.repeats=1",
    "calibration.orientations.trajectory.duration=1 s",
    "calibration.shake.trajectory.duration=4 s",
    "calibration.noise.trajectory.duration=4 s",
    "calibration.tap.trajectory.duration=2 s",
    "calibration.press.trajectory.duration=2 s",
)


@pytest.fixture
def guided(root, tmp_path):
    """The example without its steps, and a function that adds some."""
    text = (root / "pipelines" / "guided.toml").read_text()
    begin, end = text.index("[calibration]"), text.index("[trajectory.press]")

    def write(steps, **changes):
        body = text[:begin] + steps + "\n" + text[end:]
        for old, new in changes.items():
            body = body.replace(old, new)
        file = tmp_path / "guided.toml"
        file.write_text(body)
        return file

    return write


@pytest.mark.gate
@pytest.mark.slow
def test_every_step_finds_what_the_rig_hides(palpate, root, tmp_path):
    target = tmp_path / "found.toml"
    sets = [word for override in QUICK for word in ("--set", override)]
    done = palpate("calibrate", root / "pipelines" / "guided.toml", "--out", target, *sets)
    assert done.returncode == 0, done.stderr
    values = tomllib.loads(target.read_text())["measured"]
    mass, weight = 0.163, 0.163 * 9.80665
    truth = {
        "mass": mass,
        "mass_by_weight": mass,
        "delay": 0.0117,
        "tap_delay": 0.0117,
        "centre_x": 0.002,
        "centre_y": -0.001,
        "centre_z": 0.035,
        "bias_x": 0.0,
        "bias_z": 0.8,
        "weight": weight,
        "bias": 0.8,
        "offset": 0.8 - weight,
        "force_std": 0.05,
        "velocity_std": 0.67e-3,
        "moving_velocity_std": 0.67e-3,
        "position_std": 5e-6,
        "compliance": 1 / 40e3,
    }
    for name, value in truth.items():
        assert abs(values[name]["value"] - value) < 3.5 * values[name]["std"], name
    # The mean of 21 readings takes a 21st of the variance along.
    paper = values["paper_velocity_std"]
    assert paper["value"] == pytest.approx(0.67e-3 * (20 / 21) ** 0.5, rel=0.05)
    # A scatter of n readings is known to 1/sqrt(2 n) of itself: a repeat has hundreds to ten thousands.
    assert 0.002 < paper["std"] / paper["value"] < 0.05
    for text in (
        "step 1 of 6, standstill: the tip hangs free",
        "step 2 of 6, orientations",
        "42.3 to 57.7 mm high, at most 244 mm/s of 250, 9.02 m/s^2 of 10",
        "repeat 2 of 2: 10 s of motion",
        "  delay: 11.",
    ):
        assert text in done.stderr
    spectrum = tomllib.loads(target.read_text())["measurement"]["spectra"]["force"]
    assert spectrum["unit"] == "N/sqrt(Hz)"
    # White noise of 0.05 N at 800 Hz: 0.05 sqrt(2/800).
    assert spectrum["densities"][-1] == pytest.approx(0.05 * (2 / 800) ** 0.5, rel=0.1)


def test_what_the_steps_before_a_failure_found_is_kept(palpate, guided, tmp_path):
    steps = """
[calibration]
repeats = 1
[calibration.standstill]
trajectory = { type = "stay", duration = "4 s" }
[calibration.shake]
trajectory = { type = "shake", amplitude = "0.02 mm", frequencies = ["5 Hz"], duration = "2 s" }
"""
    done = palpate("calibrate", guided(steps), "--out", tmp_path / "found.toml")
    assert done.returncode == 2
    assert not (tmp_path / "found.toml").exists()
    assert str(tmp_path / "found.part.toml") in done.stderr.replace("\n", "")
    assert "offset" in tomllib.loads((tmp_path / "found.part.toml").read_text())["values"]


STAY = 'trajectory = { type = "stay", duration = "3 s" }'
SHAKE = 'trajectory = { type = "shake", amplitude = "5 mm", duration = "4 s", standstill = "1 s" }'

TOO_FAST = f"[calibration]\ntop_speed = '0.1 m/s'\n[calibration.standstill]\n{STAY}\n[calibration.shake]\n{SHAKE}"


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ("[calibration.standstill]", "[calibration.standstill] needs a motion, such as"),
        (f"[calibration.standstill]\n{SHAKE}", "no standstill of 2 s or more"),
        (f"[calibration.shake]\n{STAY}", "no shake of 2 s or more"),
        (f"[calibration.noise]\n{STAY}", "no steady oscillation"),
        (f"[calibration.shakes]\n{STAY}", "unknown key 'shakes'; did you mean 'shake'"),
        (f"[calibration.orientations]\ndown = [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]\n{STAY}", "down"),
        (f"[calibration.orientations]\ndown = [[0.0, 0.0, -2.0], [0.0, 0.0, 1.0], [1.0, 0.0]]\n{STAY}", "a direction"),
        (f"[calibration.standstill]\n{STAY}\ndevice = {{ rig = 'nothing' }}", "no [device.nothing]"),
        (
            '[calibration.press]\ntrajectory = { type = "point", bias = "4 mm" }',
            "[calibration.press] deepest: the motion reaches -0.005 m, -0.001 is the limit",
        ),
        (TOO_FAST, "[calibration.shake] top_speed"),
    ],
)  # fmt: skip
def test_a_step_that_cannot_be_done_is_refused_with_the_reason(guided, steps, message):
    with pytest.raises(UserError) as caught:
        run_calibration(load_plan(guided(steps)))
    assert message in " ".join(str(caught.value).split())


def test_a_limit_broken_in_a_later_step_stops_before_the_first(guided):
    said = []
    with pytest.raises(ConfigurationError):
        run_calibration(load_plan(guided(TOO_FAST)), Guide(said.append))
    assert said == []


def test_weight_alone_gives_the_mass(guided):
    steps = f"[calibration]\nrepeats = 1\n[calibration.standstill]\n{STAY}\n[calibration.orientations]\n{STAY}"
    values = run_calibration(load_plan(guided(steps)))[1].values
    assert values["mass"].value == values["mass_by_weight"].value
    assert "delay" not in values


def recorded(palpate, file, trajectory, folder, *overrides):
    """A log of one motion, by `palpate run`."""
    text = file.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    source = folder.with_suffix(".toml")
    source.write_text(
        text[:begin] + f"[trajectory.press]\n{trajectory}\n" + text[end:] + '\n[sink.log]\ntype = "mcap"\n'
    )
    sets = [word for override in overrides for word in ("--set", override)]
    done = palpate("run", source, "--out", folder, *sets)
    assert done.returncode == 0, done.stderr
    return folder / "log.mcap"


LOG = '[calibration.{step}.device.rig]\ntype = "mcap-replay"\nfile = "{file}"\n'


@pytest.mark.slow
def test_steps_read_logs(palpate, guided, tmp_path):
    """A standstill and a shake, each recorded before."""
    plain = guided("")
    still = recorded(palpate, plain, 'type = "stay"\nduration = "4 s"', tmp_path / "still")
    shake = recorded(palpate, plain, 'type = "shake"\namplitude = "5 mm"\nduration = "4 s"', tmp_path / "shake")
    file = guided(LOG.format(step="standstill", file=still) + LOG.format(step="shake", file=shake))
    done = palpate("calibrate", file)
    assert done.returncode == 0, done.stderr
    tables = tomllib.loads((tmp_path / "rig.toml").read_text())
    table, values = tables["measurement"], tables["measured"]
    assert values["delay"]["value"] == pytest.approx(0.0117, abs=3e-4)
    assert values["offset"]["value"] == pytest.approx(0.8 - 0.163 * 9.80665, abs=0.01)
    assert {len(facts["sha256"]) for facts in table["logs"].values()} == {64}
    assert set(table["logs"]) == {"standstill.rig", "shake.rig"}


@pytest.mark.slow
def test_a_log_of_a_palpation_is_refused(palpate, guided, tmp_path):
    press = 'type = "point"\nbias = "4 mm"\namplitude = "2 mm"\nfrequency = "2 Hz"\nduration = "4 s"'
    log = recorded(palpate, guided(""), press, tmp_path / "pressed")
    done = palpate("calibrate", guided(LOG.format(step="shake", file=log)))
    assert done.returncode == 2
    assert "in contact" in done.stderr, done.stderr


def test_a_log_with_too_few_rests_is_refused(palpate, guided, tmp_path):
    log = recorded(palpate, guided(""), 'type = "shake"\nduration = "3 s"', tmp_path / "shaken")
    with pytest.raises(LogError, match=r"the log holds 2 standstills; \[calibration.orientations\] down names 4"):
        run_calibration(load_plan(guided(LOG.format(step="orientations", file=log))))


def test_without_a_velocity_its_noise_is_no_step(guided):
    steps = '[calibration.noise]\ntrajectory = { type = "shake", frequencies = ["1 Hz"], duration = "3 s" }'
    with pytest.raises(LogError, match=r"needs \[alignment\] velocity"):
        run_calibration(load_plan(guided(steps, **{'velocity = "rig.twist.z"\n': ""})))


def test_nobody_there_to_answer(monkeypatch):
    def prompt(*args, **kwargs):
        raise typer.Abort

    monkeypatch.setattr(typer, "prompt", prompt)
    with pytest.raises(ConfigurationError, match="--yes"):
        _ask(print, yes=False)("turn the tool")
    said = []
    _ask(said.append, yes=True)("turn the tool")
    assert said == ["turn the tool"]
