"""The driver of docs/own-sensor.md, as a plugin file, against a gauge on a pseudo-terminal."""

import contextlib
import os
import pty
import re
import threading
from pathlib import Path

import numpy as np
import pytest
from palpate import Device, DeviceError, ReportsHealth
from palpate_engine import registry

PAGE = Path(__file__).parents[2] / "docs" / "own-sensor.md"


class SimulatedGauge:
    """Sends lines from the command to start to the command to stop, or until it is unplugged or silent."""

    def __init__(self):
        self._end, other = pty.openpty()
        self.port = os.ttyname(other)
        os.set_blocking(self._end, False)
        os.close(other)  # from now on only the driver has it open
        self.heard, self.silent, self._over = b"", threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._send)
        self._thread.start()

    def _send(self):
        count = 0
        while not self._over.wait(0.002):
            with contextlib.suppress(OSError):  # nobody has opened it, or nothing has come
                self.heard += os.read(self._end, 64)
            if b"start" in self.heard and b"stop" not in self.heard and not self.silent.is_set():
                count += 1
                line = b"12x garbled\n" if count == 20 else b"%d %.3f\n" % (2000 * count, -0.5)
                with contextlib.suppress(OSError):
                    os.write(self._end, line)

    def unplug(self):
        if not self._over.is_set():
            self._over.set()
            self._thread.join()
            os.close(self._end)


@pytest.fixture
def gauge():
    made = SimulatedGauge()
    yield made
    made.unplug()


@pytest.fixture
def plugin_file(tmp_path):
    (code,) = re.findall(r"```python\n# file: gauge.py\n(.*?)```", PAGE.read_text(), re.DOTALL)
    lines = [line for line in code.splitlines() if line.strip() and not re.match(r'(from|import|#|\s*""")', line)]
    assert len(lines) <= 40
    file = tmp_path / "gauge.py"
    # A name that no installed distribution has: of two claimants of one name neither has the short form.
    file.write_text(code.replace('"gauge"', '"gauge-of-the-page"'))
    return file


@pytest.fixture
def sensor(plugin_file, gauge):
    made = registry.load([plugin_file]).parts["device"]["gauge-of-the-page"].part(port=gauge.port, sensor_timeout="2 s")
    assert isinstance(made, Device)
    return made


def first_readings(link, count):
    found = []
    for batch in link.batches():
        found.append(batch)
        if sum(len(batch.time) for batch in found) >= count:
            return found
    return found


def test_a_sensor_of_ones_own(sensor, gauge):
    with sensor.connect(0) as link:
        assert isinstance(link, ReportsHealth)
        assert link.shared("force") is not None
        assert link.shared("wrench") is None
        found = first_readings(link, 60)
        health = link.health
    stamps = np.concatenate([batch.time for batch in found])
    np.testing.assert_allclose(np.concatenate([batch.values for batch in found]), -0.5)
    assert np.median(np.diff(stamps)) == pytest.approx(2e6, rel=0.01)  # by the gauge's clock, whenever they arrived
    assert health["damaged"] == 1
    assert health["unit"] == "N"
    assert health["readings"] >= 60
    assert b"start\n" in gauge.heard


@pytest.mark.slow
def test_a_sensor_that_is_unplugged(sensor, gauge):
    with sensor.connect(0) as link:
        first_readings(link, 5)
        gauge.unplug()
        with pytest.raises(DeviceError, match=r"gauge at .*: the sensor is disconnected"):
            list(link.batches())


@pytest.mark.slow
def test_a_sensor_that_falls_silent(sensor, gauge):
    with sensor.model_copy(update={"sensor_timeout": 0.3}).connect(0) as link:
        first_readings(link, 5)
        gauge.silent.set()
        with pytest.raises(DeviceError, match=r"the sensor is silent: no valid reading for 3\d\d ms"):
            list(link.batches())


@pytest.mark.slow
def test_a_port_that_is_not_there(sensor):
    absent = sensor.model_copy(update={"port": "/tmp/palpate-no-such-port"})
    with pytest.raises(DeviceError, match="cannot be opened: No such file"), absent.connect(0):
        pass


@pytest.mark.slow
def test_another_content_than_that_of_the_parent_is_not_executed(sensor, plugin_file):
    plugin_file.write_text(f"{plugin_file.read_text()}\nraise SystemExit\n")
    with pytest.raises(DeviceError, match=r"gauge\.py .*is not executed: its content is not what"), sensor.connect(0):
        pass


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("yield Reading((0.0, 1.0))", "its reader's `read` gives 2 values in a reading; expected 1"),
        (
            "yield Reading((self.gain,))",
            "AttributeError: 'GaugeReader' object has no attribute 'gain' (`read`, gauge.py",
        ),
    ],
)
def test_a_mistake_of_a_reader_is_named_by_method_and_place(plugin_file, gauge, code, words):
    """Not that its process has ended with exit code 1."""
    text = plugin_file.read_text()
    begin = text.index("def read(self, line)")
    begin = text.index("\n", begin) + 1
    plugin_file.write_text(f"{text[:begin]}        {code}\n{text[begin:]}")
    device = (
        registry.load([plugin_file]).parts["device"]["gauge-of-the-page"].part(port=gauge.port, sensor_timeout="2 s")
    )
    with pytest.raises(DeviceError) as caught, device.connect(0) as link:
        for _ in link.batches():
            pass
    assert words in str(caught.value)
