"""Time-stamps that contradict the rate of their stream: a finding from a factor of 1.05 on, refused beyond 2."""

import json

import numpy as np
import pytest
from palpate.device import Channel, Stream
from palpate.stream_health import Health
from palpate_engine.result.record_flags import _rate_flags

DEVICE = """
from contextlib import contextmanager

import numpy as np
from palpate import Batch, Channel, Device, Stream, plugin


class Spring(Device):
    '''A spring of 300 N/m, read at {readings} Hz.'''

    @property
    def streams(self):
        '''Height and force, by an announced rate.'''
        return (Stream("swing", (Channel("z", "m"), Channel("f", "N")), {announced}),)

    @contextmanager
    def connect(self, seed):
        '''The link.'''
        yield Link()


class Link:
    '''Presses for six seconds.'''

    def batches(self):
        '''One for each tenth of a second.'''
        noise = np.random.default_rng(1).standard_normal((2, 3000))
        for start in range(0, 3000, 50):
            rows = slice(start, start + 50)
            time = np.arange(start, start + 50) / 500
            depth = 0.003 * np.sin(np.pi * np.clip(time - 1.0, 0.0, 5.0)) ** 2 - 0.001
            force = 300.0 * np.maximum(depth, 0.0) + 2e-3 * noise[0, rows]
            stamps = np.rint({unit} * time).astype(np.int64)
            yield Batch("swing", stamps, stamps, np.column_stack([1e-6 * noise[1, rows] - depth, force]))


@plugin
def palpate_devices():
    return {{"own": Spring}}
"""
PIPELINE = """
[run]
plugins = ["own.py"]

[device.spring]
type = "own"

[alignment]
tare_duration = "0.5 s"
tip_mass = "0 g"
force = {channel = "spring.swing.f", uncertainty = "0.1 ms"}
position = "spring.swing.z"

[model.kelvin-voigt]
type = "kelvin-voigt"

[estimator.fit]
type = "casadi-fit"
"""


def health_of(stamps, rate=500.0, blocks=1, gap=20_000_000, received=None):
    """What a stream of time-stamps [s] has, fed in blocks; it arrives when it is stamped, or as given [s]."""
    health = Health(Stream("s", (Channel("z", "m"),), rate))
    arrivals = stamps if received is None else received
    both = [np.rint(1e9 * times).astype(np.int64) for times in (stamps, arrivals)]
    for block, arrived in zip(*(np.array_split(times, blocks) for times in both), strict=True):
        health.arrived(block, arrived)
        health.in_order(block, gap)
    return health


def usual(n=1000):
    return np.arange(n) / 500.0


def jittery(n=1000):
    """Each stamp is off by up to a quarter of an interval."""
    return usual(n) + np.random.default_rng(1).uniform(-5e-4, 5e-4, n)


def lossy(n=1000):
    """One in eight readings was lost: their mean rate is 438 Hz."""
    return usual(n)[np.arange(n) % 8 != 3]


def bunched(n=1000):
    """Stamped on arrival, in bunches of five within 0.1 ms: most intervals are far too short."""
    return np.floor(np.arange(n) / 5) / 100.0 + 2e-5 * (np.arange(n) % 5)


def paused(n=1000):
    return usual(n) + 7.0 * (np.arange(n) > n // 2)


def rounded(n=1000):
    """To whole milliseconds, at 800 Hz: intervals of 1, 1, 1 and 2 ms."""
    return np.floor(1e3 * np.arange(n) / 800.0) / 1e3


@pytest.mark.parametrize("stamps", [usual, jittery, lossy, bunched, paused, rounded])
@pytest.mark.parametrize("clock", [1.0, 1.02, 0.98])
def test_a_rate_that_is_right_is_not_contradicted(stamps, clock):
    rate = 800.0 if stamps is rounded else 500.0
    assert health_of(clock * stamps(), rate).rate_ratio is None


@pytest.mark.parametrize("stamps", [usual, jittery, paused])
@pytest.mark.parametrize("factor", [1e3, 1e6, 2.5, 1.5, 1.07, 0.93, 0.5, 0.2, 1e-3])
def test_a_rate_that_is_wrong_is_contradicted_by_its_factor(stamps, factor):
    gap = round(20_000_000 / factor)
    health = health_of(stamps() / factor, gap=gap)
    assert health.rate_ratio == pytest.approx(factor, rel=0.01 if factor > 1e5 else 2e-3)
    (flag,) = _rate_flags("s", health)
    assert flag.code == ("rate-contradicted" if 0.5 < factor < 2.0 else "wrong-stamps")


def test_blocks_do_not_change_what_is_counted():
    stamps = np.concatenate([jittery(400), 5.0 + jittery(400) / 1.2])
    whole = health_of(stamps)
    counts = ("rate_ratio", "shorter", "longer", "paused", "gaps")
    for blocks in (2, 7, 61, 800):
        parted = health_of(stamps, blocks=blocks)
        assert [getattr(parted, key) for key in counts] == [getattr(whole, key) for key in counts]


@pytest.mark.parametrize(
    ("factor", "rate", "words"),
    [
        (1e3, 500.0, "give 500000 Hz, and 500 Hz are announced: the time-stamps seem to be in microseconds"),
        (1e6, 500.0, "seem to be in milliseconds"),
        (1.0, 0.5, "is the rate announced in kHz?"),
        (3.0, 500.0, "announce the rate of the readings"),
    ],
)
def test_the_unit_that_is_likely_is_named(factor, rate, words):
    (flag,) = _rate_flags("s", health_of(usual() / factor, rate))
    assert words in flag.message


def test_arrivals_confirm_time_stamps_at_another_rate():
    """An arm that sends 125 states a second in place of 500 is slow, and its time-stamps are right."""
    slow = np.arange(500) / 125.0
    assert health_of(slow, received=slow + 100.0).rate_ratio is None
    assert health_of(slow).rate_ratio == pytest.approx(0.25)
    assert health_of(usual() / 1e3, received=usual() + 100.0).rate_ratio == pytest.approx(1e3, rel=1e-3)


def test_a_stream_without_a_rate_is_not_compared():
    assert health_of(usual(), None).rate_ratio is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unit", "announced", "verdict", "codes"),
    [
        ("1e9", 500.0, "good", []),
        ("1e9", 515.0, "good", []),
        ("1e9", 530.0, "doubtful", ["rate-contradicted"]),
        ("1e6", 500.0, "invalid", ["wrong-stamps"]),
        ("1e9", 1250.0, "invalid", ["wrong-stamps"]),
    ],
)
def test_a_device_with_stamps_in_microseconds_is_refused(palpate, tmp_path, unit, announced, verdict, codes):
    """A spring of 300 N/m was good, 339.2 +- 2.7 in one record, beside a rate of 500000 Hz."""
    (tmp_path / "own.py").write_text(DEVICE.format(unit=unit, announced=announced, readings=500))
    (tmp_path / "own.toml").write_text(PIPELINE)
    done = palpate("run", "own.toml", "--out", "out")
    assert done.returncode == 0, done.stderr
    (track,) = json.loads((tmp_path / "out" / "result.json").read_text())["tracks"].values()
    stiffness = track["parameters"]["stiffness"]
    assert stiffness["verdict"] == verdict
    assert ("invalid[" in done.stdout) is (verdict == "invalid")
    assert [flag["code"] for flag in track["flags"] if flag["code"] in ("rate-contradicted", "wrong-stamps")] == codes
    assert ("microseconds" in done.stdout) is (unit == "1e6")
    assert verdict == "invalid" or stiffness["value"] == pytest.approx(300.0, rel=0.01)
