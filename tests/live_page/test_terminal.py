"""The terminal while a run goes on."""

import io
import re
import threading
import time

import pytest
from palpate import Flag, GuardState
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_live import terminal_panel
from rich.console import Console

from tests.live_page.conftest import TRACKS
from tests.live_page.test_feed import FOUND


@pytest.fixture
def watcher(samples, estimates):
    """One that has been told a little."""
    made = terminal_panel.Watcher("a [bold]run[/bold]", TRACKS)
    made.samples(block := samples(0, 500))
    made.estimates("dr/b", estimates(block, 1))
    made.progress(1.0, 4.0, 0.0)
    return made


def shown(view):
    out = io.StringIO()
    Console(file=out, width=120, markup=False).print(view)
    return out.getvalue()


def test_a_line_says_what_there_is(watcher):
    assert re.match(
        r"1\.0 of 4\.0 s, \d+ x real time; force 499\.00 N, depth 1\.00 mm; dr/b: elasticity", watcher.line()
    )
    assert "dr/a" not in watcher.line()  # it has not said anything
    watcher.flags("dr/b", (Flag("odd", "odd"),))
    watcher.flags(None, (Flag("gaps", "gaps"),))
    assert "(odd)" in watcher.line()
    assert watcher.line().endswith("every track: gaps")


def test_a_code_is_said_once_with_how_often(watcher):
    """Each stream with a gap raises a flag of its own; six words alike say no more than one with its number."""
    flags = tuple(Flag("gaps", f"arm/{i} has 2 gaps") for i in range(6))
    watcher.flags(None, (flags[0], Flag("untared", "it is not"), *flags[1:]))
    watcher.flags("dr/b", flags[:2])
    assert watcher.line().endswith("(gaps x 2); every track: gaps x 6, untared")
    assert "every track: gaps x 6, untared\n" in re.sub(" +\n", "\n", shown(watcher.view()))


def test_the_uncertainty_is_the_combined_one(watcher):
    watcher.health({"tracks": {"dr/b": {"parameters": {"elasticity": FOUND}}}})
    assert "elasticity 0.0010 ± 0.0040 kPa" in watcher.line()
    watcher.health({"tracks": {"dr/b": {"parameters": {"elasticity": {**FOUND, "combined": None}}}}})
    assert "elasticity 0.000998 ± ? kPa" in watcher.line()


def test_the_panel_takes_no_text_for_markup(watcher):
    watcher.guard(GuardState("tripped", "the force is 13 N [red]", 13.0))
    text = shown(watcher.view())
    assert "a [bold]run[/bold]" in text
    assert "stopped by the guard: the force is 13 N [red]" in text
    assert "elasticity" in text
    assert "kPa" in text


def test_a_call_for_the_emergency_stop_is_red_and_rings_once(watcher, monkeypatch):
    monkeypatch.setattr(terminal_panel, "_PANEL_INTERVAL", 0.001)
    watcher.guard(GuardState("tripped", "the arm does not obey", 13.0, True))
    assert "PRESS THE EMERGENCY STOP: the arm does not obey" in watcher.line()
    out, views = io.StringIO(), threading.Semaphore(0)
    view = watcher.view
    monkeypatch.setattr(watcher, "view", lambda: views.release() or view())
    ended = threading.Event()
    errors = Console(file=out, width=120, force_terminal=True, color_system="standard")
    thread = threading.Thread(target=terminal_panel._show_panel, args=(watcher, errors, ended))
    thread.start()
    for _ in range(3):
        views.acquire()
    ended.set()
    thread.join()
    assert re.search(r"\x1b\[1;31m[^\x1b]*PRESS THE EMERGENCY STOP", out.getvalue())
    assert out.getvalue().count("\a") == 1


@pytest.mark.slow
@pytest.mark.parametrize(("terminal_", "clears"), [("", False), ("1", True)])
def test_it_shows_a_run(terminal_, clears, point_pipeline, tmp_path, monkeypatch, capsys):
    """A panel on a terminal, which it clears when it ends; lines elsewhere."""
    monkeypatch.setenv("FORCE_COLOR", terminal_) if terminal_ else monkeypatch.delenv("FORCE_COLOR", raising=False)
    monkeypatch.setenv("COLUMNS", "140")
    monkeypatch.setattr(terminal_panel, "_LINE_INTERVAL", 0.01)
    monkeypatch.setattr(terminal_panel, "_PANEL_INTERVAL", 0.01)
    pipeline = load_pipeline(point_pipeline, ["trajectory.press.duration=2 s"])
    with terminal_panel.panel(pipeline) as watcher:
        run_pipeline(pipeline, tmp_path / "out", watcher.progress, watcher)
        time.sleep(0.1)
    said = capsys.readouterr().err
    assert ("\x1b[2K" in said) == clears
    assert "dr/ekf" in said
    assert re.search(r"force -?\d\.\d\d N, depth -?\d\.\d\d mm", said)


class Stuck(io.StringIO):
    """A terminal that has gone."""

    def write(self, text):
        raise OSError(5, "Input/output error")


def test_a_terminal_that_has_gone_stops_nobody(point_pipeline, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stderr", Stuck())
    monkeypatch.setattr(terminal_panel, "_LINE_INTERVAL", 0.01)
    pipeline = load_pipeline(point_pipeline, ["trajectory.press.duration=1 s"])
    with terminal_panel.panel(pipeline) as watcher:
        result = run_pipeline(pipeline, tmp_path / "out", watcher.progress, watcher)
    assert result.interrupted is None
