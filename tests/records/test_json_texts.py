"""Numbers that JSON has as texts, as encoders write those of 64 bits."""

import numpy as np
import pytest
from palpate_records.log_tables import tables_of, texts_of
from palpate_records.mcap.mcap_file import McapFile

from tests.records.official import json_topic, log_of


def tables(path):
    return {topic: (names, block) for topic, names, block in tables_of(McapFile(path))}


def test_numbers_as_texts_are_numbers(tmp_path):
    """They were texts, and nothing could be force or position."""
    messages = [
        {
            "header": {"stamp": {"sec": "17", "nanosec": str(1000 * i)}, "frame_id": "7"},
            "force": {"z": f"{0.5 * i}"},
            "q": ["1.5", f"-{i}e-3", ".25"],
        }
        for i in range(5)
    ]
    path = log_of(tmp_path / "log.mcap", lambda writer: json_topic(writer, "/j", messages))
    names, block = tables(path)["/j"]
    assert {"force.z", "q[0]", "q[1]", "q[2]"} <= set(names)
    assert "header.frame_id" not in names
    np.testing.assert_allclose(block.values[:, names.index("force.z")], 0.5 * np.arange(5))
    np.testing.assert_allclose(block.values[:, names.index("q[1]")], -1e-3 * np.arange(5))
    np.testing.assert_array_equal(block.time, 17 * 10**9 + 1000 * np.arange(5))


@pytest.mark.parametrize("text", ["0012", "1_5", "", "-", "1.2.3", "0x10", "1" * 50, "one"])
def test_other_texts_stay_texts(tmp_path, text):
    messages = [{"x": 1.0, "serial": text}] * 3
    path = log_of(tmp_path / "log.mcap", lambda writer: json_topic(writer, "/j", messages))
    assert tables(path)["/j"][0] == ("x",)
    ((_, names, _, rows),) = texts_of(McapFile(path))
    assert (names, rows[0]) == (("serial",), (text,))
