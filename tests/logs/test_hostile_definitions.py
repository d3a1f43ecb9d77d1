"""Definitions made to exhaust time or memory: each is read, or refused in words, in little of both."""

import time
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.decoders import decoder_of
from palpate_kit.logs.readings import FieldReading
from palpate_kit.logs.topics import Messages

from tests.logs.hostile_definitions import MEGABYTE, hostile

KINDS = ("ros2msg", "ros2idl", "ros1msg", "json", "protobuf")
SECOND = 5.0  # of a processor: what takes one second on this machine's like, on a slow one
NEVER = np.zeros(1, np.int64)


def memory(key: str) -> int:
    """A line of the kernel's account of this process [bytes]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(key))


def attempts(topic, payload):
    """Each way to read a message, by name."""
    yield "fields", lambda: decoder_of(topic).fields(payload)
    message = Messages.joined([payload], NEVER, NEVER)
    yield "read", lambda: decoder_of(topic).read(message, [FieldReading("x")])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_definition_takes_a_second_or_200_megabytes(kind):
    refused, slow, large = [], {}, {}
    for name, topic, payload in hostile(kind):
        for how, attempt in attempts(topic, payload):
            Path("/proc/self/clear_refs").write_text("5")  # the greatest size begins anew
            before, began = memory("VmRSS"), time.process_time()
            try:
                attempt()
            except LogError as error:
                refused.append(str(error))
            if (took := time.process_time() - began) > SECOND:
                slow[name, how] = took
            if (grown := memory("VmHWM") - before) > 200 * MEGABYTE:
                large[name, how] = grown
    assert (slow, large) == ({}, {})
    assert len(refused) > 10
    assert max(map(len, refused)) < 1000
