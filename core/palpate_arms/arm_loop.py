"""The servo loop of an arm, at 500 Hz: every state and every command is checked before the command is sent."""

from __future__ import annotations

import math
from typing import Any, NoReturn

import numpy as np
from palpate import ForceLaw, clock
from palpate_kit.acquisition.child import Parent
from palpate_kit.acquisition.ring import Ring
from palpate_kit.kinematics.work_frame import WorkFrame

from palpate_arms.arm_driver import ArmFaultError, GarbledStateError
from palpate_arms.arm_exit import ArmExit
from palpate_arms.arm_lag import LagMeter, deflection
from palpate_arms.arm_rows import RETRACT, STOP
from palpate_arms.arm_state import ArmState
from palpate_arms.arm_watch import ArmWatch
from palpate_arms.commanded_arm import CommandedArm
from palpate_arms.driver_answer import driver_error
from palpate_arms.fence import Fence
from palpate_arms.force_watch import ForceEye
from palpate_arms.motion_offer import MotionOffer
from palpate_arms.obedience import Obedience
from palpate_arms.posture_fence import Verdict
from palpate_arms.servo import Commander
from palpate_arms.servo_law import ServoLaw, tick_room
from palpate_arms.servo_pace import Beat, Pace
from palpate_arms.setpoint_buffer import PERIOD, Plan
from palpate_arms.setpoint_rows import SETPOINT
from palpate_arms.station_plane import StationPlane

_SECOND = 1e9  # [ns]
_MS = 1e3  # per second
# Choices.
_BLIND = 1.15e9  # [ns] without a new state, for each second between two: 2.3 ms at 500 Hz (0151)
_UNHEARD = 0.005  # [s] without a command taken: a link that holds commands back delivers them at once (0213)
_EXPLAIN_PERIODS = 10  # in which the state that says why a command was refused arrives on its own connection
_LISTEN_EVERY = 5  # periods; stopping uses shared memory and does not wait
_FIRST_MODES = ("retreat", "stay")  # in which the arm shows whether it can be moved at all
_MOVING = (*_FIRST_MODES, "approach", "follow")


class ArmLoop:
    """Holds, approaches, follows, retreats, retracts and stops an arm, whoever makes it."""

    def __init__(self, parent: Parent, ring: Ring, robot: CommandedArm, settings: dict[str, Any]) -> None:
        """Take a connected arm, and the task of its process as plain data; nothing moves before limits are set."""
        self._parent, self._ring, self._robot = parent, ring, robot
        self._own = settings["own"]  # facts and limits of the arm itself: joint speed, lag, deadband, box of its links
        self._host_timeout = settings["host_timeout"]
        self._law = ServoLaw(**settings["law"])
        work = WorkFrame.model_construct(**settings["work"])
        self._fence = Fence(settings["own"], work, robot.tool, robot.model, self._law.acceleration)
        self._commander: Commander | None = None  # from the first state on
        self._eye: ForceEye | None = None  # the force, once it is to be watched
        self._setpoint = np.zeros(SETPOINT.size)
        self._offered: MotionOffer | None = None  # a motion that is being checked
        self._cycles = 0
        timeout = settings["controller_timeout"]
        self._watch = ArmWatch(robot, timeout)
        self._exit = ArmExit(parent, ring, robot, self._record_at_rest, timeout)
        self._beat, self._lag = Beat(), LagMeter()
        self._obedience = Obedience(robot, self._fence, settings["own"], self._law.gives_way)

    def run(self) -> NoReturn:
        """Run one cycle after another, each at its deadline; an error ends the process, and the motion, at once."""
        try:
            Pace(self._ring, self._beat, lambda: self._following).run(self._cycle, self._take_state)
        except ArmFaultError as fault:
            self._fail(fault)
        except Exception as error:
            text = driver_error(error, self._robot.driver)
            self._fail(ArmFaultError(text or f"its servo loop failed: {type(error).__name__}: {error}"))

    @property
    def _following(self) -> bool:
        """True while a plan is followed, whose lateness is counted."""
        return self._commander is not None and self._commander.mode == "follow"

    def _cycle(self, now: int, left_out: int) -> None:
        """Do a period at a time [ns]: state, checks, orders, force, and a command; `left_out` periods had none."""
        self._robot.driver_time.end_cycle()
        if left_out and self._commander is not None:
            self._commander.held_up(left_out)
        # The newest state, whatever it shows, and the orders of the main job.
        self._take_state()
        self._check(now)
        self._listen(now)
        robot, commander = self._robot, self._commander
        if commander is None:
            return
        # A motion that is offered, the force, and a driver that shows in its first motion that it is too slow.
        if self._offered is not None:
            self._check_offer(self._offered, commander)
        self._check_force(commander, now)
        if commander.mode in _FIRST_MODES and (text := self._unfit_driver()) is not None:
            self._refuse(text, commander)
        if commander.mode == "done":
            self._finish()
        # A command, or at rest a sign of life.
        self._setpoint = commander.setpoint
        if commander.mode == "hold" or self._obedience.must_wait(now):
            robot.feed_watchdog()
            return
        self._command(commander, now)

    def _command(self, commander: Commander, now: int) -> None:
        """Send the next command, if it keeps the limits; else that of a retraction."""
        robot, state = self._robot, self._robot.look()
        # A law that reads a frozen position would drive on and on, a force that is not read rises, and commands that
        # lie on a lost link come all at once: without news the arm waits where it is.
        deaf = self._eye is not None and commander.mode in _MOVING and self._eye.deaf(now)
        if not deaf and now - robot.seen <= _BLIND * robot.state_period and robot.driver.unheard <= self._unheard:
            self._advance(commander, state)
        if not robot.servo(commander.command, commander.turn):
            for _ in range(_EXPLAIN_PERIODS):
                self._take_state()
                self._check(clock().now_ns())
                clock().sleep(PERIOD)
            self._fail(ArmFaultError("the robot refuses commands: its program has ended (out of reach, or stopped)"))

    def _advance(self, commander: Commander, state: ArmState) -> None:
        """Make the next command and check it, and the arm in motion; one that breaks a limit is taken back.

        A verdict is the limit that is broken, None where all are kept.
        """
        previous, leaving = (commander.command, commander.turn), commander.mode == "retract"
        room = tick_room(self._fence.limits, self._robot.state_period, self._robot.driver.ahead)
        commander.next(state.position, state.velocity, room)
        self._fence.plane = commander.plane
        verdict = self._fence.command(commander.command, commander.turn, previous, state, leaving)
        if verdict is not None:
            commander.take_back()
            self._fence.taken_back()
        else:
            self._obedience.note_command(commander.command)
        # The measured arm, too: behind its command, and where a force leads it.
        if verdict is None and commander.mode in _MOVING:
            if commander.mode == "follow" and state.fresh:
                self._lag.add(commander.command, previous[0], state.position)
            verdict = self._fence.in_motion(commander.command, state)
            if verdict is None and (text := commander.led_astray(float(state.position[2]))) is not None:
                verdict = Verdict(text)
        elif verdict is None and leaving:
            verdict = self._fence.in_retraction(state)
        if verdict is not None:
            self._stop_for(verdict, commander)

    @property
    def _max_age(self) -> float:
        """The age [s] that a state may have, above the promptest since the connection."""
        limits = self._fence.limits
        return math.inf if limits is None else float(limits.get("reading_age", math.inf))

    def _unfit_driver(self) -> str | None:
        """Return why this driver must move nothing: its calls take too long, or its states come late; else None."""
        return self._robot.driver_time.refusal or self._watch.late_answer(self._max_age)

    @property
    def _unheard(self) -> float:
        """The time [s] for which no command needs to have been taken, by states as seldom as they are."""
        return _UNHEARD + self._robot.state_period - PERIOD

    def _stop_for(self, verdict: Verdict, commander: Commander) -> None:
        """Retract where the arm follows its commands, else stop it where it is."""
        if not verdict.trusted or commander.mode not in _MOVING:
            self._fail(GarbledStateError(verdict.text))
        self._parent.tell("limit", text=verdict.text, at=clock().now_ns())
        commander.retract()

    def _check_force(self, commander: Commander, now: int) -> None:
        """Read the force at a time [ns]: a force that leads gets it, and one that is over a limit ends the motion."""
        if self._eye is None or commander.mode not in _MOVING:
            return
        tip, plane = self._robot.position, commander.plane
        height, commanded = plane.height(tip), plane.height(commander.command)
        text = self._eye.look(now, -height, tip, commander.is_in_air(height), -commanded)
        if commander.lead is not None:
            commander.lead.hear(self._eye.felt)
        if text is not None:
            self._parent.tell("limit", text=text, at=clock().now_ns())
            commander.retract()

    def _take_state(self) -> None:
        """Take a new state where there is one, check and record it; the first one makes the commander."""
        if self._robot.poll():
            self._demand_obedience()
            self._watch.check_state()
            if self._commander is None:
                robot = self._robot
                self._commander = Commander(self._law, robot.look().position, robot.turn())
                self._setpoint = self._commander.setpoint
            self._record_state()

    def _demand_obedience(self) -> None:
        """Stop an arm whose newest state shows that it does not do as it was commanded, in its first motion."""
        if self._commander is None:
            return
        if (text := self._obedience.fault(self._commander)) is not None:
            self._fail(GarbledStateError(text))
        if self._obedience.answers:
            self._parent.tell("answers", answers=self._obedience.take_answers())

    def _record_state(self) -> None:
        """Write the newest state to the ring, with the setpoint, and let the pace follow it."""
        robot = self._robot
        stamps = round(robot.stamp * _SECOND), robot.seen
        self._beat.saw(*stamps)
        self._ring.write(stamps, [*robot.row, *robot.reading.status, *self._setpoint])

    def _check(self, now: int) -> None:
        """Check modes, pace and links of the arm at a time [ns], by its newest state."""
        commander = self._commander
        self._watch.check_modes()
        if commander is None or commander.mode == "hold":
            self._watch.check_start()
        elif commander.mode in _MOVING and (text := self._watch.slowdown() or self._watch.lateness(self._max_age)):
            self._stop_for(Verdict(text), commander)  # it leaves the material
        self._watch.check_links(now)

    def _listen(self, now: int) -> None:
        """Obey the main job at a time [ns]: messages now and then, words in shared memory and its silence always."""
        head, commander = self._ring.head, self._commander
        self._cycles += 1
        if self._cycles % _LISTEN_EVERY == 0:
            for message in self._parent.messages():
                if message["say"] == "close":
                    self._exit.leave(commander)
                elif commander is not None:
                    self._obey(message, commander)
        # Without the main job the arm stops; where that is silent, the arm leaves the material.
        beat = self._ring.last_beat(host=True)
        if self._parent.gone:
            self._exit.leave(commander)
        if head[STOP]:
            self._finish()
        elif commander is not None:
            silence = (now - beat) / _SECOND
            if head[RETRACT]:
                commander.retract()
            elif commander.mode in _MOVING and silence > self._host_timeout:
                late = clock().late_computer() or "; is the computer too busy?"
                text = f"the main job gave no sign of life for {_MS * silence:.0f} ms ([device.*] host_timeout){late}"
                self._parent.tell("limit", text=text, at=now)
                commander.retract()

    def _obey(self, message: dict[str, Any], commander: Commander) -> None:
        """Carry out an order of the main job; motions are refused without limits and before the handshake.

        A file that belongs to an order, readings or setpoints, came as a descriptor along with it.
        """
        match message["say"]:
            case "limits":
                if not all(np.isfinite(value).all() for key, value in message.items() if key != "say"):
                    self._fail(ArmFaultError("a limit is not a finite number"))
                self._fence.limits = message
                self._law = self._law.within(message)
                commander.law = self._law
            case "watch":
                self._eye = ForceEye(self._parent.descriptors.pop(0), message)
                self._fence.give_way(deflection(self._eye.stop, self._own.get("stiffness")))
            case "retreat" | "follow" if self._fence.limits is None:
                self._refuse("no limits were set: `link.limit` comes before a motion", commander)
            case "retreat":
                self._robot.driver_time.begin()
                commander.plane = StationPlane(np.array(message["foot"]), np.array(message["normal"]))
                if not commander.plane.is_one:
                    self._fail(ArmFaultError("the plane of the first station is invalid"))
                self._begin(commander)
                self._retreat(commander, message["way"], message["speed"])
            case "follow" if not self._obedience.has_begun:
                self._refuse("the arm has not shown that it obeys: `link.retreat` comes before a motion", commander)
            case "follow":
                plan = Plan.in_file(self._parent.descriptors.pop(0), message["rows"])
                law = None if message.get("law") is None else ForceLaw(**message["law"])
                self._offered = MotionOffer(plan, law)

    def _retreat(self, commander: Commander, way: float, speed: float) -> None:
        """Retreat by a way [m] at a speed [m/s]: at first in steps, by which the arm shows that it obeys."""
        if self._obedience.has_begun:
            commander.retreat(way, speed)
        elif (text := self._obedience.retreat(commander, way, speed)) is not None:
            self._refuse(text, commander)

    def _begin(self, commander: Commander) -> None:
        """Begin a motion from where the arm stands."""
        commander.settle(self._robot.look().position, self._robot.turn())
        self._fence.begin(commander.command)

    def _check_offer(self, offer: MotionOffer, commander: Commander) -> None:
        """Check a piece of a plan in each period, and begin the motion when all of it keeps the limits."""
        if commander.mode in ("retract", "done"):
            self._offered = None
            return
        text = offer.fault(self._fence, None if self._eye is None else self._eye.stop)
        if text is not None:
            self._offered = None
            self._refuse(text, commander)
        elif offer.is_whole and not self._obedience.is_busy(commander, offer.plan):
            self._offered = None
            self._begin(commander)
            commander.follow(offer.plan, offer.law)

    def _refuse(self, text: str, commander: Commander) -> None:
        """End a motion of which nothing was done, with the reason."""
        self._parent.tell("limit", text=text, at=clock().now_ns())
        commander.mode = "done"

    def _finish(self) -> NoReturn:
        """End the motion, which is over one way or the other."""
        self._obedience.end()
        touches = [] if self._eye is None else [vars(touch) for touch in self._eye.touches]
        facts = {"lag": self._lag.lag, "driver_time": sum(self._robot.driver_time.mean), "touches": touches}
        self._exit.finish(self._commander, facts, self._take_state)

    def _record_at_rest(self) -> bool:
        """Record a new state of an arm that was stopped, whatever it shows; return False without one."""
        if not self._robot.poll():
            return False
        self._record_state()
        return True

    def _fail(self, fault: ArmFaultError) -> NoReturn:
        """Stop the arm, and end the process."""
        self._exit.fail(self._commander, fault)
