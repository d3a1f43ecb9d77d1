"""A desk on a copy of the folder of fits of eight curves."""

import json
import re
import signal
import subprocess
from contextlib import contextmanager

import pytest
from palpate_desk.desk import Desk
from palpate_kit.page.datagrams import unpack
from websockets.sync.client import connect

from tests.curves.conftest import fits_once, folder  # noqa: F401
from tests.processes import PALPATE, start


@pytest.fixture
def desk(folder):  # noqa: F811
    """The desk of the folder, without a page."""
    return Desk(folder / "fits")


class Page:
    """A program that talks like the page."""

    def __init__(self, socket):
        self.socket = socket

    def ask(self, **message):
        self.socket.send(json.dumps(message))

    def read(self, *kinds):
        """The next message of one of some kinds."""
        while True:
            said = self.socket.recv(timeout=40)
            header, rows = unpack(said.encode() if isinstance(said, str) else said)
            if header["kind"] in kinds:
                return (header, rows) if rows is not None else header


@contextmanager
def opened(address):
    """A page of a desk."""
    with connect(
        f"{address.replace('http', 'ws')}data", origin=address[: address.index("/", 8)], max_size=None
    ) as socket:
        yield Page(socket)


@contextmanager
def served(folder, *options):  # noqa: F811
    """`palpate desk FOLDER` as a process with its address."""
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with start(PALPATE, "desk", folder, "--no-browser", *options, **pipe) as process:
        try:
            line = next(text for text in process.stdout if "http" in text)
            process.address = re.search(r"http\S+", line)[0]
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=120)
