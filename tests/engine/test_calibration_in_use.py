"""A calibration file: written, read, taken by a pipeline, and flagged where it does not fit."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import pytest
from palpate import ConfigurationError
from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue, calibrated_value
from palpate_engine.config import load_pipeline
from palpate_engine.config.calibration import calibration_of
from palpate_engine.pipeline import run_pipeline
from palpate_engine.pipeline.live.stored_offset import stored_offset
from palpate_kit.runs.calibration_file import Calibration, read_calibration


def value(number, std, unit):
    return calibrated_value(MeasuredValue.of([RepeatValue(number, std)], unit))


def calibration(**changes):
    values = {
        "mass": value(0.15, 2e-4, "kg"),
        "delay": value(0.0031, 4e-5, "s"),
        "velocity_delay": value(2e-5, 4e-6, "s"),
        "offset": value(-0.77, 1e-3, "N"),
        "force_std": value(0.041, 4e-4, "N"),
        "velocity_std": value(0.5e-3, 9e-6, "m/s"),
    }
    table = {
        "created": datetime.now(UTC).replace(microsecond=0),
        "values": values,
        "channels": {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z"},
        "devices": {"rig": {"type": "sim", "serial_number": "SIM-0001"}},
        "tip": {"type": "sphere", "radius": 0.005},
    }
    return Calibration(**(table | changes))


@pytest.fixture
def pipeline(point_pipeline, tmp_path):
    """The example pipeline with its timing and mass left open, and a calibration beside it."""
    text = point_pipeline.read_text().replace('tip_mass = "140 g"\n\n[indenter', "\n[indenter")
    for device in ("rig.wrench.z", "rig.twist.z"):
        text = text.replace(f'{{ channel = "{device}", uncertainty = "0.1 ms" }}', f'"{device}"')
    point_pipeline.write_text(text)

    def build(*overrides, **changes):
        (tmp_path / "c.toml").write_text(calibration(**changes).text())
        return load_pipeline(point_pipeline, ['run.calibration="c.toml"', *overrides])

    return build


def codes(pipeline):
    return [flag.code for flag in pipeline.calibration.flags(pipeline, {})]


def test_a_file_reads_back_as_it_was_written(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(calibration().text())
    assert read_calibration(path) == calibration(created=read_calibration(path).created)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("x = [", "not TOML"),
        ("name = 'x'", "not a calibration file: created"),
        ("created = 2026-01-01T00:00:00\nvalues = {}\nchannels = {}", "no time zone"),
        ("format = 99\ncreated = 2026-01-01T00:00:00Z\nvalues = {}\nchannels = {}", "format"),
    ],
)
def test_what_is_no_calibration_is_refused(tmp_path, text, problem):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=problem):
        read_calibration(path)
    with pytest.raises(ConfigurationError, match="cannot read"):
        read_calibration(tmp_path / "none.toml")


def test_a_pipeline_takes_mass_timing_and_noise(pipeline):
    found = pipeline()
    assert found.alignment.tip_mass == 0.15
    assert found.alignment.tip_mass_uncertainty == pytest.approx(2e-4)
    assert found.alignment.force.delay == 0.0031
    assert found.alignment.force.uncertainty == pytest.approx(4e-5)
    assert found.alignment.velocity.delay == 0.0, "a velocity that is hardly late stays where it is"
    assert found.alignment.tare == "free-air"
    assert found.estimators["ekf"].force_std == 0.041
    assert found.estimators["ekf"].velocity_std == 0.5e-3
    assert codes(found) == []


def test_a_late_velocity_is_moved(pipeline):
    values = calibration().values | {"velocity_delay": value(0.02, 1e-5, "s")}
    assert pipeline(values=values).alignment.velocity.delay == 0.02


def test_the_tare_is_taken_where_it_is_asked_for(pipeline):
    found = pipeline('alignment.tare="calibrated"')
    assert found.alignment.tare == -0.77
    assert found.alignment.tare_uncertainty == pytest.approx(1e-3)


def test_a_robot_that_gives_way_is_known(pipeline):
    values = calibration().values | {"compliance": value(25e-6, 1e-7, "m/N")}
    assert pipeline(values=values).alignment.series_stiffness == pytest.approx(40e3)
    stated = pipeline('alignment.series_stiffness="100 N/mm"', values=values)
    assert stated.alignment.series_stiffness == pytest.approx(100e3)


def test_what_the_file_states_stands_and_is_flagged(pipeline):
    found = pipeline('alignment.tip_mass="140 g"', 'alignment.force.delay="1 ms"', 'estimator.ekf.force_std="0.1 N"')
    assert found.alignment.tip_mass == 0.14
    assert found.alignment.force.delay == 0.001
    assert found.estimators["ekf"].force_std == 0.1
    assert codes(found) == ["calibration-mass", "calibration-delay"]
    agreed = pipeline('alignment.tip_mass="150.1 g"', 'alignment.force.delay="3.13 ms"')
    assert codes(agreed) == []


SINCE = datetime(2026, 5, 1, 8, 0, tzinfo=UTC)
FED = {"rig": {"type": "sim", "powered_since": SINCE.isoformat()}}


@pytest.mark.parametrize(
    ("then", "now", "code"),
    [
        (FED, {"powered_since": (SINCE + timedelta(seconds=3)).isoformat()}, None),  # clocks differ
        (FED, {"powered_since": (SINCE + timedelta(seconds=40)).isoformat()}, "calibration-offset"),
        (FED, {"powered_since": "ages ago"}, "calibration-offset-unknown"),
        (FED, {}, "calibration-offset-unknown"),
        ({"rig": {"type": "sim"}}, {"powered_since": SINCE.isoformat()}, "calibration-offset-unknown"),
    ],
)
def test_an_offset_counts_only_while_the_sensor_has_its_power(pipeline, then, now, code):
    found = pipeline('alignment.tare="calibrated"', devices=then)
    live = {"rig": now}
    assert [flag.code for flag in found.calibration.flags(found, live)] == ([] if code is None else [code])
    offset = stored_offset(found, live)
    assert offset.value == -0.77
    assert (offset.doubt is None) is (code is None)
    stated = pipeline("alignment.tare=-0.7 N", devices=then)  # the user's own word
    assert stored_offset(stated, live).doubt is None
    assert list(stated.calibration.flags(stated, live)) == []
    assert stored_offset(pipeline(devices=then), live) is None


def test_an_offset_does_not_outlive_its_calibration(pipeline):
    old = datetime.now(UTC) - timedelta(days=31)
    found = pipeline('alignment.tare="calibrated"', devices=FED, created=old)
    live = {"rig": FED["rig"]}
    assert "31.0 days old" in stored_offset(found, live).doubt
    assert [flag.code for flag in found.calibration.flags(found, live)] == ["calibration-old"]


def test_a_sensor_that_the_robot_feeds_is_as_old_as_the_robot(pipeline):
    """What feeds the sensor is another device: the one that tells the position."""
    channels = {"force": "sensor.wrench.z", "position": "arm.tip.z"}
    fed = {"sensor": {"supply": "robot"}, "arm": {"powered_since": SINCE.isoformat()}}
    use = pipeline(channels=channels, devices=fed).calibration
    known = SimpleNamespace(
        alignment=SimpleNamespace(
            force=SimpleNamespace(channel="sensor.wrench.z"), position=SimpleNamespace(channel="arm.tip.z")
        )
    )
    assert use.offset_doubt(known, fed) is None
    again = {**fed, "arm": {"powered_since": (SINCE + timedelta(hours=1)).isoformat()}}
    assert use.offset_doubt(known, again).code == "calibration-offset"
    assert use.offset_doubt(known, {**fed, "sensor": {"supply": "unknown"}}).code == "calibration-offset-unknown"


@pytest.mark.parametrize(
    ("payload", "centre", "words"),
    [
        (0.4, (0.0, 0.0, 0.03), []),  # its share of (3, 4, 35) mm at 150 g is 1.9 mm aside
        (0.4, (0.0, 0.0019, 0.03), []),
        (0.4, (0.02, 0.0, 0.03), ["20.0 mm off its flange's axis: the tip of .* asks for 1.9 mm"]),
        (0.4, (0.0, 0.0, 0.0), ["0.0 mm before its flange: the tip of .* alone asks for 13.1 mm or more"]),
        (0.0, (0.0, 0.0, 0.0), []),  # never set: another flag
    ],
)
def test_the_payload_of_an_arm_is_compared_with_the_tip(pipeline, payload, centre, words):
    places = {f"centre_{axis}": value(x, 1e-4, "m") for axis, x in zip("xyz", (0.003, 0.004, 0.035), strict=True)}
    found = pipeline(values=calibration().values | places)
    flags = list(found.calibration.flags(found, {"rig": {"payload": payload, "payload_centre": list(centre)}}))
    assert {flag.code for flag in flags} <= {"payload"}
    assert len(flags) == len(words)
    for flag, text in zip(flags, words, strict=True):
        assert re.search(text, flag.message), flag.message


def test_an_old_one_another_sensor_and_another_tip_are_flagged(pipeline):
    assert codes(pipeline(created=datetime.now(UTC) - timedelta(days=31))) == ["calibration-old"]
    assert codes(pipeline('run.calibration_valid="1 h"', created=datetime.now(UTC) - timedelta(hours=2))) == [
        "calibration-old"
    ]
    assert codes(pipeline(created=datetime.now(UTC) + timedelta(days=3))) == ["calibration-old"]
    other = {"rig": {"type": "sim", "serial_number": "SIM-0002"}}
    assert "calibration-sensor" in codes(pipeline(devices=other))
    assert codes(pipeline(channels={"force": "rig.wrench.x", "position": "rig.tip.z"})) == ["calibration-sensor"]
    assert codes(pipeline(tip={"type": "sphere", "radius": 0.0025})) == ["calibration-tip"]
    assert codes(pipeline(tip=None)) == []


def test_live_devices_are_compared_by_what_they_say(pipeline):
    """Serial numbers of live devices are known once they are connected."""
    found = pipeline(devices={"rig": {"type": "ur3e", "identity": "S/N: 1"}})

    def codes_with(identity):
        texts = found.calibration.flags(found, {"rig": {"identity": identity, "states": 7}})
        return [flag.code for flag in texts]

    assert codes_with("S/N: 1") == []
    assert "calibration-sensor" in codes_with("S/N: 2")


def test_a_calibration_that_is_not_there_is_a_mistake(point_pipeline):
    with pytest.raises(ConfigurationError, match=r"\[run\] calibration: .*none.toml: cannot read"):
        load_pipeline(point_pipeline, ['run.calibration="none.toml"'])
    with pytest.raises(ConfigurationError, match="names no calibration"):
        load_pipeline(point_pipeline, ['alignment.tare="calibrated"'])


def test_its_uncertainties_reach_the_result(pipeline, tmp_path):
    values = calibration().values | {"delay": value(0.0, 2e-4, "s"), "mass": value(0.14, 5e-3, "kg")}
    result = run_pipeline(pipeline('trajectory.press.duration="3 s"', values=values), tmp_path / "out")
    assert result.run["inputs"]["calibration.file"].endswith("c.toml")
    assert len(result.run["inputs"]["calibration.sha256"]) == 64
    found = result.tracks["dr/ekf"].parameters
    eta, elasticity = found["viscosity"], found["elasticity"]
    assert eta.budget["timing"] == pytest.approx(elasticity.value / 3 * 2e-4, rel=1e-6)
    assert set(elasticity.budget) == {"timing", "mass", "tare", "radius", "poisson"}
    assert eta.systematic == pytest.approx(sum(share**2 for share in eta.budget.values()) ** 0.5)
    assert eta.combined >= eta.systematic
    table = eta.table()
    assert table["systematic_timing"] == eta.budget["timing"]
    # A mass wrong by 2x moves E of S2 under a small sphere by some percent; 5 g of 140 g by a 28th of that.
    assert 2e-5 < elasticity.budget["mass"] / elasticity.value < 5e-3


def test_the_shares_of_tare_and_mass_are_those_of_a_fit(pipeline, tmp_path):
    """An offset of 0.05 N moves E of S2 under R 5 mm by about 1 %, and eta hardly."""
    found = pipeline(
        'alignment.tare="-0.7729 N"', 'alignment.tare_uncertainty="0.05 N"', 'trajectory.press.duration="3 s"'
    )
    parameters = run_pipeline(found, tmp_path / "out").tracks["dr/ekf"].parameters
    shares = {name: p.budget["tare"] / p.value for name, p in parameters.items()}
    assert 0.003 < shares["elasticity"] < 0.12
    assert shares["viscosity"] < shares["elasticity"] * 1.5


def test_without_a_plugin_that_reads_it_a_calibration_is_a_mistake(pipeline):
    found = pipeline()
    use, mistakes = calibration_of(found.run, found.stated, replace(found.registry, calibrations={}))
    assert use is None
    assert "no plugin here reads" in mistakes[0].problem
    assert calibration_of(None, found.stated, replace(found.registry, calibrations={})) == (None, [])


def test_a_plugin_file_reads_calibrations_of_its_own(point_pipeline, tmp_path):
    """Its hook, named before the shipped one, is asked for whatever file the pipeline names."""
    (tmp_path / "scales.py").write_text(
        "from palpate import CalibrationReader, plugin\n"
        "from palpate_calibration.calibration_use import AppliedCalibration\n"
        "from palpate_kit.runs.calibration_file import CalibratedValue, Calibration\n"
        "from datetime import UTC, datetime\n"
        "def weighed(path, valid_for):\n"
        "    kg = float(path.read_text())\n"
        "    mass = CalibratedValue(value=kg, unit='kg', std=1e-3, interval=(kg - 2e-3, kg + 2e-3))\n"
        "    found = Calibration(created=datetime.now(UTC), values={'mass': mass}, channels={})\n"
        "    return AppliedCalibration(found, str(path), valid_for)\n"
        "@plugin\n"
        "def palpate_offers():\n"
        "    return {'calibration': {'a-balance': CalibrationReader('palpate_file_scales:weighed')}}\n"
    )
    (tmp_path / "weight.txt").write_text("0.151")
    text = point_pipeline.read_text().replace('tip_mass = "140 g"', "")
    point_pipeline.write_text(text)
    found = load_pipeline(point_pipeline, ['run.plugins=["scales.py"]', 'run.calibration="weight.txt"'])
    assert found.alignment.tip_mass == 0.151
