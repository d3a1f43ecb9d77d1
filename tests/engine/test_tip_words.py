"""Tips in words: one key or several, with and without commas."""

import pytest
from palpate import ConfigurationError
from palpate_engine import registry, tip_table

KNOWN = registry.load()


@pytest.mark.parametrize(
    ("text", "table"),
    [
        ("flat 3 mm", {"type": "flat", "radius": "3 mm"}),
        ("flat diameter 6 mm", {"type": "flat", "radius": pytest.approx(3e-3)}),
        ("sphere 3 mm", {"type": "exact-sphere", "radius": "3 mm"}),
        ("blunt-cone 30 deg, tip_radius 1 mm", {"type": "blunt-cone", "angle": "30 deg", "tip_radius": "1 mm"}),
        ("blunt-cone angle 30 deg tip_radius 1 mm", {"type": "blunt-cone", "angle": "30 deg", "tip_radius": "1 mm"}),
        ("blunt-cone tip_radius 1 mm, angle 30 deg", {"type": "blunt-cone", "angle": "30 deg", "tip_radius": "1 mm"}),
        ("ellipsoid 5 mm, height 2 mm,", {"type": "ellipsoid", "radius": "5 mm", "height": "2 mm"}),
    ],
)
def test_a_tip_in_words(text, table):
    assert tip_table(text, KNOWN) == table


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", '; write it as in "sphere 3 mm"'),
        ("flat", 'flat needs its radius, as in "flat VALUE"'),
        ("ellipsoid 5 mm", 'ellipsoid needs its height, as in "ellipsoid VALUE, height VALUE"'),
        ("ellipsoid height 5 mm", 'ellipsoid needs its radius, as in "ellipsoid VALUE, height VALUE"'),
        ("ellipsoid 5 mm, hight 2 mm", "hight"),
        ("ellipsoid hight 2 mm", "has no 'hight'; did you mean 'height'"),
        ("flat 5 mm, radius 6 mm", "radius is stated twice"),
        ("flat 5 mm, diameter 12 mm", "both radius and diameter are stated"),
        ("blunt-cone 1 mm, tip_radius 30 deg", "is a length, not an angle"),
        ("quartic 3", "quartic needs a key each"),
    ],
)
def test_words_that_are_not_a_tip(text, words):
    with pytest.raises(ConfigurationError, match=words):
        tip_table(text, KNOWN)
