"""Simulated time: who runs when, and that it is the same every time."""

import os
import queue
import threading

import pytest
from palpate.clocks import clock, host_time_ns
from palpate.twin import HoldUp
from palpate_kit.simulated_time.simulated_clock import SimulatedClock
from palpate_kit.simulated_time.simulated_turns import DeadlockError


def test_the_order_of_turns_is_that_of_the_times_waited_for():
    log = []

    def worker(name, period, count):
        def work():
            for _ in range(count):
                clock().sleep(period)
                log.append((name, round(clock().now() - begin, 6)))

        return work

    with SimulatedClock().running():
        begin = clock().now()
        threads = [clock().thread(worker(*settings), settings[0]) for settings in (("a", 0.002, 3), ("b", 0.003, 2))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert clock().now() - begin == pytest.approx(0.006)
    # At 6 ms both are due: the one that began to wait for it first runs first.
    assert log == [("a", 0.002), ("b", 0.003), ("a", 0.004), ("b", 0.006), ("a", 0.006)]


@pytest.mark.parametrize("by", [-3600.0, 3600.0])
def test_host_time_goes_on_where_the_computers_clock_is_set(by, monkeypatch):
    """Readings are stamped by it: none is older or younger than what waits for it."""
    wall = SimulatedClock.epoch_ns
    with SimulatedClock().running():
        before = host_time_ns()
        monkeypatch.setattr(SimulatedClock, "epoch_ns", lambda self: wall(self) + round(1e9 * by))
        clock().sleep(0.25)
        assert host_time_ns() - before == 250_000_000


def test_years_pass_in_no_time():
    with SimulatedClock().running():
        before = clock().epoch_ns()
        clock().sleep(3.15e7)
        assert clock().epoch_ns() - before == 31_500_000_000_000_000


def test_events_and_queues_wake_at_the_instant_of_their_cause():
    with SimulatedClock().running():
        event, items = clock().event(), clock().queue()

        def cause():
            clock().sleep(0.5)
            event.set()
            clock().sleep(0.25)
            items.put("item")

        begin = clock().now()
        clock().thread(cause, "cause").start()
        assert not event.wait(0.4)
        assert event.wait(1.0)
        assert clock().now() - begin == pytest.approx(0.5)
        with pytest.raises(queue.Empty):
            items.get(timeout=0.2)
        assert items.get(timeout=1.0) == "item"
        assert clock().now() - begin == pytest.approx(0.75)
        with pytest.raises(queue.Empty):
            items.get_nowait()


def test_files_are_waited_for():
    with SimulatedClock().running():
        reader, writer = os.pipe()

        def write():
            clock().sleep(0.1)
            os.write(writer, b"x")

        begin = clock().now()
        assert clock().wait([reader], 0.05) == []
        clock().thread(write, "writer").start()
        assert clock().wait([reader], 10.0) == [reader]
        assert clock().now() - begin == pytest.approx(0.15)
        os.close(reader)
        os.close(writer)


@pytest.mark.parametrize(
    ("hold_up", "late"),
    [
        (HoldUp("main", 0.02, first=0.0995), [0.1195]),
        (HoldUp("main", 0.005, first=0.1, every=0.1), [0.105, 0.205, 0.305]),
        (HoldUp("robot", 0.5), []),
    ],
)
def test_a_process_that_is_held_up_comes_late_and_no_other(hold_up, late):
    seen, elsewhere = [], []
    with SimulatedClock([hold_up]).running():
        begin = clock().now_ns()

        def other():
            for tick in range(1, 400):
                clock().wait_until(begin + tick * 1_000_000)
                elsewhere.append(clock().now_ns() - begin)

        clock().process_thread(other, "other", "sensor").start()
        for tick in range(1, 350):
            clock().wait_until(begin + tick * 1_000_000)
            if clock().now_ns() - begin > tick * 1_000_000:
                seen.append(round((clock().now_ns() - begin) / 1e9, 6))
    assert sorted(set(seen)) == late
    assert elsewhere == [tick * 1_000_000 for tick in range(1, len(elsewhere) + 1)]


def test_threads_that_wait_for_one_another_are_named():
    with SimulatedClock().running():
        never = clock().event()
        clock().thread(never.wait, "left").start()
        with pytest.raises(DeadlockError, match="main: left, main: main"):
            never.wait()


def test_a_process_that_is_killed_ends_where_it_waits():
    ends = []
    with SimulatedClock().running():

        def work():
            try:
                clock().sleep(1e9)
            finally:
                ends.append(clock().now())

        thread = clock().process_thread(work, "work", "robot 1")
        thread.start()
        clock().sleep(2.0)
        assert thread.is_alive()
        clock().kill("robot 1")
        thread.join(1.0)
        assert not thread.is_alive()
        assert ends == [clock().now()]


def test_the_end_of_a_simulation_ends_its_threads():
    before = threading.active_count()
    with SimulatedClock().running():
        for name in "abc":
            clock().thread(lambda: clock().sleep(1e9), name).start()
        clock().sleep(1.0)
    assert threading.active_count() == before
    assert not clock().simulated


def test_a_thread_that_is_not_part_of_it_may_set_events_and_must_not_wait():
    complaints = []
    with SimulatedClock().running():
        event = clock().event()

        def outside():
            try:
                clock().sleep(1.0)
            except RuntimeError as error:
                complaints.append(str(error))
            event.set()

        thread = threading.Thread(target=outside, name="stranger")
        thread.start()
        thread.join()
        assert event.wait(1.0)
    assert complaints == ["thread stranger waits in simulated time, and was not made by clock().thread"]


def test_time_stands_still_while_anything_is_computed():
    with SimulatedClock().running():
        before = clock().now_ns()
        sum(range(1_000_000))
        assert clock().now_ns() == before


def test_a_process_that_is_held_up_reads_what_came_meanwhile_when_it_is_free():
    reader, writer = os.pipe()
    seen = []
    with SimulatedClock([HoldUp("sensor", 0.02, first=0.1)]).running():
        begin = clock().now_ns()

        def read():
            clock().wait([reader], None)
            seen.append(round((clock().now_ns() - begin) / 1e9, 6))

        clock().process_thread(read, "read", "sensor").start()
        clock().sleep(0.105)
        os.write(writer, b"x")
        clock().sleep(0.1)
    os.close(reader)
    os.close(writer)
    assert seen == [0.12]
