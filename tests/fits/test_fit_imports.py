"""A fit of files imports no part that it does not use."""

import json

import numpy as np
import pytest

from tests import processes
from tests.curves.conftest import press

_FAMILIES = ("simulation", "ros2", "live", "desk", "devices.ur", "devices.bota", "devices.rdt")
_OF_KIT = ("acquisition", "protocols", "page", "simulated_time", "figures")
_PROGRAM = """
import json, sys
from palpate_engine.cli import call
try:
    call(["fit", "in", "--tip", "paraboloid 3 mm", "--out", "fits"])
finally:
    print(json.dumps(sorted(sys.modules)))
"""


@pytest.mark.slow
def test_a_fit_of_files_imports_no_robot_and_no_page(tmp_path):
    """A folder of two CSV files had imported every device, the live page and the simulation: 540 modules."""
    (tmp_path / "in").mkdir()
    for seed in range(2):
        table = press(seed, n=200)
        np.savetxt(tmp_path / f"in/{seed}.csv", table, delimiter=",", header="time_s,force_N,height_mm", comments="")
    done = processes.run(_PROGRAM, cwd=tmp_path)
    modules = json.loads(done.stdout.splitlines()[-1])
    assert (tmp_path / "fits" / "fits.csv").is_file(), done.stderr
    assert "palpate_fits.tracker" in modules
    unused = ("palpate_arms", *(f"palpate_{name}." for name in _FAMILIES), *(f"palpate_kit.{name}" for name in _OF_KIT))
    assert not [name for name in modules if name.startswith(unused)]
