"""``palpate acceptance`` on a twin by the real clients: what takes a process of its own, such as signals and kills."""

import json

import pytest

from tests.devices.acceptance_hand import Person
from tests.devices.conftest import ALERT
from tests.devices.simulated_bench import PIPELINE

pytestmark = [pytest.mark.slow, pytest.mark.live]

# A computer with other work: what a run notices by itself it notices later, and it misses ticks while it brakes.
BUSY = (
    "safety.latency=0.3 s",
    "safety.deceleration=0.2 m/s^2",
    "safety.stop_force=8 N",
    "device.arm.approach_speed=10 mm/s",
)


def gone_through(bench, tmp_path, steps, before=()):
    """Exit code, errors and acceptance.json of some steps."""
    twin = bench(*ALERT, *BUSY)
    words = [word for step in steps for word in ("--step", step)]
    person = Person(twin, tmp_path / "a", str(PIPELINE), *words, before=before)
    code, out = person.go_through()
    table = json.loads((tmp_path / "a" / "acceptance.json").read_text())
    assert "to sign" in out
    return code, person.said, {step["name"]: step for step in table["steps"]}, table


def test_a_sound_rig_passes_whatever_stops_it(bench, tmp_path):
    names = [f"free-air/{step}" for step in ("ctrl-c", "kill-all")]
    code, said, steps, table = gone_through(bench, tmp_path, names)
    assert {name: step["problems"] for name, step in steps.items()} == {name: [] for name in names}, said
    assert code == 0
    assert table["verdict"] == "passed in part"
    assert steps["free-air/kill-all"]["told"] == ""
    assert "signature: ___" in (tmp_path / "a" / "acceptance.md").read_text()


def test_a_run_that_stands_still_goes_on_for_as_long_as_it_may(bench, tmp_path):
    """Whether that is a few milliseconds more than `host_timeout` is up to other work of the computer, not the rig."""
    _, said, steps, _ = gone_through(bench, tmp_path, ["free-air/stall"])
    stall = steps["free-air/stall"]
    assert 0.5 < stall["measured"]["reaction"] < 1.5, said
    assert "it goes too far" not in stall["problems"]
    told = stall["told"]  # by the servo process, or by the program itself when it goes on
    assert "no sign of life" in told or "this program was held up" in told


def test_a_rig_whose_stops_are_slow_fails(bench, tmp_path):
    code, said, steps, table = gone_through(bench, tmp_path, ["free-air/estop"], ("slow-stop 0.02",))
    assert code == 1
    assert "stops worse than [safety] declares" in said
    assert table["verdict"] == "failed"
    assert "it brakes too softly" in steps["free-air/estop"]["problems"]


def test_what_was_measured_stays_where_the_person_goes(bench, tmp_path):
    """One answer, that there is free air; none, as foam is to be laid under the tip."""
    twin = bench(*ALERT, *BUSY)
    person = Person(twin, tmp_path / "a", str(PIPELINE), "--step", "free-air/ctrl-c", "--step", "foam/ctrl-c")
    code, _ = person.go_through(answers=1)
    assert code == 2
    assert "no answer: the acceptance needs a person" in person.said
    table = json.loads((tmp_path / "a" / "acceptance.json").read_text())
    assert [step["name"] for step in table["steps"]] == ["free-air/ctrl-c"]
    assert "not done: free-air/estop" in (tmp_path / "a" / "acceptance.md").read_text()
    assert twin.wait_at_rest()["joint_speed"] < 1e-3
