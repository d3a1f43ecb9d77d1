"""A sink that publishes estimates, maps and flags as topics of a ROS 2 system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from palpate import DeviceError, Estimates, Flag, OutputError, Run, Samples, Sink, Time, Writer
from pydantic import Field, model_validator

from palpate_ros2.messages import DIAGNOSTICS, VECTOR, cloud, diagnostics, legal_name, pack_vector_stamped
from palpate_ros2.network import Middleware, Network, Talker, demand_reachable
from palpate_ros2.participant import talker

_MAP_INTERVAL = 1.0  # [s] of the record, between two maps of a track: a choice
_MAX_POINTS = 5000  # of the map of one track, a choice: 1 m at `_POINT_DISTANCE`
_POINT_DISTANCE = 2e-4  # [m] between two points of a map, a choice: less than a tip is wide
_TIME_ROUNDING = 1e-6  # [s], a choice: an interval may be shorter by so much, and is never shorter than this
Rows = NDArray[np.intp]  # indexes of samples


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
    def _check_addresses(self) -> Self:
        demand_reachable(self.middleware, self.interface, self.peers)
        return self

    @contextmanager
    def open(self, run: Run) -> Iterator[Writer]:
        """Join the domain and yield the writer of the run; raises OutputError where the middleware does not start."""
        network = Network(self.domain, self.interface, self.peers, reliable=True, middleware=self.middleware)
        try:
            member = talker(network)
        except DeviceError as error:
            raise OutputError(f"sink ros2: {error}") from error
        try:
            yield RunPublisher(self, run, member)
        finally:
            member.close()


class RunPublisher:
    """Writer that publishes one run."""

    def __init__(self, settings: Ros2Sink, run: Run, talker: Talker) -> None:
        self._settings, self._talker = settings, talker
        self._base = f"{settings.namespace}/palpate"
        self._flags_topic = f"{self._base}/flags"
        self._parameters = {
            track: [parameter.name for parameter in parameters] for track, parameters in run.tracks.items()
        }
        self._samples: Samples | None = None  # of the next estimates
        # By track: times of the record [s] before which nothing is published.
        self._next_estimate = dict.fromkeys(run.tracks, -np.inf)
        self._next_map = dict.fromkeys(run.tracks, -np.inf)
        # By track: rows of the map: x, y, z [m], then value and standard deviation of each parameter.
        self._points: dict[str, list[list[float]]] = {track: [] for track in run.tracks}
        self._flags: dict[str, tuple[Flag, ...]] = {}
        talker.announce(self._flags_topic, DIAGNOSTICS, latched=True)
        for track, parameters in self._parameters.items():
            for parameter in parameters:
                talker.announce(self._parameter_topic(track, parameter), VECTOR)

    def batch(self, device: str, batch: Any) -> None:
        """Publish nothing: raw readings are topics of their devices."""

    def samples(self, samples: Samples) -> None:
        """Keep the samples that the next estimates belong to."""
        self._samples = samples

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Publish one estimate of each interval, and the map of the track once in `_MAP_INTERVAL`."""
        samples = self._samples
        if samples is None or len(samples) != len(estimates) or not len(estimates):
            return  # estimates of an offline estimator, which come after the run
        rows = np.flatnonzero(np.isfinite(estimates.values).all(axis=1))
        if not len(rows):
            return
        self._add_points(track, samples, estimates, rows)
        self._send_estimates(track, samples, estimates, rows)
        time = float(estimates.time[-1])
        if self._points[track] and time >= self._next_map[track]:
            self._next_map[track] = time + _MAP_INTERVAL
            self._send_map(track, self._stamp)

    def _send_estimates(self, track: str, samples: Samples, estimates: Estimates, rows: Rows) -> None:
        """Publish the first of the rows (n,) of finite estimates in each interval."""
        interval = max(self._settings.interval - _TIME_ROUNDING, _TIME_ROUNDING)
        times = estimates.time[rows]
        i = int(np.searchsorted(times, self._next_estimate[track]))
        while i < len(rows):
            row = int(rows[i])
            for column, parameter in enumerate(self._parameters[track]):
                numbers = (
                    float(estimates.values[row, column]),
                    float(estimates.std[row, column]),
                    float(estimates.time[row]),
                )
                message = pack_vector_stamped(int(samples.stamp[row]), self._settings.frame, numbers)
                self._talker.send(self._parameter_topic(track, parameter), *message)
            self._next_estimate[track] = float(estimates.time[row]) + interval
            i += int(np.searchsorted(times[i:], self._next_estimate[track]))

    def _add_points(self, track: str, samples: Samples, estimates: Estimates, rows: Rows) -> None:
        """Add the rows (n,) in contact whose place is known to the map, where it is far enough from the last point."""
        points = self._points[track]
        for row in rows.tolist():
            x, y = samples.lateral[row].tolist()
            if not samples.contact[row] or not np.isfinite([x, y]).all() or len(points) > _MAX_POINTS:
                continue
            pairs = np.column_stack([estimates.values[row], estimates.std[row]]).ravel()
            numbers = [float(estimates.surface[row]), *pairs.tolist()]
            if points and np.hypot(x - points[-1][0], y - points[-1][1]) < _POINT_DISTANCE:
                points[-1][2:] = numbers  # the latest estimate at a point counts
            else:
                points.append([x, y, *numbers])

    def _send_map(self, track: str, stamp: int) -> None:
        """Publish the map of a track at a time `stamp` [ns]."""
        fields = ["x", "y", "z"]
        for parameter in self._parameters[track]:
            fields += [parameter, f"{parameter}_std"]
        message = cloud(stamp, self._settings.frame, fields, np.array(self._points[track]))
        self._talker.send(f"{self._track_topic(track)}/map", *message, latched=True)

    def flags(self, track: str | None, flags: tuple[Flag, ...]) -> None:
        """Keep all current flags on a track, or with None on the record, for the next message."""
        self._flags[track or "record"] = flags

    def health(self, health: Mapping[str, Any]) -> None:
        """Publish the flags: `health` is called once a second."""
        self._send_flags()

    def result(self, table: Mapping[str, Any]) -> None:
        """Publish the last maps, and the flags of the result."""
        for track, points in self._points.items():
            if points:
                self._send_map(track, self._stamp)
        for track, entry in table["tracks"].items():
            self._flags[track] = tuple(map(Flag.of_table, entry["flags"]))
        self._send_flags()

    def _send_flags(self) -> None:
        """Publish the current flags."""
        self._talker.send(self._flags_topic, *diagnostics(self._stamp, self._flags), latched=True)

    @property
    def _stamp(self) -> int:
        """The time [ns] of the latest sample; 0 before the first."""
        return int(self._samples.stamp[-1]) if self._samples is not None and len(self._samples) else 0

    def _track_topic(self, track: str) -> str:
        """Return the topic of a track, ``model/estimator``."""
        return "/".join([self._base, *(legal_name(part) for part in track.split("/"))])

    def _parameter_topic(self, track: str, parameter: str) -> str:
        """Return the topic of a parameter of a track."""
        return f"{self._track_topic(track)}/{legal_name(parameter)}"
