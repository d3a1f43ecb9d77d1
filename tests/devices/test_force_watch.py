"""The eye of the servo process on the sensor's shared memory, reading by reading, without a process."""

import os

import numpy as np
import pytest
from palpate import Repeats
from palpate_arms.force_watch import ForceEye
from palpate_kit.acquisition.ring import ROWS, Ring, ring_size, shared_memory

RATE, COLUMNS, FIRST = 800.0, 8, 2
BIAS = np.array([0.3, -0.2, 0.6, 0.0, 0.0, 0.0])
NAMES = {0: "s.x", 1: "s.y", 2: "s.z", 3: "s.tx", 4: "s.ty", 5: "s.tz"}


def readings(count, push=0.0, repeat=1, seed=0):
    """Wrenches (n, 6)."""
    rows = BIAS + 0.05 * np.random.default_rng(seed).standard_normal((count, 6))
    rows[:, 2] += push
    return np.repeat(rows[::repeat], repeat, axis=0)[:count]


class Line:
    """A sensor's ring, and an eye that looks every 2 ms."""

    def __init__(self, repeat=1, **facts):
        memory = shared_memory(ring_size(COLUMNS))
        self.ring = Ring(memory, COLUMNS)
        usual = Repeats.of(readings(800, repeat=repeat), RATE, NAMES, (0, 1, 2), "s")
        watch = {"columns": COLUMNS, "rows": ROWS, "first": FIRST, "channels": (0, 1, 2), "tare": BIAS[:3]}
        watch |= {"stop": 12.0, "name": "s.z", "normal": 2, "sign": 1.0, "ranges": [(-500.0, 500.0)] * 3}
        watch |= {"repeats": vars(usual), **facts}
        self.eye = ForceEye(memory, watch)
        os.close(memory)
        self.now = self.sent = 0
        self.deaf: list[float] = []  # when [s]

    def run(self, rows, stamped=False, late=0.0):
        """Send readings, so late [s] by their stamps [us]; why it stopped, and after how many seconds."""
        for k in range(0, len(rows), 2):
            for row in rows[k : k + 2]:
                stamp = round(self.sent / RATE * 1e6) if stamped else 0
                self.ring.write((1000 * stamp + round(1e9 * late), stamp), row.tolist())
                self.sent += 1
            self.now += 2_500_000
            text = self.eye.look(self.now)
            if self.eye.deaf(self.now):
                self.deaf.append(k / RATE)
            if text is not None:
                return text, (k + 2) / RATE
        return None, len(rows) / RATE


@pytest.mark.parametrize(("columns", "words"), [(slice(None), "every axis of s"), (2, "s.z")])
def test_a_stuck_sensor_stops_the_arm_which_waits_before(columns, words):
    line = Line()
    assert line.run(readings(800, push=3.0, seed=1))[0] is None
    assert line.deaf == []
    rows = readings(800, push=3.0, seed=2)
    rows[:, columns] = rows[0, columns]
    text, late = line.run(rows)
    assert text.startswith(f"{words} repeats its reading in every digit for")
    assert late == pytest.approx(0.1, abs=0.005)
    assert line.deaf[0] == pytest.approx(0.03, abs=0.005)  # from here on nothing leads the tip deeper


def test_it_goes_on_where_readings_change_again_in_time():
    line = Line()
    rows = readings(800, seed=1)
    rows[100:160] = rows[100]  # 75 ms
    assert line.run(rows)[0] is None
    assert (min(line.deaf), max(line.deaf)) == pytest.approx((0.155, 0.2), abs=0.005)


def test_a_slow_sensor_that_is_resampled_is_neither_stopped_nor_held():
    line = Line(repeat=8)
    assert line.run(readings(4000, push=2.0, repeat=8, seed=1))[0] is None
    assert line.deaf == []


@pytest.mark.parametrize(("column", "words"), [(2, "s.z is at the end"), (0, "a force across s.z is at the end")])
def test_the_end_of_the_range_stops_the_arm_at_once(column, words):
    line = Line(ranges=[(-8.0, 8.0)] * 3)
    rows = readings(40, seed=1)
    rows[20, column] = 8.0
    text, late = line.run(rows)
    assert words in text
    assert late == pytest.approx(21 / RATE, abs=2 / RATE)


def test_a_force_clipped_below_its_range_stops_the_arm():
    line = Line()
    text, late = line.run(readings(800, push=np.linspace(0.0, 10.0, 800), seed=1).clip(-6.0, 6.0))
    assert text.startswith("s.z repeats its reading")
    assert late < 0.54 + 0.12


def test_a_torque_stops_the_arm():
    line = Line(torques=(3, 4, 5), torque_tare=BIAS[3:], torque=1.5)
    rows = readings(800, push=3.0, seed=1)
    assert line.run(rows)[0] is None
    rows[400:, 4] -= 2.0
    text, late = line.run(rows)
    assert "over the limit of 1.5 N*m that stops the motion ([safety] torque)" in text
    assert late == pytest.approx(0.5, abs=0.005)
