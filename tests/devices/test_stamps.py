"""Time-stamps that are no number, or ahead of their arrival, are named as what they are; by what the twin's arm did."""

import numpy as np
import pytest
from palpate import Batch, Channel, DeviceError, Stream
from palpate_engine.pipeline.arrivals import declared_batches

STREAMS = (Stream("wrench", (Channel("z", "N"),), 100.0),)


class Link:
    def __init__(self, time):
        self._time = time

    def batches(self):
        received = np.arange(len(self._time), dtype=np.int64)
        yield Batch("wrench", self._time, received, np.zeros((len(self._time), 1)))


@pytest.mark.parametrize(
    ("time", "shown"),
    [
        (np.array([0.0, np.nan]), "nan"),
        (np.array([0.5, 1.5]), "0.5"),
        (np.array([np.inf]), "inf"),
        (np.array(["soon"]), "soon"),
        (np.array([None]), "None"),
        (np.zeros(0), "none, of type float64"),
    ],
)
def test_a_stamp_that_is_no_whole_number_is_named(time, shown):
    words = rf"device own sends a time-stamp in the stream 'wrench' that is not a whole number of nanoseconds: {shown}$"
    with pytest.raises(DeviceError, match=words):
        list(declared_batches("own", Link(time), STREAMS))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        ("10", "the controller's time-stamp is 10 s ahead of its arrival, beyond all before it"),
        ("nan", "the controller's time-stamp is not a number"),
    ],
)
def test_a_robot_whose_time_is_none_is_stopped_and_named(rig, seconds, words):
    error, _, _ = rig.run_into(f"stamp-leap {seconds}", lambda state: state["height"] < -0.0005)
    assert words in error
    assert rig.wait_at_rest()["height"] > rig.at_fault["height"] - 0.0012
