"""A handful of the scenes of ``benchmarks/scenes.py``: random starts, materials, motions, faults and hold-ups."""

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


# What each scene ends by: a tool that looks elsewhere, a tip that touches the skin at the start, faults in motion.
ENDS = {
    16: "the tool is turned by 8.5 deg",
    15: "the controller has closed the link",
    29: "the tip touches something",
    53: "the tip touches something",
    49: "the force is 10.7 N",
    176: "the robot has changed to reduced mode",
    145: "repeats its reading in every digit",
    101: "the controller slows the arm to 50 %",
    102: "the arm was commanded to move",
}
QUICK = (16, 15)


@pytest.mark.parametrize(
    ("seed", "words"),
    [pytest.param(*case, marks=() if case[0] in QUICK else pytest.mark.slow) for case in ENDS.items()],
)
def test_the_arm_keeps_its_limits_and_what_is_told_is_true(scenes, tmp_path, seed, words):
    scene = scenes.drawn(seed)
    row = scenes.run(scene, tmp_path)
    assert row["problems"] == [], f"{scene}: {row}"
    assert words in row["ended"]
