"""A computer whose clock is set during a run: by hand, or by a time server that was out of reach."""

import pytest
from palpate import clock
from palpate_engine import run_pipeline
from palpate_kit.simulated_time.simulated_clock import SimulatedClock

from tests.devices.simulated_bench import SHORT

FROM = 946_684_800_000_000_000 + 10**9  # [ns]; a second after simulated time begins


@pytest.mark.slow
@pytest.mark.parametrize("hours", [-1, 1])
def test_a_clock_that_is_set_changes_nothing(simulated, monkeypatch, hours):
    """Before the tip retreats: readings were compared with the clock that was set, and none came, or all did."""
    twin = simulated(*SHORT, "trajectory.press.duration=0.5 s")
    wall, looks = SimulatedClock.epoch_ns, []

    def epoch_ns(self):
        looks.append(clock().now_ns())
        return wall(self) + (hours * 3600 * 10**9 if wall(self) > FROM else 0)

    monkeypatch.setattr(SimulatedClock, "epoch_ns", epoch_ns)
    result = run_pipeline(twin.pipeline(), twin.folder / "out")
    assert looks[-1] > 10**9
    assert result.run["live"].get("stop") is None
    assert result.run["live"]["felt"]["std"] > 0
    assert all(stream["backwards"] == 0 for stream in result.streams.values())
    assert result.run["live"]["estimates"]["latency"]["max"] < 1.0
