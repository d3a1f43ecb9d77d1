"""Sensors that lie smoothly, on a rig of 27 N/mm: judged by what the twin's arm did, in simulated time."""

from pathlib import Path

import pytest
from palpate import DeviceError, clock
from palpate_engine.safety import check_motion

from tests.devices.simulated_bench import PIPELINE
from tests.devices.test_late_readings import STIFF, stiff  # noqa: F401  (a fixture)

SAFETY_CASE = Path(__file__).parents[2] / "docs" / "safety-case.md"
GRID = (
    'type = "grid-points"\nsize = ["8 mm", "0 mm"]\npitch = "4 mm"\nduration = "0.5 s"\nsettle = "0.1 s"\n'
    'travel_speed = "20 mm/s"\n'
    'press = { bias = "0.5 mm", amplitude = "0.1 mm", frequency = "2 Hz", clearance = "3 mm", speed = "2 mm/s" }\n'
)


@pytest.fixture
def points(simulated, tmp_path):
    """The same rig on three points, 0.6 mm deep: 6 N."""
    text = PIPELINE.read_text()
    begin, end = text.index("[trajectory.press]"), text.index("[alignment]")
    file = tmp_path / "points.toml"
    file.write_text(f"{text[:begin]}[trajectory.points]\n{GRID}\n{text[end:]}")
    return simulated(*STIFF, "safety.standstill=0.5 s", pipeline=file)


def lied_to_from_the_start(rig, fault):
    """What a run ends with whose sensor lies before it begins."""
    clock().sleep(0.1)
    rig.fault(fault)
    clock().sleep(0.1)
    try:
        rig.run()
    except DeviceError as error:
        return str(error)
    return "it came to its end"


@pytest.mark.slow
def test_a_cable_that_pulls_on_the_way_down_stops_it_in_the_air(stiff):  # noqa: F811
    """Before, 8 N made 20.2 of 12."""
    rig = stiff()
    error, _, _ = rig.run_into("push 0 0 -8", lambda state: 1e-3 < state["height"] < 2e-3)
    assert "before a contact was felt: is something pulling at the cable" in error
    assert rig.truth.force < 0.1


@pytest.mark.slow
def test_a_wrong_sign_stops_it_at_the_first_newton(stiff):  # noqa: F811
    """Before, 13.3 N."""
    rig = stiff()
    assert "count the other way round ([alignment] force sign = -1)?" in lied_to_from_the_start(rig, "sign")
    assert rig.truth.force < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("level", "most"), [(10.0, 13.0), (4.0, 6.0)])
def test_a_number_that_has_passed_its_end_stops_the_touch(stiff, level, most):  # noqa: F811
    """Of a sensor that states no range: the force seems to fall, and rises again from the other end."""
    rig = stiff()
    assert "where any contact gives" in lied_to_from_the_start(rig, f"wrapped-force {level}")
    assert level < rig.truth.force < most
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material


@pytest.mark.slow
def test_a_material_stiffer_than_stated_stops_the_touch(stiff):  # noqa: F811
    """12 N stopped it before; nothing else is wrong with the rig."""
    rig = stiff("safety.stiffness=3 N/mm")
    with pytest.raises(DeviceError, match=r"the stiffest material gives .* N \(\[safety\] stiffness = 3 N/mm\)"):
        rig.run()
    assert rig.truth.force < 3.0
    assert rig.wait_at_rest()["height"] > 2e-3  # it has left the material


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("old-force 0.5", "too late"),
        ("forgotten-force 1", "before a contact was felt"),
        ("push 0 0 0.5", "in free air"),
    ],
)
def test_from_touch_to_touch_the_zero_in_free_air_is_compared(points, fault, words):
    """Forces that are old or forgotten, and a cable, show at the first or the second touch."""
    rig, seen = points, []
    if fault.startswith("push"):
        error, _, _ = rig.run_into(
            fault, lambda state: seen.append(state["height"]) or (min(seen) < 0.0 and state["height"] > 2.8e-3)
        )
    else:
        error = lied_to_from_the_start(rig, fault)
    assert words in error
    assert rig.truth.force < 7.0
    assert rig.truth.high[0] < 2e-3  # the third point was not palpated


@pytest.mark.slow
def test_sound_touches_are_not_stopped(points):
    assert points.run().interrupted is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "force"),
    [
        ("reduced-force 0.102", 66.2),
        ("compressed-force", 66.2),
        ("old-force 0.5", 65.8),
        ("reduced-force 0.5", 24.2),
        ("deadened-force 10", 23.6),
        ("forgotten-force 1", 13.6),
    ],
)
def test_what_stays_unseen_in_a_first_touch_stands_in_the_safety_case(stiff, fault, force):  # noqa: F811
    """3 mm into an unknown material: what bounds the force is the depth."""
    rig = stiff()
    lied_to_from_the_start(rig, fault)
    assert rig.truth.force == pytest.approx(force, abs=0.5)
    assert f"{force:.1f} N" in SAFETY_CASE.read_text()
    pipeline = rig.pipeline()
    assert force < check_motion(pipeline.trajectories["press"], pipeline.safety).unfelt_force < 82.0
