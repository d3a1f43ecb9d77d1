"""What the page is told: every row once and in order, whatever blocks the samples come in; nothing grows."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as some
from palpate import Flag, FlagMeaning, GuardState, Status
from palpate_kit.page.datagrams import LARGEST, pack, pack_rows, pieces, unpack
from palpate_live.history import ROWS, History
from palpate_live.live_feed import PageFeed

from tests.live_page.conftest import records

FOUND = {"value": 2.0, "std": 3.0, "settling": 0.0, "systematic": 4.0, "combined": 5.0, "unit": "Pa"}


def rows_of(messages, kind="rows"):
    found = [rows for header, rows in records(messages) if header["kind"] == kind]
    return np.concatenate([time for time, _ in found]), np.concatenate([columns for _, columns in found], axis=1)


@pytest.mark.parametrize("rows", [0, 1, 7])
@pytest.mark.parametrize("text", ["", "ä", "twelve chars"])
def test_a_message_comes_back_as_it_was(rows, text):
    time, columns = np.linspace(0, 1, rows), np.arange(3 * rows, dtype=np.float32).reshape(3, rows)
    header, (back, table) = unpack(pack_rows({"kind": "rows", "text": text}, time, columns))
    assert header == {"kind": "rows", "text": text, "rows": rows}
    assert np.array_equal(back, time)
    assert rows == 0 or np.array_equal(table, columns)
    assert unpack(pack({"kind": text})) == ({"kind": text}, None)


@settings(max_examples=20)
@given(some.integers(1, 5000), some.integers(1, 900))
def test_pieces_are_whole_and_fit_into_a_datagram(rows, columns):
    cut = list(pieces(rows, columns))
    assert [i for piece in cut for i in range(piece.start, piece.stop)] == list(range(rows))
    assert all((piece.stop - piece.start) * (8 + 4 * columns) < LARGEST for piece in cut)


@settings(deadline=None, max_examples=20)
@given(some.lists(some.integers(1, 400), min_size=1, max_size=12))
def test_rows_do_not_depend_on_the_blocks(lengths):
    run, samples, estimates = _parts()

    def told(blocks):
        sent, at = [], 0
        feed = PageFeed(run, sent.append, {})
        for length in blocks:
            block = samples(at, length)
            feed.samples(block)
            feed.estimates("dr/a", estimates(block, 2))
            feed.estimates("dr/b", estimates(block, 1))
            at += length
        feed.flush()
        return rows_of(sent)

    (time, columns), (whole, together) = told(lengths), told([sum(lengths)])
    assert np.array_equal(time, whole)
    assert np.array_equal(columns, together, equal_nan=True)
    assert np.all(np.diff(np.floor(time * 100 + 1e-9)) >= 1)  # one in each hundredth of a second


def _parts():
    from pathlib import Path

    from palpate import Run

    from tests.live_page import conftest as parts

    run = Run(Path("x"), {}, parts.TRACKS, {}, {}, "a run")
    return run, parts.samples.__wrapped__(), parts.estimates.__wrapped__()


def test_columns_are_where_the_page_is_told(a_run, samples, estimates):
    sent = []
    feed = PageFeed(a_run(), sent.append, {})
    block = samples(0, 500)
    feed.samples(block)
    feed.estimates("dr/a", estimates(block, 2))
    feed.estimates("dr/b", estimates(block, 1, int(Status.IDLE)))
    feed.flush()
    run, time, columns = unpack(sent[0])[0], *rows_of(sent)
    a, b = run["tracks"]
    assert run["columns"] == len(columns)
    assert a["parameters"][0] == {"name": "elasticity", "unit": "kPa", "factor": 1e-3}
    assert np.allclose(columns[0], time * 500)  # force
    assert np.allclose(columns[a["begin"]], time)
    assert np.allclose(columns[a["begin"] + 2 * 2 + 1], time * 500 + 0.5)  # the model's force
    assert np.isnan(columns[b["begin"] :]).all()  # a track that is idle says nothing


def test_the_band_is_the_combined_uncertainty_once_it_is_known(a_run, samples, estimates):
    sent = []
    feed = PageFeed(a_run(), sent.append, {})

    def step(at):
        block = samples(at, 100)
        feed.samples(block)
        feed.estimates("dr/b", estimates(block, 1))

    step(0)
    feed.health({"time": 0.2, "tracks": {"dr/b": {"parameters": {"elasticity": FOUND}}}})
    step(100)
    feed.health({"tracks": {"dr/b": {"parameters": {"elasticity": {**FOUND, "combined": None}}}}})
    step(200)
    feed.flush()
    time, columns = rows_of(sent)
    u = columns[unpack(sent[0])[0]["tracks"][1]["begin"] + 1]
    assert np.allclose(u[time < 0.2], 1e-3)
    assert np.allclose(u[(time >= 0.2) & (time < 0.4)], np.hypot(4.0, 1e-3))
    assert np.isnan(u[time >= 0.4]).all()  # nobody can tell it


def test_what_is_told_stands_in_the_order_of_the_record(a_run, samples):
    sent = []
    feed = PageFeed(a_run(), sent.append, {"odd": FlagMeaning("doubtful", "It is odd.", "Mend it.")})
    for k in range(5):
        feed.samples(samples(100 * k, 100))
        feed.flags("dr/a", (Flag("odd", f"for the {k}th time", "doubtful"),))
    feed.guard(GuardState("tripped", "too hot", 3.0))
    now = 0.0
    for header, rows in records(sent):
        now = rows[0][-1] if rows else now
        if header["kind"] == "flags":
            assert 0 <= header["t"] - now < 0.01
            assert header["flags"][0]["remedy"] == "Mend it."
    assert records(sent)[-1][0]["reason"] == "too hot"


def test_without_estimates_rows_are_sent_too(a_run, samples, estimates, monkeypatch):
    """The estimates of a live run are given up where they cannot keep up; the force goes on."""
    monkeypatch.setattr("palpate_live.live_feed._ROWS_INTERVAL", 0.0)
    sent = []
    feed = PageFeed(a_run(), sent.append, {})
    feed.samples(block := samples(0, 50))
    feed.estimates("dr/a", estimates(block, 2))
    for k in range(1, 20):
        feed.samples(samples(50 * k, 50))
    assert len(rows_of(sent)[0]) >= 85


@pytest.mark.parametrize("blocks", [30, 1])
def test_an_offline_estimator_speaks_for_rows_that_are_there(a_run, samples, estimates, blocks):
    """Also where the whole record is one block, whose rows are sent already."""
    history = History()
    feed = PageFeed(a_run(), history.add, {})
    for k in range(blocks):
        feed.samples(samples(3000 // blocks * k, 3000 // blocks))
    feed.health({})
    whole = samples(0, 3000)
    feed.estimates("dr/b", estimates(whole, 1))
    table = {"parameters": {"elasticity": FOUND}, "flags": [], "verdict": "good"}
    feed.result({"run": {}, "tracks": {"dr/b": table}, "truth": {}})
    time, columns = history.rows
    begin = history.run["tracks"][1]["begin"]
    assert np.allclose(columns[begin], time)
    assert np.allclose(columns[begin + 1], np.hypot(4.0, 1e-3))
    assert np.isnan(columns[5:begin]).all()


@pytest.mark.parametrize("minutes", [1, 60])
def test_a_run_without_end_stays_at_the_same_memory(minutes):
    history, count = History(), 100 * 60 * minutes
    history.add(pack({"kind": "run", "columns": 3, "recorded": False, "tracks": []}))
    for begin in range(0, count, 1000):
        time = (begin + np.arange(1000)) / 100.0
        history.add(pack_rows({"kind": "rows"}, time, np.tile(time.astype(np.float32), (3, 1))))
        history.add(pack({"kind": "flags", "track": None, "flags": [], "t": begin}))
        history.add(pack({"kind": "health", "t": begin}))
    time, columns = history.rows
    assert len(time) == min(count, len(time)) <= ROWS
    assert time[0] == 0.0
    assert time[-1] == (count - 1) / 100.0
    assert np.all(np.diff(time) > 0)
    assert np.allclose(columns[2], time, rtol=1e-6)
    assert np.allclose(np.diff(time[-3000:]), 0.01)  # the latest half minute is whole
    assert len(list(history.messages())) < 2100


def test_a_late_browser_gets_rows_messages_and_the_latest_health(a_run, samples):
    history = History()
    feed = PageFeed(a_run(), history.add, {})
    for k in range(10):
        feed.samples(samples(100 * k, 100))
        feed.health({"behind": float(k)})
    told = records(history.messages())
    assert [header["kind"] for header, _ in told] == ["run", "rows", "health"]
    assert told[2][0]["behind"] == 9.0
    assert len(told[1][1][0]) == 200
