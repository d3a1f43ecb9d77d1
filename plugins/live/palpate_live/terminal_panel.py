"""The terminal during a run: a panel four times a second, or a line every 5 s without a terminal."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from palpate import Batch, Estimates, Flag, GuardState, Parameter, Samples
from palpate_engine import EMERGENCY, Pipeline, display_unit
from palpate_kit.terminal.quantities import value_with_uncertainty

from palpate_live.row_columns import UNUSABLE, unmodelled_std

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

# Choices.
_PANEL_INTERVAL = 0.25  # [s] between two pictures of the panel
_LINE_INTERVAL = 5.0  # [s] between two lines without a terminal
_MIN_BACKLOG = 0.5  # [s] of the estimates, from which on it is shown
_BAR_WIDTH = 60  # characters of the bar of progress
_JOIN_TIMEOUT = 1.0  # [s] for a terminal that takes nothing
_PHASES = {"standstill": "standstill", "motion": "moving", "tripped": "stopped by the guard", "over": "motion is over"}


@contextmanager
def panel(pipeline: Pipeline) -> Iterator[Watcher]:
    """Show a run on standard error while the context lives; a stuck or closed terminal does not stop the run."""
    from rich.console import Console

    watcher = Watcher(pipeline.run.name, {str(track.name): track.model.parameters for track in pipeline.tracks})
    errors = Console(stderr=True, markup=False, emoji=False, highlight=False)
    ended = threading.Event()
    show = _show_panel if errors.is_terminal else _print_lines
    thread = threading.Thread(target=show, args=(watcher, errors, ended), daemon=True, name="terminal")
    thread.start()
    try:
        yield watcher
    finally:
        ended.set()
        thread.join(_JOIN_TIMEOUT)


def _show_panel(watcher: Watcher, errors: Console, ended: threading.Event) -> None:
    """Draw the panel until the run has ended, and ring once if a person has to press the emergency stop."""
    from rich.live import Live

    with suppress(OSError), Live(console=errors, auto_refresh=False, transient=True) as live:
        has_rung = False
        while not ended.wait(_PANEL_INTERVAL):
            live.update(watcher.view(), refresh=True)
            if watcher.calls_for_stop and not has_rung:
                has_rung = True
                errors.bell()


def _print_lines(watcher: Watcher, errors: Console, ended: threading.Event) -> None:
    """Print a line now and then until the run has ended."""
    with suppress(OSError, ValueError):  # ValueError: of a file that is closed
        while not ended.wait(_LINE_INTERVAL):
            errors.print(watcher.line(), soft_wrap=True)


class Watcher:
    """The latest state to show; the drawing thread reads it when it likes."""

    def __init__(self, name: str, tracks: Mapping[str, tuple[Parameter, ...]]) -> None:
        """Show a run of a name, with the parameters of its tracks."""
        self._name, self._tracks = name, tracks
        self._start = time.monotonic()
        self.now = self.behind = 0.0  # [s] of the record, and of the estimates after it
        self.total: float | None = None  # [s] of the record
        self._force = self._height = math.nan  # [N], [m]
        self._surface: float | None = None  # [m]
        # By track: values and the estimator's standard deviations (2, k), and uncertainties that it does not know (k,).
        self._values = {track: np.full((2, len(parameters)), np.nan) for track, parameters in tracks.items()}
        self._unmodelled_std = {track: np.zeros(len(parameters)) for track, parameters in tracks.items()}
        self._assessed = set[str]()  # tracks whose unmodelled uncertainties are known
        self._flags: dict[str | None, tuple[Flag, ...]] = {}
        self._guard: GuardState | None = None

    def progress(self, now: float, total: float | None, behind: float) -> None:
        """Take the time [s] of the record, its total, and by how much the estimates are behind."""
        self.now, self.total, self.behind = now, total, behind

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not shown."""

    def samples(self, samples: Samples) -> None:
        """Take the latest force and height."""
        self._force, self._height = float(samples.force[-1]), float(samples.position[-1])

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Take the latest usable estimates of a track; they stay when contact ends."""
        if len(estimates) and not int(estimates.status[-1]) & UNUSABLE:
            self._values[track] = np.array([estimates.values[-1], estimates.std[-1]])
            self._surface = float(estimates.surface[-1])

    def health(self, health: Mapping[str, Any]) -> None:
        """Take the uncertainties that the estimators do not know."""
        for track, track_result in health.get("tracks", {}).items():
            parameters = track_result["parameters"].values()
            self._unmodelled_std[track] = np.array([unmodelled_std(parameter) for parameter in parameters])
            self._assessed.add(track)

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Take the current flags on a track, or on the record."""
        self._flags[track] = flags

    def guard(self, state: GuardState) -> None:
        """Take the state of the guard."""
        self._guard = state

    @property
    def calls_for_stop(self) -> bool:
        """True if a person has to press the emergency stop."""
        return self._guard is not None and self._guard.calls_for_stop

    @property
    def _state(self) -> str:
        """The call for the emergency stop, the guard's phase, or the speed of a run without a guard."""
        if self._guard is None:
            return f"{self.now / max(time.monotonic() - self._start, 1e-3):.0f} x real time"
        if self.calls_for_stop:
            return f"{EMERGENCY}: {self._guard.reason}"
        return _PHASES[self._guard.phase] + (f": {self._guard.reason}" if self._guard.reason else "")

    @property
    def _time(self) -> str:
        """Time of the record, state, and backlog of the estimates."""
        total = f" of {self.total:.1f}" if self.total else ""
        backlog = f", estimates are {self.behind:.1f} s behind" if self.behind > _MIN_BACKLOG else ""
        return f"{self.now:.1f}{total} s, {self._state}{backlog}"

    @property
    def _tip(self) -> str:
        """Force and depth of the tip, as far as they are known."""
        parts = []
        if math.isfinite(self._force):
            parts.append(f"force {self._force:.2f} N")
        depth = math.nan if self._surface is None else self._surface - self._height
        if math.isfinite(depth):
            parts.append(f"depth {1e3 * depth:.2f} mm")
        return ", ".join(parts)

    def _value(self, track: str, index: int) -> str:
        """Return a parameter of a track in its display unit, with its combined uncertainty where that is known."""
        value, std = self._values[track][:, index]
        _, factor = display_unit(self._tracks[track][index].unit)
        if track not in self._assessed:  # of an offline track, whose uncertainty comes with its result
            return f"{float(value) * factor:.4g}"
        combined_std = float(np.hypot(std, self._unmodelled_std[track][index]))
        return value_with_uncertainty(float(value) * factor, combined_std * factor)

    def _codes(self, track: str | None) -> str:
        """Return each flag's code once, with its number where several streams or devices raise it."""
        counts = Counter(flag.code for flag in self._flags.get(track, ()))
        return ", ".join(code if count == 1 else f"{code} x {count}" for code, count in counts.items())

    def line(self) -> str:
        """Return the state of the run in one line: time, tip, values of each track, flags ("every track": of the
        record)."""
        parts = [f"{self._time}; {self._tip}" if self._tip else self._time]
        for track, parameters in self._tracks.items():
            if not np.isfinite(self._values[track][0]).all():
                continue
            values = [
                f"{parameter.name} {self._value(track, i)} {display_unit(parameter.unit)[0]}"
                for i, parameter in enumerate(parameters)
            ]
            codes = self._codes(track)
            parts.append(f"{track}: {', '.join(values)}{f' ({codes})' if codes else ''}")
        if self._codes(None):
            parts.append(f"every track: {self._codes(None)}")
        return "; ".join(parts)

    def view(self) -> RenderableType:
        """Return the panel."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.text import Text

        text_lines = [Text(line, "bold red" if self.calls_for_stop else "") for line in (self._time, self._tip) if line]
        if self._codes(None):
            text_lines.append(Text(f"every track: {self._codes(None)}", "yellow"))
        bar = [ProgressBar(self.total, min(self.now, self.total), width=_BAR_WIDTH)] if self.total else []
        return Group(self._track_table(), *text_lines, *bar)

    def _track_table(self) -> Table:
        """Return the tracks with a column for each parameter, and their flags."""
        from rich.table import Table
        from rich.text import Text

        units = {
            parameter.name: display_unit(parameter.unit)[0]
            for parameters in self._tracks.values()
            for parameter in parameters
        }
        table = Table(title=Text(self._name), title_justify="left")
        table.add_column("track")
        for name, unit in units.items():
            table.add_column(Text(f"{name}\n{unit}"), justify="right")
        table.add_column("flags so far")
        for track, parameters in self._tracks.items():
            cells = {parameter.name: self._value(track, i) for i, parameter in enumerate(parameters)}
            table.add_row(Text(track), *(cells.get(name, "") for name in units), Text(self._codes(track), "yellow"))
        return table
