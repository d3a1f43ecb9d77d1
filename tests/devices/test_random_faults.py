"""Five of the runs of ``benchmarks/random_faults.py``: random starts, materials, faults and instants."""

import importlib.util
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def random_faults():
    spec = importlib.util.spec_from_file_location(
        "random_faults", Path(__file__).parents[2] / "benchmarks" / "random_faults.py"
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules["random_faults"] = module  # where its dataclass looks for itself
    spec.loader.exec_module(module)
    yield module
    del sys.modules["random_faults"]


# A preload, a tool that looks elsewhere, and three faults in different materials.
@pytest.mark.parametrize("seed", [13, 16, 29, 42, 52])
def test_the_arm_keeps_its_promises(random_faults, bench, short, seed):
    scene, ended, broken = random_faults.run(bench(*short), seed)
    assert broken == [], f"{scene}: {ended}"
    if scene.preload > 1.0:
        assert "standstill_force" in ended or "touches" in ended or "force =" in ended
