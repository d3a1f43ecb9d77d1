"""Boxes that speak RDT by UDP, against their twin."""

import numpy as np
import pytest
from palpate import DeviceError
from palpate_devices.rdt.device import RdtSensor
from palpate_kit.protocols.rdt_packets import REPLY, STREAM, missing_readings, parse_request, request


def test_requests_and_numbers():
    assert request(STREAM).hex() == "1234000200000000"
    assert parse_request(request(STREAM, 5)) == (STREAM, 5)
    assert parse_request(b"too short") is parse_request(bytes(8)) is None
    assert REPLY.size == 36
    for before, now, lost in ((None, 7, 0), (7, 8, 0), (7, 10, 2), (2**32 - 1, 0, 0), (2**32 - 2, 1, 2), (9, 9, -1)):
        assert missing_readings(before, now) == lost
    assert missing_readings(9, 5) < 0


@pytest.mark.parametrize("box", ["ati", "onrobot"])
def test_what_the_box_feels_arrives(bench, short, box):
    twin = bench(*short, f"twin.bench.sensor={box}")
    sensor = RdtSensor.model_validate({"host": twin.host, "box": box, "rate": "500 Hz", "sensor_timeout": "2 s"})
    found, count = [], 0
    with sensor.connect(0) as link:
        assert link.shared("wrench") is not None
        for batch in link.batches():
            found += [batch] if batch.stream == "wrench" else []
            count += len(batch.time)
            if count > 300:
                break
        twin.fault("silent")
        with pytest.raises(DeviceError, match="silent"):
            list(link.batches())
        health = link.health
    values = np.concatenate([batch.values for batch in found])
    # The weight of 140 g and the offset of 0.6 N.
    assert values[:, 2].mean() == pytest.approx(0.6 - 0.14 * 9.80665, abs=0.03)
    assert values[:, 2].std() == pytest.approx(0.05, rel=0.5)
    assert health["unusable"] == 0


def test_a_box_that_is_not_there():
    with (
        pytest.raises(DeviceError, match=r"cannot be reached|silent"),
        RdtSensor(host="127.9.8.7", boot=0.5).connect(0),
    ):
        pass
