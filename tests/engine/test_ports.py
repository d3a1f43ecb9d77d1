"""Ports and abilities: one answer to which column a signal is, and to what a device can."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate import (
    Batch,
    Channel,
    ConfigurationError,
    Device,
    KnowsTruth,
    Resumable,
    Setpoint,
    Stream,
    SupportsOwnMotion,
    SupportsReach,
    Trajectory,
    Turnable,
)
from palpate.device import ask_devices, own_motions, truth_of
from palpate_calibration.calibration_record import CalibrationRecorder
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports
from palpate_engine.config import load_pipeline
from palpate_engine.config.signal_wiring import check_wiring
from palpate_engine.pipeline.live.guard import Guard
from palpate_logs.csv_replay import CsvReplay
from palpate_trajectories.point import Point
from palpate_trajectories.raster import Raster
from pydantic import ValidationError

PIPELINES = Path(__file__).parents[2] / "pipelines"
DAQ = Stream("", (Channel("trigger", "1"), Channel("fz", "N", (-9.0, 9.0)), Channel("z", "m")), 1000.0)
SIGNALS = {"force": "log.fz", "position": {"channel": "log.z", "sign": -1}}


def settings(**changes):
    return AlignmentSettings.model_validate({**SIGNALS, "tare": "none", **changes})


def test_a_port_names_device_stream_column_unit_and_limits():
    ports = Ports.of(settings(), {"log": (DAQ,)})
    assert [(r, p.key, p.column, p.unit, p.limits) for r, p in ports.roles.items()] == [
        ("force", ("log", ""), 1, "N", (-9.0, 9.0)),
        ("position", ("log", ""), 2, "m", None),
    ]
    assert ports["position"].signal.sign == -1
    assert Ports.of(settings(force_limit=4.0), {"log": (DAQ,)})["force"].limits == (-4.0, 4.0)
    with pytest.raises(KeyError):
        Ports.of(settings(velocity="log.vz"), {"log": (DAQ,)})


def test_components_are_of_one_unit_and_what_has_none_stands_alone():
    stream = Stream("", (*(Channel(name, "N") for name in "xyz"), Channel("a", "1"), Channel("b", "1")), 1000.0)
    for name, columns in (("z", (0, 1, 2)), ("b", (4,))):
        given = settings(force=f"log.{name}", position="log.x")
        assert Ports.of(given, {"log": (stream,)})["force"].components == columns


@pytest.mark.parametrize("key", ["touch_lag", "drift", "tip_mass", "tip_mass_uncertainty", "tare_uncertainty"])
def test_what_is_a_size_is_not_below_none(key):
    assert getattr(settings(**{key: 0.0}), key) == 0.0
    with pytest.raises(ValidationError, match=r"greater than or equal to 0"):
        settings(**{key: -1e-9})


def test_a_pipeline_resolves_its_signals_and_does_so_anew_with_other_devices():
    pipeline = load_pipeline(PIPELINES / "filters.toml")
    assert pipeline.ports is pipeline.ports
    assert pipeline.ports["force"].key == ("rig", "wrench")
    faster = pipeline.devices["rig"].model_copy(update={"sensor_rate": 1234.0})
    assert replace(pipeline, devices={"rig": faster}).ports["force"].stream.rate == 1234.0


def test_aligner_recorder_and_guard_read_the_same_column():
    ports = Ports.of(settings(), {"log": (DAQ,)})
    aligner, recorder, guard = Aligner(settings(), ports), CalibrationRecorder(settings(), ports), Guard(None, ports)
    stamps = np.arange(200, dtype=np.int64) * 1_000_000
    values = np.column_stack([np.full(200, 7.0), np.linspace(1.0, 2.0, 200), np.full(200, -0.003)])
    batch = Batch("", stamps, stamps, values)
    for taker in (aligner.feed, recorder.feed, guard.check):
        taker("log", batch)
    samples = aligner.samples(final=True)
    np.testing.assert_array_equal(samples.force, values[:, 1])
    np.testing.assert_array_equal(samples.position, -values[:, 2])
    np.testing.assert_array_equal(recorder.record().force.values, values[:, 1])
    assert guard.judge_standstill().force == pytest.approx(1.5)


@pytest.mark.parametrize(("gap", "gaps"), [(0.02, 1), (0.05, 0)])
def test_a_calibration_counts_the_gaps_that_the_alignment_counts(gap, gaps):
    given = settings(gap=gap)
    ports = Ports.of(given, {"log": (DAQ,)})
    aligner, recorder = Aligner(given, ports), CalibrationRecorder(given, ports)
    stamps = np.arange(300, dtype=np.int64) * 1_000_000
    stamps[150:] += 30_000_000
    batch = Batch("", stamps, stamps, np.ones((300, 3)))
    aligner.feed("log", batch)
    recorder.feed("log", batch)
    assert recorder.record().force.health.gaps == gaps
    assert aligner.report.streams["log"].gaps == gaps


def test_abilities_are_told_by_what_a_device_has():
    rig = load_pipeline(PIPELINES / "filters.toml").devices["rig"]
    arm = load_pipeline(PIPELINES / "point_ur3e.toml").devices["arm"]
    assert isinstance(rig, KnowsTruth)
    assert isinstance(rig, Turnable)
    assert isinstance(rig, SupportsReach)
    assert not isinstance(rig, SupportsOwnMotion)
    assert isinstance(arm, SupportsOwnMotion)
    assert not isinstance(arm, KnowsTruth | Turnable | SupportsReach)
    for ability in ("truth", "outlines", "turned", "own_motion", "refuse"):
        assert not hasattr(Device, ability)
        assert not hasattr(CsvReplay, ability)
    devices = {"rig": rig, "arm": arm}
    assert truth_of(devices)["elasticity"] == 112.5e3
    assert set(own_motions(devices)) == {"arm"}
    still = np.zeros((1, 3))
    ask_devices(devices, Setpoint(still, still, np.zeros(1, bool)))


def test_what_can_be_gone_on_with_is_told_by_what_a_trajectory_has():
    assert issubclass(Raster, Resumable)
    assert not issubclass(Point, Resumable)
    assert not hasattr(Trajectory, "after")


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("alignment.position='rig.tip.x'", "the position is the one along the normal, rig.tip.z"),
        ("alignment.velocity='rig.twist.y'", "the velocity is the one along the normal, rig.twist.z"),
        ("alignment.position={channel='rig.tip.z', sign=-1}", "positive out of the material already"),
        ("safety.stop_force=600 N", "600 N never comes: rig.wrench.z is at the end of its range at 500 N"),
        ("alignment.force_limit=11 N", "12 N never comes: rig.wrench.z is at the end of its range at 11 N"),
    ],
)
def test_a_channel_that_cannot_serve_is_a_mistake_of_the_file(override, words):
    limits = {
        "low": "['-5 mm', '-5 mm', '-7 mm']", "high": "['5 mm', '5 mm', '20 mm']", "force": "'900 N'",
        "stop_force": "'12 N'", "stiffness": "'3 N/mm'",
    }  # fmt: skip
    safety = [f"safety.{key}={value}" for key, value in limits.items()]
    load_pipeline(PIPELINES / "filters.toml", safety)
    with pytest.raises(ConfigurationError) as caught:
        load_pipeline(PIPELINES / "filters.toml", [*safety, override])
    assert words in str(caught.value)


def test_heights_of_other_frames_are_taken_at_their_word():
    """In the base's frame the normal may be anything."""
    pose = Stream("tip", tuple(Channel(axis, "m") for axis in "xyz"), 500.0, "pose", frame="base")
    wrench = Stream("wrench", (Channel("z", "N"),), 800.0)
    made = AlignmentSettings.model_validate({"force": "r.wrench.z", "position": {"channel": "r.tip.x", "sign": -1}})
    assert check_wiring(Ports.of(made, {"r": (pose, wrench)}), None) == []
