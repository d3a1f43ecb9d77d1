"""The simulated rig: is its physics honest?"""

import time

import numpy as np
import pytest
from palpate import contact_force
from palpate_models import DimensionalityReduction, Sphere
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_testing import check_device
from palpate_trajectories.point import Point

MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
PRESS = Point(bias=0.004, duration=2.0)
THETA = (112.5e3, 362.0)


def rig(**changes):
    specimen = {"model": MODEL, "elasticity": THETA[0], "viscosity": THETA[1], "surface": 0.0003}
    return SimulatedRig.model_validate({"specimen": specimen, **changes})


QUIET = {"position_std": 0.0, "velocity_std": 0.0, "force_std": 0.0, "bias": 0.0, "drift": 0.0}


def readings(device, trajectory=PRESS, seed=0):
    """All of each stream: {name: (time [s], values)}."""
    with device.connect(seed) as link:
        link.follow(trajectory)
        batches = list(link.batches())
    names = {batch.stream for batch in batches}
    return {
        name: (
            np.concatenate([b.time for b in batches if b.stream == name]) / 1e9,
            np.concatenate([b.values for b in batches if b.stream == name]),
        )
        for name in names
    }


def test_it_keeps_the_promises_of_a_device():
    check_device(rig(), Point(bias=0.004, duration=0.5))


def test_rates_and_stamps():
    streams = readings(rig(sensor_rate=1000.0))
    assert np.allclose(np.diff(streams["tip"][0]), 0.002)
    assert np.allclose(np.diff(streams["wrench"][0]), 0.001)
    assert np.array_equal(streams["tip"][0], streams["twist"][0])


def test_an_arm_that_is_not_steady_moves_as_it_says_and_the_force_feels_it():
    """The tip's own motion has the stated size, its speed is its derivative, and what it does not feel is unchanged."""
    steady, uneasy = (readings(rig(**QUIET, unrest=unrest)) for unrest in (0.0, 20e-6))
    own, speed = uneasy["tip"][1][:, 2] - steady["tip"][1][:, 2], uneasy["twist"][1][:, 2] - steady["twist"][1][:, 2]
    assert own.std() == pytest.approx(20e-6, rel=0.35)
    assert np.cumsum(speed) * 0.002 == pytest.approx(own - own[0], abs=8e-6)
    assert np.array_equal(uneasy["tip"][1][:, :2], steady["tip"][1][:, :2])
    felt = uneasy["wrench"][1][:, 2] - steady["wrench"][1][:, 2]
    assert 0.01 < felt.std() < 0.1
    assert np.array_equal(uneasy["setpoint"][1], steady["setpoint"][1])


def test_the_loop_passes_four_fifths_of_two_hertz():
    _, tip = readings(rig(**QUIET), Point(bias=0.004, duration=10.0))["tip"]
    t = np.arange(len(tip)) * 0.002
    sine = (t > 6.0) & (t < 11.0)
    fit = np.column_stack([np.sin(4 * np.pi * t[sine]), np.cos(4 * np.pi * t[sine]), np.ones(sine.sum())])
    a, b, _ = np.linalg.lstsq(fit, tip[sine, 2], rcond=None)[0]
    assert np.hypot(a, b) == pytest.approx(0.8e-3, rel=0.02)


def test_velocity_is_the_derivative_of_position():
    streams = readings(rig(**QUIET))
    t, tip = streams["tip"]
    _, twist = streams["twist"]
    slope = (tip[2:, 2] - tip[:-2, 2]) / (t[2:] - t[:-2])
    assert twist[1:-1, 2] == pytest.approx(slope, abs=2e-4)


def test_the_sensor_feels_contact_weight_and_inertia():
    streams = readings(rig(**QUIET, rate=500.0, sensor_rate=500.0, tip_mass=0.2))
    _, tip = streams["tip"]
    _, twist = streams["twist"]
    _, wrench = streams["wrench"]
    contact = contact_force(MODEL, 0.0003 - tip[:, 2], -twist[:, 2], THETA, pulls=False)
    remainder = wrench[:, 2] - contact + 0.2 * 9.80665
    acceleration = np.gradient(twist[:, 2], 0.002)
    inner = slice(5, -5)
    # One control period holds the command: the acceleration jumps at each tick, so a difference is only so good.
    assert remainder[inner] == pytest.approx(-0.2 * acceleration[inner], abs=0.03)
    assert wrench[0, 2] == pytest.approx(-0.2 * 9.80665)
    assert np.corrcoef(remainder[inner], -acceleration[inner])[0, 1] > 0.98


def test_bias_drift_noise_and_range():
    still = Point(bias=0.001, amplitude=0.0005, clearance=0.05, standstill=20.0, duration=0.5, speed=0.05)
    streams = readings(rig(bias=0.6, drift=0.01, force_std=0.05, force_limit=5.0), still)
    t, wrench = streams["wrench"]
    rest = t < 20.0
    slope, offset = np.polyfit(t[rest], wrench[rest, 2], 1)
    assert slope == pytest.approx(0.01, abs=0.001)
    assert offset == pytest.approx(0.6 - 0.14 * 9.80665, abs=0.01)
    assert wrench[rest, 0].std() == pytest.approx(0.05, rel=0.03)
    hard = readings(rig(force_limit=1.0))["wrench"][1]
    assert hard[:, 2].max() == 1.0


def test_velocity_noise():
    quiet, noisy = (readings(rig(**{**QUIET, "velocity_std": std}))["twist"][1][:, 2] for std in (0.0, 0.67e-3))
    assert (noisy - quiet).std() == pytest.approx(0.67e-3, rel=0.05)


def test_delays_are_in_the_stamps_only():
    on_time, late = readings(rig()), readings(rig(force_delay=0.0123, motion_delay=0.022))
    assert late["wrench"][0] - on_time["wrench"][0] == pytest.approx(0.0123)
    assert late["tip"][0] - on_time["tip"][0] == pytest.approx(0.022)
    np.testing.assert_array_equal(late["wrench"][1], on_time["wrench"][1])


def test_seeds():
    first, same, other = readings(rig(), seed=3), readings(rig(), seed=3), readings(rig(), seed=4)
    np.testing.assert_array_equal(first["wrench"][1], same["wrench"][1])
    assert not np.array_equal(first["wrench"][1], other["wrench"][1])
    own = readings(rig(seed=3), seed=99)
    np.testing.assert_array_equal(own["wrench"][1], first["wrench"][1])


def test_nothing_sticks():
    """Leaving faster than the material recovers, the tip is let go, not pulled."""
    streams = readings(rig(**QUIET, tip_mass=1e-6), Point(bias=0.004, duration=0.5, speed=0.2))
    assert streams["wrench"][1][:, 2].min() > -1e-4


@pytest.mark.slow
def test_real_time_takes_its_time():
    short = Point(bias=0.002, clearance=0.001, standstill=0.1, duration=0.5, speed=0.02)
    before = time.monotonic()
    with rig(pace="real-time").connect(0) as link:
        link.follow(short)
        for batch in link.batches():
            assert (batch.received <= time.time_ns()).all()  # nothing is told before it has happened
    assert time.monotonic() - before > short.total_duration - 0.01


def test_stop_ends_the_stream():
    with rig(pace="real-time").connect(0) as link:
        link.follow(PRESS)
        batches = link.batches()
        next(batches)
        link.stop()
        link.stop()
        assert len(list(batches)) <= 4
