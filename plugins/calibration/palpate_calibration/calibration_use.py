"""A calibration in use: what a pipeline takes from it, and the flags against it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate import Device, Flag
from palpate_engine import AlignmentSettings, Pipeline, Signal, is_same_tip, plain_settings
from palpate_kit.runs.calibration_file import CalibratedValue, Calibration, read_calibration
from palpate_kit.runs.device_identity import is_identity, other_identity

# Choices.
_SIGNIFICANT = 3.0  # standard uncertainties
_MIN_LATENESS = 1e-4  # [s] of a velocity that is moved: a tenth of a sample at 1 kHz
_START_TOLERANCE = 5.0  # [s] between two reports of one start
_CLOCK_DRIFT = 1e-4  # of the time between these reports, by which two clocks may differ: 9 s a day
_CENTRE_ROUNDING = 2e-3  # [m] of a centre of mass on a pendant
_MIN_PAYLOAD_SHARE = 0.9  # of the mass of the tip: a smaller payload was never set
_MIN_PAYLOAD = 1e-9  # [kg] in a quotient in place of 0
_DAY = 86400.0  # [s]
_NOISES = ("force_std", "velocity_std", "position_std")


def identity_of(devices: Mapping[str, Device], channels: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the identity of the devices behind some channels: serial numbers, firmware, file and hash."""
    names = {channel.partition(".")[0] for channel in channels.values()}
    return {name: dict(devices[name].provenance) for name in sorted(names) if name in devices}


def identity_in(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the part of a live device's facts that identifies it, and since when it is powered."""
    texts = {key: text for key, text in facts.items() if isinstance(text, str)}
    return {key: text for key, text in texts.items() if is_identity(key) or key in ("powered_since", "supply")}


@dataclass(frozen=True)
class AppliedCalibration:
    """A calibration that a pipeline names."""

    calibration: Calibration
    path: str
    valid_for: float  # [s]

    @property
    def values(self) -> Mapping[str, CalibratedValue]:
        """Values of the calibration, by name."""
        return self.calibration.values

    def alignment(self, settings: AlignmentSettings) -> AlignmentSettings:
        """Return the settings with mass, tare, timing and stiffness of the calibration where the file leaves them open.

        A positive delay moves the force back in time, whose stream is interpolated anyway. The velocity is moved only
        where its delay is significant: interpolation would change its noise.
        """
        stated_keys, changes = settings.model_fields_set, dict[str, Any]()
        values = self.values
        # Mass and stiffness.
        if "mass" in values and "tip_mass" not in stated_keys:
            changes |= {"tip_mass": values["mass"].value, "tip_mass_uncertainty": values["mass"].std}
        if "compliance" in values and values["compliance"].value > 0 and "series_stiffness" not in stated_keys:
            changes["series_stiffness"] = 1.0 / values["compliance"].value
        # Tare, by the orientation of the sensor where that is known.
        if settings.is_oriented:
            changes |= self._orientation(settings)
        elif "offset" in values and settings.tare == "calibrated":
            changes |= {"tare": values["offset"].value, "tare_uncertainty": values["offset"].std}
        # Timing.
        if "delay" in values and not self._timing_is_stated(settings):
            changes["force"] = _delayed_signal(settings.force, values["delay"])
            lag = values.get("velocity_delay")
            is_late = lag is not None and abs(lag.value) > max(_SIGNIFICANT * lag.std, _MIN_LATENESS)
            if settings.velocity is not None and lag is not None and is_late:
                changes["velocity"] = _delayed_signal(settings.velocity, lag)
        return settings.model_copy(update=changes)

    def _orientation(self, settings: AlignmentSettings) -> dict[str, Any]:
        """Return the sensor's mounting (x, y, z) [rad], and its bias (x, y, z) [N] for a calibrated tare.

        The offset has the weight of one posture in it, and does not hold for a tool that turns.
        """
        changes = dict[str, Any]()
        mounting = [self.values.get(f"mounting_{axis}") for axis in "xyz"]
        bias = [self.values.get(f"bias_{axis}") for axis in "xyz"]
        if all(mounting) and "mounting" not in settings.model_fields_set:
            changes["mounting"] = tuple(value.value for value in mounting if value)
            changes["mounting_uncertainty"] = max(value.std for value in mounting if value)
        if all(bias) and settings.tare == "calibrated" and settings.bias is None:
            sign, std = settings.force.sign, max(value.std for value in bias if value)
            changes |= {
                "bias": tuple(sign * value.value for value in bias if value),
                "tare": 0.0,
                "tare_uncertainty": std,
            }
        return changes

    def age(self, now: datetime) -> float:
        """Return the age [s] of the calibration."""
        return (now - self.calibration.created).total_seconds()

    def offset_doubt(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Flag | None:
        """Return a flag if its offset need not be that of the sensor now; None where it is.

        An offset is valid while the sensor keeps its power, and no longer than the calibration is. `live` is what
        connected devices reported of themselves, by name.
        """
        now = datetime.now(UTC)
        for age_flag in self._age_flags(now):
            return age_flag
        start_then, start_now = (self._powered_since(pipeline, live, past) for past in (True, False))
        if start_then is None or start_now is None:
            text = "it is not known whether the sensor was restarted after its offset was taken ([device.*] supply)"
            return Flag("calibration-offset-unknown", f"{self.path}: {text}")
        if abs((start_now - start_then).total_seconds()) > _START_TOLERANCE + _CLOCK_DRIFT * abs(self.age(now)):
            restart = f"powered since {start_now}, at the calibration since {start_then}"
            return Flag("calibration-offset", f"{self.path}: the sensor was restarted: {restart}")
        return None

    def _powered_since(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]], past: bool) -> datetime | None:
        """Return the start of the sensor's power, its own or that of the robot that feeds it; None if unknown."""
        channels = {"force": pipeline.alignment.force.channel, "position": pipeline.alignment.position.channel}
        facts: dict[str, Mapping[str, Any]] = {}
        for role, channel in channels.items():
            if past:
                channel = self.calibration.channels.get(role, "")
            devices: Mapping[str, Mapping[str, Any]] = self.calibration.devices if past else live
            facts[role] = devices.get(channel.partition(".")[0], {})
        source = facts["position"] if facts["force"].get("supply") == "robot" else facts["force"]
        try:
            return datetime.fromisoformat(str(source.get("powered_since")))
        except ValueError:
            return None

    def estimator(self, estimator: Any) -> Any:
        """Return an estimator with the calibration's noise in those of its settings that the file leaves open."""
        values = self.values
        open_noises = [
            name
            for name in _NOISES
            if name in values and name in type(estimator).model_fields and name not in estimator.model_fields_set
        ]
        return estimator.model_copy(update={name: values[name].value for name in open_noises})

    @staticmethod
    def _timing_is_stated(settings: AlignmentSettings) -> bool:
        signals = [settings.force, settings.position, settings.velocity]
        return any(signal is not None and {"delay", "uncertainty"} & signal.model_fields_set for signal in signals)

    def flags(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Iterator[Flag]:
        """Yield the flags on this calibration: its age, another sensor or tip, settings that contradict it.

        `live` is what connected devices reported of themselves, by name.
        """
        if pipeline.stated is None:
            return
        devices = {
            name: {**device.provenance, **identity_in(live.get(name, {}))} for name, device in pipeline.devices.items()
        }
        yield from self._age_flags(datetime.now(UTC))
        yield from self._device_flags(pipeline.stated, devices)
        yield from self._tip_flags(pipeline)
        yield from self._conflict_flags(pipeline.stated)
        for name, facts in live.items():
            for text in self._payload_problems(facts):
                yield Flag("payload", f"{name} {text}")
        if pipeline.stated.tare == "calibrated" and live:
            doubt = self.offset_doubt(pipeline, live)
            if doubt is not None and doubt.code != "calibration-old":
                yield doubt

    def _age_flags(self, now: datetime) -> Iterator[Flag]:
        age = self.age(now)
        if age > self.valid_for:
            limit = self.valid_for / _DAY
            yield Flag("calibration-old", f"{self.path} is {age / _DAY:.1f} days old; {limit:.3g} are allowed")
        if age < -_DAY:
            yield Flag("calibration-old", f"{self.path} is from the future: a clock is wrong")

    def _tip_flags(self, pipeline: Pipeline) -> Iterator[Flag]:
        registry, tip = pipeline.registry, self.calibration.tip
        mounted_tips = [plain_settings(indenter, registry) for indenter in pipeline.indenters.values()]
        if tip is not None and mounted_tips and not any(is_same_tip(tip, other, registry) for other in mounted_tips):
            yield Flag("calibration-tip", f"{self.path} was made with another tip: {_settings_text(tip)}")

    def _device_flags(self, stated: AlignmentSettings, devices: Mapping[str, Mapping[str, str]]) -> Iterator[Flag]:
        channels = {"force": stated.force, "position": stated.position}
        for role, signal in channels.items():
            channel_then = self.calibration.channels.get(role, "")
            device_then = self.calibration.devices.get(channel_then.partition(".")[0], {})
            device_now = devices.get(signal.channel.partition(".")[0], {})
            if (key := other_identity(device_then, device_now)) is not None:
                change = f"{key} {device_then[key]}, now {device_now[key]}"
                yield Flag("calibration-sensor", f"{self.path} was made with another {role} device: {change}")
            if role == "force" and channel_then.rpartition(".")[2] != signal.channel.rpartition(".")[2]:
                text = f"{self.path} is of {channel_then}, the force here is {signal.channel}"
                yield Flag("calibration-sensor", text)

    def _payload_problems(self, arm: Mapping[str, Any]) -> Iterator[str]:
        """Yield the problems of the centre of mass that an arm assumes, as sentences without their subject.

        `arm` is what the arm reported: payload [kg] and its centre [m] from the flange, the axis last.
        Between flange and tip there is the sensor, too, whose own centre is on the axis: so what the payload and the
        tip weigh off that axis is the same, whichever way the sensor is turned, and along it the payload has no less.
        """
        values, payload, centre = self.values, arm.get("payload"), arm.get("payload_centre")
        names = ("mass", "centre_x", "centre_y", "centre_z")
        if payload is None or centre is None or not all(name in values for name in names):
            return
        mass, *tip = (values[name] for name in names)
        if payload < _MIN_PAYLOAD_SHARE * mass.value:  # a payload that was never set, which is reported anyway
            return
        # Moments [kg m] of payload and tip across the axis, and along it.
        tolerance = payload * _CENTRE_ROUNDING + _SIGNIFICANT * mass.value * max(value.std for value in tip)
        payload_moment = payload * math.hypot(*centre[:2])
        tip_moment = mass.value * math.hypot(tip[0].value, tip[1].value)
        if abs(payload_moment - tip_moment) > tolerance:
            yield (
                f"assumes a payload with its centre of mass {1e3 * math.hypot(*centre[:2]):.1f} mm off its flange's "
                f"axis: the tip of {self.path} asks for {1e3 * tip_moment / max(payload, _MIN_PAYLOAD):.1f} mm"
            )
        if payload * centre[2] < mass.value * tip[2].value - tolerance:
            distance = mass.value * tip[2].value / max(payload, _MIN_PAYLOAD)
            yield (
                f"assumes a payload with its centre of mass {1e3 * centre[2]:.1f} mm before its flange: the tip of "
                f"{self.path} alone asks for {1e3 * distance:.1f} mm or more"
            )

    def _conflict_flags(self, stated: AlignmentSettings) -> Iterator[Flag]:
        """Yield a flag for each setting of the file that applies, although the calibration contradicts it."""
        values = self.values
        mass, delay = values.get("mass"), values.get("delay")
        if mass is not None and stated.tip_mass is not None and not _within(mass, stated.tip_mass):
            yield Flag(
                "calibration-mass",
                f"[alignment] tip_mass is {stated.tip_mass:.4g} kg; {self.path} states {mass.value:.4g}",
            )
        if delay is not None and self._timing_is_stated(stated):
            declared = stated.force.delay - stated.position.delay
            if not _within(delay, declared):
                yield Flag(
                    "calibration-delay",
                    f"[alignment] states a delay of {declared * 1e3:.3g} ms; "
                    f"{self.path} states {delay.value * 1e3:.3g} ms",
                )


def calibration_in(path: Path, valid_for: float) -> AppliedCalibration:
    """Return the calibration in a file, which is flagged when older than `valid_for` [s]; raises ConfigurationError."""
    return AppliedCalibration(read_calibration(path), str(path), valid_for)


def _delayed_signal(signal: Signal, delay: CalibratedValue) -> Signal:
    return signal.model_copy(update={"delay": delay.value, "uncertainty": delay.std})


def _within(calibrated: CalibratedValue, stated: float) -> bool:
    low, high = calibrated.interval
    return low <= stated <= high


def _settings_text(table: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in table.items())
