"""What a relief makes of a track that takes the skin for flat."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate_maps.map_analysis import Path2D, find_lumps, sites_along

_spec = importlib.util.spec_from_file_location("sweeps_bench", Path(__file__).parents[2] / "benchmarks/sweeps.py")
bench = importlib.util.module_from_spec(_spec)
sys.modules["sweeps_bench"] = bench
_spec.loader.exec_module(bench)


@pytest.mark.parametrize(("speed", "sensitivity"), [(4e-3, 120.0), (2e-3, 120.0), (4e-3, 0.0)])
def test_the_scatter_is_that_of_the_speed_at_which_the_skin_rises(speed, sensitivity):
    """s = h sin(2 pi y/L): its slopes have an RMS of sqrt(2) pi h/L, of which pieces of 4 mm see sinc(4 mm/L)."""
    time = np.arange(0.0, 0.08 / speed, 0.01)
    y = speed * time
    surface = 0.2e-3 * np.sin(2 * np.pi * y / 20e-3)
    path = Path2D(
        "dr/afukf", "elasticity", time, np.column_stack([0 * y, y]), 1e5 + 0 * y, 1e3 + 0 * y, 1.0, surface, sensitivity
    )
    expected = sensitivity * speed * np.sqrt(2) * np.pi * 0.2e-3 / 20e-3
    assert sites_along(path).relief == pytest.approx(expected * np.sinc(0.2) ** 2, rel=0.1, abs=1e-12)


@pytest.mark.slow
def test_a_rough_skin_under_a_fading_filter_is_no_lump():
    """0.3 mm and 1 degree at 6 mm/s, nothing in it: two lumps of 11 % where the relief does not count."""
    settings = ["device.rig.specimen.inclusions=[]", bench.RELIEF, "device.rig.specimen.relief.seed=1007"]
    (path,) = bench.paths(bench.pipeline(1007, 6.0, *settings, 'run.tracks=["dr/afukf"]'))
    sites = sites_along(path)
    assert sites.relief > 0.01
    assert not find_lumps(sites).lumps
    assert find_lumps(replace(sites, relief=0.0)).lumps
