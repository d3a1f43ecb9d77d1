"""A servo loop that the host holds up, in virtual time: no false alarm, no haste, and the right cause."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from palpate_arms.arm_loop import ArmLoop
from palpate_arms.arm_rest import Rest
from palpate_arms.arm_state import ArmState
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw
from palpate_arms.servo_pace import Beat, next_deadline
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_kit.kinematics.rotations import matrix_of
from palpate_kit.kinematics.ur_arm import UR3E
from palpate_kit.kinematics.work_frame import WorkFrame
from palpate_simulation.twins.arm import TICK, SimulatedArm
from palpate_simulation.twins.controller import Controller

WORK = WorkFrame.model_construct(origin=(-0.3, -0.13, 0.1), rotation=(0.0, 0.0, 0.0), turn=0.0)
TOOL = matrix_of([0.0, 0.0, 0.12, 0.0, 0.0, 0.0])
POSTURE = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])
SPEED, LAG = 0.04, 0.0045  # of the servo's default settings
LIMITS = {
    "say": "limits",
    "low": (-0.005, -0.005, -0.007),
    "high": (0.005, 0.005, 0.02),
    "speed": SPEED,
    "acceleration": 2.0,
    "orientation": np.radians(5.0),
    "angular_speed": np.radians(10.0),
}
SETTINGS = {
    "controller_timeout": 5.0,
    "host_timeout": 10.0,
    "work": WORK.model_dump(),
    "own": {"joint_speed": 1.5, "tracking": 0.01, "links_low": (-2, -2, 0), "links_high": (2, 2, 2), "lag": LAG},
    "law": {
        "control": "pd", "gain": 20.0, "damping": 0.5, "approach_speed": 0.02, "retract_speed": 0.04,
        "acceleration": 1.0, "angular_speed": np.radians(10.0), "lever": 0.12,
    },
}  # fmt: skip
TICK_NS = round(PERIOD * 1e9)


class VirtualRobot:
    """The twin's arm at the other end of the servo loop's commands, with the noise of a real one."""

    tool, model, state_period, stamp = TOOL, UR3E, PERIOD, 0.0
    driver = SimpleNamespace(unheard=0.0, ahead=0.0, has_watchdog=True)  # each command is taken in its tick

    def __init__(self, height, seed=0):
        goal = WORK.tool_pose(np.array([0.0, 0.0, height]))
        self.arm = SimulatedArm(UR3E.joints_at(goal, TOOL, POSTURE, steps=100), TOOL)
        self.noise = np.random.default_rng(seed)
        self.seen, self.fresh, self.fastest = 0, True, 0.0
        self.pass_on()

    def tick(self):
        before = self._place()
        self.arm.advance()
        self.fastest = max(self.fastest, float(np.linalg.norm(self._place() - before)) / TICK)

    def _place(self):
        return UR3E.tip(self.arm.q.tolist(), TOOL)[0][:3, 3]

    def pass_on(self):
        """The servo loop sees a new state."""
        pose, jacobian = UR3E.tip(self.arm.q.tolist(), TOOL)
        out = WORK.matrix[:3, :3]
        place = out.T @ (pose[:3, 3] - WORK.matrix[:3, 3]) + self.noise.normal(0, 5e-6, 3)
        speed = out.T @ (jacobian[:3] @ self.arm.qd) + self.noise.normal(0, 0.67e-3, 3)
        self.state, self.fresh = (place, speed, pose[:3, :3], self.arm.q.tolist()), True

    def look(self):
        fresh, self.fresh = self.fresh, False
        return ArmState(*self.state, fresh)

    def turn(self):
        return np.zeros(3)

    def servo(self, position, turn):
        target = WORK.tool_pose(position)
        self.arm.servo(UR3E.joints_at(target, TOOL, self.arm.q, steps=15), 0.03, 1000.0)
        return True


def sine(peak, frequency=2.0, duration=1.0):
    """Setpoints (n, 7) whose speed has this peak [m/s], about 6 mm over the skin; they begin and end at rest."""
    time = np.arange(round(duration / PERIOD)) * PERIOD
    swing = peak / (2 * np.pi * frequency)
    rows = np.zeros((len(time), 7))
    rows[:, 2] = 0.006 + swing * np.cos(2 * np.pi * frequency * time)
    rows[:, 5] = -peak * np.sin(2 * np.pi * frequency * time)
    return rows


def steady(speed, duration=0.8):
    """Setpoints (n, 7) that go down from 6 mm at one speed [m/s]."""
    time = np.arange(round(duration / PERIOD)) * PERIOD
    rows = np.zeros((len(time), 7))
    rows[:, 2], rows[:, 5] = 0.006 - speed * time, -speed
    return rows


def driven(rows, held_up, unseen=0.0, jam=np.inf, longest=6.0):
    """The real servo loop, cycle by cycle, told elapsed times of which some are illegal: its verdicts, and the arm.

    `held_up()` says by how much [s] the host comes late to a cycle; `unseen` is the share of states that nobody sees.
    """
    told, robot, chance = [], VirtualRobot(float(rows[0, 2])), np.random.default_rng(1)
    parent = SimpleNamespace(tell=lambda word, **facts: told.append(facts["text"]))
    loop = ArmLoop(parent, None, robot, SETTINGS)
    commander = loop._commander = Commander(loop._law, robot.look().position)
    loop._obey(LIMITS, commander)
    loop._fence.begin(commander.command)
    commander.follow(Plan.of(rows))
    now = deadline = ticked = cycles = 0
    try:
        while commander.mode != "done" and now < longest * 1e9:
            now = max(deadline, now) + round(1e9 * held_up())
            while ticked + TICK_NS <= now:
                ticked += TICK_NS
                robot.arm.jammed = ticked > jam * 1e9
                robot.tick()
                if chance.random() >= unseen:
                    robot.pass_on()
                    robot.seen = ticked
            loop._command(commander, now)
            cycles += 1
            deadline, left_out = next_deadline(deadline, now, now)
            commander.held_up(left_out)
    except SystemExit:
        pass
    return told, robot, cycles, now / 1e9


@pytest.fixture(autouse=True)
def _ends_by_an_exception(monkeypatch):
    def end(code):
        raise SystemExit(code)

    monkeypatch.setattr("os._exit", end)
    monkeypatch.setattr(
        "palpate_arms.arm_exit.ArmExit._come_to_rest", lambda self, commander, fault, at_once: Rest(True)
    )


def sometimes(length, every):
    """Held up for so long [s], once in so many cycles."""
    chance = np.random.default_rng(2)
    return lambda: length if chance.random() < 1 / every else chance.uniform(0.0, 0.3e-3)


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("share", "length", "late"),
    [(0.9, 0.003, 0.03), (0.9, 0.008, 0.1), (0.5, 0.030, 0.4), (1.0, 0.008, 0.2), (0.9, 0.100, 1.5)],
)
def test_a_hold_up_is_no_fault_and_makes_no_jump(share, length, late):
    """At a part of the speed limit, held up once in 50 cycles: it keeps time where it can, and its limits always."""
    rows = sine(share * SPEED)
    told, robot, cycles, lasted = driven(rows, sometimes(length, 50))
    assert told == []
    assert robot.fastest < 1.02 * SPEED
    assert lasted >= (cycles - 1) * PERIOD  # never more commands than periods
    planned = len(rows) * PERIOD + 0.15
    assert planned - 0.01 < lasted < planned + late


@pytest.mark.parametrize(("rows", "unseen"), [(steady(0.01), 0.0), (steady(0.01), 0.5), (sine(0.036), 0.0)])
def test_a_jam_is_told_for_a_jam_however_busy_the_host_is(rows, unseen):
    told, robot, _, lasted = driven(rows, sometimes(0.008, 50), unseen, jam=0.3)
    assert re.search("has moved by|does not follow", told[0])
    assert lasted < 0.3 + 0.3
    assert robot.fastest < 1.02 * SPEED


def test_what_has_passed_is_left_out_and_the_grid_stays():
    due = 1_000_000_000
    for late, left_out in ((0.0, 0), (0.49, 0), (0.51, 1), (1.49, 1), (1.51, 2), (5.51, 6)):
        sent = due + round(late * TICK_NS)
        assert next_deadline(due, sent, sent) == (due + (left_out + 1) * TICK_NS, left_out)
    for late, left_out in ((0.9, 0), (1.49, 0), (1.51, 1), (5.51, 5)):  # sent in time, and held up after that
        now = due + round(late * TICK_NS)
        assert next_deadline(due, due, now) == (due + (left_out + 1) * TICK_NS, left_out)


@pytest.mark.parametrize("seed", range(3))
def test_the_controller_never_reads_two_commands_in_a_tick_while_its_messages_take_a_tenth(seed):
    """A host that holds the loop up as it likes, before a command, within it and after it."""
    rng = np.random.default_rng(seed)
    deadline, now, sent = round(0.3 * TICK_NS), 0, []
    for _ in range(5000):
        held = rng.exponential(1e6, 3) * (rng.random(3) < 0.1)
        now = max(now, deadline) + round(held[0] + rng.uniform(0.1e6, 0.3e6) + held[1])
        sent.append(now)
        deadline, _ = next_deadline(deadline, now, now := now + round(held[2]))
    arrived = np.array(sent) + rng.uniform(0, 0.05e6, len(sent))
    assert np.diff(arrived // TICK_NS).min() >= 1


def test_a_table_is_made_up_for_a_tenth_faster_and_to_the_bit_where_nothing_was_held_up():
    rows = sine(0.02)
    law = ServoLaw("servo", 20.0, 0.5, 0.02, 0.04, 1.0, max_speed=SPEED)
    told = {}
    for held_up in (0, 20):
        commander = Commander(law, rows[0, :3])
        commander.follow(Plan.of(rows))
        places = [commander.command]
        while commander.mode != "done":
            places.append(commander.next(places[-1], np.zeros(3)))
            if held_up and len(places) == 200:
                commander.held_up(held_up)
        told[held_up] = np.array(places)[:, 2]
    np.testing.assert_array_equal(told[0][-len(rows) :], rows[:, 2])
    assert len(told[0]) - len(told[20]) == pytest.approx(20, abs=1)  # all of it is made up for
    assert np.abs(np.diff(told[20])).max() < 1.1001 * np.abs(np.diff(told[0])).max()


@pytest.mark.parametrize(
    ("written", "late", "read"), [(5, 4, [0, 1, 2, 3, 4]), (3, 0, [2]), (4, 1, [1, 3]), (1, 2, [7, 7, 0])]
)
def test_a_twin_that_is_late_reads_each_command_in_its_own_tick(written, late, read):
    """Else ten commands that came while its process slept would be one leap of the arm."""
    controller = Controller(SimulatedArm(POSTURE.copy(), TOOL), 0.0, 0.0, 0)
    controller.inputs["input_double_register_0"] = 7.0
    for number in range(written):
        controller.write({"input_double_register_0": float(number)})
    controller.date((late + 1) * TICK)
    found = []
    for _ in range(late + 1):
        controller.tick()
        found.append(controller.inputs["input_double_register_0"])
    assert found == read


def test_a_twin_that_is_late_knows_when_commands_came():
    """By the kernel's stamp of their arrival, not by when its own process looked."""
    controller = Controller(SimulatedArm(POSTURE.copy(), TOOL), 0.0, 0.0, 0)
    found = []
    for came, value in ((0.9, 1.0), (2.9, 2.0)):  # both read late, after the third tick
        controller.write({"input_double_register_0": value})
        controller.date(came * TICK)
    for _ in range(3):
        controller.tick()
        found.append((controller.inputs["input_double_register_0"], controller.read))
    assert found == [(1.0, 1), (1.0, 0), (2.0, 1)]


@pytest.mark.parametrize("phase", [0.0, 0.3e-3, 1.1e-3, 1.9e-3])
@pytest.mark.parametrize("wander", [-100e-6, 0.0, 100e-6])
def test_cycles_begin_when_the_controller_has_sent_its_state(phase, wander):
    """A controller of another phase and clock, whose states are seen up to a period late."""
    beat, rng = Beat(), np.random.default_rng(1)
    deadline, period = 0, round(1e9 * PERIOD)
    off, moved = [], []
    for number in range(2000):
        tick = round((number * PERIOD * (1.0 + wander) + phase) * 1e9)
        beat.saw(round(number * PERIOD * 1e9), tick + round(rng.uniform(0.1e6, 2.0e6)))
        moved.append(beat.correction(deadline))
        deadline += period + moved[-1]
        off.append((deadline - tick) % period)
    assert min(off[800:]) > 0.1e6  # [ns] from the last tick
    assert max(off[800:]) < 0.6e6
    assert np.abs(moved).max() <= 0.0025 * period


def test_an_arm_that_leaves_because_the_main_job_is_silent_says_so():
    """A motion that ends early for it would be taken for a whole one."""
    told, robot, rows = [], VirtualRobot(0.003), sine(0.02)
    parent = SimpleNamespace(tell=lambda word, **facts: told.append(facts["text"]), messages=list, gone=False)
    beaten = SimpleNamespace(head=np.zeros(64, np.int64), last_beat=lambda host: 1_000_000_000)
    loop = ArmLoop(parent, beaten, robot, SETTINGS)
    commander = loop._commander = Commander(loop._law, robot.look().position)
    commander.follow(Plan.of(rows))
    loop._listen(10_900_000_000)
    assert (commander.mode, told) == ("approach", [])
    loop._listen(11_100_000_000)
    assert commander.mode == "retract"
    loop._listen(11_200_000_000)
    assert len(told) == 1
    assert "the main job gave no sign of life for 10100 ms" in told[0]
