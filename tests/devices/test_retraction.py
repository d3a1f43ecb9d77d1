"""A second fault while the arm leaves: it is named, with where the tip stands, by what the twin's arm did."""

import re

import pytest

STOP = 1.0  # [N]; the press of the example passes it on its way in
LOW = (f"safety.stop_force={STOP} N",)
# Second fault -> what is said of it.
SECOND = {
    "protective-stop": "the robot is in a protective stop; look for its cause",
    "stop-program": "the robot's program was stopped",
    "half-open 20": "that link is mute, and commands did not arrive",
    "freeze": "the controller is silent",
}


class TurnedRound:
    """A condition that holds as soon as the tip, in the material, has turned round: some 50 ms after the stop."""

    lowest = 0.0

    def __call__(self, state):
        self.lowest = min(self.lowest, state["height"])
        return self.lowest < -3e-4 and state["height"] > self.lowest + 2e-5


@pytest.mark.slow
@pytest.mark.parametrize("fault", SECOND)
def test_a_retraction_that_fails_is_named_with_where_the_tip_stands(rig, fault):
    error, table, _ = rig.run_into(fault, TurnedRound(), *LOW)
    height = 1e3 * float(rig.world.position[2])
    assert height < 0.0  # it stayed in the material
    assert error.startswith("the force is 1."), error
    assert "the arm was to leave, and that has failed: " in error
    assert SECOND[fault] in error, error
    told = re.search(r"(?:stands|at last it was) at a height of (-?[\d.]+) mm and (?:feels|felt) ([\d.]+) N", error)
    assert ("PRESS THE EMERGENCY STOP" in error) == (fault == "freeze")  # without states nobody sees it stand
    assert float(told[1]) == pytest.approx(height, abs=0.3)
    assert 0.2 < float(told[2]) < 3.0
    assert "lift the tip in freedrive" in error
    assert table["run"]["live"]["stop"]["reason"] in error
