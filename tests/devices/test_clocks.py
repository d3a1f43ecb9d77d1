"""Time-stamps as real recorders write them, on logs with known truth: estimates stay right, or it is said why not."""

import numpy as np
import pytest
from mcap.writer import Writer
from palpate_devices.messages import POSE, TWIST, WRENCH
from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import run_pipeline

from tests.records.bags import press, wrench_message

SECOND = 10**9
START = 1_700_000_000 * SECOND
KAPPA = 1.2e4  # [N/m^1.5]
TRUTH = 0.75 * 0.75 * KAPPA / np.sqrt(0.005)  # [Pa] of the 5 mm tip, nu = 0.5

PIPELINE = """
[device.log]
type = "mcap-replay"
file = "{file}"
time = "{clock}"
[device.log.signals]
force = {{ topic = "/ft/wrench", field = "wrench.force.z", unit = "N" }}
z = {{ topic = "/tcp/pose", field = "pose.position.z", unit = "m" }}
vz = {{ topic = "/tcp/twist", field = "twist.linear.z", unit = "m/s" }}
[alignment]
force = {{ channel = "log.wrench.force", uncertainty = "1 ms" }}
position = {{ channel = "log.pose.z", uncertainty = "1 ms" }}
velocity = {{ channel = "log.twist.vz", uncertainty = "1 ms" }}
tip_mass = "1 g"
[indenter.tip]
type = "sphere"
radius = "5 mm"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[estimator.ekf]
type = "ekf"
"""


def write_log(path, stamps, logged, order=None, force_stamps=None):
    """Wrench, pose and twist of a press with the given stamps and log times [ns], in the given order of messages."""
    force_stamps = stamps if force_stamps is None else force_stamps
    _, height, speed, force = press(6.0)
    order = range(len(stamps)) if order is None else order
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 16)
        writer.start(profile="ros2", library="test")
        channels = [
            writer.register_channel(
                topic, "cdr", writer.register_schema(kind.name, "ros2msg", kind.definition.encode())
            )
            for topic, kind in (("/ft/wrench", WRENCH), ("/tcp/pose", POSE), ("/tcp/twist", TWIST))
        ]
        for i in order:
            stamp, arrival = int(stamps[i]), int(logged[i])
            rows = ([0, 0, force[i], 0, 0, 0], [0, 0, height[i], 0, 0, 0, 1], [0, 0, speed[i], 0, 0, 0])
            for channel, row, at in zip(channels, rows, (int(force_stamps[i]), stamp, stamp), strict=True):
                writer.add_message(channel, arrival, wrench_message(at, "base", row), at)
        writer.finish()
    return path


def true_stamps():
    return START + np.arange(3000) * 2_000_000


def result_on(path, folder, clock="stamp"):
    result = run_pipeline(build_pipeline(Source(PIPELINE.format(file=path, clock=clock), path)), folder)
    track = result.tracks["dr/ekf"]
    return track.parameters["elasticity"].value, (*result.flags, *track.flags), result


def in_order(random, stamps):
    return stamps, stamps + 100_000, None


def jittered_arrival(random, stamps):
    late = np.sort(stamps + random.integers(0, 5_000_000, len(stamps)))
    return stamps, late, None


def duplicated(random, stamps):
    order = np.sort(np.concatenate([np.arange(len(stamps)), random.choice(len(stamps), 300, replace=False)]))
    return stamps, stamps, order.tolist()


def out_of_order(random, stamps):
    order = np.arange(len(stamps))
    for i in random.choice(len(stamps) - 2, 60, replace=False):
        order[[i, i + 1]] = order[[i + 1, i]]
    return stamps, stamps, order.tolist()


def with_gap(random, stamps):
    order = np.concatenate([np.arange(1800), np.arange(2300, len(stamps))])
    return stamps, stamps, order.tolist()


def drifting(random, stamps):
    return stamps + ((stamps - stamps[0]) * 200e-6).astype(np.int64), stamps, None


HARMLESS = {f.__name__: f for f in (in_order, jittered_arrival, duplicated, out_of_order, with_gap, drifting)}
SAID = {"duplicated": "repeated", "out_of_order": "backwards", "with_gap": "gap"}


@pytest.mark.slow
@pytest.mark.parametrize("name", HARMLESS)
def test_estimates_stay_right(tmp_path, name):
    stamps, logged, order = HARMLESS[name](np.random.default_rng(5), true_stamps())
    path = write_log(tmp_path / "log.mcap", stamps, logged, order)
    elasticity, flags, _ = result_on(path, tmp_path / "out")
    assert elasticity == pytest.approx(TRUTH, rel=0.08)
    if name in SAID:
        assert any(SAID[name] in str(flag) for flag in flags), flags


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wrapped", "restarted"])
def test_stamps_that_jump_back_are_said(tmp_path, kind):
    """A counter of 32 bits that wraps, or a driver that starts anew: what comes after is never mixed in silently."""
    stamps = true_stamps()
    stamps = (
        stamps % 2**32 if kind == "wrapped" else np.where(np.arange(len(stamps)) < 2000, stamps, stamps - SECOND * 2)
    )
    path = write_log(tmp_path / "log.mcap", stamps, true_stamps())
    elasticity, flags, result = result_on(path, tmp_path / "stamp")
    if kind == "restarted":
        assert any("backwards" in str(flag) for flag in flags), flags
        assert result.streams["log.wrench"]["backwards"] > 900
    else:
        assert any(flag.code in ("backwards", "gaps") for flag in flags), flags
    # The log time is what helps.
    elasticity, _, _ = result_on(path, tmp_path / "log", clock="log")
    assert elasticity == pytest.approx(TRUTH, rel=0.08)


@pytest.mark.slow
@pytest.mark.parametrize(("drift", "said"), [(200e-6, True), (-200e-6, True), (20e-6, False), (0.0, False)])
def test_a_force_whose_clock_runs_otherwise_than_that_of_the_motion_is_said(tmp_path, drift, said):
    """200 ppm are 1 ms after 5 s, and a millisecond between force and motion is taken for viscosity."""
    random, stamps = np.random.default_rng(7), true_stamps()
    drifted = stamps + ((stamps - stamps[0]) * drift).astype(np.int64)
    arrival = np.sort(stamps + random.integers(50_000, 1_000_000, len(stamps)))
    path = write_log(tmp_path / "log.mcap", stamps, arrival, force_stamps=drifted)
    elasticity, flags, _ = result_on(path, tmp_path / "out")
    assert any(flag.code == "clock-drift" for flag in flags) == said, flags
    assert said or elasticity == pytest.approx(TRUTH, rel=0.08)
    elasticity, flags, _ = result_on(path, tmp_path / "log", clock="log")
    assert elasticity == pytest.approx(TRUTH, rel=0.08)
    assert not any(flag.code == "clock-drift" for flag in flags)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_log_times_with_a_jitter_of_5_ms_stay_right_or_are_said(tmp_path, seed):
    """Without stamps only the arrival is left; the same jitter moves all three signals of an instant."""
    stamps = true_stamps()
    arrival = np.sort(stamps + np.random.default_rng(seed).integers(0, 5_000_000, len(stamps)))
    path = write_log(tmp_path / "log.mcap", stamps, arrival)
    elasticity, _, _ = result_on(path, tmp_path / "out", clock="log")
    assert elasticity == pytest.approx(TRUTH, rel=0.08)
