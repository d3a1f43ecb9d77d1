"""A sensor that repeats itself: refused at standstill, not believed in motion; one that is coarse, quiet or slow is."""

import numpy as np
import pytest
from palpate import Batch, Channel, DeviceError, RepeatCount, Repeats, Stream
from palpate_engine.alignment import AlignmentSettings, Ports
from palpate_engine.pipeline.live.guard import Guard
from palpate_engine.safety import SafetySettings

RATE = 800.0  # [Hz]
LIMITS = SafetySettings(
    low=(-0.005, -0.005, -0.007), high=(0.005, 0.005, 0.02), force=20.0, stop_force=12.0, stiffness=3000.0
)
TIP = Stream("tip", (Channel("z", "m"),), 500.0)
ALIGNMENT = AlignmentSettings.model_validate({"force": "s.wrench.z", "position": "r.tip.z"})
BIAS = np.array([0.33, -0.21, 0.62, 0.011, -0.023, 0.005])


def wrench(limit=500.0):
    """The stream of six axes with a range of the forces [N]."""
    force = [Channel(axis, "N", (-limit, limit)) for axis in "xyz"]
    return Stream("wrench", (*force, *(Channel(f"t{axis}", "N*m") for axis in "xyz")), RATE)


def ports(stream=None):
    return Ports.of(ALIGNMENT, {"s": (stream or wrench(),), "r": (TIP,)})


def readings(duration, *, noise=0.05, step=0.0, push=0.0, rate=RATE, repeat=1, seed=0):
    """Readings (n, 6) over a time [s] with a push, constant or (n,) [N], rounded to a step, each `repeat` times."""
    count = round(duration * rate)
    rows = BIAS + noise * np.random.default_rng(seed).standard_normal((count, 6))
    rows[:, 2] += push
    if step:
        rows = step * np.round(rows / step)
    return np.repeat(rows[::repeat], repeat, axis=0)[:count]


class Sensor:
    """Hands readings to a guard in batches, with stamps that go on."""

    def __init__(self, guard, rate=RATE, size=7):
        self.guard, self.rate, self.size, self.sent = guard, rate, size, 0

    def send(self, rows):
        """Until the guard trips: how many seconds that took."""
        for begin in range(0, len(rows), self.size):
            part = rows[begin : begin + self.size]
            stamps = np.rint((self.sent + np.arange(len(part))) / self.rate * 1e9).astype(np.int64)
            self.guard.check("s", Batch("wrench", stamps, stamps, part))
            self.sent += len(part)
            if self.guard.reason is not None:
                return (begin + len(part)) / self.rate
        return len(rows) / self.rate


def rested(still, rate=RATE, stream=None, size=7):
    """A guard and its sensor after a standstill of such readings."""
    guard = Guard(LIMITS, ports(stream))
    sensor = Sensor(guard, rate, size)
    sensor.send(still)
    stamps = np.arange(20, dtype=np.int64)
    guard.check("r", Batch("tip", stamps, stamps, np.full((20, 1), 0.01)))
    guard.judge_standstill()
    return guard, sensor


def stuck(rows, columns=slice(None)):
    """The readings, of which some columns stay at the first."""
    rows = rows.copy()
    rows[:, columns] = rows[0, columns]
    return rows


SINE = 3.0 + 2.0 * np.sin(4 * np.pi * np.arange(round(4 * RATE)) / RATE)


@pytest.mark.parametrize("size", [1, 7, 500])
@pytest.mark.parametrize(
    ("columns", "words"),
    [(slice(None), "every axis of s.wrench"), (2, "s.wrench.z"), (0, "s.wrench.x")],
    ids=["all", "normal", "across"],
)
def test_a_sensor_that_is_stuck_trips_after_a_tenth_of_a_second(columns, words, size):
    guard, sensor = rested(readings(1.0), size=size)
    sensor.send(readings(1.0, push=3.0, seed=1))
    assert guard.reason is None
    late = sensor.send(stuck(readings(1.0, push=3.0, seed=2), columns))
    assert guard.reason.startswith(f"{words} repeats its reading in every digit")
    assert "stuck or clipped" in guard.reason
    assert 0.1 < late < 0.1 + (size + 2) / RATE


def test_a_force_that_is_clipped_below_its_range_trips():
    """The other axes go on."""
    guard, sensor = rested(readings(1.0))
    rising = readings(1.0, push=np.linspace(0.0, 10.0, 800), seed=1)
    late = sensor.send(rising.clip(-6.0, 6.0))
    assert guard.reason.startswith("s.wrench.z repeats its reading")
    assert late == pytest.approx(0.54 + 0.1, abs=0.02)


@pytest.mark.parametrize(("column", "words"), [(2, "s.wrench.z"), (1, "s.wrench.y")])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_reading_at_the_end_of_the_range_trips_at_once_wherever_it_is_in_a_batch(column, words, sign):
    guard, sensor = rested(readings(1.0), stream=wrench(11.0))
    rows = readings(7 / RATE, seed=1)
    rows[3, column] = sign * 11.0
    sensor.send(rows)
    assert guard.reason == f"{words} is at the end of its range"


@pytest.mark.parametrize(
    ("settings", "rate"),
    [
        ({"noise": 0.05}, RATE),
        ({"noise": 0.05, "step": 0.1}, RATE),  # coarse
        ({"noise": 0.03, "step": 0.1}, RATE),
        ({"noise": 1e-4}, RATE),  # quiet
        ({"noise": 1e-4, "step": 1e-4}, RATE),
        ({"noise": 0.05, "repeat": 8}, RATE),  # 100 Hz, resampled
        ({"noise": 0.05, "repeat": 80}, RATE),  # 10 Hz, resampled
        ({"noise": 0.05}, 10.0),  # slow
        ({"noise": 0.05, "step": 0.05}, 20.0),
    ],
)
@pytest.mark.parametrize("moving", [False, True])
def test_a_sound_sensor_of_any_kind_is_believed(settings, rate, moving):
    """In a sine, and at a force that is held."""
    for seed in range(5):
        guard, sensor = rested(readings(1.0, rate=rate, seed=seed, **settings), rate, size=40)
        count = round(8.0 * rate)
        push = 3.0 + 2.0 * np.sin(4 * np.pi * np.arange(count) / rate) if moving else 2.0
        sensor.send(readings(count / rate, push=push, rate=rate, seed=100 + seed, **settings))
        assert guard.reason is None, seed


@pytest.mark.parametrize("settings", [{"step": 0.1, "noise": 0.03}, {"repeat": 8}])
def test_a_coarse_or_slow_sensor_that_is_stuck_trips_as_well(settings):
    guard, sensor = rested(readings(1.0, **settings))
    late = sensor.send(stuck(readings(4.0, seed=1, **settings)))
    assert "repeats its reading" in guard.reason
    assert late < 1.0


def test_a_sensor_that_is_stuck_at_standstill_is_refused():
    with pytest.raises(DeviceError, match=r"every axis of s.wrench repeats .* through the standstill, 800 times"):
        rested(stuck(readings(1.0)))


def test_axes_that_a_sensor_lacks_are_of_no_account():
    """A load cell as a wrench: five columns of zeros."""
    still, moved = readings(1.0), readings(4.0, push=SINE, seed=1)
    for rows in (still, moved):
        rows[:, [0, 1, 3, 4, 5]] = 0.0
    guard, sensor = rested(still)
    sensor.send(moved)
    assert guard.reason is None
    sensor.send(stuck(moved))
    assert "repeats its reading" in guard.reason


def test_runs_do_not_depend_on_how_readings_are_cut():
    rng = np.random.default_rng(3)
    rows = np.repeat(rng.standard_normal((200, 2)), rng.integers(1, 9, 200), axis=0)
    usual = Repeats(("both", "one"), ((0, 1), (1,)), (0, 0), 1e6)
    whole, pieces = RepeatCount(usual), RepeatCount(usual)
    whole.add(rows)
    longest = np.zeros(2)
    for part in np.split(rows, np.sort(rng.integers(0, len(rows), 150))):
        pieces.add(part)
        longest = np.maximum(longest, pieces.longest)
    assert longest.tolist() == whole.longest.tolist()
    assert whole.longest[0] == 8
