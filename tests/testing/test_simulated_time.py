"""`palpate_testing.check_simulated_time`: whose time a third-party device goes by."""

import queue
import threading
import time
from contextlib import contextmanager, suppress
from time import sleep

import numpy as np
import pytest
from palpate import Batch, Channel, Device, Stream, clock
from palpate_testing import check_simulated_time

PERIOD = 0.01


def by_an_event():
    threading.Event().wait(PERIOD)


def by_a_queue():
    with suppress(queue.Empty):
        queue.Queue().get(timeout=PERIOD)


def by_a_thread():
    thread = threading.Thread(target=lambda: clock().sleep(PERIOD))
    thread.start()
    thread.join()


class Sensor(Device):
    """A sensor that waits for its next reading in one way or another, and dates it."""

    wait: object = None
    stamp: object = None

    @property
    def live(self):
        return True

    @property
    def streams(self):
        return (Stream("wrench", (Channel("z", "N"),), 100.0),)

    @contextmanager
    def connect(self, seed=0):
        yield self

    def batches(self):
        while True:
            if self.wait is not None:
                self.wait()
            stamp = np.array([(self.stamp or clock().epoch_ns)()])
            yield Batch("wrench", stamp, stamp, np.ones((1, 1)))


@pytest.mark.gate
@pytest.mark.slow
def test_a_device_that_goes_by_the_clock_runs_in_simulated_time():
    instants = []

    def wait():
        clock().sleep(PERIOD)
        instants.append(clock().now())

    check_simulated_time(Sensor(wait=wait), listen=30.0)
    assert instants[-1] - instants[0] > 29.0  # simulated seconds
    assert not clock().simulated


@pytest.mark.parametrize(
    ("settings", "call", "instead"),
    [
        ({"wait": lambda: time.sleep(PERIOD)}, "time.sleep", "clock().sleep"),
        ({"wait": lambda: sleep(PERIOD)}, "time.sleep", "clock().sleep"),
        ({"wait": by_an_event}, "threading.Event.wait", "clock().event"),
        ({"wait": by_a_queue}, "queue.Queue.get", "clock().queue"),
        ({"wait": lambda: queue.SimpleQueue().get(timeout=PERIOD)}, "SimpleQueue.get", "clock().queue"),
        ({"wait": by_a_thread}, "threading.Thread.start", "clock().thread"),
        ({"wait": lambda: clock().sleep(PERIOD), "stamp": lambda: time.time_ns()}, "time.time_ns", "clock().epoch_ns"),
    ],
)
def test_a_device_that_goes_by_another_time_is_named(settings, call, instead):
    with pytest.raises(AssertionError) as failure:
        check_simulated_time(Sensor(**settings))
    assert "test_simulated_time.py:" in str(failure.value)
    assert f"calls {call}: palpate's {instead} runs in simulated time, too" in str(failure.value)
    assert str(failure.value).startswith("Sensor: ")


def test_a_call_for_ever_is_not_made():
    with pytest.raises(AssertionError, match=r"threading\.Event\.wait"):
        check_simulated_time(Sensor(wait=threading.Event().wait))


def test_a_device_that_does_not_wait_is_named():
    with pytest.raises(AssertionError, match="100 batches came at one instant of simulated time"):
        check_simulated_time(Sensor())


def test_a_silent_device_is_named():
    with pytest.raises(AssertionError, match=r"Sensor sends nothing in 0\.5 s of simulated time"):
        check_simulated_time(Sensor(wait=lambda: clock().sleep(3600.0)), listen=0.5)
