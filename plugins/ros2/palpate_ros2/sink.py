"""What palpate finds, as topics of a ROS 2 system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self

import numpy as np
from palpate import DeviceError, Estimates, Flag, OutputError, Run, Samples, Sink, Time, Writer
from pydantic import Field, model_validator

from palpate_ros2.messages import DIAGNOSTICS, VECTOR, cloud, diagnostics, legal_name, pack_vector_stamped
from palpate_ros2.network import Middleware, Network, Talker, demand_reachable
from palpate_ros2.participant import talker

_CLOUD_EVERY = 1.0  # [s] of the record
_PLACES = 5000  # of one track that a map shows
_LEAST = 1e-6  # [s] between two messages of a topic, and what rounding may take from an interval
_APART = 2e-4  # [m] between two of them


class Ros2Sink(Sink):
    """Publishes the estimates to a ROS 2 system during the run; needs ``palpate[ros2]``, or ``palpate[zenoh]``.

    Standard types only, so that rviz, plotjuggler and ``ros2 topic echo`` show them: for every parameter of a track
    ``palpate/MODEL/ESTIMATOR/PARAMETER`` (geometry_msgs/Vector3Stamped: value, standard deviation, both in SI, and the
    time of the record), ``palpate/MODEL/ESTIMATOR/map`` where the tip's place is known (sensor_msgs/PointCloud2: x, y,
    z, then value and standard deviation of each parameter) and ``palpate/flags`` (diagnostic_msgs/DiagnosticArray).
    Nothing is published that moves a robot.
    """

    domain: int = Field(default=0, ge=0, le=232, description="the DDS domain, as in ROS_DOMAIN_ID")
    middleware: Middleware = Field(default="dds", description='"zenoh" where nodes use rmw_zenoh_cpp')
    namespace: str = Field(default="", pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)*$", description='such as "/left"')
    interval: Time = Field(default=0.02, ge=0, description="interval of the published estimates, in time of the record")
    frame: str = Field(default="surface", description="frame_id of the messages")
    interface: str | None = Field(default=None, min_length=1, description='network interface, such as "eth0" or "lo"')
    peers: tuple[str, ...] = Field(
        default=(), description="addresses of the other computers, where the network has no multicast"
    )

    @model_validator(mode="after")
    def _reachable(self) -> Self:
        demand_reachable(self.middleware, self.interface, self.peers)
        return self

    @contextmanager
    def open(self, run: Run) -> Iterator[Writer]:
        """A participant of the domain; raises OutputError where DDS does not come up."""
        try:
            member = talker(Network(self.domain, self.interface, self.peers, True, middleware=self.middleware))
        except DeviceError as error:
            raise OutputError(f"sink ros2: {error}") from error
        try:
            yield RunPublisher(self, run, member)
        finally:
            member.close()


class RunPublisher:
    """One run on its way out."""

    def __init__(self, settings: Ros2Sink, run: Run, talker: Talker) -> None:
        self._settings, self._talker = settings, talker
        self._base = f"{settings.namespace}/palpate"
        self._names = {track: [p.name for p in parameters] for track, parameters in run.tracks.items()}
        self._samples: Samples | None = None
        self._next = dict.fromkeys(run.tracks, -np.inf)
        self._next_cloud = dict.fromkeys(run.tracks, -np.inf)
        self._places: dict[str, list[list[float]]] = {track: [] for track in run.tracks}
        self._flags: dict[str, tuple[Flag, ...]] = {}
        talker.announce(f"{self._base}/flags", DIAGNOSTICS, latched=True)
        for track, names in self._names.items():
            for name in names:
                talker.announce(f"{self._topic(track)}/{legal_name(name)}", VECTOR)

    def batch(self, device: str, batch: Any) -> None:
        """Raw readings are those of others."""

    def samples(self, samples: Samples) -> None:
        """What the next estimates are of."""
        self._samples = samples

    def estimates(self, track: str, estimates: Estimates) -> None:
        """One of every interval, and the places that have become known."""
        samples = self._samples
        if samples is None or len(samples) != len(estimates) or not len(estimates):
            return  # an offline estimator's come when the run is over
        known = np.isfinite(estimates.values).all(axis=1)
        rows = np.flatnonzero(known)
        if not len(rows):
            return
        self._learn(track, samples, estimates, rows)
        while len(rows := rows[np.searchsorted(estimates.time[rows], self._next[track]) :]):
            self._send_values(track, estimates, int(rows[0]), int(samples.stamp[rows[0]]))
            self._next[track] = float(estimates.time[rows[0]]) + max(self._settings.interval - _LEAST, _LEAST)
        time = float(estimates.time[-1])
        if self._places[track] and time >= self._next_cloud[track]:
            self._next_cloud[track] = time + _CLOUD_EVERY
            self._send_map(track, self._stamp)

    def _send_values(self, track: str, estimates: Estimates, row: int, stamp: int) -> None:
        for k, name in enumerate(self._names[track]):
            numbers = float(estimates.values[row, k]), float(estimates.std[row, k]), float(estimates.time[row])
            topic = f"{self._topic(track)}/{legal_name(name)}"
            self._talker.send(topic, *pack_vector_stamped(stamp, self._settings.frame, numbers))

    def _learn(self, track: str, samples: Samples, estimates: Estimates, rows: Any) -> None:
        places = self._places[track]
        for row in rows.tolist():
            x, y = samples.lateral[row].tolist()
            if not samples.contact[row] or not np.isfinite([x, y]).all() or len(places) > _PLACES:
                continue
            pairs = np.column_stack([estimates.values[row], estimates.std[row]]).ravel()
            numbers = [float(estimates.surface[row]), *pairs.tolist()]
            if places and np.hypot(x - places[-1][0], y - places[-1][1]) < _APART:
                places[-1][2:] = numbers  # the latest of a place counts
            else:
                places.append([x, y, *numbers])

    def _send_map(self, track: str, stamp: int) -> None:
        fields = ["x", "y", "z", *(f"{name}{end}" for name in self._names[track] for end in ("", "_std"))]
        message = cloud(stamp, self._settings.frame, fields, np.array(self._places[track]))
        self._talker.send(f"{self._topic(track)}/map", *message, latched=True)

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """All current flags on a track, or on the record."""
        self._flags[track or "record"] = flags

    def health(self, health: Mapping[str, Any]) -> None:
        """The flags once a second, and before the health only where they have changed."""
        self._talker.send(f"{self._base}/flags", *diagnostics(self._stamp, self._flags), latched=True)

    def result(self, table: Mapping[str, Any]) -> None:
        """The last map, and the flags of the result."""
        for track, places in self._places.items():
            if places:
                self._send_map(track, self._stamp)
        for track, found in table["tracks"].items():
            self._flags[track] = tuple(map(Flag.of_table, found["flags"]))
        self._talker.send(f"{self._base}/flags", *diagnostics(self._stamp, self._flags), latched=True)

    @property
    def _stamp(self) -> int:
        """The time [ns] of the latest sample."""
        return int(self._samples.stamp[-1]) if self._samples is not None and len(self._samples) else 0

    def _topic(self, track: str) -> str:
        return "/".join([self._base, *(legal_name(part) for part in track.split("/"))])
