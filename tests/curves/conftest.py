"""A folder of fits of eight curves of two samples, made once."""

import shutil

import numpy as np
import pytest

from tests.command import call

TIP = ["--tip", "paraboloid 3 mm", "--set", "alignment.force.uncertainty=1 ms"]
NAMES = [f"curves/S{1 + i % 2}_{i}.csv" for i in range(8)]


def press(seed, elasticity=1e5, n=500):
    """Time [s], force [N] and height [mm] of a press."""
    random = np.random.default_rng(seed)
    time = np.arange(n) / 500
    depth = 4e-3 * np.sin(np.pi * time / time[-1]) - 1e-3
    speed, contact = np.gradient(depth, time), np.maximum(depth, 0.0)
    force = 16 / 9 * elasticity * np.sqrt(3e-3) * contact**1.5 + 8 * 360 * np.sqrt(3e-3 * contact) * speed
    force = np.maximum(force, 0.0) + 0.02 * random.standard_normal(n)
    return np.column_stack([time, force, -1e3 * depth + 2e-4 * random.standard_normal(n)])


@pytest.fixture(scope="session")
def fits_once(tmp_path_factory):
    """Curves, and the folder `fits` of their fits."""
    folder = tmp_path_factory.mktemp("curves")
    (folder / "curves").mkdir()
    for i, name in enumerate(NAMES):
        table = press(i, 1e5 * (1 + 0.2 * (i % 2)))
        np.savetxt(folder / name, table, delimiter=",", header="time_s,force_N,height_mm", comments="", fmt="%.9g")
    done = call("fit", "curves", *TIP, "--out", "fits", "--jobs", "1", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows = [f"{name},{name[7:9]},{0.002 * (i % 4)},{0.002 * (i // 4)}" for i, name in enumerate(NAMES)]
    (folder / "groups.csv").write_text("\n".join(["curve,sample,x_m,y_m", *rows]) + "\n")
    return folder


@pytest.fixture
def folder(fits_once, tmp_path, monkeypatch):
    """A copy of it, with the table `groups.csv`, as the current folder."""
    shutil.copytree(fits_once, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
