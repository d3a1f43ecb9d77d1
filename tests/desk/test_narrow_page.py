"""The page in a Chromium as narrow as a phone: every uncertainty is whole."""

import pytest

from tests.curves.conftest import fits_once, folder  # noqa: F401
from tests.desk.conftest import served
from tests.live_page.browser import CHROMIUM, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium"),
]
PATIENCE = 120.0  # [s] on a busy machine
# Texts with a ± whose end is outside the window, or outside a box that hides what is beyond it and does not scroll.
CUT_OFF = """(() => {
  const cut = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text = texts.nextNode(); text; text = texts.nextNode()) {
    if (!text.data.includes('±')) continue;
    const range = document.createRange();
    range.selectNodeContents(text);
    const edge = range.getBoundingClientRect().right;
    if (!edge) continue;
    let limit = innerWidth;
    for (let box = text.parentElement; box; box = box.parentElement) {
      const overflow = getComputedStyle(box).overflowX;
      if (overflow === 'auto' || overflow === 'scroll') { limit = Infinity; break; }
      if (overflow !== 'visible') limit = Math.min(limit, box.getBoundingClientRect().right);
    }
    if (edge > limit + 1) cut.push(text.data);
  }
  return cut;
})()"""


def test_no_uncertainty_is_cut_off_on_a_narrow_screen(folder):  # noqa: F811
    with served("fits") as process, browser(1280, 800) as chromium:
        tab = chromium.open(process.address)
        tab.call("Emulation.setDeviceMetricsOverride", width=400, height=800, deviceScaleFactor=1, mobile=False)
        tab.until("document.getElementById('curve-values')?.innerText.includes('±')", PATIENCE)
        assert tab.ask("innerWidth") == 400
        assert tab.ask(CUT_OFF) == []
        assert tab.ask("window.palpate.errors") == []
