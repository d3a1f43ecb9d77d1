"""Stop of the arms: its first reason, and whether they leave and stand as they are to."""

from __future__ import annotations

import threading
from collections.abc import Mapping

from palpate.clocks import clock
from palpate.device import Arm, Retractable
from palpate.errors import DeviceError, UnstoppedArmError

from palpate_engine.pipeline.live.peak_force import PeakForce
from palpate_engine.pipeline.live.stopped_tip import StoppedTip
from palpate_engine.safety import SafetySettings
from palpate_engine.safety.emergency import call_for_stop

_BRAKES = 1.0  # [s] at most from a stop to a standstill (0455)
_REPEATS = 2.0  # [s] for which a stop is repeated (0455)


class ArmStop:
    """Stops the arms once, for the first reason, and looks whether they obey.

    They retract where they can, else stop. What happens from then on is added to the reason: a second fault, a tip that
    goes on, the call for the emergency stop. Nothing is asked of arms that are done.
    """

    def __init__(self, tip: StoppedTip, peak: PeakForce) -> None:
        """Take the tip's state, by which a stop is checked, and the peak of the force."""
        self._tip, self._peak = tip, peak
        self._arms: list[Arm] = []
        self.moving: set[str] = set()  # devices whose motion goes on
        self.over = clock().event()  # the arms are done
        self._lock = threading.Lock()
        self.reason: str | None = None
        self.tripped: float | None = None  # monotonic [s]
        self._first_reason = ""
        self.is_stranded = False  # whether an arm was to stop or leave and did not
        self.calls_for_stop: float | None = None  # monotonic [s] since when a person has to press the emergency stop
        self._is_halt_requested = False
        self._halted: float | None = None  # monotonic [s] since when arms are to stop where they are

    def begin(self, arms: Mapping[str, Arm]) -> None:
        """Take the arms to be stopped from now on; at once where a reason is known already."""
        self._arms, self.moving = list(arms.values()), set(arms)
        if self.reason is not None:
            self._stop_arms()

    def end(self) -> None:
        """Take note that the motion is over, and the links of the arms are about to go."""
        self.over.set()
        self._arms = []

    def note_end(self, device: str) -> None:
        """Take note of an arm that has sent its last batch: its motion is done."""
        self.moving.discard(device)
        if not self.moving:
            self.over.set()

    def trip(self, reason: str) -> None:
        """Stop the arms: from any thread; the first reason is kept."""
        with self._lock:
            if self.reason is not None:
                return
            self.reason = self._first_reason = reason
            self.tripped = clock().now()
            self._tip.stop()
        self._stop_arms()

    def _stop_arms(self) -> None:
        for arm in self._arms:
            if isinstance(arm, Retractable):
                arm.retract()
            else:
                self._halted = clock().now()
                arm.stop()

    def add(self, hint: str) -> None:
        """Append a hint to the reason, also where an arm that stopped itself has given it."""
        with self._lock:
            if self.reason is not None and not self.reason.endswith(hint):
                self.reason += hint

    def _add_sentence(self, text: str) -> None:
        """Append sentences to the reason."""
        with self._lock:
            if self.reason is not None:
                self.reason = f"{self.reason.rstrip('.')}.{text}"

    def failed(self, text: str, device: str, error: BaseException | None = None) -> None:
        """Stop the arms for a device that has failed, unless all of them are done.

        Of an arm that moves, the failure may be its second fault, while it leaves. Then `error` may say whether it
        stands; else states since the stop have to show it.
        """
        if self.over.is_set():
            return
        self.trip(text)
        if device not in self.moving:
            return
        # The arm stands where its driver says so, or where states since the stop show it.
        stands = not isinstance(error, UnstoppedArmError) and (
            self._tip.shows_rest or (isinstance(error, DeviceError) and error.arm_stands)
        )
        speed = error.speed if isinstance(error, UnstoppedArmError) else self._tip.speed
        standstill = self._tip.rest_sentence(self._peak.latest, stands, speed)
        if not text.startswith(self._first_reason):
            self._strand(text, stands, standstill)
        elif self.calls_for_stop is None:
            self._add_sentence(text.removeprefix(self._first_reason) + standstill)
        if not stands:
            self._call_for_stop(standstill)

    def check_obedience(self, limits: SafetySettings) -> None:
        """Call for the emergency stop where arms go on inwards after a stop, or do not stand in time."""
        now = clock().now()
        if self.reason is None or not self.moving:
            return
        if self.calls_for_stop is not None:
            if now - self.calls_for_stop < _REPEATS:
                self.halt()
            return
        # It disobeys where the tip goes on inwards, or where an arm that only stops does not stand in time.
        text = self._tip.disobedience(limits)
        if text is None and self._halted is not None and now - self._halted > _BRAKES and not self._tip.shows_rest:
            text = f"; the arm does not obey: it does not stand {_BRAKES:g} s after it was stopped."
        if text is not None:
            standstill = self._tip.rest_sentence(self._peak.latest, False, self._tip.speed)
            self.add(text + standstill)
            self._call_for_stop(standstill)

    def demand_rest(self, patience: float) -> None:
        """Take note where arms that were stopped `patience` [s] ago have not ended their motion."""
        if not self._is_awaited:
            return
        stands = self._tip.shows_rest
        standstill = self._tip.rest_sentence(self._peak.latest, stands, self._tip.speed)
        late = f"{', '.join(sorted(self.moving))}: no end of its motion within {patience:g} s"
        self._strand(late, stands, standstill)
        if not stands:
            self._call_for_stop(standstill)

    @property
    def _is_awaited(self) -> bool:
        """True while arms that were stopped have not ended their motion."""
        return self.tripped is not None and bool(self.moving) and not self.over.is_set()

    def _strand(self, text: str, stands: bool, standstill: str) -> None:
        self.is_stranded = True
        self.add(self._tip.stranded(text, stands, standstill))

    def _call_for_stop(self, standstill: str) -> None:
        """Let a person press the emergency stop, and stop the arms on and on for a while."""
        if self.calls_for_stop is None:
            self.is_stranded, self.calls_for_stop = True, clock().now()
            call_for_stop(f"{standstill.strip()} The cause: {self._first_reason}")
        self.halt()

    def halt(self) -> None:
        """Stop the arms where they are, also those that are leaving."""
        self._halted = self._halted or clock().now()
        for arm in self._arms:
            arm.stop()

    def halt_late(self) -> None:
        """Stop arms that should have ended their motion."""
        if self._is_awaited:
            self.halt()

    def halt_on_request(self) -> None:
        """Stop the arms where they are, since a person asks for it a second time."""
        if not self._is_halt_requested and self.moving:
            self._is_halt_requested = True
            self.halt()

    def report_halt(self) -> str:
        """Add to the reason, and return, what is to be known of an arm that was stopped on its way out on request."""
        if not self._is_halt_requested or self.calls_for_stop is not None or not self._tip.shows_rest:
            return ""
        text = self._tip.pressed_in(self._peak.latest)
        self.add(text)
        return text
