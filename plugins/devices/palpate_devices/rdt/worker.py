"""The process that reads an RDT box, so that no busy thread of the main job delays a reading."""

from __future__ import annotations

import json
import math
import socket
import sys
from collections.abc import Sequence
from typing import Any

from palpate import DeviceError, clock

from palpate_devices.process.child import Parent
from palpate_devices.process.host import host
from palpate_devices.process.ring import Ring
from palpate_devices.rdt.layout import LOST, OUT_OF_ORDER, ROW
from palpate_devices.rdt.packets import PERIOD, REPLY, STOP, STREAM, missing, request

_IDLE = 0.02  # [s]


def main(arguments: Sequence[str]) -> None:
    """Read until the parent goes or the box falls silent."""
    settings, scheduling = json.loads(arguments[2]), host().enter(40)
    with Parent(int(arguments[0])) as parent:
        ring = Ring(int(arguments[1]), ROW.size)
        try:
            with host().datagrams(settings["host"], settings["port"]) as link:
                if settings["period"] is not None:
                    link.send(request(PERIOD, round(1e3 * settings["period"])))
                link.send(request(STREAM))
                host().run_without_collection()
                _read(link, ring, parent, settings, scheduling)
                link.send(request(STOP))
        except DeviceError as error:
            parent.tell("fault", text=str(error))
        except OSError as error:  # the box has no such port, or is off the net
            parent.tell("fault", text=f"the sensor cannot be reached ({error.strerror or error})")


def _read(link: socket.socket, ring: Ring, parent: Parent, settings: dict[str, Any], scheduling: str) -> None:
    heard, ready = clock().now_ns(), False
    before: int | None = None
    scale = (*(settings["counts_per_force"],) * 3, *(settings["counts_per_torque"],) * 3)
    while not parent.gone:
        found = clock().wait([link, parent], _IDLE)
        now = clock().now_ns()
        ring.beat(now)
        if link in found and len(data := link.recv(256)) == REPLY.size:
            sequence, _, status, *counts = REPLY.unpack(data)
            lost = missing(before, sequence)
            if lost < 0:
                ring.head[OUT_OF_ORDER] += 1
                continue
            if lost > settings["most_lost"]:
                raise DeviceError(f"the sensor's numbers jump by {lost}: it was restarted, and its zero reset")
            ring.head[LOST] += lost
            before, heard = sequence, now
            sound = [n / per for n, per in zip(counts, scale, strict=True)]
            ring.write((now, sequence, status), sound if status == 0 else [math.nan] * 6)
            if not ready:
                ready = True
                parent.tell("ready", scheduling=scheduling)
        if (now - heard) / 1e9 > (settings["silence"] if ready else settings["boot"]):
            raise DeviceError(f"the sensor is silent: no reading for {(now - heard) / 1e6:.0f} ms")
        if any(message["say"] == "close" for message in parent.messages()):
            return


if __name__ == "__main__":
    main(sys.argv[1:])
