"""The guard: stops the arms when a reading, or its absence, says so."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from palpate.clocks import clock, host_time_ns
from palpate.device import Arm, Batch
from palpate.errors import DeviceError, UnstoppedArmError
from palpate.sink import GuardState
from palpate.vectors import Floats

from palpate_engine.alignment import Port, Ports
from palpate_engine.pipeline.live.arm_stop import ArmStop
from palpate_engine.pipeline.live.contact_force import ContactForce
from palpate_engine.pipeline.live.host_watch import HostWatch
from palpate_engine.pipeline.live.peak_force import PeakForce
from palpate_engine.pipeline.live.rise_check import ExpectedForce, RiseCheck
from palpate_engine.pipeline.live.signal_watch import AHEAD, SignalWatch, refuse_other_clocks
from palpate_engine.pipeline.live.standstill import Noise, Standstill, refuse_unsteady
from palpate_engine.pipeline.live.stopped_tip import StoppedTip
from palpate_engine.safety import SafetySettings

_SECOND = 1e9  # [ns]
_MIN_READINGS = 10  # of force and of position before a standstill is judged: a choice
_MAX_ADHESION_SHARE = 0.5  # of the force that stops; a larger pull is not adhesion, and hints at the sign: a choice
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
        """Take the limits of a motion, None for a run without any, and the ports of the signals to be watched."""
        self._limits = limits
        self._force, self._position = SignalWatch(ports["force"]), SignalWatch(ports["position"])
        self._velocity = SignalWatch(ports["velocity"]) if "velocity" in ports.roles else None
        self.contact = ContactForce(ports["force"])
        self._axial = self.contact.components.index(ports["force"].column)  # place of the force along the tip
        self._tip, self._deeper = StoppedTip(), False  # whether it went down lately
        self.rise = RiseCheck(ports["force"], ports["position"])
        self._ended: set[str] = set()  # devices that have sent their last batch
        self.ended_early: set[str] = set()  # those of them that no safety check needs
        self.peak = PeakForce()
        self.stop = ArmStop(self._tip, self.peak)
        self._host = HostWatch(limits.held_up if limits is not None else None, self.stop.over, self.trip)

    @property
    def reason(self) -> str | None:
        """Reason why the arms were stopped; None where they were not."""
        return self.stop.reason

    @property
    def state(self) -> GuardState:
        """Phase of the motion, reason of a stop and largest tared force, as they are now."""
        if self.reason is not None:
            return GuardState("tripped", self.reason, self.peak.tared, self.stop.calls_for_stop is not None)
        phase: Literal["standstill", "motion", "over"] = "motion" if self._host.is_watching else "standstill"
        return GuardState("over" if self.stop.over.is_set() else phase, None, self.peak.tared)

    @property
    def force(self) -> Port:
        """Port at which the force is read."""
        return self._force.port

    @property
    def standstill_force(self) -> Floats:
        """Readings (n,) of the force at standstill."""
        return self._force.at_standstill()

    @property
    def standstill_middle(self) -> int:
        """Time [ns] at which that standstill was half over, on the host's clock."""
        return self._force.standstill_middle

    def expect_force(self, expected: ExpectedForce) -> None:
        """Let the guard compare the force with the place of the tip from now on."""
        assert self._limits is not None
        still = self._force.at_standstill(), self._position.at_standstill()
        zero_age = (host_time_ns() - self.standstill_middle) / _SECOND
        self.rise.begin(*still, self._limits.rise_window, expected, zero_age)

    def begin(self, arms: Mapping[str, Arm]) -> None:
        """Let arms be stopped, and silence be a fault, from now on."""
        for watch in (self._force, self._position):
            watch.begin()
        self._host.expect(watch.port.device for watch in (self._force, self._position))
        self.stop.begin(arms)
        for device in [*self._ended] if arms else ():
            self._ended_early(device)
        self._host.start()

    def ended(self, device: str) -> None:
        """Take note of a device that has sent its last batch: an arm because its motion is done, others too early while
        an arm moves."""
        self._ended.add(device)
        self._host.forget(device)
        if device in self.stop.moving:
            self.stop.note_end(device)
        elif self.stop.moving:
            self._ended_early(device)

    @property
    def error(self) -> DeviceError:
        """Error with which the run ends."""
        error_class = DeviceError if self.stop.calls_for_stop is None else UnstoppedArmError
        return error_class(self.account)

    def _ended_early(self, device: str) -> None:
        """Stop the arms where a stream has ended that a safety check needs, or that of an arm before its motion."""
        signal_names = [watch.name for watch in (self._force, self._position) if watch.port.device == device]
        if signal_names or device in self.stop.moving:
            consequence = (
                f"{' and '.join(signal_names)} can no longer be watched" if signal_names else "its motion has not begun"
            )
            self.trip(f"the stream of {device} has ended: {consequence}")
        else:
            self.ended_early.add(device)

    def close(self) -> None:
        """Take note that the motion is over."""
        self.stop.end()
        self._host.join()

    def trip(self, reason: str) -> None:
        """Stop the arms: from any thread; the first reason is kept."""
        self.stop.trip(reason)

    def check(self, device: str, batch: Batch, attended: int | None = None) -> None:
        """Check a batch of a device, and stop the arms where it shows a reason.

        `attended`: when the process that receives the device's readings last looked for them [ns].
        """
        # Once the arms are done nothing is watched; what was felt until they stood still counts as peak.
        key = (device, batch.stream)
        if self.stop.over.is_set():
            if self.reason is not None and self._force.port.key == key and (tare := self.contact.tare) is not None:
                self.peak.note(batch.values[:, self.contact.components], tare)  # felt while the arm came to rest
            return
        # Silence shows in batches without readings as well; all other checks need readings.
        if watched := self._host.has_looked(device):
            self._check_silence(device, batch, attended)
        if not len(batch.time):
            return
        self._check_times(key, batch, watched)
        # Until the tare is known the readings are those of the standstill.
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
        """Stop the arms where force or position is silent for longer than allowed, by the clock of the process that
        receives."""
        has_readings = len(batch.time) > 0
        is_received_here = attended is None  # this process receives by itself
        look = clock().now_ns() if is_received_here else int(batch.received[-1]) if has_readings else attended or 0
        for watch in (self._force, self._position):
            if watch.port.device == device:
                silent = watch.silence(batch.stream, look, has_readings)
                if self._limits is not None and silent > self._limits.sensor_timeout:
                    late = clock().late_computer()
                    self.trip(f"{watch.name} is silent for {1e3 * silent:.0f} ms{late}")

    def _check_times(self, key: tuple[str, str], batch: Batch, watched: bool) -> None:
        """Stop the arms where time-stamps leap ahead of their arrival, or readings come too late."""
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
        """Stop the arms where the height is invalid or below the limit, and see whether they obey."""
        height = self._position.port.signal.sign * self._position.of(batch)
        if not np.isfinite(height).all():
            self.trip(f"a reading of {self._position.name} is invalid")
            return
        self._deeper = float(height[-1]) < self._tip.height
        self._tip.note(batch.received, height)
        self.rise.note_tip(batch, self._tip.height)
        self.stop.check_obedience(limits)
        if (lowest := float(height.min())) < limits.low[2]:
            self.trip(f"the tip is at {1e3 * lowest:.2f} mm, below the limit of {1e3 * limits.low[2]:g} mm")

    def _check_force(self, batch: Batch, limits: SafetySettings) -> None:
        """Stop the arms for what readings (n, channels) show: their range, size, torque, repeats and rise.

        Readings of the standstill, before there is a tare, are kept for it, and not checked.
        """
        if self.contact.tare is None:
            self.contact.keep_standstill(batch)
            return
        # Every component counts: a tip that is pushed sideways is in contact, too.
        forces = batch.values[:, self.contact.components]
        if (fault := self.contact.range_fault(forces)) is not None:
            self.trip(fault)
        if np.isfinite(forces).all():
            self._check_size(forces, self.contact.tare, limits)
        axial_force = self._force.port.signal.sign * (forces[:, self._axial] - self.contact.tare[self._axial])
        faults = (
            self.contact.torque_fault(batch.values, limits.torque),
            self.contact.repeat_fault(batch.values),
            self.rise.fault(batch, axial_force),
        )
        for fault in filter(None, faults):
            self.trip(fault)

    def _check_size(self, forces: Floats, tare: Floats, limits: SafetySettings) -> None:
        """Stop the arms where a tared component of forces (n, components) [N] is over `stop_force`."""
        largest = self.peak.note(forces, tare)
        if largest > limits.stop_force:
            axial_force = self._force.port.signal.sign * float(forces[-1, self._axial] - tare[self._axial])
            self.trip(f"the force is {largest:.1f} N, over the limit of {limits.stop_force:g} N that stops the motion")
            if axial_force < -_MAX_ADHESION_SHARE * limits.stop_force and self._deeper:
                self.stop.add(_REVERSED)

    def awaits_readings(self, waited: float) -> bool:
        """Return True if readings from before the arms stood may still come, a time [s] after that; only after a
        stop."""
        if self.reason is None or self._limits is None:
            return False
        late = (self._limits.sensor_delay or 0.0) + max(self._force.age.latest, 0.0)
        return self.peak.may_rise(waited, late, self._limits)

    @property
    def account(self) -> str | None:
        """Reason why the arms were stopped, and by how much the force then passed `force`; None where they were not."""
        excess = None if self._limits is None else self._limits.excess(self.peak.tared)
        return self.reason if self.reason is None or excess is None else f"{self.reason}; {excess}"

    @property
    def has_stood_still(self) -> bool:
        """True if force and position have sent enough to be judged."""
        return min(len(self._force.at_standstill()), len(self._position.at_standstill())) >= _MIN_READINGS

    def judge_standstill(self, declared: Noise | None = None) -> Standstill:
        """Return mean and noise of the standstill in free air; raises DeviceError with advice where they are not
        plausible.

        `declared`: the noise of force [N] and velocity [m/s] that estimators count on, by their names.
        """
        force, position = self._force.at_standstill(), self._position.at_standstill()
        velocity = self._velocity.at_standstill() if self._velocity else np.zeros(0)
        if len(force) < _MIN_READINGS or len(position) < _MIN_READINGS:
            silent = self._force.name if len(force) < _MIN_READINGS else self._position.name
            raise DeviceError(
                f"{silent} gave nothing usable at standstill; is the device on, and are its readings valid?"
            )
        refuse_other_clocks(self._force, self._position)
        speed = float(velocity.std(ddof=1)) if len(velocity) > _MIN_READINGS else None
        standstill = Standstill(float(force.mean()), float(force.std(ddof=1)), speed)
        if self._limits is not None and self.contact.tare is None:
            refuse_unsteady(standstill, self._limits, self._force.name, declared or {})
            self.contact.take_tare()
        return standstill
