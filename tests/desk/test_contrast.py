"""Texts of the pages can be read: a contrast of 4.5 (WCAG 2.2) of every text on every ground, light and dark."""

import itertools
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "core/palpate_kit/page/static/page.css"
DESK = ROOT / "plugins/desk/palpate_desk/static/desk.css"
REPORT = ROOT / "plugins/report/palpate_report/templates/report.css"
TEXTS, GROUNDS = ("ink", "soft", "bad", "doubt", "fine"), ("paper", "ground")


def colours(*texts):
    """The variables of style sheets, later ones over earlier."""
    return dict(re.findall(r"--([a-z]+): (#[0-9a-f]{3,6})", " ".join(texts)))


def luminance(colour):
    """Relative luminance of sRGB (WCAG 2.2)."""
    digits = colour[1:] if len(colour) == 7 else "".join(2 * digit for digit in colour[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    """Between 1 and 21."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def sheets():
    """Colours of each page, as text and as ground."""
    page, desk, report = PAGE.read_text(), DESK.read_text(), REPORT.read_text()
    light, _, rest = desk.partition("@media (prefers-color-scheme: dark) {")
    dark = rest.partition("\n}")[0]
    yield "live", colours(page), TEXTS, GROUNDS
    yield "desk", colours(page, light), TEXTS, (*GROUNDS, "pick", "button")
    yield "desk, dark", colours(page, light, dark), TEXTS, (*GROUNDS, "pick", "button")
    grounds = re.findall(r"\.verdict\.(\w+) \{ background: (#\w+)", report)
    yield "report", colours(report) | {"white": "#fff"}, ("text", "grey", "good", "look", "bad"), ("white", "soft")
    marks = {"trust": "good", "look": "look", "refuse": "bad"}
    for name, ground in grounds:
        yield f"report, {name}", colours(report) | {"ground": ground}, ("text", marks[name]), ("ground",)


@pytest.mark.parametrize(("known", "texts", "grounds"), [pytest.param(*rest, id=name) for name, *rest in sheets()])
def test_every_text_stands_out_from_its_ground(known, texts, grounds):
    weak = {
        f"{text} on {ground}": round(contrast(known[text], known[ground]), 2)
        for text, ground in itertools.product(texts, grounds)
        if contrast(known[text], known[ground]) < 4.5
    }
    assert weak == {}


def test_black_on_white_is_21():
    assert contrast("#000000", "#fff") == pytest.approx(21.0)
