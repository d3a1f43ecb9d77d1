"""``palpate info ros2://DOMAIN``: what a running ROS 2 system publishes, looked into as a log is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import parse_qs

from palpate import ConfigurationError, to_si
from palpate_kit.logs.topic_suggestion import suggestion_for
from palpate_kit.terminal.progress import report_progress
from palpate_records.recording import Suggestion, Survey
from palpate_records.survey import survey_of

from palpate_ros2.listener import hear, listener
from palpate_ros2.network import Network, demand_reachable
from palpate_ros2.topic_snapshot import TopicSnapshot

_ADDRESS = re.compile(r"^ros2:/{1,2}(?P<domain>[^?/]*)(?:\?(?P<query>.*))?$")  # a path loses one of two slashes
_NUMBER = re.compile(r"^\d+(\.\d*)?$")
_KEYS = ("interface", "peer", "for", "middleware")
_SECONDS = 3.0
_MOST = 3600.0  # [s]


@dataclass(frozen=True)
class Address:
    """A domain, how to reach it, and how long to listen."""

    network: Network
    seconds: float

    @property
    def name(self) -> str:
        """As in messages."""
        return f"ROS 2 domain {self.network.domain}"

    def survey(self) -> Survey:
        """What is published there."""
        found = survey_of(snapshot_at(self), Path(self.name), f"for {self.seconds:g} s", report_progress)
        note = f"nothing is published: {self.network.nobody}"
        return found if found.topics else replace(found, notes=(*found.notes, note))

    def suggest(self, choices: Mapping[str, str]) -> Suggestion:
        """Return a device that reads what is published; raises LogError where nothing in it can be force or
        position."""
        found = suggestion_for(snapshot_at(self), Path(self.name), "ros2", choices)
        device = {key: value for key, value in found.device.items() if key not in ("file", "begin", "end")}
        network = self.network
        device["domain"] = network.domain
        device |= {"middleware": network.middleware} if network.middleware != "dds" else {}
        device |= {"interface": network.interface} if network.interface else {}
        device |= {"peers": list(network.peers)} if network.peers else {}
        reasons = tuple(text for text in found.reasons if not text.startswith("end:"))
        alignment = {
            key: value for key, value in found.alignment.items() if key not in ("touch_force", "tare_duration")
        }
        return replace(found, device=device, alignment=alignment, reasons=reasons)


def address_of(text: str) -> Address | None:
    """Return the address ``ros2://DOMAIN?interface=lo&peer=10.0.0.2&for=5s``; None where it is a file.
    ConfigurationError."""
    match = _ADDRESS.match(text)
    if match is None:
        return None
    domain = match["domain"] or "0"
    if not domain.isdigit() or int(domain) > 232:
        raise ConfigurationError(f"{text}: {domain!r} is not a DDS domain, which is a whole number from 0 to 232")
    given = parse_qs(match["query"] or "", keep_blank_values=True)
    if unknown := next((key for key in given if key not in _KEYS), None):
        raise ConfigurationError(f"{text}: {unknown!r} is not one of {', '.join(_KEYS)}")
    middleware = given.get("middleware", ["dds"])[-1]
    if middleware not in ("dds", "zenoh"):
        raise ConfigurationError(f"{text}: middleware: {middleware!r} is neither dds nor zenoh")
    interface, peers = given.get("interface", [""])[-1] or None, tuple(given.get("peer", ()))
    try:
        demand_reachable(middleware, interface, peers)
    except ValueError as error:
        raise ConfigurationError(f"{text}: {error}") from error
    network = Network(int(domain), interface, peers, middleware=middleware)
    try:
        text_of = given.get("for", [str(_SECONDS)])[-1]
        seconds = float(text_of) if _NUMBER.match(text_of) else to_si(text_of, "s")
    except ValueError as error:
        raise ConfigurationError(f"{text}: for: {error}") from error
    if not 0 < seconds <= _MOST:
        raise ConfigurationError(f"{text}: for: {seconds:g} s is not between 0 and {_MOST:g} s")
    return Address(network, seconds)


def snapshot_at(address: Address) -> TopicSnapshot:
    """Return all that is published at an address for a while; raises DeviceError where that is nothing."""
    with listener(address.name, address.network, None, {}) as source:
        heard = hear(source, {}, address.seconds, lambda heard: False)
        for topic, type_name in source.types.items():
            heard.know(topic, type_name, "")
    return heard
