"""The page in a real Chromium: 30 curves opened, three rejected, refitted with another tip, compared, exported.

With the variable PICTURES the walk writes the pictures of the tutorial into that folder.
"""

import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from palpate_kit.curves.fit_folder import FitFolder

from tests.curves.conftest import fits_once, folder, press  # noqa: F401
from tests.desk.conftest import served
from tests.live_page.browser import CHROMIUM, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium"),
]
_PICTURES = Path(os.environ["PICTURES"]).resolve() if os.environ.get("PICTURES") else None
_PATIENCE = 120.0  # [s] on a busy machine
_TIP = ["--tip", "paraboloid 3 mm", "--set", "alignment.force.uncertainty=1 ms"]
_NAMELESS = """Array.from(document.querySelectorAll('button, input, select, [role=grid]')).filter((e) =>
  !(e.innerText?.trim() || e.getAttribute('aria-label') || e.labels?.length)).map((e) => e.id || e.outerHTML)"""


class Walk:
    """A tab in which one waits for what is shown."""

    def __init__(self, tab):
        self.tab = tab

    def key(self, name):
        text = {"text": name} if len(name) == 1 else {}
        self.tab.call("Input.dispatchKeyEvent", type="keyDown", key=name, code=name, **text)
        self.tab.call("Input.dispatchKeyEvent", type="keyUp", key=name, code=name)

    def text(self, name):
        return self.tab.ask(f"document.getElementById('{name}').innerText")

    def shows(self, name, words):
        self.tab.until(f"document.getElementById('{name}')?.innerText.includes({words!r})", _PATIENCE)

    def type(self, name, text):
        self.tab.ask(f"document.getElementById('{name}').select()")
        self.tab.click(name)
        self.tab.ask(f"document.getElementById('{name}').select()")
        self.tab.call("Input.insertText", text=text)

    def picture(self, name):
        if _PICTURES:
            time.sleep(0.5)
            self.tab.picture(_PICTURES / f"desk-{name}.png", whole=False)


@pytest.fixture
def curves(tmp_path, monkeypatch):
    """Thirty curves of two samples, three of them of another material, and where each was measured."""
    monkeypatch.chdir(tmp_path)
    Path("curves").mkdir()
    rows = ["curve,sample,x_m,y_m"]
    for i in range(30):
        name = f"curves/S{1 + i % 2}_{i:02d}.csv"
        odd = 2.5 if i in (4, 11, 20) else 1.0
        random = np.random.default_rng(1000 + i)
        table = press(i, odd * (1e5 if i % 2 else 1.3e5) * (1 + 0.03 * random.standard_normal()))
        np.savetxt(name, table, delimiter=",", header="time_s,force_N,height_mm", comments="", fmt="%.9g")
        rows.append(f"{name},S{1 + i % 2},{0.002 * (i % 6)},{0.002 * (i // 6)}")
    Path("samples.csv").write_text("\n".join(rows) + "\n")


def test_a_laboratory_walks_through(curves):
    """Over 20 s: 30 curves are fitted again and again, as a laboratory does it, and a real browser shows each step."""
    fits = Path("fits")
    with served("curves", *_TIP, "--out", fits, "--groups", "samples.csv") as process, browser(1280, 800) as chromium:
        tab = chromium.open(process.address)
        walk = Walk(tab)
        walk.shows("counts", "30 of 30 curves · 30 to fit")
        walk.key("R")
        walk.shows("counts", " 0 to fit")
        tab.until("window.palpate.drawn > 0", _PATIENCE)
        assert " mN, the standard deviation of the force before contact" in walk.text("screen-curve")
        walk.picture("curve")
        assert "± " in walk.text("curve-values")
        assert tab.ask(_NAMELESS) == []
        assert tab.ask("document.querySelectorAll('.row').length") < 200
        hosts = tab.ask("performance.getEntriesByType('resource').map((e) => new URL(e.name).host)")
        assert set(hosts) == {process.address.split("/")[2]}
        assert len(hosts) <= 13
        _compare_models(walk)
        _reject_three(walk)
        _refit_with_another_tip(walk, fits)
        _compare_groups(walk)
        _export(walk, fits)
        _undo_and_range(walk, fits)
        assert tab.ask("window.palpate.errors") == []
        tab.call("Page.reload")
        tab.until("window.palpate?.drawn > 0", _PATIENCE)
        assert "3 rejected" in walk.text("counts")


def test_a_page_whose_curves_have_gone_says_so_and_shows_their_values(folder):  # noqa: F811
    shutil.rmtree("curves")
    with served("fits") as process, browser(1280, 800) as chromium:
        tab = chromium.open(process.address)
        walk = Walk(tab)
        walk.shows("curve-note", "no such file")
        assert "kPa" in walk.text("curve-values")
        assert tab.ask("window.palpate.errors") == []
        assert tab.ask("Array.from(document.querySelectorAll('.pale')).length") == 0


def test_the_open_facts_are_a_form(folder):  # noqa: F811
    """Mistakes stand beside their fields, all at once; what is stated is fitted, and `u` takes it back."""
    rig = folder / "fits" / "rig.toml"
    rig.write_text("# the blue stand\n")
    with served("fits", "--workers", "1") as process, browser(1280, 800) as chromium:
        tab = chromium.open(process.address)
        walk = Walk(tab)
        walk.shows("counts", " 0 to fit")
        walk.key("f")
        tab.until("document.getElementById('facts').open", _PATIENCE)
        keys = tab.ask("Array.from(document.querySelectorAll('#fact-fields input')).map((e) => e.dataset.key)")
        assert keys[0] == "thickness"  # moves most of what is open
        assert "empty: not known; specimen thicker than" in walk.text("fact-thickness-effect")
        assert tab.ask(_NAMELESS) == []
        walk.type("fact-thickness", "5 kPa")
        walk.type("fact-poisson", "much")
        tab.click("facts-state")
        for key in ("thickness", "poisson"):
            tab.until(f"document.getElementById('fact-{key}-mistake').innerText.length > 0", _PATIENCE)
        walk.picture("facts")
        assert rig.read_text() == "# the blue stand\n"
        walk.type("fact-thickness", "8 mm")
        walk.type("fact-poisson", "")
        tab.ask("document.getElementById('fact-poisson').value = ''")
        tab.click("facts-state")
        tab.until("!document.getElementById('facts').open", _PATIENCE)
        walk.shows("command", "--thickness '8 mm'")
        walk.shows("counts", " 0 to fit")
        assert {row.state for row in FitFolder(folder / "fits").rows} == {"current"}
        assert rig.read_text() == '# the blue stand\nthickness = "8 mm"\n'
        tab.ask("document.activeElement.blur()")
        walk.key("u")
        walk.shows("counts", "8 to fit")
        assert rig.read_text() == "# the blue stand\n"
        assert tab.ask("window.palpate.errors") == []


def _compare_models(walk):
    """The second model is named in both legends, and goes with the curve."""
    walk.key("c")
    walk.shows("compare", "held out N")
    second = "Array.from(document.querySelectorAll('figcaption .second')).map((e) => e.innerText.trim())"
    assert walk.tab.ask(second) == ["- - - hunt-crossley"] * 2
    drawn = walk.tab.ask("window.palpate.drawn")
    walk.picture("compare")
    walk.key("ArrowDown")
    walk.tab.until(f"window.palpate.drawn > {drawn}", _PATIENCE)
    assert walk.tab.ask(second) == [""] * 2
    assert walk.text("compare") == ""


def _reject_three(walk):
    walk.type("filter", "E>200")
    walk.shows("counts", "3 of 30")
    walk.tab.ask("document.getElementById('filter').blur()")
    for number in range(3):
        walk.key("Home")
        for _ in range(number):
            walk.key("ArrowDown")
        walk.key("x")
        walk.tab.until("document.getElementById('reject').open", _PATIENCE)
        if not number:
            walk.tab.call("Input.insertText", text="a clamp was palpated")
            walk.picture("reject")
        assert walk.tab.ask("document.getElementById('reason').value") == "a clamp was palpated"
        walk.tab.click("reject-yes")
        walk.shows("counts", f"{number + 1} rejected")
    walk.type("filter", "")
    walk.tab.ask("document.getElementById('filter').dispatchEvent(new Event('input'))")
    walk.shows("counts", "30 of 30")
    walk.tab.ask("document.getElementById('filter').blur()")


def _refit_with_another_tip(walk, fits):
    before = {row.curve: row.number("elasticity") for row in FitFolder(fits).rows}
    walk.type("tip", "paraboloid 12 mm")
    walk.tab.click("apply-all")
    walk.shows("counts", "30 to fit")
    walk.shows("command", "palpate fit")
    assert "--tip 'paraboloid 12 mm'" in walk.text("command")
    walk.picture("stale")
    walk.key("r")
    walk.shows("counts", "29 to fit")
    walk.key("R")
    walk.shows("counts", " 0 to fit")
    for row in FitFolder(fits).rows:
        assert row.number("elasticity") == pytest.approx(before[row.curve] / 2, rel=2e-3)


def _compare_groups(walk):
    walk.key("2")
    walk.tab.until("document.querySelectorAll('#groups-plot circle').length === 30", _PATIENCE)
    bars = (
        "Array.from(document.querySelectorAll('#histogram rect')).map((e) => [e.dataset.kind, Number(e.dataset.count)])"
    )
    counts = walk.tab.ask(bars)
    assert [sum(n for kind, n in counts if kind == which) for which in ("used", "rejected")] == [27, 3]
    walk.tab.click("test")
    walk.shows("groups-table", "Welch's t-test")
    walk.shows("groups-table", "S2 - S1")
    assert [line.split()[:2] for line in walk.text("groups-table").splitlines()[1:3]] == [["S1", "13"], ["S2", "14"]]
    walk.picture("groups")
    walk.key("3")
    walk.tab.until("document.querySelectorAll('#sites circle').length === 30", _PATIENCE)
    walk.picture("map")
    _drag_over_sites(walk)


def _drag_over_sites(walk):
    """A rectangle around four of the thirty places is a filter, and the map shows what it leaves."""
    site = "Array.from(document.querySelectorAll('#sites circle')).find((e) => e.dataset.curve.endsWith('NAME'))"
    box = f"(({{left, top, right, bottom}}) => [left, top, right, bottom])({site}.getBoundingClientRect())"
    left, _, _, bottom = walk.tab.ask(box.replace("NAME", "S1_00.csv"))  # at 0 mm, 0 mm
    _, top, right, _ = walk.tab.ask(box.replace("NAME", "S2_07.csv"))  # at 2 mm, 2 mm
    for kind, x, y, buttons in (
        ("mousePressed", left - 2, bottom + 2, 1),
        ("mouseMoved", right - 9, top + 9, 1),
        ("mouseMoved", right + 2, top - 2, 1),
        ("mouseReleased", right + 2, top - 2, 0),
    ):
        if kind == "mouseReleased":
            walk.picture("drag")
        walk.tab.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)
    walk.shows("counts", "4 of 30")
    words = walk.tab.ask("document.getElementById('filter').value")
    assert [word[:3] for word in words.split()] == ["x>=", "x<=", "y>=", "y<="]
    walk.tab.until("document.querySelectorAll('#sites circle').length === 4", _PATIENCE)
    walk.type("filter", "")
    walk.tab.ask("document.getElementById('filter').dispatchEvent(new Event('input'))")
    walk.shows("counts", "30 of 30")
    walk.tab.ask("document.getElementById('filter').blur()")


def _export(walk, fits):
    walk.key("4")
    for what, file in (("report", "report.html"), ("groups", "groups.svg"), ("history", "history.sh")):
        walk.tab.click(f"export-{what}")
        walk.tab.until("!document.getElementById('export-note').innerText.includes('is made ...')", _PATIENCE)
        assert (fits / file).stat().st_size > 100
    walk.picture("export")
    assert "rejected: a clamp was palpated" in (fits / "report.html").read_text()
    assert (fits / "fits.csv").read_text().count("\n") >= 31


def _undo_and_range(walk, fits):
    walk.key("1")
    walk.key("End")
    walk.tab.until("window.palpate.latest?.endsWith('S2_29.csv')", _PATIENCE)
    x, y = walk.tab.place("plot-time")
    walk.tab.call("Input.dispatchMouseEvent", type="mousePressed", x=x - 60, y=y, button="left", clickCount=1)
    walk.tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 60, y=y, button="left", buttons=1)
    walk.tab.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 60, y=y, button="left", clickCount=1)
    walk.tab.until("!document.getElementById('range').hidden", _PATIENCE)
    walk.picture("range")
    walk.tab.click("range-this")
    walk.shows("counts", "1 to fit")
    assert FitFolder(fits).own
    walk.key("u")
    walk.shows("counts", " 0 to fit")
    assert not FitFolder(fits).own


def test_the_curve_under_the_cursor_of_a_map_is_drawn(tmp_path, monkeypatch):
    """A map file of a microscope: a cell for each curve, a cross for one that cannot be read."""
    pytest.importorskip("afmformats", reason="afmformats is not installed")
    from tests.indentation.map_files import jpk_file, press as microscope_press

    monkeypatch.chdir(tmp_path)
    presses = {k: microscope_press(3000.0 + 100.0 * k, k) for k in range(6)}
    jpk_file("cells.jpk-force-map", presses, (3, 2), broken=(2,))
    with (
        served("cells.jpk-force-map", "--tip", "paraboloid 5 um", "--out", "fits") as process,
        browser(1280, 800) as chromium,
    ):
        tab = chromium.open(process.address)
        walk = Walk(tab)
        walk.shows("counts", "6 of 6")
        walk.key("R")
        walk.shows("counts", " 0 to fit")
        walk.key("3")
        tab.until("document.querySelectorAll('#sites [data-curve]').length === 6", _PATIENCE)
        assert tab.ask("document.querySelectorAll('#sites text')[0].textContent") is not None
        assert "um" in tab.ask("Array.from(document.querySelectorAll('#sites text')).map((e) => e.textContent).join()")
        cell = (
            "Array.from(document.querySelectorAll('#sites [data-curve]')).find((e) => e.dataset.curve.endsWith(':4'))"
        )
        left, top, width, height = tab.ask(
            f"(({{left, top, width, height}}) => [left, top, width, height])({cell}.getBoundingClientRect())"
        )
        tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + width / 2, y=top + height / 2)
        walk.shows("peek-name", ":4: force over depth")
        tab.until("document.querySelectorAll('#peek-depth canvas').length === 1", _PATIENCE)
        walk.picture("cells")
