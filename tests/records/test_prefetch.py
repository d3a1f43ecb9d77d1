"""Reading ahead: the same items in the same order, made and closed by one thread."""

import threading
import time

import pytest
from palpate import LogError
from palpate_records.prefetch import ahead


def counted(count, made, raised=None):
    """Numbers, noting each as it is made and the thread that makes it; `made` ends with the thread that closes."""
    try:
        for number in range(count):
            made.append(number)
            yield number
        if raised is not None:
            raise raised
    finally:
        made.append(threading.current_thread())


@pytest.mark.parametrize("most", [1, 3])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_items_come_as_they_were_made(count, most):
    made = []
    assert list(ahead(counted(count, made), most)) == list(range(count))
    assert made[:-1] == list(range(count))
    assert made[-1] is not threading.current_thread()


def test_what_is_raised_comes_after_the_items_before_it():
    error, found = LogError("the log is damaged"), []
    with pytest.raises(LogError) as caught:
        found.extend(ahead(counted(3, [], error), 4))
    assert found == [0, 1, 2]
    assert caught.value is error


@pytest.mark.parametrize("most", [1, 4])
def test_it_is_never_further_ahead_than_asked(most):
    made = []
    numbers = ahead(counted(20, made), most)
    for taken in range(5):
        assert next(numbers) == taken
        deadline = time.monotonic() + 5.0
        while len(made) < taken + most and time.monotonic() < deadline:
            time.sleep(1e-3)
        assert taken + most <= len(made) <= taken + 1 + most
    numbers.close()


def test_whoever_stops_early_leaves_nothing_open():
    made, before = [], threading.active_count()
    numbers = ahead(counted(20, made), 2)
    next(numbers)
    numbers.close()
    assert isinstance(made[-1], threading.Thread)
    assert not made[-1].is_alive()
    assert len(made) < 20
    assert threading.active_count() == before
