"""benchmarks/results/messages.md: every mistake is made again, and palpate says what the page says."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(scope="module")
def maker():
    """The script that writes the page."""
    spec = importlib.util.spec_from_file_location("messages", ROOT / "benchmarks" / "messages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the page has messages of Python 3.11 itself")
def test_the_page_is_what_palpate_says(maker):
    assert maker.pages() == (ROOT / "benchmarks" / "results" / "messages.md").read_text(encoding="utf-8")


def test_there_are_25_and_each_ends_well():
    text = (ROOT / "benchmarks" / "results" / "messages.md").read_text(encoding="utf-8")
    mistakes, _, plugins = text.partition("## Broken plugins")
    assert mistakes.count("\n### ") == 25
    assert re.findall(r"Exit code (\d+)\.", mistakes) == ["2"] * 25
    assert "Traceback" not in text
    assert plugins.count("\n### ") >= 12
    assert plugins.count("own.py") >= plugins.count("\n### ")
