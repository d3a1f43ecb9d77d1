"""Weight and centre of mass: intervals that hold the truth although the directions are not exact, and refusals."""

import numpy as np
import pytest
from palpate import Batch, Channel, LogError, Stream
from palpate_calibration.orientations import Pose, WrenchRecorder, weigh_tool
from palpate_calibration.settings import Orientations
from palpate_engine.alignment import AlignmentSettings, Ports

MASS, CENTRE = 0.25, np.array([0.001, -0.002, 0.04])
BIAS, TORQUE = np.array([0.3, -0.2, 0.6]), np.array([0.01, 0.02, -0.03])
ANGLE = np.radians(0.5)
DOWN = Orientations().down
STD = np.array([1e-3] * 3 + [2e-5] * 3)


def tilted(downs, angle, rng):
    """The directions as they really were: each turned by some angle about two axes."""
    turned = []
    for down in downs:
        axis = np.cross(down, rng.standard_normal(3))
        sideways = np.cross(down, axis)
        frame = np.array([axis / np.linalg.norm(axis), sideways / np.linalg.norm(sideways)])
        moved = down + angle * rng.standard_normal(2) @ frame
        turned.append(moved / np.linalg.norm(moved))
    return np.array(turned)


def poses(downs, rng):
    weights = MASS * 9.80665 * downs
    wrenches = np.hstack([weights + BIAS, np.cross(CENTRE, weights) + TORQUE])
    return [Pose(wrench + STD * rng.standard_normal(6), STD) for wrench in wrenches]


@pytest.mark.slow
def test_intervals_hold_the_truth_ninety_to_ninety_nine_times_of_a_hundred():
    truth = {"mass_by_weight": MASS, "bias_z": BIAS[2], "torque_bias_x": TORQUE[0]}
    truth |= {f"centre_{axis}": value for axis, value in zip("xyz", CENTRE, strict=True)}
    inside = dict.fromkeys(truth, 0)
    for seed in range(100):
        rng = np.random.default_rng(700 + seed)
        real = tilted(np.array(DOWN), ANGLE, rng)
        found = weigh_tool([poses(real, rng) for _ in range(3)], DOWN, ANGLE)
        for name, value in truth.items():
            low, high = found[name].interval
            inside[name] += low <= value <= high
    for name, count in inside.items():
        assert 90 <= count <= 99, (name, count)


def test_the_uncertainty_of_the_directions_is_type_b():
    rng = np.random.default_rng(1)
    repeats = [poses(np.array(DOWN), rng) for _ in range(3)]
    exact, unsure = weigh_tool(repeats, DOWN, 0.0), weigh_tool(repeats, DOWN, ANGLE)
    assert exact["mass_by_weight"].type_b == 0
    assert unsure["mass_by_weight"].type_b > 10 * unsure["mass_by_weight"].fit
    assert exact["mass_by_weight"].value == unsure["mass_by_weight"].value


def test_a_tool_that_was_not_turned_as_said_is_refused():
    rng = np.random.default_rng(2)
    upright = np.tile([0.0, 0.0, -1.0], (4, 1))
    with pytest.raises(LogError, match="no weight explains"):
        weigh_tool([poses(upright, rng)], DOWN, ANGLE)
    swapped = np.array(DOWN)[[0, 2, 1, 3]]
    with pytest.raises(LogError, match="no weight explains"):
        weigh_tool([poses(swapped, rng)], DOWN, ANGLE)


def sensor(*names):
    wrench = Stream("wrench", tuple(Channel(name, "N") for name in names), 800.0)
    return {"s": (wrench,), "a": (Stream("tip", (Channel("z", "m"),), 500.0),)}


SETTINGS = AlignmentSettings.model_validate({"force": "s.wrench.z", "position": "a.tip.z"})


def test_a_sensor_of_one_axis_cannot_weigh():
    with pytest.raises(LogError, match="x, y, tx, ty, tz missing"):
        WrenchRecorder(Ports.of(SETTINGS, sensor("z")))


def test_a_rest_that_is_too_short_is_refused():
    recorder = WrenchRecorder(Ports.of(SETTINGS, sensor("x", "y", "z", "tx", "ty", "tz")))
    with pytest.raises(LogError, match="no reading"):
        recorder.poses()
    stamps = (np.arange(240) * 1_250_000).astype(np.int64)
    recorder.feed("s", Batch("wrench", stamps, stamps, np.zeros((240, 6))))
    with pytest.raises(LogError, match="too short"):
        recorder.poses()
