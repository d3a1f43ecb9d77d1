"""The guard: stops the arms when a reading, or its absence, says so."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from typing import Literal

import numpy as np
from palpate.clocks import clock, host_time_ns
from palpate.device import Arm, Batch, Retractable
from palpate.errors import DeviceError, UnstoppedArmError
from palpate.sink import GuardState
from palpate.vectors import Floats

from palpate_engine.alignment import Port, Ports
from palpate_engine.pipeline.live.contact_force import ContactForce
from palpate_engine.pipeline.live.host_watch import HostWatch
from palpate_engine.pipeline.live.peak_force import PeakForce
from palpate_engine.pipeline.live.rise_check import ExpectedForce, RiseCheck
from palpate_engine.pipeline.live.signal_watch import AHEAD, SignalWatch, refuse_other_clocks
from palpate_engine.pipeline.live.standstill import Noise, Standstill, refuse_unsteady
from palpate_engine.pipeline.live.stopped_tip import StoppedTip
from palpate_engine.safety import SafetySettings
from palpate_engine.safety.emergency import call_for_stop

_ENOUGH = 10  # readings
_BRAKES, _REPEATS = 1.0, 2.0  # [s] at most from a stop to a standstill; for which a stop is repeated
_PULL = 0.5  # of the force that stops: so much below zero is not adhesion
_REVERSED = (
    "; it falls while the tip goes deeper: does the sensor count the other way round ([alignment] force sign = -1)?"
)


class Guard:
    """Sees every batch first, in the thread that received it.

    It trips on a force beyond `stop_force`, or a torque beyond `torque`, in any component that the force's stream
    declares, a time-stamp that is ahead of its arrival, a tip below the depth limit, a reading that is at the end
    of its range, over it or invalid, a sensor that repeats itself, is silent or disagrees with the place of the tip, a
    silent robot, readings of force or position that come late, a stream of them that ends, a device that fails, this
    program being held up, and on being asked. Tripping makes the arms retract where they can, else stop; the first
    reason counts. Silence is judged by the process that receives: that this one comes late is not silence. Nothing is
    watched once all arms are done.
    """

    def __init__(self, limits: SafetySettings | None, ports: Ports) -> None:
        self._limits = limits
        self._force, self._position = SignalWatch(ports["force"]), SignalWatch(ports["position"])
        self._velocity = SignalWatch(ports["velocity"]) if "velocity" in ports.roles else None
        self.contact = ContactForce(ports["force"])
        self._named = self.contact.components.index(ports["force"].column)
        self._tip, self._deeper = StoppedTip(), False  # whether it went down lately
        self.rise = RiseCheck(ports["force"], ports["position"])
        self._arms: list[Arm] = []
        self._moving: set[str] = set()  # devices whose motion goes on
        self._ended: set[str] = set()  # devices that have sent their last batch
        self.ended_early: set[str] = set()  # those of them that no safety check needs
        self._lock = threading.Lock()
        self._over = clock().event()
        self.reason: str | None = None
        self.tripped: float | None = None  # monotonic [s]
        self._first_reason = ""
        self.is_stranded = False  # whether an arm was to stop or leave and did not
        self.calls_for_stop: float | None = None  # monotonic [s] since when a person has to press the emergency stop
        self._is_halt_requested = False
        self._halted: float | None = None  # monotonic [s] since when arms are to stop where they are
        self.peak = PeakForce()
        self._host = HostWatch(limits.held_up if limits is not None else None, self._over, self.trip)

    @property
    def state(self) -> GuardState:
        """What it does now."""
        if self.reason is not None:
            return GuardState("tripped", self.reason, self.peak.tared, self.calls_for_stop is not None)
        phase: Literal["standstill", "motion", "over"] = "motion" if self._host.is_watching else "standstill"
        return GuardState("over" if self._over.is_set() else phase, None, self.peak.tared)

    @property
    def force(self) -> Port:
        """Where the force is read."""
        return self._force.port

    @property
    def standstill_force(self) -> Floats:
        """The force's readings at standstill (n,)."""
        return self._force.at_standstill()

    @property
    def standstill_middle(self) -> int:
        """When [ns] that standstill was half over, on the host's clock."""
        return self._force.standstill_middle

    def expect_force(self, expected: ExpectedForce) -> None:
        """From now on the force has to agree with the place of the tip."""
        assert self._limits is not None
        still = self._force.at_standstill(), self._position.at_standstill()
        zero_age = (host_time_ns() - self.standstill_middle) / 1e9
        self.rise.begin(*still, self._limits.rise_window, expected, zero_age)

    def begin(self, arms: Mapping[str, Arm]) -> None:
        """From now on the arms are to be stopped, and silence is a fault."""
        self._arms, self._moving = list(arms.values()), set(arms)
        for watch in (self._force, self._position):
            watch.begin()
        self._host.expect(watch.port.device for watch in (self._force, self._position))
        if self.reason is not None:
            self._stop_arms()
        for device in [*self._ended] if arms else ():
            self._ended_early(device)
        self._host.start()

    def ended(self, device: str) -> None:
        """A device has sent its last batch: an arm because its motion is done, others too early while an arm moves."""
        self._ended.add(device)
        self._host.forget(device)
        if device in self._moving:
            self._moving.discard(device)
            if not self._moving:
                self._over.set()
        elif self._moving:
            self._ended_early(device)

    def failed(self, text: str, device: str, error: BaseException | None = None) -> None:
        """A device has failed: no fault once all arms are done, a second one of an arm that is to leave.

        Of an arm that moves, `error` may say whether it stands; else states since the stop have to show it.
        """
        if self._over.is_set():
            return
        self.trip(text)
        if device not in self._moving:
            return
        stands = not isinstance(error, UnstoppedArmError) and (
            self._tip.shows_rest or (isinstance(error, DeviceError) and error.arm_stands)
        )
        speed = error.speed if isinstance(error, UnstoppedArmError) else self._tip.speed
        rest = self._tip.rest_sentence(self.peak.latest, stands, speed)
        if not text.startswith(self._first_reason):
            self._strand(text, stands, rest)
        elif self.calls_for_stop is None:
            self._add_sentence(text.removeprefix(self._first_reason) + rest)
        if not stands:
            self._call_for_stop(rest)

    def demand_rest(self, patience: float) -> None:
        """Take note where arms that were stopped `patience` [s] ago have not ended their motion."""
        if self.tripped is not None and self._moving and not self._over.is_set():
            stands = self._tip.shows_rest
            rest = self._tip.rest_sentence(self.peak.latest, stands, self._tip.speed)
            late = f"{', '.join(sorted(self._moving))}: no end of its motion within {patience:g} s"
            self._strand(late, stands, rest)
            if not stands:
                self._call_for_stop(rest)

    def _strand(self, text: str, stands: bool, rest: str) -> None:
        self.is_stranded = True
        self._add(self._tip.stranded(text, stands, rest))

    def _call_for_stop(self, rest: str) -> None:
        """Let a person press the emergency stop, and stop the arms on and on for a while."""
        if self.calls_for_stop is None:
            self.is_stranded, self.calls_for_stop = True, clock().now()
            call_for_stop(f"{rest.strip()} The cause: {self._first_reason}")
        self.halt()

    def halt_late(self) -> None:
        """Stop arms that should have ended their motion."""
        if self.tripped is not None and self._moving and not self._over.is_set():
            self.halt()

    def halt_on_request(self) -> None:
        """Stop the arms where they are, since a person asks for it a second time."""
        if not self._is_halt_requested and self._moving:
            self._is_halt_requested = True
            self.halt()

    def report_halt(self) -> str:
        """Add to the reason, and return, what is to be known of an arm that was stopped on its way out on request."""
        if not self._is_halt_requested or self.calls_for_stop is not None or not self._tip.shows_rest:
            return ""
        text = self._tip.pressed_in(self.peak.latest)
        self._add(text)
        return text

    def halt(self) -> None:
        """Stop the arms where they are, also those that are leaving."""
        self._halted = self._halted or clock().now()
        for arm in self._arms:
            arm.stop()

    @property
    def error(self) -> DeviceError:
        """What the run ends with."""
        kind = DeviceError if self.calls_for_stop is None else UnstoppedArmError
        return kind(self.account)

    def _ended_early(self, device: str) -> None:
        needed = [watch.name for watch in (self._force, self._position) if watch.port.device == device]
        if needed or device in self._moving:
            what = f"{' and '.join(needed)} can no longer be watched" if needed else "its motion has not begun"
            self.trip(f"the stream of {device} has ended: {what}")
        else:
            self.ended_early.add(device)

    def close(self) -> None:
        """The motion is over."""
        self._over.set()
        self._host.join()
        self._arms = []  # their links are about to go

    def trip(self, reason: str) -> None:
        """Stop the arms: from any thread; the first reason is kept."""
        with self._lock:
            if self.reason is not None:
                return
            self.reason = self._first_reason = reason
            self.tripped = clock().now()
            self._tip.stop()
        self._stop_arms()

    def _add(self, hint: str) -> None:
        """Append a hint to the reason, also where an arm that stopped itself has given it."""
        with self._lock:
            if self.reason is not None and not self.reason.endswith(hint):
                self.reason += hint

    def _add_sentence(self, text: str) -> None:
        """Append sentences to the reason."""
        with self._lock:
            if self.reason is not None:
                self.reason = f"{self.reason.rstrip('.')}.{text}"

    def _stop_arms(self) -> None:
        for arm in self._arms:
            if isinstance(arm, Retractable):
                arm.retract()
            else:
                self._halted = clock().now()
                arm.stop()

    def check(self, device: str, batch: Batch, attended: int | None = None) -> None:
        """Look at a batch; `attended`: when the process that receives it last looked for readings [ns]."""
        key = (device, batch.stream)
        if self._over.is_set():
            if self.reason is not None and self._force.port.key == key and (tare := self.contact.tare) is not None:
                self.peak.note(batch.values[:, self.contact.components], tare)  # felt while the arm came to rest
            return
        if watched := self._host.has_looked(device):
            self._check_silence(device, batch, attended)
        if not len(batch.time):
            return
        self._check_times(key, batch, watched)
        for watch in (self._force, self._position, self._velocity):
            if self.contact.tare is None and watch is not None and watch.port.key == key:
                watch.add_standstill(batch)
        if self._limits is None:
            return
        if self._force.port.key == key:
            self._check_force(batch, self._limits)
        if self._position.port.key == key and self.contact.tare is not None:
            self._check_height(batch, self._limits)
        if key == (self._position.port.device, "setpoint"):
            self.rise.note_command(batch)

    def _check_silence(self, device: str, batch: Batch, attended: int | None) -> None:
        news = len(batch.time) > 0
        here = attended is None  # this process receives by itself
        looked = clock().now_ns() if here else int(batch.received[-1]) if news else attended or 0
        for watch in (self._force, self._position):
            if watch.port.device == device:
                silent = watch.silence(batch.stream, looked, news)
                if self._limits is not None and silent > self._limits.sensor_timeout:
                    late = clock().late_computer()
                    self.trip(f"{watch.name} is silent for {1e3 * silent:.0f} ms{late}")

    def _check_times(self, key: tuple[str, str], batch: Batch, watched: bool) -> None:
        for watch in (self._force, self._position):
            if watch.port.key != key:
                continue
            if (leap := watch.leap(batch)) > AHEAD:
                self.trip(f"a time-stamp of {watch.name} is {leap:.3g} s ahead of its arrival, beyond all before it")
            limits = self._limits
            delay, limit = (0.0, math.inf) if limits is None else (limits.sensor_delay or 0.0, limits.reading_age)
            if (late := watch.late_fault(batch, delay, limit)) is not None and watched:
                self.trip(late)

    def _check_height(self, batch: Batch, limits: SafetySettings) -> None:
        height = self._position.port.signal.sign * self._position.of(batch)
        if not np.isfinite(height).all():
            self.trip(f"a reading of {self._position.name} is invalid")
            return
        self._deeper = float(height[-1]) < self._tip.height
        self._tip.note(batch.received, height)
        self.rise.note_tip(batch, self._tip.height)
        if self.reason is not None:
            self._check_obedience(limits)
        if (lowest := float(height.min())) < limits.low[2]:
            self.trip(f"the tip is at {1e3 * lowest:.2f} mm, below the limit of {1e3 * limits.low[2]:g} mm")

    def _check_obedience(self, limits: SafetySettings) -> None:
        """Call for the emergency stop where arms go on inwards after a stop, or do not stand in time."""
        now = clock().now()
        if not self._moving:
            return
        if self.calls_for_stop is not None:
            if now - self.calls_for_stop < _REPEATS:
                self.halt()
            return
        text = self._tip.disobedience(limits)
        if text is None and self._halted is not None and now - self._halted > _BRAKES and not self._tip.shows_rest:
            text = f"; the arm does not obey: it does not stand {_BRAKES:g} s after it was stopped."
        if text is not None:
            rest = self._tip.rest_sentence(self.peak.latest, False, self._tip.speed)
            self._add(text + rest)
            self._call_for_stop(rest)

    def _check_force(self, batch: Batch, limits: SafetySettings) -> None:
        if self.contact.tare is None:
            self.contact.rest(batch)
            return
        values = batch.values[:, self.contact.components]
        if (fault := self.contact.fault_of(values)) is not None:
            self.trip(fault)
        if np.isfinite(values).all():
            self._check_size(values, self.contact.tare, limits)
        pushed = self._force.port.signal.sign * (values[:, self._named] - self.contact.tare[self._named])
        faults = (
            self.contact.torque_fault(batch.values, limits.torque),
            self.contact.repeated(batch.values),
            self.rise.fault(batch, pushed),
        )
        for fault in filter(None, faults):
            self.trip(fault)

    def _check_size(self, values: Floats, tare: Floats, limits: SafetySettings) -> None:
        largest = self.peak.note(values, tare)
        if largest > limits.stop_force:
            pushed = self._force.port.signal.sign * float(values[-1, self._named] - tare[self._named])
            self.trip(f"the force is {largest:.1f} N, over the limit of {limits.stop_force:g} N that stops the motion")
            if pushed < -_PULL * limits.stop_force and self._deeper:
                self._add(_REVERSED)

    def awaits_readings(self, waited: float) -> bool:
        """Return True if readings from before the arms stood may still come, a time [s] after that; only after a
        stop."""
        if self.reason is None or self._limits is None:
            return False
        late = (self._limits.sensor_delay or 0.0) + max(self._force.age.latest, 0.0)
        return self.peak.may_rise(waited, late, self._limits)

    @property
    def account(self) -> str | None:
        """Why the arms were stopped, and by how much the force then passed `force`; None where they were not."""
        excess = None if self._limits is None else self._limits.excess(self.peak.tared)
        return self.reason if self.reason is None or excess is None else f"{self.reason}; {excess}"

    @property
    def has_stood_still(self) -> bool:
        """True if force and position have sent enough to be judged."""
        return min(len(self._force.at_standstill()), len(self._position.at_standstill())) >= _ENOUGH

    def judge_standstill(self, declared: Noise | None = None) -> Standstill:
        """Tare and noise from the standstill in free air; raises DeviceError with advice where they are not plausible.

        `declared`: the noise of force [N] and velocity [m/s] that estimators count on, by their names.
        """
        force, position = self._force.at_standstill(), self._position.at_standstill()
        velocity = self._velocity.at_standstill() if self._velocity else np.zeros(0)
        if len(force) < _ENOUGH or len(position) < _ENOUGH:
            silent = self._force.name if len(force) < _ENOUGH else self._position.name
            raise DeviceError(
                f"{silent} gave nothing usable at standstill; is the device on, and are its readings valid?"
            )
        refuse_other_clocks(self._force, self._position)
        speed = float(velocity.std(ddof=1)) if len(velocity) > _ENOUGH else None
        found = Standstill(float(force.mean()), float(force.std(ddof=1)), speed)
        if self._limits is not None and self.contact.tare is None:
            refuse_unsteady(found, self._limits, self._force.name, declared or {})
            self.contact.settle()
        return found
