"""palpate at a fraction 1/PALPATE_SLOW of the speed of the wall clock, for a machine on which others work as well.

With this folder on PYTHONPATH all processes of a test use that clock, and so does the simulator; the client library
keeps step with its states. Limits and E are judged, never times.
"""

import os
import sys
from importlib.abc import MetaPathFinder
from importlib.util import find_spec

FACTOR = float(os.environ.get("PALPATE_SLOW", "1"))
EPOCH = 1_800_000_000_000_000_000  # [ns] the same for all processes


def slow_down(clocks):
    """Give the module's clock of the wall a slower time."""
    import queue
    import select
    import threading
    import time

    def longer(timeout):
        return None if timeout is None else FACTOR * timeout

    class SlowEvent(threading.Event):
        def wait(self, timeout=None):
            return super().wait(longer(timeout))

    class SlowQueue(queue.Queue):
        def get(self, block=True, timeout=None):
            return super().get(block, longer(timeout))

    clock, now_ns, sleep = clocks.WallClock, time.monotonic_ns, time.sleep
    clock.now_ns = staticmethod(lambda: int(now_ns() / FACTOR))
    clock.now = staticmethod(lambda: now_ns() / FACTOR / 1e9)
    clock.epoch_ns = staticmethod(lambda: EPOCH + int(now_ns() / FACTOR))
    clock.sleep = staticmethod(lambda duration: sleep(FACTOR * duration))
    clock.wait = lambda self, readable, timeout: select.select(readable, [], [], longer(timeout))[0]
    clock.event = lambda self: SlowEvent()
    clock.queue = lambda self, most=0: SlowQueue(most)


class Finder(MetaPathFinder):
    """Slows the clock down as soon as it is imported."""

    def find_spec(self, name, path=None, target=None):
        """That of the module, with one thing more to do."""
        if name != "palpate.clocks":
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        execute = spec.loader.exec_module
        spec.loader.exec_module = lambda module: (execute(module), slow_down(module))
        return spec


if FACTOR != 1.0:
    sys.meta_path.insert(0, Finder())
