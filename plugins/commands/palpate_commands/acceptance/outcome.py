"""Outcomes of the steps of an acceptance, compared with what the rig declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate_commands.acceptance.measurement import Braking, ForceDelay, StandstillAfterEvent
from palpate_commands.acceptance.steps import Visit

_COVERAGE = 2.0  # standard uncertainties of a delay, 95 % of normal errors
STANDSTILL_MOVEMENT = 1e-4  # [m] by which the height of a tip that stands varies at most: 20 times the encoders' noise


@dataclass(frozen=True)
class Allowed:
    """Bounds that `[safety]` and the devices declare for a step."""

    reaction: float  # [s]
    deceleration: float  # [m/s^2]

    def way(self, speed: float) -> float:
        """Return the longest way [m] from the event to the end of braking: v tau + v^2/2a."""
        return speed * self.reaction + speed**2 / (2 * self.deceleration)


@dataclass(frozen=True)
class Outcome:
    """Outcome of a step."""

    visit: Visit
    allowed: Allowed
    braking: Braking | None  # None where none could be measured
    report: str  # the reason that the run gave for its end, or why nothing was measured
    force_delay: ForceDelay | None = None  # of the force, where that was what the step was for
    answers: tuple[Mapping[str, float], ...] = ()  # of the arm to its first commands, [m]
    standstill: StandstillAfterEvent | None = None  # of a run whose record of states ends with the event

    @property
    def stop(self) -> Braking | StandstillAfterEvent | None:
        """Stop that was measured, with the way of braking where that was recorded."""
        return self.braking or self.standstill

    @property
    def problems(self) -> tuple[str, ...]:
        """Measured values that are worse than declared by more than the spacing of the states explains.

        Sentences, one for each of them; none where the step is passed.
        """
        braking, allowed = self.braking, self.allowed
        if self.force_delay is not None:
            is_late = self.force_delay.value - _COVERAGE * self.force_delay.std > allowed.reaction
            return ("the force comes later than declared",) if is_late else ()
        if self.standstill is not None:
            return self._problems_after(self.standstill)
        if braking is None:
            return ("not measured",)
        verdicts = (
            (braking.reaction > allowed.reaction + braking.resolution, "braking begins too late"),
            (braking.deceleration_most < allowed.deceleration, "it brakes too softly"),
            (self._goes_too_far(braking), "it goes too far"),
        )
        return tuple(text for is_wrong, text in verdicts if is_wrong)

    def _goes_too_far(self, stop: Braking | StandstillAfterEvent) -> bool:
        return stop.way > self.allowed.way(stop.speed) + stop.speed * stop.resolution

    def _problems_after(self, standstill: StandstillAfterEvent) -> tuple[str, ...]:
        """Return the problems of a stop of which only the place after it is known."""
        verdicts = (
            (standstill.movement > STANDSTILL_MOVEMENT, "it still moved once the run had ended"),
            (self._goes_too_far(standstill), "it goes too far"),
        )
        return tuple(text for is_wrong, text in verdicts if is_wrong)
