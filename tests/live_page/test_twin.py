"""The page beside the real drivers and the twins."""

import os
import re
import signal

import pytest

from tests.devices.conftest import bench  # noqa: F401
from tests.live_page.browser import CHROMIUM, browser
from tests.live_page.conftest import addresses, meanwhile  # noqa: F401

pytestmark = pytest.mark.live


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_the_stop_button_ends_a_run_in_contact_with_the_arm_retracted(bench, addresses):  # noqa: F811
    """A click in a browser: the guard trips, the arm leaves the material, the result is what was found.

    The wall clock: a browser is no part of a simulation.
    """
    twin = bench()

    def press():
        try:
            tab = chromium.open(addresses.get(timeout=180))
            tab.until("document.getElementById('state')?.textContent === 'moving'", 180)
            twin.wait(lambda state: state["height"] < -0.002)
            tab.click("stop")
            tab.until("document.getElementById('state')?.textContent === 'stopped by the guard'", 180)
            return tab.until("document.getElementById('why')?.textContent", 180)
        except BaseException:
            os.kill(os.getpid(), signal.SIGINT)  # the run must not go on without its test
            raise

    with browser() as chromium:
        wait = meanwhile(press)
        result = twin.run('sink.page.type="live"', "trajectory.press.duration=120 s")
        assert "on the live page" in wait()
    assert re.match("stopped: on the live page", result.interrupted)
    assert result.run["log_duration"] < 110
    assert twin.wait_at_rest()["height"] > 0
