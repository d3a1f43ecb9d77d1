"""The driver of docs/devices.md for a sensor by UDP, against a box in software."""

import os
import re
import socket
import struct
import threading
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from palpate import Device, DeviceError, Watched

DOCS = Path(__file__).parents[2] / "docs" / "devices.md"
HOST = f"127.9.{os.getpid() % 250}.2"
START, STOP = bytes.fromhex("1234 0002 00000000"), bytes.fromhex("1234 0000 00000000")


@pytest.fixture
def device():
    (code,) = re.findall(r"```python\n# file: net_ft.py\n(.*?)```", DOCS.read_text(), re.DOTALL)
    module = ModuleType("net_ft")
    exec(compile(code, "net_ft.py", "exec"), module.__dict__)
    assert module.palpate_devices() == {"net-ft": module.NetFT}
    made = module.NetFT(host=HOST, counts_per_force=1e4, counts_per_torque=1e5)
    assert isinstance(made, Device)
    return made


def serve(server, readings, heard):
    """Wait for the request, send readings as (sequence, status, counts), wait for the stop."""
    request, client = server.recvfrom(64)
    for sequence, status, counts in readings:
        server.sendto(struct.pack("!3I6i", sequence, 0, status, *counts), client)
    heard += [request, server.recvfrom(64)[0]]


def test_a_sensor_of_ones_own(device):
    counts = [10_000, -20_000, 30_000, 100_000, 0, -100_000]
    readings = [(2**32 - 2, 0, counts), (2**32 - 1, 0, counts), (2, 0, counts), (3, 1, counts)]  # wraps, loses two
    heard, found = [], []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((HOST, 49152))
        server.settimeout(5)
        thread = threading.Thread(target=serve, args=(server, readings, heard))
        thread.start()
        with device.connect(0) as link:
            assert isinstance(link, Watched)
            with pytest.raises(DeviceError, match="the sensor is silent"):
                found.extend(link.batches())
            health = link.health
        thread.join()
    assert heard == [START, STOP]
    values = np.concatenate([batch.values for batch in found])
    np.testing.assert_allclose(values[:3], [[1, -2, 3, 1, 0, -1]] * 3)
    assert np.isnan(values[3]).all()
    assert health == {"lost": 2}
    assert any(not len(batch.time) for batch in found)  # a sign of life while nothing came
    assert all(batch.time.dtype == np.int64 for batch in found)


def test_a_box_that_is_not_there(device):
    with device.connect(0) as link, pytest.raises(DeviceError, match=r"refused|silent"):
        list(link.batches())
