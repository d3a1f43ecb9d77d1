"""Touch by a record's own noise: an instrument of nanonewtons and micrometres, and robots as they were."""

import numpy as np
import pytest
from palpate import Batch, Channel, Stream
from palpate.estimation import Samples
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports
from palpate_engine.alignment.change_point import change_point, shortest_descent

RATE, AIR, DEEP = 2000.0, 2e-6, 0.6e-6
STREAM = Stream("", (Channel("force", "N"), Channel("height", "m")), None)
NOISE = 1e-11


def curve(seed=0, noise=NOISE, offset=0.0, tilt=0.0, force_scale=1.0, length_scale=1.0):
    """Readings of a way in and out of 3 kPa under 5 um, with its surface at 0: force [N] and height [m]."""
    way = np.linspace(AIR, -DEEP, 1500)
    height = np.concatenate([way, way[::-1]])
    force = 16 / 9 * 3000.0 * np.sqrt(5e-6) * np.maximum(-height, 0) ** 1.5 + tilt * (height - AIR)
    force = force + offset + noise * np.random.default_rng(seed).standard_normal(len(height))
    return force_scale * force, length_scale * height


def aligned(force, height, size=None, **changes):
    """Samples and report, the record cut into pieces of `size` readings."""
    table = {"force": "afm.force", "position": "afm.height", "tip_mass": 0.0, "tare_duration": 0.3, **changes}
    settings = AlignmentSettings.model_validate(table)
    aligner = Aligner(settings, Ports.of(settings, {"afm": (STREAM,)}))
    stamp = np.arange(len(force), dtype=np.int64) * round(1e9 / RATE)
    values, blocks = np.column_stack([force, height]), []
    for begin in range(0, len(force), size or len(force)):
        rows = slice(begin, begin + (size or len(force)))
        aligner.feed("afm", Batch("", stamp[rows], stamp[rows], values[rows]))
        blocks.append(aligner.samples())
    blocks.append(aligner.samples(final=True))
    return Samples.joined(blocks), aligner.report


@pytest.mark.parametrize("tare", ["free-air", "none"])
@pytest.mark.parametrize("offset", [0.0, -3e-8, 3e-8])
def test_a_curve_of_nanonewtons_touches_at_its_surface(tare, offset):
    """The threshold would be 0.05 N, and 0.25 N without a tare, for a press of 4 nN."""
    for seed in range(4):
        samples, report = aligned(*curve(seed, offset=offset), tare=tare)
        assert report.touches == 1
        assert abs(report.first_touch[1]) < 0.05 * DEEP
        first = int(np.argmax(samples.contact))
        assert abs(samples.position[first]) < 0.05 * DEEP
        assert report.touch_force == pytest.approx(10 * NOISE, rel=0.2)


def test_a_tilted_baseline_is_not_touch():
    """A tilt of 10 noise standard deviations over the air."""
    samples, report = aligned(*curve(tilt=-10 * NOISE / AIR))
    assert report.touches == 1
    assert abs(samples.position[int(np.argmax(samples.contact))]) < 0.1 * DEEP


def test_only_air_has_no_touch():
    force, height = curve()
    samples, report = aligned(force[:1100], height[:1100])
    assert report.touches == 0
    assert not samples.contact.any()


def test_contact_does_not_depend_on_the_unit_of_force_or_length():
    """Up to a thousand robots' floors below: the same readings in contact at every scale that is not a robot's."""
    expected = aligned(*curve())[0].contact
    for force_scale, length_scale in ((1e3, 1.0), (1e-3, 1e-2), (1.0, 1e2), (1e6, 1e3)):
        samples, _ = aligned(*curve(force_scale=force_scale, length_scale=length_scale))
        np.testing.assert_array_equal(samples.contact, expected)


@pytest.mark.parametrize("tare", ["free-air", "none"])
def test_how_a_record_is_cut_changes_nothing(tare):
    whole, _ = aligned(*curve(3, offset=1e-9), tare=tare)
    for size in (13, 700):
        pieces, _ = aligned(*curve(3, offset=1e-9), size, tare=tare)
        np.testing.assert_array_equal(pieces.contact, whole.contact)
        np.testing.assert_array_equal(pieces.force, whole.force)


@pytest.mark.parametrize(
    ("mass", "noise", "expected"),
    [(0.14, 1e-3, 0.05), (None, 1e-3, 0.05), (0.0, 8e-3, 0.05), (0.0, 1e-3, 1e-2), (0.0, 0.0, 0.25)],
)
def test_a_robots_threshold_stays(mass, noise, expected):
    """A tip that hangs behind the sensor is felt whatever the noise; without one a quiet sensor's own noise counts."""
    force = noise * np.random.default_rng(0).standard_normal(3000)
    _, report = aligned(force, np.full(3000, 1e-3), tip_mass=mass)
    assert report.touch_force == pytest.approx(expected, rel=0.1)


def test_a_touch_force_that_is_stated_stays():
    _, report = aligned(*curve(), touch_force=1e-9)
    assert report.touch_force == 1e-9


def test_the_least_way_down_is_of_the_record_and_no_more_than_a_robots():
    random = np.random.default_rng(1)
    still = 5e-6 * random.standard_normal(1000)
    assert shortest_descent(still, float(np.ptp(still))) == pytest.approx(2e-5, rel=0.1)
    assert shortest_descent(np.linspace(0.05, 0.0, 1000), 0.05) == 2e-5
    small = np.linspace(2e-6, 0.0, 1000) + 1e-10 * random.standard_normal(1000)
    assert shortest_descent(small, 2e-6) == pytest.approx(4e-9, rel=0.05)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6])
def test_a_change_point_is_found_at_every_scale(scale):
    force, height = curve(2, length_scale=1e3)
    found = change_point(scale * height[:1500], force[:1500])
    assert found is not None
    assert abs(found.surface) < 0.02 * scale * 1e3 * DEEP
