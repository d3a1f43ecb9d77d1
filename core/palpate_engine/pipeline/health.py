"""Health of a run while it goes on, for the writers that take it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from palpate.clocks import clock
from palpate.device import ReportsHealth
from palpate.flags import Flag
from palpate.sink import GuardState, TakesFlags, TakesGuard, TakesHealth, Writer

from palpate_engine.alignment import Aligner
from palpate_engine.config import Pipeline
from palpate_engine.pipeline.flow import Flow
from palpate_engine.pipeline.tracks import Tracks
from palpate_engine.result import finite_tree, record_flags, stream_tables

_INTERVAL = 1.0  # [s] between two reports; a choice


class HealthReporter:
    """Health and flags once a second, the guard's state as it changes; costs nothing where no sink takes them."""

    def __init__(
        self, writers: Iterable[Writer], flow: Flow, aligner: Aligner, tracks: Tracks, pipeline: Pipeline
    ) -> None:
        """Take the writers of a run, each of which gets what it takes, and the sources of the reports."""
        writers = list(writers)
        self._health_writers = [writer for writer in writers if isinstance(writer, TakesHealth)]
        self._flag_writers = [writer for writer in writers if isinstance(writer, TakesFlags)]
        self._guard_writers = [writer for writer in writers if isinstance(writer, TakesGuard)]
        self._flow, self._aligner, self._tracks, self._pipeline = flow, aligner, tracks, pipeline
        self._guard_state: GuardState | None = None  # the latest that was written
        self._flag_codes: dict[str | None, set[str]] = {}  # the latest that were written, by track
        self._by_record = any(getattr(writer, "by_record", False) for writer in writers)
        self._next = 0.0 if self._by_record else clock().now()  # [s] of the next report, by the record or the clock

    def step(self, progress: Mapping[str, Any]) -> None:
        """Report after a step of the run where it is time; `progress` is that of the data path, with the `time` [s]."""
        self._report_guard()
        now = progress["time"] if self._by_record else clock().now()
        if (self._health_writers or self._flag_writers) and now >= self._next:
            self._next = now + _INTERVAL
            self._report(progress)

    def finish(self, progress: Mapping[str, Any]) -> None:
        """Report after the last step."""
        self._report_guard()
        if self._health_writers or self._flag_writers:
            self._report(progress)

    def _report_guard(self) -> None:
        """Write the guard's state where its phase or its reason has changed."""
        if not self._guard_writers or self._flow.guard is None:
            return
        state, written = self._flow.guard.state, self._guard_state
        if written is None or (written.phase, written.reason) != (state.phase, state.reason):
            self._guard_state = state
            for writer in self._guard_writers:
                writer.guard(state)

    def _report(self, progress: Mapping[str, Any]) -> None:
        """Write the health of streams, devices and tracks, and the flags that have changed."""
        report = self._aligner.report
        tracks = self._tracks.results_so_far(self._pipeline, report)
        if self._health_writers:
            devices = {name: link.health for name, link in self._flow.links.items() if isinstance(link, ReportsHealth)}
            tare = {"offset": report.tare.offset, "noise": report.tare.noise} if report.tare else None
            table = {**progress, "streams": stream_tables(report), "devices": devices, "tare": tare}
            table["tracks"] = {name: track.table() for name, track in tracks.items()}
            for writer in self._health_writers:
                writer.health(finite_tree(table))
        if self._flag_writers:
            registry = self._pipeline.registry
            self._report_flags(None, registry.judged(record_flags(report, self._pipeline.alignment, None)))
            for name, track in tracks.items():
                self._report_flags(name, track.judged(registry, ()).flags)

    def _report_flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Write the flags of a track, or of the record (None), where their codes have changed."""
        codes = {flag.code for flag in flags}
        if codes != self._flag_codes.get(track, set()):
            self._flag_codes[track] = codes
            for writer in self._flag_writers:
                writer.flags(track, flags)
