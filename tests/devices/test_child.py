"""The parent's end of a device process."""

import socket

import pytest
from palpate import DeviceError
from palpate_kit.acquisition.child import Child


class Leaving:
    """A process that was alive at the first look, and says why it ends before the second."""

    def __init__(self, end):
        self._end, self._looks = end, 0

    def poll(self):
        """Its exit code."""
        self._looks += 1
        if self._looks == 2:
            self._end.sendall(b'{"say": "fault", "text": "the port is in use"}\n')
        return None if self._looks == 1 else 0


def test_what_a_process_says_before_its_end_is_why_it_ended():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        child = Child.__new__(Child)
        child.name, child.fault, child._hint, child._text = "bota", None, "", b""
        child.ring, child._socket, child._process = Silent(), ours, Leaving(theirs)
        child.check()
        with pytest.raises(DeviceError, match="bota: the port is in use"):
            child.check()


class Silent:
    """The ring of a process that has not begun."""

    def last_beat(self):
        """Never."""
        return 0
