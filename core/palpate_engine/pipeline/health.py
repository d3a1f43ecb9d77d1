"""Health of a run while it goes on, for the writers that want it."""

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

_EVERY = 1.0  # [s]


class HealthReporter:
    """Health and flags once a second, the guard's state as it changes; costs nothing where no sink takes them."""

    def __init__(
        self, writers: Iterable[Writer], flow: Flow, aligner: Aligner, tracks: Tracks, pipeline: Pipeline
    ) -> None:
        every = list(writers)
        self._health = [writer for writer in every if isinstance(writer, TakesHealth)]
        self._flags = [writer for writer in every if isinstance(writer, TakesFlags)]
        self._guard = [writer for writer in every if isinstance(writer, TakesGuard)]
        self._flow, self._aligner, self._tracks, self._pipeline = flow, aligner, tracks, pipeline
        self._state: GuardState | None = None
        self._known: dict[str | None, set[str]] = {}
        self._by_record = any(getattr(writer, "by_record", False) for writer in every)
        self._next = 0.0 if self._by_record else clock().now()

    def look(self, now: Mapping[str, Any]) -> None:
        """Between two steps of the run; `now` is what the data path says of itself."""
        if self._guard and self._flow.guard is not None:
            self._tell_guard(self._flow.guard.state)
        present = now["time"] if self._by_record else clock().now()
        if (self._health or self._flags) and present >= self._next:
            self._next = present + _EVERY
            self._tell(now)

    def last(self, now: Mapping[str, Any]) -> None:
        """After the last step."""
        if self._guard and self._flow.guard is not None:
            self._tell_guard(self._flow.guard.state)
        if self._health or self._flags:
            self._tell(now)

    def _tell_guard(self, state: GuardState) -> None:
        before = self._state
        if before is None or (before.phase, before.reason) != (state.phase, state.reason):
            self._state = state
            for writer in self._guard:
                writer.guard(state)

    def _tell(self, now: Mapping[str, Any]) -> None:
        report = self._aligner.report
        tracks = self._tracks.results_so_far(self._pipeline, report)
        if self._health:
            devices = {name: link.health for name, link in self._flow.links.items() if isinstance(link, ReportsHealth)}
            tare = {"offset": report.tare.offset, "noise": report.tare.noise} if report.tare else None
            table = {**now, "streams": stream_tables(report), "devices": devices, "tare": tare}
            table["tracks"] = {name: found.table() for name, found in tracks.items()}
            for writer in self._health:
                writer.health(finite_tree(table))
        if self._flags:
            registry = self._pipeline.registry
            self._tell_flags(None, registry.judged(record_flags(report, self._pipeline.alignment, None)))
            for name, found in tracks.items():
                self._tell_flags(name, found.judged(registry, ()).flags)

    def _tell_flags(self, track: str | None, current: tuple[Flag, ...]) -> None:
        codes = {flag.code for flag in current}
        if codes != self._known.get(track, set()):
            self._known[track] = codes
            for writer in self._flags:
                writer.flags(track, current)
