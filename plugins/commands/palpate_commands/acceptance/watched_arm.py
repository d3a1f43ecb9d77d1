"""The robot of an acceptance: where its states are, and which of its values report a stop."""

from __future__ import annotations

from dataclasses import dataclass

from palpate import ConfigurationError, Device, Observable, ReportsStops, StopModes
from palpate_engine import Pipeline, own_motions


@dataclass(frozen=True)
class WatchedArm:
    """A robot whose stops can be watched while a run commands it, and where its states are."""

    name: str
    device: Device
    pose: str
    twist: str
    status: str
    mode: int  # column of the mode that reports its stops
    modes: StopModes

    @classmethod
    def of(cls, pipeline: Pipeline) -> WatchedArm:
        """Return the one robot of a pipeline; raises ConfigurationError."""
        names = list(own_motions(pipeline.devices))
        if len(names) != 1:
            raise ConfigurationError(f"{pipeline.path}: expected one robot, not {len(names)} ({', '.join(names)})")
        device = pipeline.devices[names[0]]
        layouts = {stream.layout: stream.name for stream in device.streams}
        modes = device.stop_modes if isinstance(device, ReportsStops) else None
        # Stream and column of the channel that reports a stop.
        columns: list[tuple[str, int]] = []
        for stream in device.streams:
            channels = [channel.name for channel in stream.channels]
            if modes is not None and modes.channel in channels:
                columns.append((stream.name, channels.index(modes.channel)))
        is_observable = device.live and isinstance(device, Observable) and {"pose", "twist"} <= layouts.keys()
        if modes is None or not (is_observable and columns):
            raise ConfigurationError(
                f"{pipeline.path}: [device.{names[0]}] cannot be watched while a run moves it: a live robot is needed "
                "whose pose, twist and `stop_modes` a second connection can observe, or a run record (its driver "
                "declares `single_connection`)"
            )
        return cls(names[0], device, layouts["pose"], layouts["twist"], *columns[0], modes)

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams that show how it stops."""
        return tuple(dict.fromkeys((self.pose, self.twist, self.status)))

    def columns(self, stream: str) -> int:
        """Return the number of channels of a stream."""
        return next(len(candidate.channels) for candidate in self.device.streams if candidate.name == stream)
