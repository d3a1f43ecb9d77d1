"""The page in a real Chromium."""

import re

import pytest
from palpate import GuardState, Run
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_live.live_feed import PageFeed
from palpate_live.server_process import PageServer
from palpate_live.sink import flag_meanings

from tests.live_page.browser import CHROMIUM, browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")

# How many pixels of each chart are coloured like the curve of a track.
COLOURED = """Array.from(document.querySelectorAll('.chart canvas')).map((canvas) => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  let found = 0;
  for (let i = 0; i < data.length; i += 4) found += data[i + 3] > 200 && data[i + 2] - data[i] > 100;
  return found;
})"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dr/kinematic", "dr/ekf"])  # the paper's filter determines nothing in 3 s
def test_all_panels_are_drawn(point_pipeline, tmp_path, name):
    pipeline = load_pipeline(point_pipeline, [f'run.tracks=["{name}"]', "trajectory.press.duration=3 s"])
    asked = []
    child = PageServer(0, asked.append, patient=True)
    tracks = {str(track.name): track.model.parameters for track in pipeline.tracks}
    feed = PageFeed(Run(tmp_path, {}, tracks, {}, {}, "<b>a run</b>"), child.send, flag_meanings())
    result = run_pipeline(pipeline, tmp_path / "out", observer=feed)
    with browser() as chromium:
        tab = chromium.open(child.address)
        tab.until("window.palpate && window.palpate.draws > 2 && !!document.querySelector('#devices table')")
        drawn = tab.ask(COLOURED)
        assert len(drawn) == 6  # force, depth, elasticity, viscosity, innovation, NIS
        assert min(drawn) > 30, drawn
        found = result.tracks[name]
        elasticity, card = found.parameters["elasticity"], tab.ask("document.querySelector('.card').innerText")
        if name == "dr/ekf":
            assert found.verdict == elasticity.verdict == "not determined"
            assert "not determined (result)" in card
            assert "elasticity\t" in card
            assert " not determined\tkPa" in card
        else:
            assert f"{elasticity.value / 1e3:.1f}" in card
            assert f"± {elasticity.combined / 1e3:.2g}"[:4] in card
        flags = tab.ask("document.getElementById('flags').innerText")
        assert all(flag.code in flags for flag in found.flags)
        assert "rig.wrench" in tab.ask("document.getElementById('devices').innerText")
        assert tab.ask("document.getElementById('name').innerText") == "<b>a run</b>"  # no text is markup
        assert tab.ask("document.getElementById('map-note').innerText").startswith("The tip stays in one place")
        tab.key("Escape")
        tab.until("document.getElementById('state')?.textContent === 'stop was asked for'")
    child.close()
    assert asked == ["on the live page"]


@pytest.mark.slow
def test_a_call_for_the_emergency_stop_is_red_on_the_page(a_run, samples):
    child = PageServer(0, lambda reason: None, patient=True)
    feed = PageFeed(a_run(), child.send, {})
    feed.samples(samples(0, 100))
    feed.guard(GuardState("tripped", "the arm does not obey", 3.0, True))
    feed.flush()
    with browser() as chromium:
        tab = chromium.open(child.address)
        tab.until("document.getElementById('state')?.textContent === 'PRESS THE EMERGENCY STOP'")
        assert tab.ask("document.getElementById('why').innerText") == "the arm does not obey"
        border = tab.ask("getComputedStyle(document.body).border")
    child.close()
    width, red, green, blue = map(int, re.findall(r"\d+", border))
    assert width == 8
    assert red > 150 > 2 * max(green, blue) - 50
