"""The parent's end of a device process."""

import socket
from collections import deque

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


def child_of(ours, process):
    """A child by its end of the socket."""
    child = Child.__new__(Child)
    child.name, child.fault, child._hint, child._text, child._unread = "bota", None, "", b"", deque()
    child.ring, child._socket, child._process = Silent(), ours, process
    return child


def test_what_comes_with_the_message_that_was_waited_for_is_kept():
    """On a busy machine one read has both: a topic announced right after `ready` was never found."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        child = child_of(ours, Leaving(theirs))
        theirs.sendall(b'{"say": "early"}\n{"say": "ready", "rate": 5}\n{"say": "topic"}\n{"say": "flag"}\n{"say"')
        assert child.wait_for("ready", 1.0) == {"say": "ready", "rate": 5}
        theirs.sendall(b': "late"}\n')
        assert [message["say"] for message in child.messages(1.0)] == ["topic", "flag", "late"]
        assert child.messages() == []


def test_what_a_process_says_before_its_end_is_why_it_ended():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        child = child_of(ours, Leaving(theirs))
        child.check()
        with pytest.raises(DeviceError, match="bota: the port is in use"):
            child.check()


class Silent:
    """The ring of a process that has not begun."""

    def last_beat(self):
        """Never."""
        return 0
