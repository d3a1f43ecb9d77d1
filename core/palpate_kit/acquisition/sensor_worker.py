"""The process that reads a sensor, so that no busy thread of the main job delays a reading."""

from __future__ import annotations

import contextlib
import json
import sys
import termios
import traceback
from collections.abc import Sequence
from typing import Any

from palpate import DeviceError, UserError, clock

from palpate_kit.acquisition.child import Parent
from palpate_kit.acquisition.class_place import class_at
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.ring import WORDS, Ring
from palpate_kit.acquisition.sensor_reader import SensorReader

MODULE = "palpate_kit.acquisition.sensor_worker"
_PRIORITY = 40  # of real-time scheduling, of 99
_SECOND, _MILLISECOND = 1e9, 1e6  # [ns]
_STAMPS = 2  # columns before the values: times of arrival and of the sensor
_IDLE = 0.02  # [s] without readings, after which the process shows that it is alive


def main(arguments: Sequence[str]) -> None:
    """Read until the parent goes, the sensor goes, or it falls silent."""
    task, scheduling = json.loads(arguments[2]), host().enter(_PRIORITY)
    with Parent(int(arguments[0])) as parent:
        try:
            reader: SensorReader = class_at(task["reader"])(task["settings"])
            _serve(parent, Ring(int(arguments[1]), task["columns"]), reader, task["silence"], scheduling)
        except (DeviceError, UserError) as error:
            parent.tell("fault", text=str(error))
        except Exception as error:  # whatever a reader raises
            parent.tell("fault", text=f"its reader failed: {type(error).__name__}: {error}{_place(error)}")


def _place(error: Exception) -> str:
    """Return the method and the line in which an error was raised."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f" (`{frame.name}`, {frame.filename.rpartition('/')[2]}, line {frame.lineno})"


def _serve(parent: Parent, ring: Ring, reader: SensorReader, silence: float, scheduling: str) -> None:
    """Open the line, start the sensor and read it, and close the line however that ends; raises DeviceError.

    `reader` knows the sensor, `ring` takes its readings; `silence` [s] without a reading is a fault, `scheduling` is a
    sentence for the parent.
    """
    line, problem = None, "cannot be reached"
    try:
        line = reader.open()
        host().run_without_collection()
        parent.tell("ready", **reader.start(line), scheduling=scheduling)
        problem = "is disconnected"
        _read(line, ring, parent, reader, silence)
    except (OSError, termios.error) as error:  # termios.error is not an OSError
        raise DeviceError(f"the sensor {problem} ({getattr(error, 'strerror', None) or error})") from error
    finally:
        if line is not None:
            with contextlib.suppress(Exception):  # whatever a line that has gone raises
                reader.stop(line)
            with contextlib.suppress(OSError):
                line.close()


def _read(line: Any, ring: Ring, parent: Parent, reader: SensorReader, silence: float) -> None:
    """Write the readings of a line into the ring until the parent goes or says so.

    A row of the ring is the host time of arrival [ns], the sensor's own stamp, and the values. The ring's head has the
    counts of the reader, such as of damaged frames. `silence` is in s. Raises DeviceError where the sensor falls
    silent, or a reading has another number of values than its streams.
    """
    descriptor, last = line.fileno(), clock().now_ns()
    while not parent.gone:
        ready = clock().wait([descriptor, parent], _IDLE)
        now = clock().now_ns()
        ring.beat(now)
        if descriptor in ready:
            for values, stamp in reader.read(line):
                if len(values) != ring.columns - _STAMPS:
                    raise DeviceError(
                        f"its reader's `read` gives {len(values)} values in a reading; expected "
                        f"{ring.columns - _STAMPS}, as many as its streams have channels"
                    )
                ring.write((now, stamp), values)
                last = now
            for place, count in enumerate(reader.counts.values(), WORDS):
                ring.head[place] = count
        if (now - last) / _SECOND > silence:
            late = clock().late_computer()
            raise DeviceError(f"the sensor is silent: no valid reading for {(now - last) / _MILLISECOND:.0f} ms{late}")
        if any(message["say"] == "close" for message in parent.messages()):
            return


if __name__ == "__main__":
    main(sys.argv[1:])
