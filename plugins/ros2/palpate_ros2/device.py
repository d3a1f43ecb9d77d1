"""Topics of a ROS 2 system as a device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from math import inf
from typing import Literal, Self

from palpate import Device, Link, LogError, Settings, Stream, Time, to_si
from palpate_kit.logs.joint_kinematics import Kinematics
from palpate_kit.logs.log_link import described_feeds
from palpate_records.messages.channel_mapping import Clock, MappedSignal, Orientation
from palpate_records.messages.definitions import parse_definitions
from palpate_records.messages.feeds import TopicFeed, mapped_streams
from palpate_records.recording import SystemSurvey
from pydantic import Field, field_validator, model_validator

from palpate_ros2.limits import Limit, LimitBounds
from palpate_ros2.link import Ros2Link
from palpate_ros2.listener import Listener, hear, listener, refuse_missing
from palpate_ros2.names import resolve_name
from palpate_ros2.network import Middleware, Network, demand_reachable
from palpate_ros2.publisher_statistics import CommonClock
from palpate_ros2.topic_snapshot import TopicSnapshot

_NAMING_TIME = 1.0  # [s], a choice: messages that name joints and frames may be so much later than the first


class WatchedRange(Settings):
    """Range that readings of a channel should be in, in its unit."""

    least: float | str | None = Field(default=None, description='such as "-8 mm"')
    greatest: float | str | None = Field(default=None, description='such as "20 N"')


class Ros2Device(Device):
    """Topics of a running ROS 2 system, by DDS (``palpate[ros2]``) or zenoh (``palpate[zenoh]``), without ROS.

    `signals` and `kinematics` say which numbers of which topics are the channels, with the keys of mcap-replay: a
    pipeline for a bag becomes live when the type of its device does. Stamps are mapped to the host's clock by the
    lower envelope of the arrivals, for each publisher by itself. It only reads: palpate moves no robot over ROS, and
    no motion is stopped by it.
    """

    domain: int = Field(default=0, ge=0, le=232, description="the DDS domain, as in ROS_DOMAIN_ID")
    middleware: Middleware = Field(
        default="dds", description='"dds" for rmw_fastrtps and rmw_cyclonedds; "zenoh" where nodes use rmw_zenoh_cpp'
    )
    signals: dict[str, MappedSignal] = Field(
        default={},
        description='channels by name: { force = { topic = "/wrench", field = "wrench.force.z", unit = "N" } }',
    )
    kinematics: Kinematics | None = Field(
        default=None, description="the robot whose joints give the streams tip and twist, such as ros.tip.z"
    )
    time: Clock = Field(
        default="stamp",
        description='"stamp" (of the header, else arrival), "log" (arrival), "publish" (when its writer wrote it), '
        'or { field = "data", index = 0 }',
    )
    clocks: Literal["each", "one"] = Field(
        default="each",
        description='"each": the clock of each topic is mapped separately; "one": all stamps are of one computer, or '
        "of several that are synchronised, and delays between topics are kept",
    )
    namespace: str = Field(default="", description="of topics that do not begin with a slash")
    types: dict[str, str] = Field(
        default={},
        description='definitions of custom types, each the text of its .msg or .idl: { "my_msgs/msg/Load" = '
        '"float64 newtons" }',
    )
    reliability: Literal["best-effort", "reliable"] = Field(
        default="best-effort",
        description='"reliable" requests lost messages again, and matches reliable writers only',
    )
    history: int = Field(default=1000, ge=1, le=100_000, description="messages of a topic that DDS may queue")
    interface: str | None = Field(default=None, min_length=1, description='network interface, such as "eth0" or "lo"')
    peers: tuple[str, ...] = Field(
        default=(),
        description="addresses of the other computers, where the network has no multicast; with zenoh: of the router, "
        'or of other members, such as "tcp/192.168.1.10:7447"',
    )
    limits: dict[str, WatchedRange] = Field(
        default={},
        description="limits of readings by channel; a reading beyond is flagged, and "
        'stops nothing: { force = { greatest = "20 N" }, "tip.z" = { least = "-8 mm" } }',
    )
    alarm: str | None = Field(
        default=None,
        pattern=r"^/[A-Za-z_]",
        description="topic (std_msgs/Bool, latched) that becomes true at the first reading beyond a limit",
    )
    patience: Time = Field(default=3.0, gt=0, description="longest time to find the topics")
    listen: Time | None = Field(default=None, gt=0, description="listening time; left out: until Ctrl-C")

    @field_validator("types")
    @classmethod
    def _parse_types(cls, types: dict[str, str]) -> dict[str, str]:
        for name, definition in types.items():
            if name.count("/") != 2:  # package/msg/Name
                raise ValueError(f'{name!r} is not a type: give it as "package/msg/Name"')
            try:
                parse_definitions(name, definition)
            except LogError as error:
                raise ValueError(str(error)) from error
        return types

    @model_validator(mode="after")
    def _demand_streams(self) -> Self:
        if not self.signals and self.kinematics is None:
            raise ValueError("give signals: which numbers of which topics are the channels")
        names = [stream.name for stream in self.streams]
        duplicates = [name for name in names if names.count(name) > 1]
        if duplicates:
            raise ValueError(
                f"two streams would be {duplicates[0]!r}; the kinematics make tip and twist: name others in topics"
            )
        return self

    @model_validator(mode="after")
    def _check_addresses(self) -> Self:
        demand_reachable(self.middleware, self.interface, self.peers)
        return self

    @model_validator(mode="after")
    def _check_limits(self) -> Self:
        if self.alarm is not None and not self.limits:
            raise ValueError("alarm needs limits")
        self._bounds  # noqa: B018  computes the bounds, which raises ValueError for an invalid limit
        return self

    @cached_property
    def _bounds(self) -> list[LimitBounds]:
        """The limits in SI, each with its stream and column; raises ValueError for an invalid limit."""
        channels = self._channels_by_name()
        bounds = []
        for name, limits in self.limits.items():
            if name not in channels:
                raise ValueError(f"limits: no channel {name!r} (there are: {', '.join(channels)})")
            stream_name, column, unit = channels[name]
            low = -inf if limits.least is None else to_si(limits.least, unit)
            high = inf if limits.greatest is None else to_si(limits.greatest, unit)
            if not low < high:
                raise ValueError(f"limits: of {name!r} the least is not below the greatest")
            bounds.append(LimitBounds(name, stream_name, column, unit, low, high))
        return bounds

    def _channels_by_name(self) -> dict[str, tuple[str, int, str]]:
        """Return stream, column and unit of each channel, by ``stream.channel`` and, if it is a signal, by its name."""
        channels = {}
        for stream in self.streams:
            for column, channel in enumerate(stream.channels):
                entry = (stream.name, column, channel.unit)
                channels[f"{stream.name}.{channel.name}"] = entry
                if channel.name in self.signals:
                    channels[channel.name] = entry
        return channels

    @property
    def live(self) -> bool:
        """True: it sends in real time."""
        return True

    @classmethod
    def system_at(cls, address: str) -> SystemSurvey | None:
        """Return the system at an address ``ros2://DOMAIN``; None for an address of another kind."""
        from palpate_ros2.domain_survey import address_of

        return address_of(address)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The streams: one for each mapped topic, and those of the tip."""
        mapped = [group.stream for group in mapped_streams(self._signals)]
        tip = self.kinematics.streams if self.kinematics is not None else ()
        return tuple(replace(stream, clock="host") for stream in (*mapped, *tip))

    @property
    def provenance(self) -> Mapping[str, str]:
        """Domain and middleware."""
        return {"domain": str(self.domain), "middleware": "cyclonedds" if self.middleware == "dds" else self.middleware}

    @contextmanager
    def connect(self, seed: int) -> Iterator[Link]:
        """Yield the link, once all topics are found; raises DeviceError or LogError where they are not as described."""
        name = f"ros2://{self.domain}"
        with listener(name, self.network, self._topics, self.types, self.alarm) as source:
            feeds = self._feeds(source, name)
            limits = [Limit(bound) for bound in self._bounds]
            common = CommonClock() if self.clocks == "one" else None
            yield Ros2Link(source, feeds, name, self.listen, limits, common)

    @property
    def network(self) -> Network:
        """The network of the settings."""
        return Network(
            domain=self.domain,
            interface=self.interface,
            peers=self.peers,
            reliable=self.reliability == "reliable",
            history=self.history,
            middleware=self.middleware,
        )

    @cached_property
    def _signals(self) -> dict[str, MappedSignal]:
        """The signals, their topics with the namespace."""
        signals = {}
        for name, signal in self.signals.items():
            changes: dict[str, object] = {"topic": resolve_name(signal.topic, self.namespace)}
            if isinstance(signal.orientation, Orientation):
                topic = resolve_name(signal.orientation.topic, self.namespace)
                changes["orientation"] = signal.orientation.model_copy(update={"topic": topic})
            signals[name] = signal.model_copy(update=changes)
        return signals

    @cached_property
    def _kinematics(self) -> Kinematics | None:
        """The kinematics, their topic with the namespace."""
        if self.kinematics is None:
            return None
        topic = resolve_name(self.kinematics.topic, self.namespace)
        return self.kinematics.model_copy(update={"topic": topic})

    @cached_property
    def _topics(self) -> list[str]:
        """The topics to subscribe to, each once: of signals, of their orientations, and of the joints."""
        signals = self._signals.values()
        topics = [signal.topic for signal in signals]
        topics += [signal.orientation.topic for signal in signals if isinstance(signal.orientation, Orientation)]
        if self._kinematics is not None:
            topics.append(self._kinematics.topic)
        return list(dict.fromkeys(topics))

    def _feeds(self, source: Listener, name: str) -> list[TopicFeed]:
        """Return the feeds of the topics; raises DeviceError or LogError where they are not as described."""
        topics = set(self._topics)
        snapshot = hear(source, self.types, self.patience, is_complete=lambda snapshot: topics <= snapshot.filled)
        refuse_missing(source, snapshot, self._topics, name, self.patience)
        try:
            feeds = self._described_feeds(snapshot, name)
        except LogError:  # joints and frames may be named by later messages than the first
            later = hear(source, self.types, _NAMING_TIME, is_complete=lambda snapshot: False)
            feeds = self._described_feeds(later if topics <= later.filled else snapshot, name)
        return [replace(feed, stream=replace(feed.stream, clock="host")) for feed in feeds]

    def _described_feeds(self, snapshot: TopicSnapshot, name: str) -> list[TopicFeed]:
        """Return the feeds by the messages of a snapshot; raises LogError where they are not as described."""
        return described_feeds(snapshot, self._signals, self._kinematics, self.time, name)
