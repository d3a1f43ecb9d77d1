"""Real-time scheduling of a live run, where it is permitted."""

import os
import threading

import pytest
from palpate.pipeline.live.scheduling import real_time_section


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="no such scheduling here")
def test_every_thread_has_it_and_gives_it_back():
    """A thread that was there before, as that of a log, too: others wait for what it holds."""
    ready, over, number = threading.Event(), threading.Event(), []

    def wait():
        number.append(threading.get_native_id())
        ready.set()
        over.wait()

    thread = threading.Thread(target=wait)
    thread.start()
    ready.wait()
    try:
        with real_time_section() as said:
            if "not permitted" in said:
                pytest.skip("real-time scheduling is not permitted here")
            assert os.sched_getscheduler(0) == os.sched_getscheduler(number[0]) == os.SCHED_FIFO
        assert os.sched_getscheduler(0) == os.sched_getscheduler(number[0]) == os.SCHED_OTHER
    finally:
        over.set()
        thread.join()
