"""The steps of an acceptance protocol: the event that stops a motion, who causes it, and how soon braking begins."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Site = Literal["free-air", "foam"]


@dataclass(frozen=True)
class AcceptanceStep:
    """One way to stop a motion."""

    name: str
    event: str  # that happens to the motion, as a sentence
    # The limit that declares how soon braking has to begin; sensor_delay: how late the force may come, nothing stops.
    bound: Literal["latency", "reaction", "sensor_timeout", "blind", "sensor_delay"]
    ask: str = ""  # of a person, while the arm moves; empty: this program does it
    then: str = ""  # of a person, afterwards
    mode: Literal["", "emergency", "safeguard", "reflex"] = ""  # the stop by which the controller reports it
    number: signal.Signals | None = None  # that is sent to the run
    group: bool = False  # to all of its processes
    sites: tuple[Site, ...] = ("free-air", "foam")
    fault: str = ""  # by which a twin does what is asked of a person
    leaves: bool = True  # True: the arm leaves the material by itself

    @property
    def stops(self) -> bool:
        """True if the motion is stopped; else strokes at two speeds go to their end."""
        return self.bound != "sensor_delay"

    @property
    def interrupts_record(self) -> bool:
        """True if the run cannot record its arm's states from the event on, or not before it goes on."""
        return self.number in (signal.SIGKILL, signal.SIGSTOP)

    @property
    def by_hand(self) -> bool:
        """True if a person causes the event while the arm moves."""
        return bool(self.ask)


STEPS: Mapping[str, AcceptanceStep] = {
    step.name: step
    for step in (
        AcceptanceStep("delay", "strokes at two speeds: how late the force comes", "sensor_delay", sites=("foam",)),
        AcceptanceStep(
            "estop",
            "the emergency stop is pressed",
            "latency",
            "press the emergency stop",
            "release the button, power the arm on and release its brakes on the pendant",
            "emergency",
            fault="emergency-stop",
            leaves=False,
        ),
        AcceptanceStep(
            "safeguard",
            "the safeguard is opened",
            "latency",
            "open the safeguard",
            "close the safeguard and reset it",
            "safeguard",
            fault="safeguard-stop",
            leaves=False,
        ),
        AcceptanceStep(
            "reflex",
            "the controller stops by its own threshold of force",
            "latency",
            "hold up the forearm, above the force sensor, until the robot stops by itself",
            "let the arm go, and recover it as its maker says",
            "reflex",
            sites=("free-air",),
            fault="protective-stop",
            leaves=False,
        ),
        AcceptanceStep(
            "cable",
            "the cable of the force sensor is pulled",
            "sensor_timeout",
            "pull the cable of the force sensor",
            "put the cable back",
            fault="unplug",
        ),
        AcceptanceStep("ctrl-c", "Ctrl-C at the run", "latency", number=signal.SIGINT),
        AcceptanceStep("kill", "the run's main process is killed", "latency", number=signal.SIGKILL, leaves=False),
        AcceptanceStep(
            "kill-all",
            "all processes of the run are killed",
            "blind",
            number=signal.SIGKILL,
            group=True,
            leaves=False,
        ),
        AcceptanceStep("stall", "the run's main process stands still (SIGSTOP)", "blind", number=signal.SIGSTOP),
        AcceptanceStep("force", "the force passes its limit", "reaction", sites=("foam",)),
    )
}


@dataclass(frozen=True)
class Visit:
    """A step at a site."""

    site: Site
    step: AcceptanceStep

    @property
    def name(self) -> str:
        """Name of the step on the page: site and step."""
        return f"{self.site}/{self.step.name}"


def all_visits() -> tuple[Visit, ...]:
    """Return the whole protocol, in its order: first in free air, then on foam."""
    sites: tuple[Site, ...] = ("free-air", "foam")
    return tuple(Visit(site, step) for site in sites for step in STEPS.values() if site in step.sites)
