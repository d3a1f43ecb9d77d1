"""Every trajectory: the promises, and what cannot be done is refused by name."""

import itertools

import numpy as np
import pytest
from palpate import ConfigurationError
from palpate_testing import check_trajectory
from palpate_trajectories import palpate_trajectories
from palpate_trajectories.approach import PressShape
from palpate_trajectories.excitation import Chirp, MultiSine
from palpate_trajectories.force_hold import ForceHold
from palpate_trajectories.grid_points import GridPoints, short_order
from palpate_trajectories.lifted_motion import LiftedTrajectory
from palpate_trajectories.line_sweep import LineSweep
from palpate_trajectories.load_unload import Compression, LoadUnload
from palpate_trajectories.nominal_height import NominalHeight
from palpate_trajectories.point import Point
from palpate_trajectories.ramp_hold import RampHold
from palpate_trajectories.raster import Raster
from palpate_trajectories.shake import Shake
from palpate_trajectories.stay import Stay
from palpate_trajectories.translation import TranslatedTrajectory
from palpate_trajectories.waypoint_file import FromFile

PRESS = PressShape(bias=0.004)
TILTED = NominalHeight(height=0.001, tilt_x=0.02, tilt_y=-0.01)
WAYPOINTS = "time,x,y,z\n0,0,0,0.005\n1,0,0,0.002\n2,0.001,0,-0.002\n4,0.02,0.01,-0.002\n5,0.02,0.01,0.005\n"


@pytest.fixture
def bumpy(tmp_path):
    """A map of heights in a file."""
    x, y = np.linspace(-0.05, 0.05, 21), np.linspace(-0.04, 0.04, 17)
    heights = 0.002 * np.sin(40 * x)[None, :] * np.cos(30 * y)[:, None]
    path = tmp_path / "heights.csv"
    np.savetxt(path, np.vstack([np.r_[0.0, x], np.column_stack([y, heights])]), delimiter=",")
    return NominalHeight(file=path)


EXAMPLES = {
    "point": [Point(bias=0.004, settle=0.7), Point(bias=0.004, settle=1.0, duration=2.3)],
    "load-unload": [
        LoadUnload(depth=0.005),
        LoadUnload(depth=0.013, speeds=(0.002, 0.0042, 0.02), cycles=2, surface=TILTED, place=(0.01, 0.02)),
    ],
    "compression": [Compression(), Compression(hold=2.0, thickness=0.03, strain=0.2, speed=0.001)],
    "force-hold": [
        ForceHold(force=2.0, depth=0.005, stiffness=2000.0, duration=8.0),
        ForceHold(force=1.0, depth=0.003, stiffness=5000.0, duration=6.0, speed=0.003, surface=TILTED),
    ],
    "ramp-hold": [
        RampHold(depths=(0.003,), hold=2.0),
        RampHold(depths=(0.002, 0.004), hold=1.5, speed=0.005, turn=0.2, surface=TILTED, place=(0.01, 0.0)),
    ],
    "multi-sine": [MultiSine(bias=0.004), MultiSine(bias=0.003, amplitudes=(1e-3,), frequencies=(3.0,))],
    "lifted-motion": [LiftedTrajectory(of=Point(bias=0.004), lift=0.02, pace=0.25)],
    "moved": [TranslatedTrajectory(of=Point(bias=0.004), by=(0.01, -0.02))],
    "stay": [Stay(), Stay(height=0.02, place=(0.01, 0.0), duration=2.0)],
    "shake": [Shake(), Shake(frequencies=(2.0, 5.0), amplitude=0.001, duration=3.0)],
    "chirp": [Chirp(bias=0.004), Chirp(bias=0.004, first_frequency=5.0, last_frequency=0.5, surface=TILTED)],
    "line-sweep": [
        LineSweep(end=(0.0, 0.02), settle=1.0, press=PRESS),
        LineSweep(start=(-0.01, 0.003), end=(0.02, -0.02), settle=0.0, speed=0.006, press=PRESS, surface=TILTED),
    ],
    "raster": [
        Raster(size=(0.02, 0.01), pitch=0.005, press=PRESS),
        Raster(size=(0.02, 0.01), pitch=0.004, press=PRESS, boustrophedon=False, angle=0.4, dwell=0.3, surface=TILTED),
        Raster(size=(0.02, 0.01), pitch=0.005, press=PRESS, first_line=2),
    ],
    "grid-points": [
        GridPoints(size=(0.01, 0.01), pitch=0.005, duration=1.0, press=PRESS, surface=TILTED),
        GridPoints(places=((0.0, 0.0), (0.01, 0.0), (0.0, 0.0)), duration=1.3, press=PRESS),
    ],
}


@pytest.mark.parametrize(
    "trajectory", [pytest.param(t, id=f"{name}-{i}") for name, group in EXAMPLES.items() for i, t in enumerate(group)]
)
def test_it_keeps_the_promises_of_a_trajectory(trajectory):
    check_trajectory(trajectory)


def test_every_trajectory_is_among_the_examples():
    assert set(EXAMPLES) | {"from-file"} == set(palpate_trajectories())


def test_waypoints_of_a_file(tmp_path):
    path = tmp_path / "way.csv"
    path.write_text(WAYPOINTS)
    motion = FromFile(file=path)
    check_trajectory(motion)
    assert motion.total_duration == 5.0
    assert motion.at(np.array([2.0])).position[0] == pytest.approx([0.001, 0.0, -0.002], abs=1e-12)


@pytest.mark.slow
def test_a_map_of_heights_is_followed(bumpy):
    sweep = LineSweep(start=(-0.03, -0.02), end=(0.03, 0.02), settle=0.5, press=PRESS, surface=bumpy)
    check_trajectory(sweep)
    setpoint = sweep.at(np.array([8.0]))
    x, y, z = setpoint.position[0]
    assert abs(z - 0.002 * np.sin(40 * x) * np.cos(30 * y) + 0.004) < 0.00101


def test_the_plane_through_three_touches():
    plane = NominalHeight(touches=((0.0, 0.0, 0.001), (0.01, 0.0, 0.002), (0.0, 0.02, 0.0)))
    height, along_x, along_y = plane.at(np.array([0.01, 0.005]), np.array([0.02, 0.0]))
    assert height == pytest.approx([0.001, 0.0015])
    assert along_x == pytest.approx([0.1, 0.1])
    assert along_y == pytest.approx([-0.05, -0.05])


def test_a_sweep_has_its_speed_and_its_time():
    sweep = LineSweep(start=(0.01, 0.0), end=(0.04, 0.04), settle=10.0, speed=0.005, ramp=0.2, press=PRESS)
    begin = 1.0 + 0.9
    time = np.arange(begin + 10.3, begin + 10.0 + 9.9, 0.01)
    assert np.linalg.norm(sweep.at(time).velocity[:, :2], axis=1) == pytest.approx(0.005, abs=1e-12)
    assert sweep.total_duration == pytest.approx(begin + 10.0 + 0.05 / 0.005 + 0.2 + 0.9)
    still = sweep.at(np.array([begin + 0.01, begin + 9.99]))
    assert still.position[:, 0] == pytest.approx(0.01)
    assert still.measuring.all()


def test_a_raster_visits_every_line_and_goes_on_where_it_was_stopped():
    raster = Raster(size=(0.06, 0.04), pitch=0.005, press=PRESS, angle=np.pi / 2, centre=(0.01, 0.02))
    assert raster.lines == 9
    time = np.arange(0.0, raster.total_duration, 0.01)
    setpoint = raster.at(time)
    place = setpoint.position[setpoint.measuring]
    assert place[:, 1].min() == pytest.approx(0.02 - 0.03, abs=1e-9)
    assert place[:, 1].max() == pytest.approx(0.02 + 0.03, abs=1e-9)
    fast = np.abs(setpoint.velocity[setpoint.measuring][:, 1]) > 3.9e-3
    assert sorted({round(1e3 * x) for x in place[fast, 0]}) == [-10, -5, 0, 5, 10, 15, 20, 25, 30]
    half = raster.after(raster.total_duration / 2)
    assert half.first_line == 4
    assert raster.after(raster.total_duration) is None
    rest = half.at(np.arange(0.0, half.total_duration, 0.01))
    assert len({round(1e3 * x) for x in rest.position[:, 0]}) >= 5
    assert half.after(1.0).first_line == 4


def test_load_unload_is_as_deep_and_as_fast_as_it_says():
    cycles = LoadUnload(depth=0.005, speeds=(0.002, 0.006), cycles=2)
    time = np.arange(0.0, cycles.total_duration, 1e-3)
    setpoint = cycles.at(time)
    assert setpoint.position[:, 2].min() == pytest.approx(-0.005, abs=1e-8)
    speed = np.abs(setpoint.velocity[:, 2])
    assert speed.max() == pytest.approx(0.006)
    assert np.mean(np.isclose(speed, 0.002)) > 0.5
    bottoms = np.diff(np.sign(setpoint.velocity[:, 2])) > 0
    assert np.count_nonzero(bottoms & (setpoint.position[1:, 2] < -0.004)) == 4


def test_a_chirp_ends_at_its_last_frequency():
    chirp = Chirp(bias=0.004, amplitude=0.001, first_frequency=0.5, last_frequency=5.0, duration=10.0)
    time = np.arange(0.0, chirp.total_duration, 1e-3)
    setpoint = chirp.at(time)
    speed = np.abs(setpoint.velocity[setpoint.measuring, 2])
    assert speed[:1500].max() == pytest.approx(2 * np.pi * 0.5 * 0.001, rel=0.35)
    assert speed[-300:].max() == pytest.approx(2 * np.pi * 5.0 * 0.001, rel=0.1)


def test_a_short_way_is_short():
    places = [(x, y) for x in range(5) for y in range(4)]
    order = short_order(places)
    assert sorted(order) == list(range(20))
    way = sum(np.hypot(*np.subtract(places[a], places[b])) for a, b in itertools.pairwise(order))
    assert way <= 21.0  # 19 is the shortest there is


@pytest.mark.parametrize(
    ("part", "settings", "word"),
    [
        (Raster, {"size": (0.06, 0.04), "pitch": 0.0, "press": PRESS}, "pitch"),
        (Raster, {"size": (0.06, 0.04), "pitch": 0.05, "press": PRESS}, "pitch"),
        (Raster, {"size": (0.06, 0.04), "pitch": 1e-6, "press": PRESS}, "lines"),
        (Raster, {"size": (0.06, 0.04), "pitch": 0.005, "speed": 0.05, "press": PRESS}, "periods"),
        (Raster, {"size": (0.06, 0.04), "pitch": 0.005, "first_line": 9, "press": PRESS}, "first_line"),
        (LineSweep, {"end": (0.0, 0.0), "press": PRESS}, "the same place"),
        (LineSweep, {"end": (0.0, 0.01), "speed": 0.1, "press": PRESS}, "periods"),
        (PressShape, {"bias": 0.004, "amplitude": 0.004}, "amplitude"),
        (PressShape, {"bias": 0.02, "amplitude": 0.01, "frequency": 10.0}, "m/s"),
        (GridPoints, {"press": PRESS}, "places"),
        (GridPoints, {"size": (0.06, 0.04), "pitch": 1e-5, "press": PRESS}, "points"),
        (GridPoints, {"places": ((0.0, 0.0),), "order": (1,), "press": PRESS}, "order"),
        (LoadUnload, {"depth": 0.005, "speeds": (0.0,)}, "speed"),
        (LoadUnload, {"depth": 0.001, "clearance": 0.001, "speeds": (0.1,)}, "never reached"),
        (Compression, {"strain": 1.5}, "strain"),
        (MultiSine, {"bias": 0.004, "amplitudes": (1e-3,), "frequencies": (1.0, 2.0)}, "amplitudes"),
        (MultiSine, {"bias": 0.001, "amplitudes": (1e-3,), "frequencies": (1.0,)}, "bias"),
        (Chirp, {"bias": 0.004, "last_frequency": 60.0}, "m/s"),
        (NominalHeight, {"touches": ((0.0, 0.0, 0.0), (0.01, 0.0, 0.0), (0.02, 0.0, 0.0))}, "one line"),
        (NominalHeight, {"tilt_x": 1.0}, "tilt_x"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_by_name(part, settings, word):
    with pytest.raises(ConfigurationError, match=word):
        part(**settings)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("0,0,0,0.005\n1,0,0,nan\n", "finite"),
        ("0,0,0,0.005\n0,0,0,0.004\n", "increase"),
        ("0,0,0,0.005\n1,0,0,-0.05\n2,0,0,0.005\n", "allowed"),
        ("0,0,0\n1,0,0\n", "columns"),
        ("a,b\nc,d\n", "read"),
        ("0,0,0,0.005\n2,0,0,0.006\n", "measuring"),
    ],
)
def test_a_bad_file_of_waypoints_is_refused(tmp_path, text, word):
    path = tmp_path / "way.csv"
    path.write_text(text)
    with pytest.raises(Exception, match=word):
        FromFile(file=path)


def test_a_ramp_and_its_holds_are_straight_and_still():
    """Depths are held exactly, the ramp has its speed, and nothing after the last hold is measured."""
    motion = RampHold(depths=(0.002, 0.003), hold=2.0, speed=0.01, turn=0.05, standstill=0.5)
    time = np.arange(0.0, motion.total_duration, 1e-3)
    found = motion.at(time)
    depth, speed = -found.position[:, 2], -found.velocity[:, 2]
    for held in (0.002, 0.003):
        assert np.count_nonzero(np.abs(depth - held) < 1e-12) == pytest.approx(2000, abs=2)
    assert speed.max() == pytest.approx(0.01, rel=1e-9)
    last = np.flatnonzero(np.abs(depth - 0.003) < 1e-12)[-1]
    assert not found.measuring[last + 1 :].any()
    assert found.measuring[500:last].all()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"depths": (0.003, 0.002)}, "increase"),
        ({"depths": ()}, "depths"),
        ({"depths": (0.003,), "turn": 1.0}, "never reached"),
        ({"depths": (0.002, 0.0021), "turn": 0.1}, "never reached"),
    ],
)
def test_ramps_that_cannot_be_are_refused(wrong, said):
    with pytest.raises(ConfigurationError, match=said):
        RampHold(**wrong)
