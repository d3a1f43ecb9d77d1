"""Definitions made to exhaust time or memory: each is read, or refused in words, in little of both."""

import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Messages

from tests.records.hostile_definitions import MEGABYTE, hostile

KINDS = ("ros2msg", "ros2idl", "ros1msg", "json", "protobuf")
CALLS = 2_000_000  # of Python and C functions, which take about a second of a processor
NEVER = np.zeros(1, np.int64)


def memory(key: str) -> int:
    """A line of the kernel's account of this process [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(key))


@contextmanager
def counted_calls():
    """The number of functions that were called within, in a list."""
    calls = [0]

    def count(frame, event, argument):
        calls[0] += event in ("call", "c_call")

    sys.setprofile(count)
    try:
        yield calls
    finally:
        sys.setprofile(None)


def attempts(topic, payload):
    """Each way to read a message, by name."""
    yield "fields", lambda: decoder_of(topic).fields(payload)
    message = Messages.joined([payload], NEVER, NEVER)
    yield "read", lambda: decoder_of(topic).read(message, [FieldReading("x")])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_definition_takes_a_second_or_200_megabytes(kind):
    """A second is counted in calls, not timed."""
    refused, slow, large = [], {}, {}
    for name, topic, payload in hostile(kind):
        for how, attempt in attempts(topic, payload):
            Path("/proc/self/clear_refs").write_text("5")  # the greatest size begins anew
            before = memory("VmRSS")
            with counted_calls() as calls:
                try:
                    attempt()
                except LogError as error:
                    refused.append(str(error))
            if calls[0] > CALLS:
                slow[name, how] = calls[0]
            if (grown := memory("VmHWM") - before) > 200 * MEGABYTE:
                large[name, how] = grown
    assert (slow, large) == ({}, {})
    assert len(refused) > 10
    assert max(map(len, refused)) < 1000
