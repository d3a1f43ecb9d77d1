"""Rows of items, made: each from its run, which rows of one recording and pipeline share."""

from __future__ import annotations

import contextlib
import io
import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from palpate import PalpateError, UserError, to_si
from palpate_engine import (
    ConsentError,
    Pipeline,
    Result,
    Source,
    TrackResult,
    UncertainValue,
    analysis,
    build_pipeline,
    run_pipeline,
)
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.terminal.progress import progress, report_progress

from reproduction.item import AuthorsRecording, Item, PublishedNumber
from reproduction.paper_formulas import rounding, value_of
from reproduction.record_delay import RecordDelay, record_delay
from reproduction.verdict import COMMON, Status, judge


@dataclass(frozen=True)
class Row:
    """One published number and what palpate finds."""

    published: PublishedNumber
    status: Status
    value: float | None = None  # in the published unit
    std: float | None = None  # the same, combined
    tolerance: float | None = None  # the same; None where the row is not judged
    said: str = ""  # why it was skipped, failed, or is only shown
    flags: tuple[str, ...] = ()  # codes that are more than notes

    @property
    def ratio(self) -> float | None:
        """palpate over paper."""
        return None if self.value is None or not self.published.value else self.value / self.published.number

    @property
    def ratio_std(self) -> float | None:
        """Its standard uncertainty, from that of palpate and the published spread."""
        if self.ratio is None or self.value is None:
            return None
        own = 0.0 if self.std is None or not self.value else self.std / self.value
        theirs = (self.published.spread or 0.0) / self.published.number
        return abs(self.ratio) * math.hypot(own, theirs)


@dataclass
class Maker:
    """Makes rows; a run is made once for all that ask for the same."""

    paper: Path  # its folder
    folder: Path  # for run folders
    files: Mapping[str, Path]  # recordings on this machine
    recordings: Mapping[str, AuthorsRecording]
    delays: dict[str, RecordDelay] = field(default_factory=dict)  # by recording, as they are asked for
    _runs: dict[str, Result] = field(default_factory=dict)

    def rows(self, item: Item) -> list[Row]:
        """Every row of an item; a failure is a row with its reason. Raises ConsentError."""
        return [self._row(published) for published in item.published]

    def _row(self, published: PublishedNumber) -> Row:
        if lacking := self._lacking(published):
            return Row(published, "skipped", said=lacking)
        try:
            value, std, unshared, flags = self._value(published)
        except ConsentError:
            raise
        except PalpateError as error:
            return Row(published, "failed", said=str(error))
        if value is None or not math.isfinite(value):
            return Row(published, "failed", said="no usable value", flags=flags)
        status, tolerance = judge(published, value, unshared)
        reasons = {"outside": published.known, "fitted": published.fitted, "shown": published.shown}
        return Row(published, status, value, std, tolerance, reasons.get(status, ""), flags)

    def _lacking(self, published: PublishedNumber) -> str:
        """Which recording a row asks for that is not here; empty where none."""
        if not published.recording:
            return ""
        if published.recording not in self.files:
            return f"{published.recording} is not here"
        other = "" if published.fitted else self.recordings[published.recording].delay_of
        return f"{other}, which shows its delay, is not here" if other and other not in self.files else ""

    def _value(self, published: PublishedNumber) -> tuple[float | None, float | None, float, tuple[str, ...]]:
        """Value, combined uncertainty, the one without what is common to both numbers, and what is flagged."""
        if published.source == "arithmetic":
            given = {name: float(number) for name, number in published.given.items()}
            return value_of(published.formula, given), None, rounding(published.formula, published.given), ()
        result = self._run(published)
        track = result.tracks.get(published.track)
        if track is None:
            raise UserError(f"no track {published.track!r}")
        flags = tuple(dict.fromkeys(f.code for f in (*result.flags, *track.flags) if f.severity != "note"))
        if published.quantity == "lumps":
            return float(_lumps(result.folder, published.track)), None, 0.0, flags
        if published.quantity in ("rss", "rms", "nis"):
            return _of_residual(track, published.quantity), None, 0.0, flags
        estimate = _parameter(track, published.quantity)
        scale = to_si(f"1 {published.unit}", estimate.unit) if published.unit else 1.0
        usable = track.usable and math.isfinite(estimate.value)
        value = estimate.value / scale if usable else None
        return value, estimate.combined / scale, estimate.without(*COMMON) / scale, flags

    def _run(self, published: PublishedNumber) -> Result:
        key = _key(published)
        if key not in self._runs:
            name = _name(len(self._runs) + 1, published)
            with progress(name, "s"):
                result = run_pipeline(self._pipeline(published), self.folder / name, report_progress)
            result.demand_whole()
            self._runs[key] = result
        return self._runs[key]

    def _pipeline(self, published: PublishedNumber) -> Pipeline:
        source = Source.read(self.paper / "pipelines" / published.pipeline)
        for assignment in self._overrides(published):
            source.override(assignment)
        return build_pipeline(source)

    def _overrides(self, published: PublishedNumber) -> list[str]:
        own = [f"{key}={_text(value)}" for key, value in published.set.items()]
        if not published.recording:
            return own
        delays = self._delays(published)
        file = json.dumps(str(self.files[published.recording].resolve()))
        return [f"device.log.file={file}", *(f"alignment.{key}={text}" for key, text in delays.items()), *own]

    def _delays(self, published: PublishedNumber) -> dict[str, str]:
        """Keys of the alignment: delays that were fitted to the paper only where the row says so."""
        recording = self.recordings[published.recording]
        motion, force, more = recording.motion_delay, recording.force_delay, dict[str, str]()
        if recording.delay_of and not published.fitted:
            told = self.delay(recording.delay_of, published)
            motion, force = (f"{1e3 * max(late, 0.0):.3f} ms" for late in (told.delay, -told.delay))
            more = {"force.uncertainty": f"{1e3 * told.std:.3f} ms"}
        channels = {"force": force, "position": motion, "velocity": motion}
        given = self._tables(published).get("alignment", {})
        return {f"{name}.delay": delay for name, delay in channels.items() if name in given} | more

    def delay(self, name: str, published: PublishedNumber) -> RecordDelay:
        """What a recording shows of its own delay, read by the pipeline of a row."""
        if name not in self.delays:
            self.delays[name] = record_delay(self.files[name], self._tables(published))
        return self.delays[name]

    def _tables(self, published: PublishedNumber) -> dict[str, Any]:
        return tomllib.loads((self.paper / "pipelines" / published.pipeline).read_text("utf-8"))


def _key(published: PublishedNumber) -> str:
    """What rows share that are of one run."""
    return json.dumps(
        [published.pipeline, published.recording, dict(published.set), bool(published.fitted)], sort_keys=True
    )


def _name(number: int, published: PublishedNumber) -> str:
    return f"{number:03d}-{published.recording or Path(published.pipeline).stem}"


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _parameter(track: TrackResult, name: str) -> UncertainValue:
    if name == "surface":
        return track.surface
    if name not in track.parameters:
        raise UserError(f"no parameter {name!r} (there are: {', '.join(track.parameters)})")
    return track.parameters[name]


def _of_residual(track: TrackResult, quantity: str) -> float | None:
    if quantity == "nis":
        return track.nis
    if track.report is None:
        return None
    return track.report.rss if quantity == "rss" else track.report.rms


def _lumps(run: Path, track: str) -> int:
    """How many lumps `palpate map lumps` finds."""
    with contextlib.redirect_stdout(io.StringIO()):
        analysis("map lumps")(run, track=track, as_json=True)
    found = json.loads((RunFolder(run).maps / "lumps.json").read_text("utf-8"))
    return len(found["lumps"])
