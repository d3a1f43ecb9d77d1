"""A disk that is full, a run folder that goes: what the arm does, and what is kept."""

import errno
import json
import os
import resource
import shutil
from contextlib import contextmanager

import pytest
from mcap.reader import make_reader
from palpate import OutputError, clock
from palpate_devices.log_file import LogFile
from palpate_engine.pipeline import closing_reserve as module
from palpate_kit.runs.run_folder import RunFolder

from tests.devices.simulated_bench import readings


def at_contact(rig, act):
    """Do something as soon as the tip is in the material; when and how high it was, once that has come."""
    seen = []

    def make():
        state = rig.wait(lambda state: state["height"] < -0.001)
        seen.append((clock().now(), state["height"]))
        act()

    clock().thread(make, "mishap").start()
    return seen


@contextmanager
def file_size_limits():
    """The limits of this process, as they were before."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield before
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def check_arm(rig, seen, table, within):
    """It left the material at once, and the result says why: it stops within 0.5 mm, having gone on at 15 mm/s."""
    ((time, height),) = seen
    delay = table["run"]["live"]["stop"]["monotonic"] - time
    state = rig.wait_at_rest()
    assert state["height"] > 0.002
    assert 0 < delay < within
    assert state["low"][2] > height - 0.0005 - 0.015 * delay


@pytest.mark.gate
@pytest.mark.slow
def test_a_full_disk_stops_the_arm_and_leaves_a_log_that_any_reader_opens(rig):
    """A limit on the size of files stands for the disk: writing fails in the same place."""
    out = rig.folder / "out"
    with file_size_limits() as (_, hard):

        def fill():
            size = (out / "log.mcap").stat().st_size + 30_000
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))

        seen = at_contact(rig, fill)
        with pytest.raises(OutputError, match=r"sink mcap: cannot write .*log\.mcap: File too large .*is in .*out"):
            rig.run()
    table = RunFolder(out).result
    check_arm(rig, seen, table, 0.5)
    assert "File too large" in table["run"]["live"]["stop"]["reason"]
    with (out / "log.mcap").open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) > 3000
    wrench = sum(len(batch.time) for batch in readings(out / "log.mcap", "sensor", "wrench"))
    assert 0.5 < wrench / table["run"]["live"]["devices"]["sensor"]["readings"] < 1


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("how", ["deleted", pytest.param("moved", marks=pytest.mark.slow)])
def test_a_run_folder_that_goes_ends_the_motion_at_once(rig, how):
    out, elsewhere = rig.folder / "out", rig.folder / "elsewhere"
    seen = at_contact(rig, lambda: shutil.rmtree(out) if how == "deleted" else out.rename(elsewhere))
    with pytest.raises(OutputError, match=r"out: the run folder is gone: was it moved, deleted or unmounted\?"):
        rig.run()
    table = json.loads((out / "result.json").read_text())  # there is a folder for it again
    check_arm(rig, seen, table, 0.15)
    if how == "moved":
        assert sum(len(batch.time) for batch in readings(elsewhere / "log.mcap", "sensor", "wrench")) > 1000


def test_a_disk_without_room_for_the_end_of_a_run_refuses_it(rig, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(module.os, "posix_fallocate", full)
    rig.fault("mark")
    with pytest.raises(OutputError, match=r"out: 4 MB cannot be kept back for the end of the run: No space left"):
        rig.run()
    assert not (rig.folder / "out").exists()
    assert rig.state()["fastest_tip"] < 1e-3


def test_a_reserve_gives_its_room_back(tmp_path):
    with module.closing_reserve(tmp_path, True) as room:
        assert os.fstat(room._file.fileno()).st_blocks * 512 >= 4 << 20
        assert not list(tmp_path.iterdir())  # nor does a kill leave it
        room.release()
        room.release()
    with module.closing_reserve(tmp_path / "none", False) as room:
        room.release()


def test_what_is_cut_ends_at_the_latest_mark(tmp_path):
    with (tmp_path / "log").open("xb", buffering=0) as raw:
        file = LogFile(raw.fileno())
        file.write(b"whole")
        file.flush()
        file.mark()
        file.write(b"half a")
        file.flush()
        file.write(b" chunk")
        assert file.tell() == 17
        file.cut()
        file.write(b".")
        file.flush()
    assert (tmp_path / "log").read_bytes() == b"whole."
