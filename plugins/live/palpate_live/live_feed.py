"""The writer: takes a run's data, chooses rows, and hands messages on; it never waits, and keeps next to nothing."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from palpate import Batch, Estimates, Flag, FlagMeaning, Floats, GuardState, Run, Samples
from palpate_engine import display_unit, finite_tree, is_open
from palpate_kit.page.datagrams import pack, pack_rows, pieces

from palpate_live.row_columns import RowColumns, Table, beyond, describe_run, rows_of

_EVERY = 0.02  # [s] between two messages with rows

Send = Callable[[bytes], object]


class PageFeed:
    """A run's data as messages for the page."""

    def __init__(self, run: Run, send: Send, meanings: Mapping[str, FlagMeaning], recorded: bool = False) -> None:
        self._send, self._meanings = send, meanings
        self.by_record = recorded
        self._columns = RowColumns(run.tracks)
        self._begins = self._columns.begins
        self._beyond = {track: np.zeros(len(parameters)) for track, parameters in run.tracks.items()}
        self._now = 0.0  # [s] of the record
        self._bin = -math.inf  # in which the latest row is
        self._samples: Samples | None = None
        self._chosen: NDArray[np.intp] = np.zeros(0, np.intp)
        self._blocks: list[tuple[Floats, Table]] = []
        self._stamp = 0  # [ns] of the latest row, in the record's clock
        self._last: str | None = None  # track sent last of the block before
        self._latest: str | None = None
        self._offline: dict[str, Estimates] = {}
        self._next = time.monotonic()
        self._tell(describe_run(run, recorded))

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not shown."""

    def samples(self, samples: Samples) -> None:
        """Begin a block: the first sample of each hundredth of a second becomes a row."""
        self._last, self._latest = self._latest, None
        if self._last is None:
            self._flush_in_time()
        self._chosen, self._bin = rows_of(samples.time, self._bin)
        self._now, self._samples = float(samples.time[-1]), samples
        if len(self._chosen):
            self._blocks.append((samples.time[self._chosen], self._columns.of_samples(samples, self._chosen)))
            self._stamp = int(samples.stamp[self._chosen[-1]])

    def estimates(self, track: str, estimates: Estimates) -> None:
        """A track's estimates of the block; of an offline estimator, of the whole record."""
        samples = self._samples
        block = samples is not None and len(estimates) == len(samples) and estimates.time[0] == samples.time[0]
        if not block or (len(self._chosen) and not self._blocks):  # its rows have been sent
            self._offline[track] = estimates
            return
        self._latest = track
        if len(self._chosen):
            own = self._columns.of_track(estimates, self._chosen, self._beyond[track])
            begin = self._begins[track]
            self._blocks[-1][1][:, begin : begin + own.shape[1]] = own
        if track == self._last:
            self._flush_in_time()

    def health(self, health: Mapping[str, Any]) -> None:
        """Streams, devices, tare, backlog; and what each track would find if the run ended now."""
        table = dict(health)
        for track, found in table.pop("tracks", {}).items():
            self._found(track, found)
        self._tell({"kind": "health", **table})

    def _found(self, track: str, found: Mapping[str, Any], final: bool = False) -> None:
        """Values with their combined uncertainty; rows from now on have it, too."""
        self._beyond[track] = np.array([beyond(part) for part in found["parameters"].values()])
        shown = {kind: {n: _value(p) for n, p in found.get(kind, {}).items()} for kind in ("parameters", "derived")}
        self._tell({"kind": "found", "track": track, "final": final, "verdict": found.get("verdict"), **shown})

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """All current flags on a track, or on the record."""
        tables = []
        for flag in flags:
            meaning = self._meanings.get(flag.code)
            words = {"meaning": meaning.meaning, "remedy": meaning.remedy} if meaning else {}
            tables.append({**flag.table(), **words})
        self._tell({"kind": "flags", "track": track, "flags": tables})

    def guard(self, state: GuardState) -> None:
        """What the guard does."""
        facts = {"phase": state.phase, "reason": state.reason, "peak": state.peak_force}
        self._tell({"kind": "guard", **facts, "calls_for_stop": state.calls_for_stop})

    def result(self, table: Mapping[str, Any]) -> None:
        """What the run found in the end."""
        self.flush()
        record = table["run"]
        for name, track in table["tracks"].items():
            self._found(name, track, True)
            if name in self._offline:
                self._afterwards(name, self._offline.pop(name))
            self.flags(name, tuple(map(Flag.of_table, track["flags"])))
        if table["tracks"]:
            self.flags(None, ())  # every track has those of the record now
        self._tell({"kind": "result", "truth": table["truth"], "duration": record.get("log_duration")})

    def _tell(self, message: Mapping[str, Any]) -> None:
        if self._blocks:
            self.flush()  # messages stand in the order of the record
        self._send(pack({**finite_tree(dict(message)), "t": self._now}))

    def _flush_in_time(self) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _EVERY
            self.flush()

    def flush(self) -> None:
        """Send the rows that wait."""
        if not self._blocks:
            return
        times = np.concatenate([times for times, _ in self._blocks])
        table = np.concatenate([rows for _, rows in self._blocks]).T
        self._blocks.clear()
        for piece in pieces(len(times), len(table)):
            stamp = self._stamp - round(1e9 * (times[-1] - times[piece][-1]))
            self._send(pack_rows({"kind": "rows", "stamp": stamp}, times[piece], table[:, piece]))

    def _afterwards(self, track: str, estimates: Estimates) -> None:
        """Of an offline estimator, whose result comes when the record has ended: the same rows, all at once."""
        rows, _ = rows_of(estimates.time, -math.inf)
        table = self._columns.of_track(estimates, rows, self._beyond[track]).T
        times = estimates.time[rows]
        for piece in pieces(len(times), len(table)):
            header = {"kind": "later", "track": track, "begin": self._begins[track]}
            self._send(pack_rows(header, times[piece], table[:, piece]))


def _value(part: Mapping[str, Any]) -> list[Any]:
    """Value and combined standard uncertainty [SI], its unit, how many of it one SI unit is, or why it has none."""
    word = part.get("verdict") or ""
    return [part["value"], part["combined"], *display_unit(part["unit"]), word if is_open(word) else ""]
