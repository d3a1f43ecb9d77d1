"""Some of the scenes of ``benchmarks/scenes.py``: random starts, materials, motions, faults and hold-ups."""

import importlib.util
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def scenes():
    spec = importlib.util.spec_from_file_location("scenes", Path(__file__).parents[2] / "benchmarks" / "scenes.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["scenes"] = module  # where its dataclass looks for itself
    spec.loader.exec_module(module)
    yield module
    del sys.modules["scenes"]


# What each scene ends by: motions that come to their end, tools that look elsewhere, tips that touch the skin at the
# start, hold-ups, faults in motion and second ones while the arm leaves.
ENDS = {
    0: "the tool is turned by 5.2 deg",
    23: "the robot's program was stopped",
    54: "the controller has closed the link. PRESS THE EMERGENCY STOP: no states show",
    2: "readings of sensor.wrench.z come late",
    3: "the main job gave no sign of life",
    4: "the arm was to leave, and that has failed",
    5: "done",
    7: "the sensor is disconnected",
    9: "done",
    12: "the controller has closed the link. PRESS THE EMERGENCY STOP: no states show",
    16: "the stiffest material gives",
    17: "protective stop",
    18: "the controller is silent",
    20: "in free air",
    21: "at the end of its envelope",
    25: "the robot's program was stopped",
    29: "the tip touches something",
    31: "done",
    32: "over range or invalid",
    42: "the controller's states come late",
    # Rigs that lie or do not obey: the first 10 N are not felt, frames are apart, a cable pulls, a driver is slow, a
    # person sits up.
    100021: "at the end of its envelope",
    100020: "when it was commanded to stay where it is",
    100023: "before a contact was felt",
    100024: "its driver is too slow",
    100034: "the skin comes towards the tip",
}
QUICK = (0, 23)


@pytest.mark.parametrize(
    ("seed", "words"),
    [pytest.param(*case, marks=() if case[0] in QUICK else pytest.mark.slow) for case in ENDS.items()],
)
def test_the_arm_keeps_its_limits_and_what_is_told_is_true(scenes, tmp_path, seed, words):
    """Some 3 CPU s each: what no test of one fault shows is how faults, hold-ups and motions meet."""
    scene = scenes.drawn(seed)
    row = scenes.run(scene, tmp_path)
    assert row["problems"] == [], f"{scene}: {row}"
    assert words in row["ended"]
