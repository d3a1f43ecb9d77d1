"""Runs for the page: made of few numbers, or of the rig that lives in the tests of the core."""

import queue
import threading
import time

import numpy as np
import pytest
from palpate import Estimates, Parameter, Run, Samples
from palpate_kit.page.datagrams import unpack
from palpate_live import sink, watch_command
from palpate_live.server_process import PageServer
from websockets.sync.client import connect

from tests.engine.conftest import live_pipeline, run_live, stage  # noqa: F401

PARAMETERS = (Parameter("elasticity", "E", "Pa", "stiffness"), Parameter("viscosity", "eta", "Pa*s", "damping"))
TRACKS = {"dr/a": PARAMETERS, "dr/b": PARAMETERS[:1]}


@pytest.fixture
def a_run(tmp_path):
    """A run of two tracks, with whatever else is given."""
    return lambda **more: Run(tmp_path, {}, TRACKS, {}, {}, "a run", **more)


@pytest.fixture
def samples():
    """Samples (n) at 500 Hz from a number on; the force counts them."""

    def made(first, count):
        steps = np.arange(first, first + count)
        time_, zeros, yes = steps / 500.0, np.zeros(count), np.ones(count, bool)
        stamp = np.rint(time_ * 1e9).astype(np.int64)
        return Samples(stamp, time_, np.full(count, 0.002), steps.astype(float), zeros - 1e-3, zeros, yes, yes)

    return made


@pytest.fixture
def estimates():
    """Estimates for samples: every value is the time, every std a thousandth."""

    def made(samples, parameters, status=0):
        n = len(samples)
        values = np.tile(samples.time[:, None], (1, parameters))
        plain = (np.zeros(n), np.full(n, 1e-4), samples.force + 0.5, np.ones(n))
        return Estimates(samples.time, values, values * 0 + 1e-3, *plain, np.full(n, status, np.uint32))

    return made


@pytest.fixture
def child():
    """A page that is served, and what was asked to stop."""
    asked = []
    made = PageServer(0, asked.append)
    made.asked = asked
    yield made
    made.close()


@pytest.fixture
def addresses(monkeypatch):
    """Where pages are, as they are said."""
    said = queue.Queue()
    for module in (sink, watch_command):
        monkeypatch.setattr(module, "say", lambda text: said.put(text.removeprefix("live page: ")))
    return said


def opened(address):
    """The page's WebSocket as a browser opens it."""
    where = address.removeprefix("http://")
    origin = f"http://{where.split('/')[0]}"
    return connect(f"ws://{where}data", origin=origin, compression=None, max_size=None)


def meanwhile(work):
    """Do something beside a run; a function that waits for it and gives what came out."""
    found = queue.Queue()

    def do():
        try:
            found.put((work(), None))
        except BaseException as error:  # it is raised where somebody hears it
            found.put((None, error))

    threading.Thread(target=do, daemon=True).start()

    def wait():
        answer, error = found.get(timeout=60)
        if error is not None:
            raise error
        return answer

    return wait


def read_any(page):
    """The next message."""
    said = page.recv(timeout=60)
    return unpack(said.encode() if isinstance(said, str) else said)


def read(socket, kind, patience=20.0):
    """The next message of a kind from a WebSocket."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        said = socket.recv(timeout=patience)
        header, rows = unpack(said.encode() if isinstance(said, str) else said)
        if header["kind"] == kind:
            return header, rows
    raise AssertionError(f"no {kind} came")


def records(messages):
    """Headers and rows of messages."""
    return [unpack(message) for message in messages]
