"""The soak of ``benchmarks/soak.py``, shortened: memory flat, nothing lost, clocks together."""

import importlib.util
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from palpate_devices.mcap_replay import McapReplay

MINUTES = 0.2
PERIOD = 1.25e6  # [ns] of the sensor


@pytest.fixture(scope="module")
def soak():
    spec = importlib.util.spec_from_file_location("soak", Path(__file__).parents[2] / "benchmarks" / "soak.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["soak"] = module  # where its dataclass looks for itself
    spec.loader.exec_module(module)
    yield module
    del sys.modules["soak"]


@pytest.fixture(scope="module")
def soaked(soak, tmp_path_factory):
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed")
    pytest.importorskip("serial", reason="pyserial is not installed")
    host = f"127.8.{os.getpid() % 250}.2"
    return soak.soak(MINUTES, 1.5, tmp_path_factory.mktemp("soak"), 0.5, host)


def recorded(soaked, device, stream):
    """Stamps [ns] and values of a stream."""
    with McapReplay(file=soaked.log, recorded=device).connect(0) as link:
        batches = [batch for batch in link.batches() if batch.stream == stream]
    return np.concatenate([b.time for b in batches]), np.concatenate([b.values for b in batches])


def test_memory_is_flat(soaked):
    assert soaked.code == 0
    times, memory = soaked.memory[:-1].T  # the last look may find half of the processes gone
    late = times > 0.6 * times[-1]
    assert late.sum() > 5
    assert memory[late].max() - memory[late].min() < 5 * 1024  # kB


def test_nothing_is_lost(soaked):
    sensor = soaked.table["run"]["live"]["devices"]["sensor"]
    assert soaked.state["frames_dropped"] == sensor["damaged"] == sensor["unusable"] == 0
    stamps, values = recorded(soaked, "sensor", "wrench")
    assert len(stamps) == sensor["readings"] == soaked.table["streams"]["sensor.wrench"]["samples"]
    assert np.isfinite(values).all()
    assert np.diff(stamps).max() < 1.9 * PERIOD  # none is missing between two
    arm = soaked.table["run"]["live"]["devices"]["arm"]
    assert len(recorded(soaked, "arm", "tip")[0]) == arm["states"]
    # What the servo loop did not do it says.
    commands, wanted = arm["commands"], 60 * MINUTES / 0.002
    assert commands["cycles"] + commands["periods_lost"] > wanted


def test_the_clocks_stay_together(soaked):
    """Both devices' clocks on the host's: each drifts from its own by no more than it says."""
    devices = soaked.table["run"]["live"]["devices"]
    stamps, _ = recorded(soaked, "sensor", "wrench")
    # The twin's sensor takes a reading every 1.25 ms of true time and stamps it with a clock that is 20 ppm fast.
    apart = (stamps - stamps[0]) - PERIOD * np.arange(len(stamps))
    second = len(stamps) // 15
    drift = np.median(apart[-second:]) - np.median(apart[second : 2 * second])
    assert abs(drift) < 0.3e6  # what the pipeline declares
    assert devices["sensor"]["clock_wander"] < 20e-6 * 60 * MINUTES + 1e-3
    stamps, values = recorded(soaked, "arm", "status")
    apart = stamps - stamps[0] - 1e9 * (values[:, 0] - values[0, 0])
    drift = np.median(apart[-1000:]) - np.median(apart[500:1500])
    assert abs(drift) < max(1e9 * devices["arm"]["clock_wander"], 0.3e6)


def test_the_bare_loop_is_measured(soak):
    found = soak.bare_loop(0.5)
    assert 0 <= found["p50"] <= found["p99"] <= found["largest"]
    assert found["rate"] <= 501
