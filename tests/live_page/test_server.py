"""The page's process: who gets in, what browsers get, and that it never holds up the run."""

import asyncio
import http.client
import os
import signal
import socket
import time
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from palpate import OutputError
from palpate_kit.page.gate import GuardedConnection, refusal
from palpate_live.live_feed import PageFeed
from palpate_live.server_process import PageServer
from websockets.asyncio.client import connect as connect_async
from websockets.asyncio.server import serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.http11 import Request
from websockets.sync.client import connect

from tests.live_page.conftest import read

TOKEN = "secret"


def request(path, *headers):
    return Request(path, Headers(list(headers)))


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:9000", "localhost", "127.0.0.1"])
def test_this_machine_by_any_port_gets_in(host):
    """As through `ssh -L 9000:127.0.0.1:8000`."""
    assert refusal(request(f"/{TOKEN}/", ("Host", host)), TOKEN) is None
    assert refusal(request(f"/{TOKEN}/data", ("Host", host), ("Origin", f"http://{host}")), TOKEN) is None


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", [("Host", "127.0.0.1")]),
        ("/wrong/", [("Host", "127.0.0.1")]),
        (f"/{TOKEN}x/", [("Host", "127.0.0.1")]),
        ("/?token=secret", [("Host", "127.0.0.1")]),
        ("/\udcffsecret/", [("Host", "127.0.0.1")]),
        (f"/{TOKEN}/", []),
        (f"/{TOKEN}/", [("Host", "127.0.0.1.evil.example")]),
        (f"/{TOKEN}/", [("Host", "127.0.0.1.evil.example:80")]),
        (f"/{TOKEN}/", [("Host", "evil.example")]),
        (f"/{TOKEN}/", [("Host", "localhost:80@evil.example")]),
        (f"/{TOKEN}/", [("Host", "127.0.0.1"), ("Host", "evil.example")]),
        (f"/{TOKEN}/", [("Host", "127.0.0.1"), ("Origin", "http://evil.example")]),
        (f"/{TOKEN}/data", [("Host", "127.0.0.1:8000")]),
        (f"/{TOKEN}/data", [("Host", "127.0.0.1:8000"), ("Origin", "null")]),
        (f"/{TOKEN}/data", [("Host", "127.0.0.1:8000"), ("Origin", "http://127.0.0.1:8001")]),
        (f"/{TOKEN}/data", [("Host", "127.0.0.1:8000"), ("Origin", "https://127.0.0.1:8000")]),
        ("/wrong/data", [("Host", "127.0.0.1:8000"), ("Origin", "http://127.0.0.1:8000")]),
    ],
)
def test_nobody_else_does(path, headers):
    assert refusal(request(path, *headers), TOKEN) is not None


def fetched(child, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", child.port, timeout=20)
    connection.request("GET", path, headers=headers)
    found = connection.getresponse()
    return found.status, dict(found.getheaders()), found.read()


@contextmanager
def page(child, **more):
    """The page's WebSocket as a browser opens it."""
    address = f"ws://127.0.0.1:{child.port}/{child.token}/data"
    options = {"origin": f"http://127.0.0.1:{child.port}", "compression": None, "max_size": None, **more}
    with connect(address, **options) as found:
        yield found


def test_the_server_refuses_and_serves(child):
    for path, headers in [("/", {}), (f"/{child.token}/", {"Host": "127.0.0.1.evil.example"})]:
        assert fetched(child, path, **headers)[0] == 403
    status, headers, body = fetched(child, f"/{child.token}/")
    assert (status, headers["X-Frame-Options"], headers["Referrer-Policy"]) == (200, "DENY", "no-referrer")
    assert "default-src 'none'; script-src 'self'" in headers["Content-Security-Policy"]
    assert f"ws://127.0.0.1:{child.port}" in headers["Content-Security-Policy"]
    assert b"no emergency stop" in body
    assert b"http" not in body.replace(b"http-equiv", b"")  # nothing comes from elsewhere
    names = {word.split(b'"')[0].decode() for key in (b'src="', b'href="') for word in body.split(key)[1:]}
    for name in names | {"charts.js", "map.js", "numbers.js", "panels.js", "record.js"}:
        assert fetched(child, f"/{child.token}/{name}")[0] == 200, name
    for name in ("../server.py", "..%2fserver.py", "nothing.js"):
        assert fetched(child, f"/{child.token}/{name}")[0] == 404
    for origin in ("http://evil.example", None):
        with pytest.raises(InvalidStatus) as refused, page(child, origin=origin):
            pass
        assert refused.value.response.status_code == 403
    with pytest.raises(InvalidStatus), page(child, additional_headers={"Host": "127.0.0.1.evil.example"}):
        pass


@pytest.mark.slow
def test_it_listens_on_this_machine_only(child):
    with socket.socket() as other, pytest.raises(OSError, match="refused"):
        other.connect(("127.0.0.2", child.port))


@pytest.mark.slow
@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"], ids=["nothing", "half a request"])
def test_connections_without_a_token_keep_nobody_away(child, said):
    """Of 300 that say nothing the oldest are gone when the next one comes; who has the token stays."""
    address = ("127.0.0.1", child.port)
    with connect(f"ws://127.0.0.1:{child.port}/{child.token}/data", origin=f"http://127.0.0.1:{child.port}") as browser:
        silent = [socket.create_connection(address) for _ in range(300)]
        for one in silent:
            one.sendall(said)
        client = http.client.HTTPConnection(*address, timeout=20)
        client.request("GET", f"/{child.token}/")
        assert client.getresponse().status == 200
        client.close()
        for one in silent[:200]:
            one.settimeout(1.0)
            with suppress(ConnectionResetError):
                assert one.recv(1) == b""
        browser.send("stop")
        with suppress(TimeoutError):
            browser.recv(timeout=0.1)
    for one in silent:
        one.close()
    deadline = time.monotonic() + 20.0
    while not child.asked and time.monotonic() < deadline:
        time.sleep(0.01)
    assert child.asked == ["on the live page"]


@pytest.mark.parametrize(("strangers", "left"), [(40, 40), (63, 63), (64, 63), (100, 63)])
def test_so_many_connections_without_a_token_are_kept(strangers, left):
    """Besides the latest, which has it."""

    async def closed():
        guarded = {"create_connection": GuardedConnection, "open_timeout": None}
        async with serve(lambda page: page.wait_closed(), "127.0.0.1", 0, **guarded) as server:
            port = server.sockets[0].getsockname()[1]
            silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(strangers)]
            async with connect_async(f"ws://127.0.0.1:{port}"):  # all are accepted
                gone = [reader.at_eof() or reader.exception() is not None for reader, _ in silent]
            for _, writer in silent:
                writer.transport.abort()
        return gone

    assert asyncio.run(closed()) == [True] * (strangers - left) + [False] * left


def test_a_port_that_is_taken_is_one_clear_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OutputError, match=rf"port {taken.getsockname()[1]} .* in use; port = 0 takes a free one"):
            PageServer(taken.getsockname()[1], None)


def test_two_browsers_early_and_late_see_the_same(child, a_run, samples):
    feed = PageFeed(a_run(duration=9.0), child.send, {})
    feed.samples(samples(0, 500))
    feed.flush()
    with page(child) as first:
        assert read(first, "run")[0]["duration"] == 9.0
        before = read(first, "rows")[1]
        feed.samples(samples(500, 500))
        feed.flush()
        after = read(first, "rows")[1]
        with page(child) as second:
            read(second, "run")
            whole = read(second, "rows")[1]
            assert np.array_equal(np.concatenate([before[0], after[0]]), whole[0])
            assert np.array_equal(np.concatenate([before[1], after[1]], axis=1), whole[1], equal_nan=True)
        with page(child) as again:  # a reload
            assert len(read(again, "rows")[1][0]) == len(whole[0])


def test_stop_is_the_only_word(child):
    with page(child) as one, page(child) as other:
        other.send("format the disk")
        with pytest.raises(ConnectionClosed):
            other.recv(timeout=20)
        assert not child.asked
        one.send("stop")
        deadline = time.monotonic() + 20
        while not child.asked and time.monotonic() < deadline:
            time.sleep(0.005)
    assert child.asked == ["on the live page"]


def test_browsers_hear_of_the_end(child, a_run):
    PageFeed(a_run(), child.send, {})
    with page(child) as one:
        read(one, "run")
        assert child.close() is None
        assert read(one, "over")
        with pytest.raises(ConnectionClosed):
            one.recv(timeout=20)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGSTOP, signal.SIGKILL])
def test_a_page_that_stands_still_or_dies_holds_nobody_up(child, a_run, samples, estimates, how):
    """A stopped process takes what fits into the socket; then messages are dropped, whole, and counted."""
    feed = PageFeed(a_run(), child.send, {})
    os.kill(child.pid, how)
    longest = 0.0
    for k in range(2000):
        block = samples(500 * k, 500)
        began = time.thread_time()
        feed.samples(block)
        feed.estimates("dr/a", estimates(block, 2))
        feed.flush()
        longest = max(longest, time.thread_time() - began)
    assert child.dropped > 100
    assert longest < 1.0
    began = time.monotonic()
    told = child.close()
    assert time.monotonic() - began < 20
    assert ("ended from outside" if how == signal.SIGKILL else "too slow") in told


@pytest.mark.slow
def test_messages_that_got_through_are_whole(child, a_run, samples):
    feed = PageFeed(a_run(), child.send, {})
    os.kill(child.pid, signal.SIGSTOP)
    for k in range(1500):
        feed.samples(samples(500 * k, 500))
        feed.flush()
    assert child.dropped
    os.kill(child.pid, signal.SIGCONT)
    with page(child) as one:
        read(one, "run")
        _, (time_, columns) = read(one, "rows")
        assert np.allclose(columns[0], 500 * time_)
        assert len(time_) % 100 == 0  # each message had a second


def drain(socket):
    for _ in range(10**6):
        socket.recv(timeout=20)


@pytest.mark.slow
def test_a_slow_browser_is_let_go(a_run, samples):
    """It may come again and gets the history; nobody remembers what it did not take."""
    child = PageServer(0, None, patient=True)
    feed = PageFeed(a_run(), child.send, {})
    with page(child, max_queue=1) as slow:
        read(slow, "run")
        for k in range(400):  # 25 MB, more than the server keeps for one browser
            feed.samples(samples(10_000 * k, 10_000))
            feed.flush()
        with pytest.raises(ConnectionClosed):
            drain(slow)
    with page(child) as again:
        assert read(again, "run")
    assert child.close() is None
