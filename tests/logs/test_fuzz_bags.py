"""Damaged rosbag2 databases: the numbers that were written, or one message in words."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from palpate import LogError
from palpate_logs.rosbag2_replay import Rosbag2Replay

from tests.records.bags import array_message, write_bag

SIGNALS = {"z": {"topic": "/data", "field": "data", "index": 1, "unit": "m"}}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bag")
    messages = [(i, array_message([0.0, i / 8])) for i in range(300)]
    path = write_bag(folder / "bag.db3", [("/data", "std_msgs/msg/Float64MultiArray", messages)])
    return folder / "damaged.db3", path.read_bytes()


def outcome(path, raw):
    path.write_bytes(raw)
    try:
        with Rosbag2Replay.model_validate({"file": path, "signals": SIGNALS}).connect(0) as link:
            return sum(len(batch.time) for batch in link.batches())
    except LogError as refusal:
        words = str(refusal)
    assert "damaged.db3" in words
    return None


FUZZ = settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_a_database_cut_anywhere_is_refused_or_read(bag, data):
    path, raw = bag
    found = outcome(path, raw[: data.draw(st.integers(0, len(raw) - 1))])
    assert found is None or found <= 300


@pytest.mark.slow
@FUZZ
@given(data=st.data())
def test_flipped_bits_never_crash(bag, data):
    """SQLite has no checksums: a flipped bit in a number cannot be seen, but nothing may break."""
    path, raw = bag
    damaged = bytearray(raw)
    for _ in range(data.draw(st.integers(1, 20))):
        damaged[data.draw(st.integers(0, len(raw) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    found = outcome(path, damaged)
    assert found is None or found <= 2 * 300


def test_numbers_survive_when_nothing_is_damaged(bag):
    path, raw = bag
    assert outcome(path, raw) == 300
    with Rosbag2Replay.model_validate({"file": path, "signals": SIGNALS}).connect(0) as link:
        values = np.concatenate([batch.values[:, 0] for batch in link.batches()])
    np.testing.assert_array_equal(values, np.arange(300) / 8)
