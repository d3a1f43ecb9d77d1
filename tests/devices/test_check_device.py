"""`palpate_testing.check_device` on devices that are live: it ends, and asks for no reading twice."""

import itertools
import time
from contextlib import contextmanager

import numpy as np
import pytest
from palpate import Batch, Channel, Device, Stream
from palpate_testing import check_device

COUNT = itertools.count()


class _Link:
    def __init__(self, silent, broken):
        self._silent, self._broken = silent, broken

    def batches(self):
        if self._broken:
            raise OSError("unplugged")
        while True:
            time.sleep(0.01)
            if not self._silent:
                stamp = np.array([time.monotonic_ns()])
                yield Batch("wrench", stamp, stamp, np.array([[float(next(COUNT))]]))


class Live(Device):
    """A sensor that never ends."""

    silent: bool = False
    broken: bool = False

    @property
    def live(self):
        """It is."""
        return True

    @property
    def streams(self):
        """One."""
        return (Stream("wrench", (Channel("z", "N"),), 100.0),)

    @contextmanager
    def connect(self, seed=0):
        """A link."""
        yield _Link(self.silent, self.broken)


@pytest.mark.slow
def test_it_ends_and_does_not_ask_for_the_same_readings():
    check_device(Live(), listen=0.2)


@pytest.mark.parametrize(("settings", "words"), [({"silent": True}, "sends nothing"), ({"broken": True}, "unplugged")])
def test_what_is_wrong_with_a_live_device_is_said(settings, words):
    with pytest.raises(AssertionError, match=words):
        check_device(Live(**settings), listen=0.1)
