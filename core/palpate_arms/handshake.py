"""The handshake: an arm shows, before and during its first motion, that it obeys in the frame of its poses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.rotations import rotation_vector

from palpate_arms.arm_lag import DELAY, STATIC_ERROR
from palpate_arms.arm_state import ArmState
from palpate_arms.echoed_pose import echo_delay
from palpate_arms.handshake_path import HandshakePath, HandshakeStep, StatedArm
from palpate_arms.servo_law import OVERSHOOT
from palpate_arms.setpoint_buffer import PERIOD
from palpate_arms.tracking_error import length

# Choices (0450).
HOLD_SPEED = 10e-3  # [m/s] of a tip at rest; twice the largest noise that [safety] standstill_speed lets pass
_MIN_SHOWN_WAY = 20e-6  # [m] of a tip at that speed within two states: less is noise of the speed alone
HOLD_TURN = 0.01  # [rad] of the tool; 1.2 mm at a lever of 120 mm
SOFT_TURN = 0.05  # [rad] of one on a spring, by 4 N m of load that its controller does not know at 80 N m/rad
PLAY = 50e-6  # [m] by which an arm may miss a small command; between the best and the usual repeatability of arms
SHARE = 0.25  # of a command, by which the answer may miss it in size and in direction: 14 deg
_SIGNIFICANT = 5.0  # standard uncertainties of a mean pose
_NO_ANSWER_SHARE = 0.5  # of a command: an arm that goes less than that outwards has not taken it
_SECOND = 1e9  # [ns]
_MM = 1e3  # per metre


def target_problem(target: Sequence[float], pose: Sequence[float], give: float) -> str | None:
    """Return why an arm at rest must not be commanded: its controller's target (6,) is not its pose (6,)."""
    distance = math.dist(target[:3], pose[:3])
    if distance <= STATIC_ERROR + give:
        return None
    return (
        f"at rest its controller's target is {_MM * distance:.2f} mm from the pose that it reports, and nothing was "
        "moved (are its commands in another frame, or of another tool, than its poses?)"
    )


class Handshake:
    """A path of first commands, and the arm's answers to it, state by state."""

    def __init__(self, path: HandshakePath, stated: StatedArm, state: ArmState) -> None:
        """Take the path of the commands, what is stated of the arm (lag, deadband, give), and its first state."""
        self._path, self._stated = path, stated
        self._start, self._rotation = state.position, state.rotation
        self._lagged = path.rows[0]  # the command (3,), as the slowest arm that counts as sound follows it
        self._blend = -math.expm1(-PERIOD / (stated.lag + DELAY))  # share of the way in a period T, 1 - e^(-T/tau)
        self._commands: list[Floats] = []  # (3,) in the work frame
        self._base_commands: list[Floats] = []  # (3,) in the base, where poses are reported
        self._sent_at: list[int] = []  # [ns] of each command
        self._sent: list[int] = []  # commands before each state
        self._seen_at: list[int] = []  # [ns] of each state
        self._places: list[Floats] = []  # (3,) of each state, in the work frame
        self._base_places: list[Floats] = []
        self._next = 0  # step
        self._rest: tuple[Floats, float] | None = None  # mean place (3,) and noise [m] before the first step
        self.answers: list[dict[str, Any]] = []

    @property
    def is_over(self) -> bool:
        """True if the arm has answered every step."""
        return self._next == len(self._path.steps)

    def note_command(self, command: Floats, base_command: Floats, now: int) -> None:
        """Note a command (3,) that is sent at a time [ns], and the same in the base."""
        self._commands.append(command)
        self._sent_at.append(now)
        self._base_commands.append(base_command)
        self._lagged = self._lagged + self._blend * (command - self._lagged)

    def fault(self, state: ArmState, base_place: Floats, arrival: int) -> str | None:
        """Return why a state that arrived at a time [ns] shows that the arm does not obey; None where it does."""
        if not self._commands or self.is_over:
            return None
        # Every state is on the way that was commanded so far; the mean of the last ones answers the step.
        self._sent.append(len(self._commands))
        self._seen_at.append(arrival)
        self._places.append(state.position)
        self._base_places.append(base_place)
        if (text := self._stray(state)) is not None:
            return text
        step = self._path.steps[self._next]
        if len(self._commands) < step.last_row:
            return None
        self._next += 1
        return self._judge(step) or (self._echo() if self.is_over else None)

    def _stray(self, state: ArmState) -> str | None:
        """Return the first way in which a state is off the path that was commanded so far; None where it is on it.

        It is judged by the tool's turn, the distance of the tip from the path, and its speed.
        """
        # The tool keeps its orientation.
        step = self._path.steps[self._next]
        displacement, commanded = state.position - self._start, self._commands[-1] - self._path.rows[0]
        turn = length(rotation_vector(state.rotation @ self._rotation.T))
        if turn > (SOFT_TURN if self._stated.gives_way else HOLD_TURN):
            return (
                f"the tool turned by {math.degrees(turn):.1f} deg when it was commanded to keep its orientation (is "
                "the rotation vector taken for angles, or for that of the flange?)"
            )
        # The tip is near the way, and not faster than the command, as its pose shows as well.
        distance = length(displacement - _nearest(displacement, commanded, self._path.axes(step)))
        give = self._stated.give if self._stated.gives_way else 0.0
        max_distance = max(STATIC_ERROR, give) + self._stated.deadband
        is_fast = length(state.velocity) > self._fastest and distance > _MIN_SHOWN_WAY
        if distance <= max_distance and not is_fast:
            return None
        return _disobedience(step, commanded, displacement, length(state.velocity))

    @property
    def _fastest(self) -> float:
        """The speed [m/s] of the latest command, and what an arm may show on top of it."""
        latest = self._commands[-2:]
        speed = length(latest[-1] - latest[0]) / PERIOD
        # A spring gives way within its lag.
        slack = self._stated.give / max(self._stated.lag, PERIOD) if self._stated.gives_way else 0.0
        return OVERSHOOT * speed + max(HOLD_SPEED, slack)

    def _judge(self, step: HandshakeStep) -> str | None:
        """Return why the mean place at the end of a step does not answer it; None where it does."""
        # States of the second half of the wait, in which the arm has settled.
        first_row = step.last_row - max(step.wait // 2, 1)
        places = np.array([place for place, sent in zip(self._places, self._sent, strict=True) if sent > first_row])
        mean = places.mean(axis=0)
        if self._rest is None:
            self._rest = mean, float(np.linalg.norm(places.std(axis=0)))
        # The way from the mean place at rest, against the command.
        displacement = mean - self._rest[0]
        commanded, uncertainty = float(np.linalg.norm(step.way)), self._rest[1] / math.sqrt(len(places))
        tolerance = PLAY + SHARE * commanded + _SIGNIFICANT * uncertainty
        is_stay = not step.axis.any()  # each of its states was looked at
        answer = length(mean - self._start) if is_stay else float(displacement @ step.way) / commanded
        self.answers.append({"commanded": commanded, "answered": answer})
        return (
            None
            if is_stay or self._is_answered(step, displacement, tolerance)
            else _disobedience(step, step.way, displacement)
        )

    def _is_answered(self, step: HandshakeStep, displacement: Floats, tolerance: float) -> bool:
        """Return True if a way (3,) [m] is the one that was commanded, in direction, axis and size, within the lag.

        Friction may hold an arm on a spring back: it goes in the direction, if at all, and no further.
        """
        # The way [m] by which a sound arm may still be behind, and what is left of the way across all axes.
        behind = length(self._commands[-1] - self._lagged) + self._stated.deadband
        side = displacement
        for axis in self._path.axes(step):
            along, commanded = float(displacement @ axis), float(step.way @ axis)  # axes point the way of their steps
            side = side - along * axis
            lowest, highest = commanded - behind, commanded
            if self._stated.gives_way:
                lowest, highest = 0.0, OVERSHOOT * commanded
            if not lowest - tolerance <= along <= highest + tolerance:
                return False
        return length(side) <= tolerance + self._stated.deadband

    def _echo(self) -> str | None:
        """Return why the poses of all steps were not measured: they are commands, in every digit."""
        longest = round(_SECOND * PERIOD) * self._path.steps[0].last_row  # [ns]; later answers are refused by the steps
        delay = echo_delay(
            np.array(self._base_commands),
            np.array(self._sent_at),
            np.array(self._base_places),
            np.array(self._seen_at),
            longest,
        )
        if delay is None:
            return None
        delay_text = f", {1e-6 * delay:g} ms later" if delay else ""
        return f"the pose that the arm reports is its command, in every digit{delay_text}: what was measured is needed"


def _disobedience(step: HandshakeStep, commanded: Floats, displacement: Floats, speed: float = 0.0) -> str:
    """Return what the arm did, (3,) [m] at a speed [m/s], in place of what a step commanded; and the likely mistake."""
    way = length(displacement)
    speed_text = f", at {_MM * speed:.0f} mm/s" if speed > HOLD_SPEED else ""
    if not step.axis.any():
        return (
            f"the arm moved by {_MM * way:.2f} mm{speed_text}, when it was commanded to stay where it is (are its "
            "commands of the flange, or in another frame than its poses?)"
        )
    along, commanded_along = float(displacement @ step.axis), float(commanded @ step.axis)
    order = f"the arm was commanded to move by {_MM * commanded_along:.2f} mm {step.direction} and has moved by"
    # Not at all, backwards, across, or too far.
    if way < _NO_ANSWER_SHARE * commanded_along and along > -PLAY:
        return (
            f"{order} {_MM * way:.2f} mm (does it take commands? are its lag and its deadband stated? do its states "
            "come late?)"
        )
    if along < 0.0:
        return f"{order} {-_MM * along:.2f} mm the other way{speed_text} (is the sign of an axis reversed?)"
    if length(displacement - along * step.axis) > SHARE * along:
        place = ", ".join(f"{_MM * x:.2f}" for x in displacement)
        return f"{order} ({place}) mm in the work frame{speed_text} (are the axes of its commands those of its poses?)"
    return f"{order} {_MM * along:.2f} mm{speed_text} (are its commands in other units than its poses?)"


def _nearest(place: Floats, end: Floats, axes: Sequence[Floats]) -> Floats:
    """Return the place (3,) nearest to another one in the box from 0 to `end` (3,), whose edges lie along the axes."""
    nearest = np.zeros(3)
    for axis in axes:
        nearest = nearest + min(max(float(place @ axis), 0.0), float(end @ axis)) * axis
    return nearest
