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

from palpate_live.row_columns import UNUSABLE, beyond

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

_PANEL, _LINES = 0.25, 5.0  # [s] between two looks
_BEHIND = 0.5  # [s] from which on it is shown
_JOIN = 1.0  # [s] for a terminal that takes nothing
_PHASES = {"standstill": "standstill", "motion": "moving", "tripped": "stopped by the guard", "over": "motion is over"}


@contextmanager
def panel(pipeline: Pipeline) -> Iterator[Watcher]:
    """Shows a run on standard error while the context lives; a stuck or closed terminal does not stop the run."""
    from rich.console import Console

    watcher = Watcher(pipeline.run.name, {str(track.name): track.model.parameters for track in pipeline.tracks})
    errors = Console(stderr=True, markup=False, emoji=False, highlight=False)
    ended = threading.Event()
    work = _show_panel if errors.is_terminal else _print_lines
    thread = threading.Thread(target=work, args=(watcher, errors, ended), daemon=True, name="terminal")
    thread.start()
    try:
        yield watcher
    finally:
        ended.set()
        thread.join(_JOIN)


def _show_panel(watcher: Watcher, errors: Console, ended: threading.Event) -> None:
    from rich.live import Live

    with suppress(OSError), Live(console=errors, auto_refresh=False, transient=True) as live:
        has_rung = False
        while not ended.wait(_PANEL):
            live.update(watcher.view(), refresh=True)
            if watcher.calls_for_stop and not has_rung:
                has_rung = True
                errors.bell()


def _print_lines(watcher: Watcher, errors: Console, ended: threading.Event) -> None:
    with suppress(OSError, ValueError):  # ValueError: of a file that is closed
        while not ended.wait(_LINES):
            errors.print(watcher.line(), soft_wrap=True)


class Watcher:
    """The latest state to show; the drawing thread reads it when it likes."""

    def __init__(self, name: str, tracks: Mapping[str, tuple[Parameter, ...]]) -> None:
        self._name, self._tracks = name, tracks
        self._began = time.monotonic()
        self.now = self.behind = 0.0
        self.total: float | None = None
        self._force = self._height = math.nan
        self._surface: float | None = None
        self._values = {track: np.full((2, len(parameters)), np.nan) for track, parameters in tracks.items()}
        self._beyond = {track: np.zeros(len(parameters)) for track, parameters in tracks.items()}
        self._flags: dict[str | None, tuple[Flag, ...]] = {}
        self._guard: GuardState | None = None
        self._judged = set[str]()  # tracks of which more than the estimator's own standard deviation is known

    def progress(self, now: float, total: float | None, behind: float) -> None:
        """How far it is [s], of how much, and how far the estimates are behind."""
        self.now, self.total, self.behind = now, total, behind

    def batch(self, device: str, batch: Batch) -> None:
        """Raw readings are not shown."""

    def samples(self, samples: Samples) -> None:
        """The latest force and height."""
        self._force, self._height = float(samples.force[-1]), float(samples.position[-1])

    def estimates(self, track: str, estimates: Estimates) -> None:
        """The latest that a track stands by; it stays when contact ends."""
        if len(estimates) and not int(estimates.status[-1]) & UNUSABLE:
            self._values[track] = np.array([estimates.values[-1], estimates.std[-1]])
            self._surface = float(estimates.surface[-1])

    def health(self, health: Mapping[str, Any]) -> None:
        """Uncertainty beyond the estimators' own."""
        for track, found in health.get("tracks", {}).items():
            parts = found["parameters"].values()
            self._beyond[track] = np.array([beyond(part) for part in parts])
            self._judged.add(track)

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Current flags on a track, or the record."""
        self._flags[track] = flags

    def guard(self, state: GuardState) -> None:
        """What the guard does."""
        self._guard = state

    @property
    def calls_for_stop(self) -> bool:
        """True if a person has to press the emergency stop."""
        return self._guard is not None and self._guard.calls_for_stop

    @property
    def _state(self) -> str:
        if self.calls_for_stop:
            return f"{EMERGENCY}: {self._guard.reason if self._guard else ''}"
        if self._guard is not None:
            return _PHASES[self._guard.phase] + (f": {self._guard.reason}" if self._guard.reason else "")
        return f"{self.now / max(time.monotonic() - self._began, 1e-3):.0f} x real time"

    @property
    def _time(self) -> str:
        whole = f" of {self.total:.1f}" if self.total else ""
        late = f", estimates are {self.behind:.1f} s behind" if self.behind > _BEHIND else ""
        return f"{self.now:.1f}{whole} s, {self._state}{late}"

    @property
    def _tip(self) -> str:
        depth = math.nan if self._surface is None else self._surface - self._height
        known = [f"force {self._force:.2f} N" if math.isfinite(self._force) else ""]
        known.append(f"depth {1e3 * depth:.2f} mm" if math.isfinite(depth) else "")
        return ", ".join(filter(None, known))

    def _value(self, track: str, column: int) -> str:
        (value, std), beyond = self._values[track][:, column], self._beyond[track][column]
        factor = display_unit(self._tracks[track][column].unit)[1]
        if track not in self._judged:  # of an offline track, whose result says how well it is known
            return f"{float(value) * factor:.4g}"
        return value_with_uncertainty(float(value) * factor, float(np.hypot(std, beyond)) * factor)

    def _codes(self, track: str | None) -> str:
        """Return each code once, with how often where several streams or devices raise it."""
        counts = Counter(flag.code for flag in self._flags.get(track, ()))
        return ", ".join(code if count == 1 else f"{code} x {count}" for code, count in counts.items())

    def line(self) -> str:
        """Return all of it in one line."""
        parts = [f"{self._time}; {self._tip}" if self._tip else self._time]
        for track, parameters in self._tracks.items():
            if not np.isfinite(self._values[track][0]).all():
                continue
            values = [f"{p.name} {self._value(track, i)} {display_unit(p.unit)[0]}" for i, p in enumerate(parameters)]
            flags = self._codes(track)
            parts.append(f"{track}: {', '.join(values)}{f' ({flags})' if flags else ''}")
        if self._codes(None):
            parts.append(f"every track: {self._codes(None)}")
        return "; ".join(parts)

    def view(self) -> RenderableType:
        """Return the panel."""
        from rich.console import Group
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        units = {p.name: display_unit(p.unit)[0] for parameters in self._tracks.values() for p in parameters}
        table = Table(title=Text(self._name), title_justify="left")
        table.add_column("track")
        for name, unit in units.items():
            table.add_column(Text(f"{name}\n{unit}"), justify="right")
        table.add_column("flags so far")
        for track, parameters in self._tracks.items():
            cells = {p.name: self._value(track, i) for i, p in enumerate(parameters)}
            table.add_row(Text(track), *(cells.get(name, "") for name in units), Text(self._codes(track), "yellow"))
        style = "bold red" if self.calls_for_stop else ""
        lines = [Text(line, style) for line in (self._time, self._tip) if line]
        if self._codes(None):
            lines.append(Text(f"every track: {self._codes(None)}", "yellow"))
        bar = [ProgressBar(self.total, min(self.now, self.total), width=60)] if self.total else []
        return Group(table, *lines, *bar)
