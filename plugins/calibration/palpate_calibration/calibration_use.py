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

_SIGNIFICANT = 3.0  # standard uncertainties
_LATE = 1e-4  # [s]; a velocity that is less late than this stays where it is
_OTHER_START, _CLOCKS = 5.0, 1e-4  # [s], and a part of the time between: what clocks of one start may differ by
_ROUNDED = 2e-3  # [m] of a centre of mass on a pendant
_NOISES = ("force_std", "velocity_std", "position_std")


def identity_of(devices: Mapping[str, Device], channels: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """What the devices behind some channels report of themselves: serial numbers, firmware, file and hash."""
    names = {channel.partition(".")[0] for channel in channels.values()}
    return {name: dict(devices[name].provenance) for name in sorted(names) if name in devices}


def identity_in(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the part of a live device's facts that identifies it, and since when it is powered."""
    kept = ("powered_since", "supply")
    return {key: text for key, text in facts.items() if isinstance(text, str) and (is_identity(key) or key in kept)}


@dataclass(frozen=True)
class AppliedCalibration:
    """A calibration that a pipeline names."""

    calibration: Calibration
    path: str
    valid_for: float  # [s]

    @property
    def values(self) -> Mapping[str, CalibratedValue]:
        """What it knows, by name."""
        return self.calibration.values

    def alignment(self, settings: AlignmentSettings) -> AlignmentSettings:
        """The settings with mass, tare, timing and stiffness of the calibration wherever the file leaves them open.

        A positive delay moves the force back in time, whose stream is interpolated anyway. The velocity is moved only
        where its delay is significant: interpolation would change its noise.
        """
        stated, changes = settings.model_fields_set, dict[str, Any]()
        values = self.values
        if "mass" in values and "tip_mass" not in stated:
            changes |= {"tip_mass": values["mass"].value, "tip_mass_uncertainty": values["mass"].std}
        if "compliance" in values and values["compliance"].value > 0 and "series_stiffness" not in stated:
            changes["series_stiffness"] = 1.0 / values["compliance"].value
        if settings.is_oriented:
            changes |= self._orientation(settings)
        elif "offset" in values and settings.tare == "calibrated":
            changes |= {"tare": values["offset"].value, "tare_uncertainty": values["offset"].std}
        if "delay" in values and not self._timing_is_stated(settings):
            changes["force"] = _late(settings.force, values["delay"])
            lag = values.get("velocity_delay")
            if (
                settings.velocity is not None
                and lag is not None
                and abs(lag.value) > max(_SIGNIFICANT * lag.std, _LATE)
            ):
                changes["velocity"] = _late(settings.velocity, lag)
        return settings.model_copy(update=changes)

    def _orientation(self, settings: AlignmentSettings) -> dict[str, Any]:
        """Return the sensor's mounting, and its bias for a calibrated tare: the offset has the weight of one posture
        in it."""
        changes = dict[str, Any]()
        mounting, bias = ([self.values.get(f"{name}_{axis}") for axis in "xyz"] for name in ("mounting", "bias"))
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
        """How old it is [s]."""
        return (now - self.calibration.created).total_seconds()

    def offset_doubt(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Flag | None:
        """Return why its offset need not be that of the sensor now; None where it is.

        An offset is valid while the sensor keeps its power, and no longer than the calibration is.
        """
        now = datetime.now(UTC)
        for old in self._too_old(now):
            return old
        then, present = (self._powered_since(pipeline, live, past) for past in (True, False))
        if then is None or present is None:
            why = "it is not known whether the sensor was restarted after its offset was taken ([device.*] supply)"
            return Flag("calibration-offset-unknown", f"{self.path}: {why}")
        if abs((present - then).total_seconds()) > _OTHER_START + _CLOCKS * abs(self.age(now)):
            return Flag(
                "calibration-offset",
                f"{self.path}: the sensor was restarted: powered since {present}, at the calibration since {then}",
            )
        return None

    def _powered_since(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]], past: bool) -> datetime | None:
        """Since when the sensor is powered, on its own or by the robot that feeds it."""
        signals = pipeline.alignment.force.channel, pipeline.alignment.position.channel
        roles = zip(("force", "position"), signals, strict=True)
        facts = [
            self.calibration.devices.get(self.calibration.channels.get(role, "").partition(".")[0], {})
            if past
            else live.get(channel.partition(".")[0], {})
            for role, channel in roles
        ]
        teller = facts[1] if facts[0].get("supply") == "robot" else facts[0]
        try:
            return datetime.fromisoformat(str(teller.get("powered_since")))
        except ValueError:
            return None

    def estimator(self, estimator: Any) -> Any:
        """Return an estimator with the calibration's noise wherever it has such a setting and the file leaves it
        open."""
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
        yield from self._too_old(datetime.now(UTC))
        yield from self._other_devices(pipeline.stated, devices)
        yield from self._other_tip(pipeline)
        yield from self._conflicts(pipeline.stated)
        yield from (Flag("payload", f"{name} {text}") for name, facts in live.items() for text in self._loads(facts))
        if pipeline.stated.tare == "calibrated" and live:
            doubt = self.offset_doubt(pipeline, live)
            if doubt is not None and doubt.code != "calibration-old":
                yield doubt

    def _too_old(self, now: datetime) -> Iterator[Flag]:
        age = self.age(now)
        if age > self.valid_for:
            limit = self.valid_for / 86400
            yield Flag("calibration-old", f"{self.path} is {age / 86400:.1f} days old; {limit:.3g} are allowed")
        if age < -86400:
            yield Flag("calibration-old", f"{self.path} is from the future: a clock is wrong")

    def _other_tip(self, pipeline: Pipeline) -> Iterator[Flag]:
        known, tip = pipeline.registry, self.calibration.tip
        mounted = [plain_settings(one, known) for one in pipeline.indenters.values()]
        if tip is not None and mounted and not any(is_same_tip(tip, one, known) for one in mounted):
            yield Flag("calibration-tip", f"{self.path} was made with another tip: {_shown(tip)}")

    def _other_devices(self, stated: AlignmentSettings, devices: Mapping[str, Mapping[str, str]]) -> Iterator[Flag]:
        channels = {"force": stated.force, "position": stated.position}
        for role, signal in channels.items():
            then = self.calibration.channels.get(role, "")
            before = self.calibration.devices.get(then.partition(".")[0], {})
            present = devices.get(signal.channel.partition(".")[0], {})
            if (key := other_identity(before, present)) is not None:
                yield Flag(
                    "calibration-sensor",
                    f"{self.path} was made with another {role} device: {key} {before[key]}, now {present[key]}",
                )
            if role == "force" and then.rpartition(".")[2] != signal.channel.rpartition(".")[2]:
                yield Flag("calibration-sensor", f"{self.path} is of {then}, the force here is {signal.channel}")

    def _loads(self, arm: Mapping[str, Any]) -> Iterator[str]:
        """What is wrong with the centre of mass that an arm assumes.

        Between flange and tip there is the sensor, too, whose own centre is on the axis: so what the payload and the
        tip weigh off that axis is the same, whichever way the sensor is turned, and along it the payload has no less.
        """
        values, payload, centre = self.values, arm.get("payload"), arm.get("payload_centre")
        names = ("mass", "centre_x", "centre_y", "centre_z")
        if payload is None or centre is None or not all(name in values for name in names):
            return
        mass, *tip = (values[name] for name in names)
        if payload < 0.9 * mass.value:  # a payload that was never set, which is reported anyway
            return
        slack = payload * _ROUNDED + _SIGNIFICANT * mass.value * max(value.std for value in tip)
        aside, own = payload * math.hypot(*centre[:2]), mass.value * math.hypot(tip[0].value, tip[1].value)
        if abs(aside - own) > slack:
            yield (
                f"assumes a payload with its centre of mass {1e3 * math.hypot(*centre[:2]):.1f} mm off its flange's "
                f"axis: the tip of {self.path} asks for {1e3 * own / max(payload, 1e-9):.1f} mm"
            )
        if payload * centre[2] < mass.value * tip[2].value - slack:
            yield (
                f"assumes a payload with its centre of mass {1e3 * centre[2]:.1f} mm before its flange: the tip of "
                f"{self.path} alone asks for {1e3 * mass.value * tip[2].value / max(payload, 1e-9):.1f} mm or more"
            )

    def _conflicts(self, stated: AlignmentSettings) -> Iterator[Flag]:
        """Settings of the file that apply, although the calibration contradicts them."""
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


def _late(signal: Signal, delay: CalibratedValue) -> Signal:
    return signal.model_copy(update={"delay": delay.value, "uncertainty": delay.std})


def _within(calibrated: CalibratedValue, stated: float) -> bool:
    low, high = calibrated.interval
    return low <= stated <= high


def _shown(table: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {value}" for key, value in table.items())
