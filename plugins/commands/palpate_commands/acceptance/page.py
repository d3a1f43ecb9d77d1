"""The report of an acceptance: a page to sign, and the same for programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from palpate_engine import SafetySettings

from palpate_commands.acceptance.measurement import Braking, StandstillAfterEvent
from palpate_commands.acceptance.outcome import Allowed, Outcome
from palpate_commands.acceptance.simulator import Simulator
from palpate_commands.acceptance.steps import Visit

SCHEMA = 1  # of the layout of acceptance.json
_MIN_DECELERATION_RATIO = (
    1.5  # of what the states leave possible over the measured, from which on that is a bound: a choice
)
_IDENTITY = ("robot", "serial", "software", "model", "safety_checksum", "payload", "tcp", "powered_since")
_HEADINGS = ("step", "what happened", "speed mm/s", "reaction ms", "deceleration m/s^2", "way mm", "verdict")
_LIMITS = (
    "`[safety]` and all that palpate does are limits of a program: not a safety function, and without a performance "
    "level: what protects people is the robot's own safety system, its emergency stop and the safeguard. This page "
    "says what was measured once, at these speeds and in this posture; it is not a declaration of conformity."
)
_RECORDED = (
    "The controller serves one program: the states are those that the run recorded. The record of a run that was "
    "killed ends there, so that its way is that to where the tip stood when the arm was connected to again."
)


@dataclass(frozen=True)
class Acceptance:
    """A protocol that has been gone through, or part of one."""

    name: str
    file: str
    began: datetime
    version: str
    identity: Mapping[str, object]
    limits: SafetySettings
    outcomes: tuple[Outcome, ...]
    steps: tuple[Visit, ...]  # of the whole protocol, on this robot
    rehearsal: str | None = None  # the twin of one that was not made on the rig
    simulator: Simulator | None = None  # in the arm's place
    single_connection: bool = False  # True: the states are those that the run recorded
    looser_limits: tuple[str, ...] = ()  # than those of the base of the pipeline, a sentence each

    @property
    def is_whole(self) -> bool:
        """True if every step was done."""
        return {outcome.visit.name for outcome in self.outcomes} == {visit.name for visit in self.steps}

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """Outcomes that were worse than declared, or not measured."""
        return tuple(outcome for outcome in self.outcomes if outcome.problems)

    @property
    def verdict(self) -> str:
        """Verdict in words: failed, passed, or passed in part."""
        if self.failed:
            return "failed"
        return "passed" if self.is_whole else "passed in part"

    def worst(self) -> Iterator[str]:
        """Yield the delay of the force, latency and deceleration as measured at worst, and as declared."""
        for delay in (outcome.force_delay for outcome in self.outcomes if outcome.force_delay is not None):
            declared = f"`sensor_delay` = {1e3 * (self.limits.sensor_delay or 0.0):.1f} ms is declared"
            yield f"the force comes {1e3 * delay.value:.0f} ± {1e3 * delay.std:.0f} ms after the pose; {declared}"
        brakings = [(outcome.visit.step, outcome.braking) for outcome in self.outcomes if outcome.braking is not None]
        reactions = [braking.reaction for step, braking in brakings if step.bound in ("latency", "reaction")]
        if reactions:
            yield (
                f"longest reaction where `latency` counts: {1e3 * max(reactions):.0f} ms; `latency` = "
                f"{1e3 * self.limits.latency:g} ms is declared, {1e3 * self.limits.prompt_reaction:.1f} ms with the "
                "delay of the sensor's filter"
            )
        if brakings:
            softest = min(braking.deceleration for _, braking in brakings)
            declared = f"`deceleration` = {self.limits.deceleration:g} m/s^2 is declared"
            yield f"softest braking: {softest:.2f} m/s^2; {declared}"

    @property
    def _answers(self) -> list[Mapping[str, float]]:
        return [answer for outcome in self.outcomes for answer in outcome.answers]

    def _obedience(self) -> Iterator[str]:
        """Yield a sentence on the arm's answers to the first commands of each run: to stay, then small steps."""
        movements = [answer["answered"] for answer in self._answers if answer["commanded"] == 0.0]
        steps = [answer for answer in self._answers if answer["commanded"] > 0.0]
        if movements and steps:
            longest = max(step["commanded"] for step in steps)
            error = max(abs(step["answered"] - step["commanded"]) for step in steps)
            yield (
                f"commanded to stay, the arm moved by {1e3 * max(movements):.2f} mm at most; it answered first steps "
                f"of up to {1e3 * longest:.2f} mm to {1e3 * error:.2f} mm"
            )

    def table(self) -> dict[str, Any]:
        """Return the table of acceptance.json, in SI."""
        declared = ("latency", "deceleration", "sensor_timeout", "speed", "acceleration", "force", "stop_force")
        return {
            "schema": SCHEMA,
            "palpate": self.version,
            "name": self.name,
            "file": self.file,
            "began": self.began.isoformat(timespec="seconds"),
            "verdict": self.verdict,
            "whole": self.is_whole,
            "rehearsal": self.rehearsal,
            "simulator": None if self.simulator is None else self.simulator.name,
            "robot": {key: value for key, value in self.identity.items() if key in _IDENTITY},
            "declared": {key: getattr(self.limits, key) for key in declared}
            | {"reaction": self.limits.prompt_reaction},
            "steps": [_step(outcome) for outcome in self.outcomes],
        }

    def text(self) -> str:
        """Return the page, in Markdown."""
        signatures = _signatures() if self.rehearsal is None else ()
        return "\n".join([*self._head(), *self._rows(), "", *self._notes(), *signatures]) + "\n"

    def _head(self) -> Iterator[str]:
        """Yield the lines of rig, software and robot, of the worst numbers, and of the steps that are still open."""
        title = "Acceptance" if self.rehearsal is None else "Rehearsal of the acceptance"
        place = "" if self.simulator is None else " on a simulator"
        yield f"# {title}{place} of {self.name}: {self.verdict}"
        if self.rehearsal is not None:
            yield ""
            yield f"In simulated time, on the twin {self.rehearsal}: nothing real has moved; this is nothing to sign."
        if self.simulator is not None:
            yield ""
            yield f"The arm is the twin {self.simulator.name}, in software: what stops it says nothing about a rig."
        yield ""
        yield f"{self.began:%Y-%m-%d %H:%M %Z}, palpate {self.version}, `{self.file}`"
        yield ""
        for key in _IDENTITY:
            if key in self.identity:
                yield f"- {key.replace('_', ' ')}: {self.identity[key]}"
        if "safety_checksum" not in self.identity:
            yield "- safety checksum on the pendant: ______________ (`safety_checksum` of the device is not stated)"
        yield ""
        yield from (f"- {line}" for line in (*self.looser_limits, *self._obedience(), *self.worst()))
        absent = [visit.name for visit in self.steps if self.simulator is not None and self.simulator.lacks(visit)]
        settled = {*absent, *(outcome.visit.name for outcome in self.outcomes)}
        missing = dict.fromkeys(visit.name for visit in self.steps if visit.name not in settled)
        if absent:
            yield f"- not in the simulator, and open until they are done on the rig: {', '.join(absent)}"
        if missing:
            yield f"- not done: {', '.join(missing)}"
        yield ""

    def _rows(self) -> Iterator[str]:
        yield "| " + " | ".join(_HEADINGS) + " |"
        yield "|" + "---|" * len(_HEADINGS)
        for outcome in self.outcomes:
            yield "| " + " | ".join(row_of(outcome)) + " |"

    def _notes(self) -> Iterator[str]:
        """Yield the lines that explain the numbers, and say what each run reported."""
        yield (
            "Each number is followed by what is declared. Reaction: from the event to the beginning of braking. The "
            "event is the robot's own report of the stop, the signal, the sensor's last reading before its cable was "
            "pulled, or the reading that passed the limit. Way: from the event until the tip stands or turns back; "
            "v tau + v^2/2a is allowed, v being the most speed until it brakes. Where nothing is stopped the reaction "
            "is how late the force comes after the pose: it belongs into `sensor_delay`. Times are known to the "
            "spacing of the robot's states."
        )
        yield ""
        if self.single_connection:
            yield _RECORDED
            yield ""
        yield "What the run reported:"
        yield ""
        yield from (
            f"- {outcome.visit.name}: {outcome.report or 'nothing: it was killed'}" for outcome in self.outcomes
        )
        yield ""
        yield _LIMITS
        yield ""


def row_of(outcome: Outcome) -> tuple[str, ...]:
    """Return a step as texts, each number with what is declared.

    Its name, the event, speed [mm/s], reaction [ms], deceleration [m/s^2], way [mm] and verdict.
    """
    visit, stop, braking, allowed = outcome.visit, outcome.stop, outcome.braking, outcome.allowed
    verdict = "; ".join(outcome.problems) or "passed"
    if (delay := outcome.force_delay) is not None:
        times = f"{1e3 * delay.value:.0f} ({1e3 * allowed.reaction:.0f})"
        return visit.name, visit.step.event, "", times, "", "", verdict
    if braking is None:
        return (
            visit.name,
            visit.step.event,
            "" if stop is None else f"{1e3 * stop.speed:.1f}",
            f"({1e3 * allowed.reaction:.0f})",
            f"({allowed.deceleration:g})",
            "" if stop is None else _way(stop, allowed),
            verdict,
        )
    # The spacing of the states may leave the deceleration open upwards: then it is a lower bound.
    is_bound = braking.deceleration_most >= _MIN_DECELERATION_RATIO * braking.deceleration
    return (
        visit.name,
        visit.step.event,
        f"{1e3 * braking.speed:.1f}",
        f"{1e3 * braking.reaction:.0f} ({1e3 * allowed.reaction:.0f})",
        f"{'> ' if is_bound else ''}{braking.deceleration:.2f} ({allowed.deceleration:g})",
        _way(braking, allowed),
        verdict,
    )


def _way(stop: Braking | StandstillAfterEvent, allowed: Allowed) -> str:
    return f"{1e3 * stop.way:.2f} ({1e3 * allowed.way(stop.speed):.2f})"


def _step(outcome: Outcome) -> dict[str, Any]:
    """Return the entry of a step in acceptance.json."""
    measurement, stop = outcome.stop or outcome.force_delay, outcome.stop
    declared = asdict(outcome.allowed) | ({} if stop is None else {"way": outcome.allowed.way(stop.speed)})
    return {
        "name": outcome.visit.name,
        "what": outcome.visit.step.event,
        "measured": None if measurement is None else asdict(measurement),
        "declared": declared,
        "problems": list(outcome.problems),
        "handshake": [dict(answer) for answer in outcome.answers],
        "told": outcome.report,
    }


def _signatures() -> Iterator[str]:
    for line in ("place, date", "name", "signature"):
        yield f"{line}: ______________________________"
        yield ""
