"""Calibration: mass and delay from a shake, with intervals that hold the truth."""

from itertools import pairwise

import numpy as np
import pytest
from palpate import Channel, LogError, Stream
from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue
from palpate_calibration.calibration_record import CalibrationRecord, CalibrationRecorder, Trace
from palpate_calibration.motion_segments import Segment, shake_segments, standstill_segments
from palpate_calibration.protocol import calibrate
from palpate_calibration.settings import CalibrationSettings
from palpate_calibration.shake_analysis import shake_fit
from palpate_calibration.statics import series_compliance, tap_delay, weight_fit
from palpate_engine.alignment import AlignmentSettings, Health, Ports
from palpate_models import DimensionalityReduction, Flat, Sphere
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_trajectories.point import Point
from palpate_trajectories.shake import Shake

MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
CHANNELS = {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.twist.z"}
WHOLE = Segment(0.1, 10.0)
SHORT = Shake(amplitude=0.005, duration=4.0, standstill=1.0)


def twin(seed=0, mass=0.14, delay=0.0, sines=((5.0, 0.003),), force_std=0.05, position_std=5e-6, rate=500.0, **more):
    """A record of an ideal rig: the motion is exactly the sines, each stream has its own instants."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(10.2 * rate)) / rate
    s = np.arange(int(10.2 * rate)) / rate + 0.0007
    height, force = np.zeros_like(t), more.get("offset", -0.8) + more.get("drift", 0.0) * s
    for k, (f, a) in enumerate(sines):
        w = 2 * np.pi * f
        height = height + a * np.sin(w * t + k)
        force = force + mass * a * w**2 * np.sin(w * (s - delay) + k)
    streams = [Health(Stream(name, (Channel("z", unit),), rate)) for name, unit in (("wrench", "N"), ("tip", "m"))]
    return CalibrationRecord(
        Trace(s, force + force_std * rng.standard_normal(len(s)), streams[0]),
        Trace(t, height + position_std * rng.standard_normal(len(t)), streams[1]),
        None,
    )


def rig(**settings):
    specimen = {"model": MODEL, "elasticity": 112.5e3, "viscosity": 362.0}
    return SimulatedRig.model_validate({"specimen": specimen, **settings})


def recorded(device, trajectory=SHORT, seed=0, **alignment):
    settings = AlignmentSettings.model_validate({**CHANNELS, **alignment})
    recorder = CalibrationRecorder(settings, Ports.of(settings, {"rig": device.streams}))
    with device.connect(seed) as link:
        link.follow(trajectory)
        for batch in link.batches():
            recorder.feed("rig", batch)
    return recorder.record()


def calibrated(device, trajectory=SHORT, repeats=3, **settings):
    records = [recorded(device, trajectory, seed) for seed in range(repeats)]
    return calibrate(records, CalibrationSettings.model_validate(settings))


@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.001, 0.00137, 0.007, 0.0225, 0.025, -0.0123])
@pytest.mark.parametrize("sines", [((5.0, 0.003),), ((2.0, 0.004), (5.3, 0.002), (7.0, 0.001))])
def test_without_noise_mass_and_delay_are_exact_at_any_fraction_of_a_sample(delay, sines):
    fit = shake_fit(twin(delay=delay, sines=sines, force_std=0.0, position_std=0.0), WHOLE)
    assert fit.frequencies == pytest.approx([f for f, _ in sines], abs=1e-9)
    assert fit.amplitudes == pytest.approx([a for _, a in sines], rel=1e-9)
    assert fit.mass.value == pytest.approx(0.14, rel=1e-8)
    assert fit.delay.value == pytest.approx(delay, abs=1e-10)


@pytest.mark.slow
def test_no_delay_is_liked_better_than_another():
    """Interpolation would pull towards half samples; the scatter about the truth must not depend on the fraction."""
    errors = {
        fraction: np.array([shake_fit(twin(seed, delay=fraction * 0.002), WHOLE).delay.value for seed in range(8)])
        - fraction * 0.002
        for fraction in (0.0, 0.25, 0.5, 0.9)
    }
    for first, second in pairwise(errors.values()):
        assert second == pytest.approx(first, abs=2e-5)


@pytest.mark.parametrize(
    ("frequency", "amplitude", "mass_std", "delay_std"),
    [(5.0, 0.003, 0.34e-3, 0.059e-3), (5.0, 0.002, 0.51e-3, 0.089e-3), (3.0, 0.005, 0.56e-3, 0.165e-3)],
)
def test_the_uncertainty_is_the_cramer_rao_bound(frequency, amplitude, mass_std, delay_std):
    """Known bounds for 0.05 N at 500 Hz, 10 s, a tip of 0.181 kg."""
    fits = [shake_fit(twin(seed, mass=0.181, sines=((frequency, amplitude),)), WHOLE) for seed in range(8)]
    assert np.mean([fit.mass.std for fit in fits]) == pytest.approx(mass_std, rel=0.06)
    assert np.mean([fit.delay.std for fit in fits]) == pytest.approx(delay_std, rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "delay"), [(0.05, 0.0033), (0.14, 0.0), (0.4, 0.025)])
def test_intervals_hold_the_truth_ninety_to_ninety_nine_times_of_a_hundred(mass, delay):
    inside = {"mass": 0, "delay": 0}
    for run in range(100):
        fits = [shake_fit(twin(1000 * run + k, mass, delay), WHOLE, (5.0,)) for k in range(2)]
        for name, truth in (("mass", mass), ("delay", delay)):
            low, high = MeasuredValue.of([getattr(fit, name) for fit in fits], "").interval
            inside[name] += low <= truth <= high
    assert 90 <= inside["mass"] <= 99
    assert 90 <= inside["delay"] <= 99


def test_coloured_noise_widens_the_interval():
    white = twin(3)
    slow = np.convolve(np.random.default_rng(4).standard_normal(len(white.force.time) + 19), np.ones(20) / 20, "valid")
    coloured = CalibrationRecord(
        Trace(white.force.time, white.force.values + 0.2 * slow, white.force.health), white.position, None
    )
    errors = [abs(shake_fit(record, WHOLE).mass.value - 0.14) for record in (white, coloured)]
    stds = [shake_fit(record, WHOLE).mass.std for record in (white, coloured)]
    assert stds[1] > 3 * stds[0]
    assert errors[1] < 3 * stds[1]


@pytest.mark.parametrize(
    "truth",
    [
        {"force_delay": 0.0, "tip_mass": 0.05},
        {"force_delay": 0.0071, "tip_mass": 0.4, "bias": 2.0},
        {"motion_delay": 0.0223, "tip_mass": 0.163, "sensor_rate": 1000.0, "drift": 0.003},
    ],
)
def test_the_simulated_rig_is_recovered(truth):
    device = rig(**truth)
    values = calibrated(device).values
    middle = SHORT.standstill / 2 * device.drift
    expected = {
        "mass": device.tip_mass,
        "delay": device.force_delay - device.motion_delay,
        "offset": device.bias - 9.80665 * device.tip_mass + middle,
        "weight": 9.80665 * device.tip_mass,
        "bias": device.bias + middle,
        "drift": device.drift,
        "force_std": device.force_std,
        "velocity_std": device.velocity_std,
        "position_std": device.position_std,
    }
    for name, value in expected.items():
        assert abs(values[name].value - value) < 3.5 * values[name].combined, name
        assert len(values[name].repeats) >= 3
        assert values[name].type_a is not None


def test_the_same_record_gives_the_same_bits():
    assert calibrated(rig(), repeats=1).values == calibrated(rig(), repeats=1).values


def test_five_hertz_three_millimetres_ten_seconds():
    """The real swing is 3 mm: the loop passes 0.53 of it."""
    values = calibrated(rig(force_delay=0.0117), Shake(amplitude=0.0057)).values
    assert values["mass"].value == pytest.approx(0.14, abs=1e-3)
    assert values["delay"].value == pytest.approx(0.0117, abs=1e-4)
    assert 1.96 * values["delay"].combined < 1e-4


def test_several_shakes_in_one_log_are_repeats():
    one = recorded(rig())
    gap = one.force.time[-1] + 0.001
    tracks = [
        Trace(np.concatenate([t.time, t.time + gap]), np.concatenate([t.values, t.values]), t.health)
        for t in (one.force, one.position)
    ]
    session = calibrate([CalibrationRecord(tracks[0], tracks[1], None)], CalibrationSettings())
    assert len(session.shakes) == 2
    assert session.shakes[0].mass.value == pytest.approx(session.shakes[1].mass.value, rel=1e-3)


def test_rest_and_shake_are_found():
    record = recorded(rig(), Shake(amplitude=0.005, duration=5.0, standstill=1.5))
    (shake,) = shake_segments(record, 0.2)
    still = standstill_segments(record)
    assert len(still) == 2
    assert 0.0 <= still[0].begin < still[0].end <= 1.6
    assert shake.begin > 2.4
    assert shake.end < 8.0
    assert shake.length > 4.0


@pytest.mark.parametrize(("delay", "noted"), [(0.0, False), (9e-5, True), (0.02, True)])
def test_a_late_velocity_is_noted(delay, noted):
    record = recorded(rig())
    assert record.velocity is not None
    late = Trace(record.velocity.time + delay, record.velocity.values, record.velocity.health)
    session = calibrate([CalibrationRecord(record.force, record.position, late)], CalibrationSettings())
    lag = session.values["velocity_delay"]
    assert lag.value == pytest.approx(delay, abs=max(1e-4 * (delay > 1e-3), 4 * lag.combined))
    assert any(note.startswith("velocity-late") for note in session.notes) == noted


IN_CONTACT = Point(bias=0.004, frequency=5.0, duration=5.0)
HIGH_SKIN = {"specimen": {"model": MODEL, "elasticity": 1e5, "viscosity": 300.0, "surface": 0.0034}}
TOUCHING = Shake(amplitude=0.005, height=0.0055, duration=4.0, standstill=1.0)


@pytest.mark.parametrize(
    ("settings", "motion", "alignment", "reason"),
    [
        ({}, IN_CONTACT, {}, "in contact"),
        (HIGH_SKIN, TOUCHING, {}, "contact"),
        ({"force_limit": 1.0}, SHORT, {}, "saturated"),
        ({}, SHORT, {"force_limit": 1.2}, "saturated"),
        ({}, Shake(amplitude=1e-4, frequencies=(2.0,), duration=4.0, standstill=1.0), {}, "too small"),
        ({}, SHORT, {"force": {"channel": "rig.wrench.z", "sign": -1}}, "sign = -1"),
        ({"force_std": 0.0, "drift": 0.0}, SHORT, {}, "stuck"),
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_used_is_refused_with_the_reason(settings, motion, alignment, reason):
    with pytest.raises(LogError, match=reason):
        calibrate([recorded(rig(**settings), motion, **alignment)], CalibrationSettings())


def test_a_record_without_motion_is_refused():
    still = twin(sines=((5.0, 1e-9),))
    with pytest.raises(LogError, match="no shake"):
        calibrate([still], CalibrationSettings())


def test_a_spring_that_softens_the_inertia_shows_at_two_frequencies():
    """Soft contact: a force of 20 N/m works against the inertia; one frequency would call it a smaller mass."""
    record = twin(sines=((3.0, 0.004), (7.0, 0.002)))
    pushed = record.force.values - 20.0 * np.interp(record.force.time, record.position.time, record.position.values)
    with pytest.raises(LogError, match="no single mass"):
        shake_fit(
            CalibrationRecord(Trace(record.force.time, pushed, record.force.health), record.position, None), WHOLE
        )


def test_repeats_and_fits_combine():
    same = MeasuredValue.of(
        [RepeatValue(1.0, 0.1), RepeatValue(1.0, 0.1), RepeatValue(1.0, 0.1), RepeatValue(1.0, 0.1)], "kg"
    )
    assert same.value == 1.0
    assert same.fit == pytest.approx(0.05)
    assert same.combined == pytest.approx(0.05)
    assert same.type_a == 0.0
    assert same.factor == pytest.approx(1.96, abs=0.01)
    apart = MeasuredValue.of([RepeatValue(0.0, 0.1), RepeatValue(10.0, 0.1)], "kg", type_b=3.0)
    assert apart.type_a == pytest.approx(5.0)
    assert apart.combined == pytest.approx(np.hypot(5.0, 3.0), rel=1e-3)
    assert apart.factor > 3.0
    once = MeasuredValue.of([RepeatValue(2.0, 0.1)], "kg")
    assert once.type_a is None
    assert once.interval == pytest.approx((2.0 - 0.196, 2.0 + 0.196), abs=1e-3)


def poses():
    """Directions of gravity in the sensor's frame: upright, and tilted about two axes."""
    a = np.radians(40.0)
    return np.array([[0, 0, -1.0], [np.sin(a), 0, -np.cos(a)], [0, np.sin(a), -np.cos(a)], [-np.sin(a), 0, -np.cos(a)]])


def test_weight_and_centre_of_mass_from_orientations():
    inside = 0
    centre, bias, turn = np.array([0.001, -0.002, 0.04]), np.array([0.3, -0.2, 0.6]), np.array([0.01, 0.02, -0.03])
    for seed in range(100):
        rng = np.random.default_rng(seed)
        weights = 0.25 * 9.80665 * poses()
        force = weights + bias + 0.002 * rng.standard_normal((4, 3))
        torque = np.cross(centre, weights) + turn + 1e-4 * rng.standard_normal((4, 3))
        fit = weight_fit(np.hstack([force, torque]), poses(), (0.002, 1e-4))
        assert fit.mass.value == pytest.approx(0.25, abs=2e-3)
        assert fit.centre == pytest.approx(centre, abs=5e-4)
        assert fit.force_bias == pytest.approx(bias, abs=0.02)
        inside += abs(fit.mass.value - 0.25) < 1.96 * fit.mass.std
    assert 90 <= inside <= 99


def test_orientations_that_tell_nothing_are_refused():
    wrenches = np.zeros((3, 6))
    with pytest.raises(LogError, match="too similar"):
        weight_fit(wrenches, np.tile([0.0, 0.0, -1.0], (3, 1)), (0.01, 1e-3))
    with pytest.raises(LogError, match="need three"):
        weight_fit(wrenches[:2], poses()[:2], (0.01, 1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.0034, -0.011])
def test_a_tap_gives_the_delay_too(delay):
    errors, stds = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        t = np.arange(0.0, 1.0, 0.002)
        s = np.arange(0.1, 0.9, 0.00125)

        def height(x):
            return 0.002 - 0.0025 * np.sin(np.pi * x) ** 2

        force = 2e4 * np.maximum(-height(s - delay), 0.0) + 0.05 * rng.standard_normal(len(s))
        found = tap_delay((s, force), (t, height(t) + 1e-6 * rng.standard_normal(len(t))))
        errors.append(found.value - delay)
        stds.append(found.std)
    assert np.abs(errors).max() < 4e-4
    assert np.mean(stds) == pytest.approx(np.std(errors), rel=0.8)


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.0083])
def test_a_plate_under_the_simulated_rig(delay):
    """The contact is the only spring there: its slope is the compliance that must come out."""
    plate = {"model": DimensionalityReduction(indenter=Flat(radius=0.005)), "elasticity": 3e6, "viscosity": 0.0}
    press = Point(bias=2e-4, amplitude=1e-4, frequency=1.0, duration=4.0)
    values = calibrated(rig(specimen=plate, force_delay=delay), press, motion="plate").values
    stiffness = 2 * 3e6 / (1 - 0.25) * 0.005
    assert abs(values["tap_delay"].value - delay) < max(4 * values["tap_delay"].combined, 3e-4)
    assert values["compliance"].value == pytest.approx(1 / stiffness, rel=0.05)


def test_compliance_on_a_rigid_plate():
    rng = np.random.default_rng(0)
    force = np.linspace(0.0, 20.0, 500)
    position = 0.01 - force / 35e3 + 5e-6 * rng.standard_normal(500)
    found = series_compliance(force, position)
    assert abs(found.value - 1 / 35e3) < 3 * found.std
    assert found.std < 1e-7
    with pytest.raises(LogError, match=r"0\.5 N"):
        series_compliance(np.full(500, 0.1), position)


@pytest.mark.parametrize("name", ["d10mm_soft", "d10mm_sphere", "d5mm_soft"])
def test_a_real_palpation_is_refused_as_contact(shared, name):
    """A point palpation, 2 Hz in contact all the time: it must not pass for a shake."""
    from palpate_logs.csv_replay import CsvReplay

    columns = {"z": {"column": 0, "unit": "mm"}, "force": {"column": 4, "unit": "N"}}
    log = CsvReplay.model_validate(
        {"file": shared / "ur3e-bota-2024" / f"{name}.csv.gz", "rate": 500.0, "columns": columns}
    )
    settings = AlignmentSettings.model_validate({"force": "log.force", "position": "log.z"})
    recorder = CalibrationRecorder(settings, Ports.of(settings, {"log": log.streams}))
    with log.connect(0) as link:
        for batch in link.batches():
            recorder.feed("log", batch)
    with pytest.raises(LogError, match="in contact"):
        calibrate([recorder.record()], CalibrationSettings())


def test_where_repeats_scatter_the_best_fit_is_not_the_mean():
    """One repeat says 7 with a tenth of the others' uncertainty, and nine lie around 10: so does the mean."""
    around = [9.0, 9.5, 10.0, 10.5, 11.0, 9.2, 10.8, 9.8, 10.2]
    found = MeasuredValue.of([RepeatValue(7.0, 0.01), *(RepeatValue(value, 1e-1) for value in around)], "kg")
    assert 9.0 < found.value < 10.5
    assert found.combined > 0.2
    low, high = found.interval
    assert low < 10.0 < high
