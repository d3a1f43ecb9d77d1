"""The process that reads a SensONE, so that no busy thread of the main job delays a reading."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import termios
from collections.abc import Sequence
from typing import Any

from palpate import DeviceError, clock

from palpate_devices.bota.commands import configure, latency_timer, powered_since, stop_stream
from palpate_devices.bota.frames import UNUSABLE, Frame, FrameDecoder, Unwrapped
from palpate_devices.bota.layout import DAMAGED, ROW, SKIPPED
from palpate_devices.process.child import Parent
from palpate_devices.process.host import host
from palpate_devices.process.ring import Ring

_REBOOT_TEXTS = (b"App Init", b"FW version")
_IDLE = 0.02  # [s]
_MOST = 4096  # bytes; a terminal hands out no more at a time, and room for more would leave holes in the heap


def main(arguments: Sequence[str]) -> None:
    """Read until the parent goes, the sensor goes, or it falls silent."""
    settings, scheduling = json.loads(arguments[2]), host().enter(40)
    with Parent(int(arguments[0])) as parent:
        _serve(parent, Ring(int(arguments[1]), ROW.size), settings, scheduling)


def _serve(parent: Parent, ring: Ring, settings: dict[str, Any], scheduling: str) -> None:
    port = None
    try:
        port = host().serial_port(settings["port"], settings["baud"])
        identity = configure(port, settings["baud"], settings, settings["boot"])
        _settle(port, settings["settle"])
        host().run_without_collection()
        facts = {"latency_timer": latency_timer(settings["port"]), "supply": settings["supply"]}
        if settings["supply"] == "usb" and (since := powered_since(settings["port"])) is not None:
            facts["powered_since"] = since
        parent.tell("ready", identity=identity, scheduling=scheduling, **facts)
        _settle(port, 0.0)  # what has waited meanwhile arrived too late for the clock
        _read(port, ring, parent, settings["silence"])
    except DeviceError as error:
        parent.tell("fault", text=str(error))
    except (OSError, termios.error) as error:  # termios.error is no OSError
        parent.tell("fault", text=f"the sensor is disconnected ({error})")
    finally:
        if port is not None:
            stop_stream(port)
            with contextlib.suppress(OSError):
                port.close()


def _settle(port: Any, duration: float) -> None:
    """Drop what the sensor sends while its filters fill."""
    deadline = clock().now() + duration
    while (rest := deadline - clock().now()) > 0 or clock().wait([port.fileno()], 0.0):
        rest = max(rest, 0.0)
        if clock().wait([port.fileno()], rest) and not os.read(port.fileno(), 65536):
            raise DeviceError("the sensor is disconnected")


def _read(port: Any, ring: Ring, parent: Parent, silence: float) -> None:
    decoder, stamps = FrameDecoder(), Unwrapped()
    heard = clock().now_ns()
    while not parent.gone:
        # Straight from the descriptor: `in_waiting` never says more than 4095, and needs a call more.
        ready = clock().wait([port.fileno(), parent], _IDLE)
        now = clock().now_ns()
        ring.beat(now)
        if port.fileno() in ready:
            data = os.read(port.fileno(), _MOST)
            if not data:
                raise DeviceError("the sensor is disconnected (its port was closed)")
            frames = decoder.feed(data)
            ring.head[DAMAGED], ring.head[SKIPPED] = decoder.damaged, decoder.skipped
            heard = now if frames else heard
            if not frames and any(text in data for text in _REBOOT_TEXTS):
                raise DeviceError("the sensor rebooted: its settings and its zero are no longer those of the start")
            for frame in frames:
                _keep(ring, stamps, frame, now)
        if (now - heard) / 1e9 > silence:
            raise DeviceError(f"the sensor is silent: no valid frame for {(now - heard) / 1e6:.0f} ms")
        for message in parent.messages():
            if message["say"] == "close":
                return


def _keep(ring: Ring, stamps: Unwrapped, frame: Frame, now: int) -> None:
    stamp = stamps.add(frame.stamp)
    if stamp is None:
        raise DeviceError("the sensor rebooted: its clock restarted, and its settings and zero were reset")
    wrench = (math.nan,) * 6 if frame.status & UNUSABLE else frame.wrench  # a reader of the ring is to see it
    ring.write((stamp, now, frame.status), [*wrench, frame.temperature])


if __name__ == "__main__":
    main(sys.argv[1:])
