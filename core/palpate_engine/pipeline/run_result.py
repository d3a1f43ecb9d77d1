"""The end of a run: its result, with the facts of the alignment and every flag that concerns all tracks."""

from __future__ import annotations

import math
import re
import signal
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.device import Device
from palpate.errors import PalpateError, StoppedError
from palpate.flags import Flag

from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.config import Pipeline, resolved_text, setup_flags, values_on_trust
from palpate_engine.config.rig_facts import UNIT_OF, remedy_of
from palpate_engine.pipeline.device_flags import device_flags
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.result import SCHEMA, Condition, TrackResult, contradictions, finite, record_flags, stream_tables

if TYPE_CHECKING:
    from palpate_engine.pipeline.live.live_facts import EstimateFacts, LiveFacts

_SECOND = re.compile(r"\bs\b")  # in a unit
_COLUMN_UNIT = re.compile(r"device\.[^.]+\.columns\.(\w+)\.unit")  # the key of the unit of a column, by its role
_MAX_BEHIND = 1.0  # [s]; estimates that were less late at worst have kept up; a choice


@dataclass(frozen=True)
class Result:
    """The result of a run, and the folder in which it is written."""

    folder: Path
    run: Mapping[str, Any]
    streams: Mapping[str, Any]
    tracks: Mapping[str, TrackResult]
    flags: tuple[Flag, ...]  # those that concern every track
    truth: Mapping[str, float]
    interrupted: str | None
    signal: int = signal.SIGINT  # that interrupted it
    document: Mapping[str, Any] | None = None  # the ``result.json`` that it was read from; None: made by this process

    def demand_whole(self) -> None:
        """Raise StoppedError, with the exit code of the signal, where the run was stopped before its end."""
        if self.interrupted is not None:
            raise StoppedError(f"{self.interrupted}: partial, in {self.folder}", self.signal)

    def demand_no_failure(self) -> None:
        """Raise PalpateError where the code of a track's part raised; the results of the others are written."""
        flags = [(name, flag) for name, track in self.tracks.items() for flag in track.flags]
        failed = [f"{name}: {flag.message}" for name, flag in flags if flag.code == "failed"]
        if failed:
            raise PalpateError(f"{'; '.join(failed)} (what the others found is in {self.folder})")

    def table(self) -> dict[str, Any]:
        """Return the contents of ``result.json``."""
        if self.document is not None:
            return dict(self.document)
        tracks = {name: track.table() for name, track in self.tracks.items()}
        for track in tracks.values():
            track["flags"] = [*(flag.table() for flag in self.flags), *track["flags"]]
        return {
            "schema": SCHEMA,
            "palpate": self.run["versions"]["palpate"],
            "run": dict(self.run),
            "streams": dict(self.streams),
            "truth": dict(self.truth),
            "tracks": tracks,
        }


def build_result(
    pipeline: Pipeline,
    folder: Path,
    facts: Mapping[str, Any],
    live: LiveFacts | None,
    report: AlignmentReport,
    tracks: Mapping[str, TrackResult],
    interrupt: Interrupt,
) -> Result:
    """Return the result of a run that has ended: its tracks, judged together with the flags of all of them."""
    run_flags = [*_rehearsal_flags(pipeline), *_run_flags(pipeline, live, report, interrupt.reason)]
    flags = pipeline.registry.judged(run_flags)
    return Result(
        folder=folder,
        run={key: finite(value) for key, value in {**facts, **_record_facts(pipeline, facts, report)}.items()},
        streams=stream_tables(report),
        tracks=_judge(pipeline, _with_assumptions(pipeline, tracks), flags),
        flags=flags,
        truth=pipeline.truth,
        interrupted=interrupt.reason,
        signal=interrupt.signal,
    )


def _judge(
    pipeline: Pipeline, tracks: Mapping[str, TrackResult], of_record: tuple[Flag, ...]
) -> dict[str, TrackResult]:
    """Return the tracks with their verdicts, each by itself and then among the others of its model."""
    judged = {name: track.judged(pipeline.registry, of_record) for name, track in tracks.items()}
    for name, contradiction in contradictions(judged).items():
        flags = (*tracks[name].flags, contradiction)
        judged[name] = replace(tracks[name], flags=flags).judged(pipeline.registry, of_record)
    return {name: track.against(pipeline.truth) for name, track in judged.items()}


def _record_facts(pipeline: Pipeline, facts: Mapping[str, Any], report: AlignmentReport) -> dict[str, Any]:
    """Return the facts of the record by its alignment, and those of the check of its rig."""
    control = pipeline.control
    check = {} if control is None else {"control": control.facts(datetime.fromisoformat(facts["started"]))}
    return {**_alignment_facts(report, pipeline.alignment), **check}


def _alignment_facts(report: AlignmentReport, settings: AlignmentSettings) -> dict[str, Any]:
    """Return the facts of a record by its alignment: length, tare, delay of the velocity, first touch."""
    tare, touch, delay = report.tare, report.first_touch, report.velocity_delay
    offset = tare and {"offset": tare.offset, "std": tare.offset_std, "noise": tare.noise, "until": tare.until}
    method = "change-point" if report.by_change_point else "threshold"
    return {
        "samples": report.samples,
        "log_duration": report.duration,
        "tare": offset,
        "velocity_delay": delay and {"value": delay[0], "std": delay[1]},
        **({"turned_tool": asdict(report.turned)} if report.turned is not None else {}),
        "first_touch": touch and {"time": touch[0], "position": touch[1], "by": method, "lag": settings.touch_lag},
    }


def _run_flags(
    pipeline: Pipeline, live: LiveFacts | None, report: AlignmentReport, stop_reason: str | None
) -> Iterator[Flag]:
    """Yield the flags that concern every track; `stop_reason` is of a run that was interrupted."""
    motion = live.motion if live is not None else None
    device_health = motion.devices if motion is not None else {}
    yield from setup_flags(pipeline)
    yield from (Flag("device", text) for device in pipeline.devices.values() for text in _warnings_of(device))
    if pipeline.calibration is not None:
        yield from pipeline.calibration.flags(pipeline, device_health)
    if pipeline.control is not None:
        yield from pipeline.control.flags(pipeline, device_health)
    yield from _backlog_flags(live.estimates if live is not None else None)
    for name in motion.ended_early if motion is not None else ():
        yield Flag("ended-early", f"{name} sent its last reading before the motion was over")
    yield from device_flags(pipeline.alignment, pipeline.ports, device_health)
    # A stop by the guard has the excess of the force in its reason already; one by a person or a signal has not.
    force_excess = None
    if motion is not None and pipeline.safety is not None:
        force_excess = pipeline.safety.excess(motion.peak_force)
    if stop_reason is not None and force_excess is not None and force_excess not in stop_reason:
        stop_reason = f"{stop_reason}; {force_excess}"
    yield from record_flags(report, pipeline.alignment, stop_reason)


def _warnings_of(device: Device) -> Sequence[str]:
    """Return the warnings of a device, or that it answers something else."""
    answer: Any = device.warnings
    if isinstance(answer, tuple | list):
        return answer
    return (f"{type(device).__name__}.warnings is {answer!r}, not a tuple of sentences",)


def _rehearsal_flags(pipeline: Pipeline) -> Iterator[Flag]:
    """Yield a flag for a rehearsal, in which nothing was measured."""
    if (twin := pipeline.run.rehearsal) is not None:
        yield Flag("rehearsal", f"simulated time, twin {twin}: the numbers are of its specimen, and of no real one")


def _assumed_conditions(pipeline: Pipeline, track: TrackResult) -> Iterator[Condition]:
    """Yield a condition for each setting that nobody stated, but for those of diagnoses.

    A tip that nobody stated may be any: every value needs it. So may be the rate of a log without a time: values with
    a second in their unit need it.
    """
    keys = [key for key in pipeline.run.assumed if _model_of(key, pipeline) in (None, track.model)]
    keys = [key for key in keys if not _is_diagnosed(key, pipeline.alignment)]
    if not keys:
        return
    units = {name: value.unit for name, value in track.parameters.items()}
    units |= {value.name: value.found.unit for value in track.derived}
    for key, text in _assumed_texts(keys, pipeline).items():
        yield _assumed_condition(key, text, units)


def _assumed_texts(keys: Sequence[str], pipeline: Pipeline) -> dict[str, str]:
    """Return the assumed values of settings, by key; those without a display unit as the resolved pipeline has them."""
    texts = values_on_trust(pipeline)
    plain_keys = [key for key in keys if not texts.get(key)]
    settings = tomllib.loads(resolved_text(pipeline)) if plain_keys else {}
    return {key: _setting(settings, key) if key in plain_keys else texts[key] for key in keys}


def _assumed_condition(key: str, text: str, units: Mapping[str, str]) -> Condition:
    """Return the condition of a setting that nobody stated, by its key and its value as a text.

    `units` has the units of the values of a track by name, on which the condition bears.
    """
    remedy = f'--set "{key}=VALUE"'
    # Another rate may be any factor on all that has a second in its unit.
    if key.startswith("device.") and key.endswith(".rate"):
        timed = [name for name, unit in units.items() if _SECOND.search(unit)]
        rows = f"{float(text):g} rows in a second"
        return Condition(
            fact="rate",
            text=rows,
            remedy=remedy,
            alternative="another rate",
            shifts=dict.fromkeys(timed, math.inf),
            code="assumed",
        )
    if (column := _COLUMN_UNIT.fullmatch(key)) is not None:
        fact = f"{UNIT_OF}{column[1]}"
        return Condition(fact, f"{fact}: {text}", remedy_of(fact), code="assumed")
    if key.startswith("indenter."):
        return Condition(
            fact=key,
            text=f"{key} = {text}",
            remedy=remedy,
            alternative="another tip",
            shifts=dict.fromkeys(units, math.inf),
            code="assumed",
        )
    return Condition(fact=key, text=f"{key} = {text}", remedy=remedy, alternative="", shifts={}, code="assumed")


def _is_diagnosed(key: str, settings: AlignmentSettings) -> bool:
    """Return True if the diagnoses state the effect of a key of the pipeline: mass, zero, delays that are open."""
    if key == "alignment.tip_mass":
        return settings.tip_mass is None
    return key == "alignment.tare" or (key.endswith(".delay") and settings.timing_uncertainty is None)


def _setting(settings: Mapping[str, Any], key: str) -> str:
    """Return the value of a key of the resolved settings."""
    value: Any = settings
    for part in key.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return "? (no such setting)" if value is None else str(value)


def _model_of(key: str, pipeline: Pipeline) -> str | None:
    """Return the model that a key belongs to; None where it concerns every track."""
    return next((name for name in pipeline.models if key.startswith(f"model.{name}.")), None)


def _with_assumptions(pipeline: Pipeline, tracks: Mapping[str, TrackResult]) -> dict[str, TrackResult]:
    """Return tracks with the conditions of what was assumed of the readings and of their models."""
    return {
        name: replace(track, conditions=(*track.conditions, *_assumed_conditions(pipeline, track)))
        for name, track in tracks.items()
    }


def _backlog_flags(estimates: EstimateFacts | None) -> Iterator[Flag]:
    """Yield a flag where the estimates of a live run did not keep up."""
    if estimates is None or estimates.largest_behind < _MAX_BEHIND:
        return
    behind = f"the estimates were up to {estimates.largest_behind:.1f} s behind the readings"
    if (until := estimates.until) is None:
        yield Flag("backlog", f"{behind}; all of them were made in the end")
    else:
        yield Flag(
            "backlog", f"{behind} and end at {until:.2f} s; the recording is whole, and its replay makes the rest"
        )
