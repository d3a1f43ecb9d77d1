"""The page over its WebSocket: what comes, what is refused, and what a kill leaves."""

import http.client
import signal
from urllib.parse import urlsplit

import numpy as np
import pytest
from palpate_kit.curves.fit_folder import FitFolder
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from tests.curves.conftest import NAMES
from tests.desk.conftest import opened, served

pytestmark = pytest.mark.slow


@pytest.mark.gate
def test_open_look_mark_refit_and_both_pages_have_it(folder):
    with (
        served(folder / "fits", "--workers", "2") as process,
        opened(process.address) as page,
        opened(process.address) as other,
    ):
        found = page.read("folder")
        assert [row["curve"] for row in found["rows"]] == sorted(NAMES)
        assert found["tip"] == "paraboloid curvature_radius 3 mm"
        other.read("folder")
        page.ask(do="curve", curve=NAMES[1], number=7)
        header, (time, columns) = page.read("curve")
        assert (header["number"], header["raw"]) == (7, False)
        assert len(time) == columns.shape[1] == 500
        _, force, height = np.loadtxt(NAMES[1], delimiter=",", skiprows=1).T
        air = force[: np.argmax(height < 0)]
        assert header["noise"] == pytest.approx(air.std(ddof=1), rel=0.1)  # a sample or two at the surface
        assert len(time) * 20 + 6000 > 8 * len(time) + columns.nbytes  # the numbers of a point are 20 bytes
        page.ask(do="mark", curve=NAMES[1], mark="bad", reason="slipped")
        assert other.read("rows")["rows"][0]["reason"] == "slipped"
        page.ask(do="tip", value="paraboloid 12 mm")
        assert {row["state"] for row in other.read("folder")["rows"]} == {"stale"}
        page.ask(do="curve", curve=NAMES[2], number=8)
        header, _ = page.read("curve")
        assert header["raw"]  # a stale row has no model beside it
        page.ask(do="refit", curve=NAMES[2])
        (row,) = other.read("rows")["rows"]
        assert (row["curve"], row["state"]) == (NAMES[2], "current")
        page.ask(do="refit-all")
        while other.read("rows", "state").get("done") != 7:
            pass
        page.ask(do="refit-all")
        assert "every curve is fitted" in page.read("error")["text"]
        page.ask(do="undo")
        assert other.read("folder")["tip"] == "paraboloid curvature_radius 3 mm"
        page.ask(do="filter", words="mark:bad")
        assert page.read("filter")["names"] == [NAMES[1]]
        for words in ("flg:x", "'"):
            page.ask(do="filter", words=words)
            assert "--where" in page.read("error")["text"]
        page.ask(do="export", what="history")
        page.read("export")
        assert (folder / "fits" / "history.sh").read_text().count("palpate fit") == 4
    rows = FitFolder(folder / "fits").rows
    assert {row.state for row in rows} == {"stale"}
    assert len((folder / "fits" / "fits.csv").read_text().splitlines()) == 9  # later rows took the place of the first


def test_places_are_filter_words_as_of_the_command_line(folder, palpate):
    palpate("fit", "fits", "--groups", "groups.csv", "--no-refit")
    words = "x>=1 x<=5mm y<0.001m"
    with served(folder / "fits", "--read-only") as process, opened(process.address) as page:
        page.read("folder")
        page.ask(do="filter", words=words)
        assert set(page.read("filter")["names"]) == set(NAMES[1:3])  # at 2 mm and 4 mm
        page.ask(do="filter", words="x<1kPa")
        assert "not a length" in page.read("error")["text"]
    done = palpate("fit", "fits", "--where", words, "--set", "estimator.fit.segment=load", "--no-refit")
    assert done.returncode == 0, done.stderr
    assert set(FitFolder(folder / "fits").own) == set(NAMES[1:3])


def test_a_second_model_is_weighed_and_drawn(folder):
    with served(folder / "fits", "--read-only") as process, opened(process.address) as page:
        page.read("folder")
        page.ask(do="curve", curve=NAMES[0], number=1)
        _, (time, first) = page.read("curve")
        page.ask(do="compare", curve=NAMES[0], model="hunt-crossley")
        header, (same_time, second) = page.read("compare")
    assert (header["curve"], header["model"], header["error"]) == (NAMES[0], "hunt-crossley", "")
    np.testing.assert_array_equal(same_time, time)
    np.testing.assert_array_equal(second[:2], first[:2])
    rms = [np.sqrt(np.nanmean((force - columns) ** 2)) for _, force, columns in (first, second)]
    behind = {one["model"]: one["behind"] for one in header["found"]["standings"]}
    assert behind["hunt-crossley"] > behind["dimensionality-reduction"]
    assert rms[1] > 1.2 * rms[0]  # it is another force, and the worse one


def test_what_is_overtaken_is_not_answered(folder):
    with served(folder / "fits") as process, opened(process.address) as page:
        page.read("folder")
        for number, name in enumerate([*NAMES, *NAMES], start=1):
            page.ask(do="curve", curve=name, number=number)
        numbers = []
        while 16 not in numbers:
            numbers.append(page.read("curve")[0]["number"])
        assert len(numbers) < 16
        assert numbers == sorted(numbers)


@pytest.mark.gate
def test_a_stranger_gets_nothing_and_read_only_writes_nothing(folder):
    with served(folder / "fits", "--read-only") as process:
        place = urlsplit(process.address)
        token = place.path.strip("/")
        for path, headers in (
            ("/", {}),
            (f"/{token}/", {"Host": "evil.example"}),
            (f"/{token}/data", {}),
            (f"/{token}/", {"Origin": "http://evil.example"}),
        ):
            link = http.client.HTTPConnection("127.0.0.1", place.port, timeout=60)
            link.request("GET", path, headers=headers)
            assert link.getresponse().status == 403
            link.close()
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{place.port}/{token}/data", origin="http://evil.example")
        before = {path.name: path.read_bytes() for path in (folder / "fits").iterdir()}
        with opened(process.address) as page:
            assert page.read("folder")["read_only"]
            for message in ({"do": "mark", "curve": NAMES[0], "mark": "good"}, {"do": "refit", "curve": NAMES[0]}):
                page.ask(**message)
                assert "--read-only" in page.read("error")["text"]
            page.socket.send('{"do": "filter", "words": "' + "x" * 70000 + '"}')
            with pytest.raises(ConnectionClosed):
                page.read("filter", "error")
    assert {path.name: path.read_bytes() for path in (folder / "fits").iterdir()} == before


@pytest.mark.parametrize("moment", [0, 3])
def test_a_kill_keeps_what_was_said(folder, moment):
    """At any moment: what the page was told is in the files, and the table has whole rows only."""
    with served(folder / "fits") as process:
        with opened(process.address) as page:
            page.read("folder")
            told = set()
            page.ask(do="tip", value="paraboloid 4 mm")
            page.read("done")
            page.ask(do="refit-all")
            for name in NAMES[: moment + 1]:
                page.ask(do="mark", curve=name, mark="bad", reason="x")
            while len(told) < moment + 1:
                told |= {row["curve"] for row in page.read("rows")["rows"] if row["mark"] == "bad"}
            process.send_signal(signal.SIGKILL)
        process.wait()
    found = FitFolder(folder / "fits")
    assert set(found.marks.rejected) >= told
    assert len(found.rows) == 8
    with served(folder / "fits") as process, opened(process.address) as page:
        rows = page.read("folder")["rows"]
        assert {row["curve"] for row in rows if row["mark"] == "bad"} == set(found.marks.rejected)


def test_a_folder_of_curves_is_begun_and_fitted(folder):
    options = ["--tip", "paraboloid 3 mm", "--out", folder / "new"]
    with served(folder / "curves", *options) as process, opened(process.address) as page:
        assert {row["state"] for row in page.read("folder")["rows"]} == {"missing"}
        page.ask(do="refit-all")
        while page.read("rows", "state").get("done") != 8:
            pass
    rows = FitFolder(folder / "new").rows
    assert [row.state for row in rows] == ["current"] * 8
    assert [row.curve for row in rows] == sorted(str(folder / name) for name in NAMES)
