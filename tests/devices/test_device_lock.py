"""One device, one program."""

import os
import subprocess
import sys
from contextlib import contextmanager

import pytest
from palpate import DeviceError
from palpate_kit.acquisition import device_lock
from palpate_kit.acquisition.computer import Computer
from palpate_kit.acquisition.device_lock import network_device, reserve

_HOLD = """
import sys, os
from pathlib import Path
from palpate_kit.acquisition.device_lock import reserve
reserve(sys.argv[1], os.getpid(), Path(sys.argv[2]))
print("held", flush=True)
sys.stdin.read()
"""


@contextmanager
def holder(device, folder):
    """Another process that has reserved a device."""
    words = [sys.executable, "-c", _HOLD, device, str(folder)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(autouse=True)
def _forget(monkeypatch):
    """What a test reserves, this process keeps to the end of the test."""
    held = {}
    monkeypatch.setattr(device_lock, "_held", held)
    yield
    for handle in held.values():
        os.close(handle)


def test_a_second_program_is_refused_by_the_name_of_the_first_until_that_is_dead(tmp_path):
    with holder("robot 192.0.2.7:30004", tmp_path) as first:
        with pytest.raises(
            DeviceError, match=rf"robot 192.0.2.7:30004 is in use by `.* -c .*process {first.pid}, in .*, since"
        ):
            reserve("robot 192.0.2.7:30004", os.getpid(), tmp_path)
        reserve("robot 192.0.2.8:30004", os.getpid(), tmp_path)  # another one is free
        first.kill()
        first.wait()
        reserve("robot 192.0.2.7:30004", os.getpid(), tmp_path)  # the file is still there


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"program": "x"}', b"\xff" * 40])
def test_a_damaged_lock_names_nobody_and_is_a_lock(tmp_path, content):
    (tmp_path / "palpate-port-dev-ttyUSB0.lock").write_bytes(content)
    handle = os.open(tmp_path / "palpate-port-dev-ttyUSB0.lock", os.O_RDWR)
    try:
        device_lock.fcntl.flock(handle, device_lock.fcntl.LOCK_EX)
        with pytest.raises(DeviceError, match="is in use by another program; one device serves one run"):
            reserve("port /dev/ttyUSB0", os.getpid(), tmp_path)
    finally:
        os.close(handle)
    reserve("port /dev/ttyUSB0", os.getpid(), tmp_path)


def test_a_lock_that_cannot_be_made_is_told(tmp_path):
    with pytest.raises(DeviceError, match=r"port x cannot be reserved: .*gone/palpate-port-x.lock: No such file"):
        reserve("port x", os.getpid(), tmp_path / "gone")


def test_a_link_in_place_of_a_lock_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("precious")
    (tmp_path / "palpate-port-x.lock").symlink_to(tmp_path / "victim")
    with pytest.raises(DeviceError, match="cannot be reserved"):
        reserve("port x", os.getpid(), tmp_path)
    assert (tmp_path / "victim").read_text() == "precious"


def test_an_address_by_name_is_that_by_number():
    assert network_device("localhost", 30004) == network_device("127.0.0.1", 30004)


def test_a_serial_port_is_one_by_whichever_link(tmp_path, monkeypatch):
    monkeypatch.setattr(device_lock.reserve, "__defaults__", (tmp_path,))
    ours, theirs = os.openpty()
    link = tmp_path / "by-id"
    link.symlink_to(os.ttyname(theirs))
    try:
        with (
            holder(f"port {os.ttyname(theirs)}", tmp_path) as first,
            pytest.raises(DeviceError, match=f"process {first.pid}"),
        ):
            Computer().serial_port(str(link), 9600)
    finally:
        os.close(ours)
        os.close(theirs)
