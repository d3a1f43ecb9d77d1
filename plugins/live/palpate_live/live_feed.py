"""The writer: takes a run's data, chooses rows, and sends them as messages; it never waits, and keeps little."""

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

from palpate_live.row_columns import RowColumns, Table, choose_rows, describe_run, unmodelled_std

_ROWS_INTERVAL = 0.02  # [s] between two messages with rows: a choice, 50 pictures a second

Send = Callable[[bytes], object]


class PageFeed:
    """A run's data as messages for the page."""

    def __init__(self, run: Run, send: Send, meanings: Mapping[str, FlagMeaning], recorded: bool = False) -> None:
        """Describe a run to the page; `send` takes each message, `meanings` are those of flags by their codes.

        `recorded` is True for a run that is over, of which the page shows and keeps the whole.
        """
        self._send, self._meanings = send, meanings
        self.by_record = recorded
        self._columns = RowColumns(run.tracks)
        self._first_columns = self._columns.first_columns
        # Standard uncertainties by track and parameter that the estimators do not know.
        self._unmodelled_std = {track: np.zeros(len(parameters)) for track, parameters in run.tracks.items()}
        self._now = 0.0  # [s] of the record
        self._bin = -math.inf  # hundredth of a second of the latest row
        # The current block: its samples, those that became rows, and rows that wait to be sent.
        self._samples: Samples | None = None
        self._row_samples: NDArray[np.intp] = np.zeros(0, np.intp)
        self._blocks: list[tuple[Floats, Table]] = []
        self._stamp = 0  # [ns] of the latest row, in the record's clock
        # A block is complete with the track that came last in the block before.
        self._last_track: str | None = None
        self._latest_track: str | None = None
        self._offline: dict[str, Estimates] = {}
        self._next = time.monotonic()  # [s] at which rows may be sent again
        self._send_message(describe_run(run, recorded))

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not shown."""

    def samples(self, samples: Samples) -> None:
        """Begin a block: the first sample of each hundredth of a second becomes a row."""
        self._last_track, self._latest_track = self._latest_track, None
        if self._last_track is None:
            self._flush_in_time()
        self._row_samples, self._bin = choose_rows(samples.time, self._bin)
        self._now, self._samples = float(samples.time[-1]), samples
        if len(self._row_samples):
            rows = self._columns.sample_rows(samples, self._row_samples)
            self._blocks.append((samples.time[self._row_samples], rows))
            self._stamp = int(samples.stamp[self._row_samples[-1]])

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Add a track's estimates of the block; keep those of an offline estimator, which are of the whole record.

        A block is samples that came together; those of them that became rows get the columns of the track.
        """
        samples = self._samples  # the latest block; estimates of it are at the same times
        is_block = samples is not None and len(estimates) == len(samples) and estimates.time[0] == samples.time[0]
        rows_are_sent = len(self._row_samples) and not self._blocks
        if not is_block or rows_are_sent:
            self._offline[track] = estimates
            return
        self._latest_track = track
        if len(self._row_samples):
            columns = self._columns.track_rows(estimates, self._row_samples, self._unmodelled_std[track])
            first = self._first_columns[track]
            _, rows = self._blocks[-1]
            rows[:, first : first + columns.shape[1]] = columns
        if track == self._last_track:
            self._flush_in_time()

    def health(self, health: Mapping[str, Any]) -> None:
        """Send streams, devices, tare and backlog; and the results of each track if the run ended now."""
        message = dict(health)
        for track, track_result in message.pop("tracks", {}).items():
            self._send_result(track, track_result)
        self._send_message({"kind": "health", **message})

    def _send_result(self, track: str, track_result: Mapping[str, Any], final: bool = False) -> None:
        """Send a track's values with their combined uncertainty, which rows from now on have, too."""
        parameters = track_result["parameters"].values()
        self._unmodelled_std[track] = np.array([unmodelled_std(parameter) for parameter in parameters])
        quantities = {
            kind: {name: _quantity(entry) for name, entry in track_result.get(kind, {}).items()}
            for kind in ("parameters", "derived")
        }
        verdict = track_result.get("verdict")
        self._send_message({"kind": "found", "track": track, "final": final, "verdict": verdict, **quantities})

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Send all current flags on a track, or on the record, with their meanings."""
        tables = []
        for flag in flags:
            table = flag.table()
            if (meaning := self._meanings.get(flag.code)) is not None:
                table = {**table, "meaning": meaning.meaning, "remedy": meaning.remedy}
            tables.append(table)
        self._send_message({"kind": "flags", "track": track, "flags": tables})

    def guard(self, state: GuardState) -> None:
        """Send the state of the guard."""
        facts = {"phase": state.phase, "reason": state.reason, "peak": state.peak_force}
        self._send_message({"kind": "guard", **facts, "calls_for_stop": state.calls_for_stop})

    def result(self, table: Mapping[str, Any]) -> None:
        """Send the results of the run at its end, and the rows of offline estimators."""
        self.flush()
        for track, track_result in table["tracks"].items():
            self._send_result(track, track_result, final=True)
            if track in self._offline:
                self._send_offline(track, self._offline.pop(track))
            self.flags(track, tuple(map(Flag.of_table, track_result["flags"])))
        if table["tracks"]:
            self.flags(None, ())  # every track has those of the record now
        duration = table["run"].get("log_duration")
        self._send_message({"kind": "result", "truth": table["truth"], "duration": duration})

    def _send_message(self, message: Mapping[str, Any]) -> None:
        """Send a message, after the rows that wait: messages stand in the order of the record."""
        if self._blocks:
            self.flush()
        self._send(pack({**finite_tree(dict(message)), "t": self._now}))

    def _flush_in_time(self) -> None:
        """Send the rows that wait, unless others were sent just before."""
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _ROWS_INTERVAL
            self.flush()

    def flush(self) -> None:
        """Send the rows that wait, in pieces that fit a datagram, each with the stamp [ns] of its last row."""
        if not self._blocks:
            return
        times = np.concatenate([times for times, _ in self._blocks])
        columns = np.concatenate([rows for _, rows in self._blocks]).T
        self._blocks.clear()
        for piece in pieces(len(times), len(columns)):
            stamp = self._stamp - round(1e9 * (times[-1] - times[piece][-1]))
            self._send(pack_rows({"kind": "rows", "stamp": stamp}, times[piece], columns[:, piece]))

    def _send_offline(self, track: str, estimates: Estimates) -> None:
        """Send the rows of an offline estimator, all at once: its result comes when the record has ended."""
        rows, _ = choose_rows(estimates.time, -math.inf)
        columns = self._columns.track_rows(estimates, rows, self._unmodelled_std[track]).T
        times = estimates.time[rows]
        for piece in pieces(len(times), len(columns)):
            header = {"kind": "later", "track": track, "begin": self._first_columns[track]}
            self._send(pack_rows(header, times[piece], columns[:, piece]))


def _quantity(entry: Mapping[str, Any]) -> list[Any]:
    """Return value and combined standard uncertainty [SI], display unit, its factor from SI, and an open verdict.

    An open verdict is the reason of a missing value; it is empty for a value that counts.
    """
    verdict = entry.get("verdict") or ""
    return [entry["value"], entry["combined"], *display_unit(entry["unit"]), verdict if is_open(verdict) else ""]
