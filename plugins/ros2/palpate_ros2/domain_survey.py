"""``palpate info ros2://DOMAIN``: a survey of a running ROS 2 system, like that of a log."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
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
_DEVICE_KEYS_OF_LOGS = ("file", "begin", "end")
_ALIGNMENT_KEYS_OF_LOGS = ("touch_force", "tare_duration")  # found by the noise of a whole record
_MAX_DOMAIN = 232  # by the numbers of ports of DDS
_LISTENING_TIME = 3.0  # [s] where the address states none: a choice
_MAX_LISTENING_TIME = 3600.0  # [s], a choice: all messages are kept in memory


@dataclass(frozen=True)
class Address:
    """Domain of ROS 2 to listen to."""

    network: Network
    seconds: float  # of listening

    @property
    def name(self) -> str:
        """Name of the system in messages."""
        return f"ROS 2 domain {self.network.domain}"

    def survey(self) -> Survey:
        """Return a survey of the messages that are published while it listens."""
        survey = survey_of(snapshot_at(self), Path(self.name), f"for {self.seconds:g} s", report_progress)
        if survey.topics:
            return survey
        return replace(survey, notes=(*survey.notes, f"nothing is published: {self.network.nobody}"))

    def suggest(self, choices: Mapping[str, str]) -> Suggestion:
        """Return a device that reads the published topics; raises LogError if no number can be force or position."""
        suggestion = suggestion_for(snapshot_at(self), Path(self.name), "ros2", choices)
        # Keys and reasons of logs that a running system does not have.
        device = {key: entry for key, entry in suggestion.device.items() if key not in _DEVICE_KEYS_OF_LOGS}
        alignment = {key: entry for key, entry in suggestion.alignment.items() if key not in _ALIGNMENT_KEYS_OF_LOGS}
        reasons = tuple(reason for reason in suggestion.reasons if not reason.startswith("end:"))
        return replace(suggestion, device=device | self._device_keys(), alignment=alignment, reasons=reasons)

    def _device_keys(self) -> dict[str, Any]:
        """Return the keys of a device of type ros2 that reach this domain, without those of default value."""
        network = self.network
        keys: dict[str, Any] = {"domain": network.domain}
        if network.middleware != "dds":
            keys["middleware"] = network.middleware
        if network.interface:
            keys["interface"] = network.interface
        if network.peers:
            keys["peers"] = list(network.peers)
        return keys


def address_of(text: str) -> Address | None:
    """Return the address ``ros2://DOMAIN?interface=lo&peer=10.0.0.2&for=5s``; None for the name of a file.

    Raises ConfigurationError for a domain, key or duration that is invalid.
    """
    match = _ADDRESS.match(text)
    if match is None:
        return None
    domain = match["domain"] or "0"
    if not domain.isdigit() or int(domain) > _MAX_DOMAIN:
        raise ConfigurationError(
            f"{text}: {domain!r} is not a DDS domain, which is a whole number from 0 to {_MAX_DOMAIN}"
        )
    query = parse_qs(match["query"] or "", keep_blank_values=True)
    unknown_keys = [key for key in query if key not in _KEYS]
    if unknown_keys:
        raise ConfigurationError(f"{text}: {unknown_keys[0]!r} is not one of {', '.join(_KEYS)}")
    return Address(_network_of_query(text, int(domain), query), _listening_time(text, query))


def _network_of_query(text: str, domain: int, query: Mapping[str, list[str]]) -> Network:
    """Return the network of the query (lists of texts by key) of an address `text`; raises ConfigurationError."""
    middleware = query.get("middleware", ["dds"])[-1]
    if middleware not in ("dds", "zenoh"):
        raise ConfigurationError(f"{text}: middleware: {middleware!r} is neither dds nor zenoh")
    interface = query.get("interface", [""])[-1] or None
    peers = tuple(query.get("peer", ()))
    try:
        demand_reachable(middleware, interface, peers)
    except ValueError as error:
        raise ConfigurationError(f"{text}: {error}") from error
    return Network(domain, interface, peers, middleware=middleware)


def _listening_time(text: str, query: Mapping[str, list[str]]) -> float:
    """Return the seconds to listen, by ``for`` in the query of an address `text`; raises ConfigurationError."""
    duration = query.get("for", [str(_LISTENING_TIME)])[-1]
    try:
        seconds = float(duration) if _NUMBER.match(duration) else to_si(duration, "s")
    except ValueError as error:
        raise ConfigurationError(f"{text}: for: {error}") from error
    if not 0 < seconds <= _MAX_LISTENING_TIME:
        raise ConfigurationError(f"{text}: for: {seconds:g} s is not between 0 and {_MAX_LISTENING_TIME:g} s")
    return seconds


def snapshot_at(address: Address) -> TopicSnapshot:
    """Return all messages that are published at an address for a while; raises DeviceError where it cannot listen."""
    with listener(address.name, address.network, None, {}) as source:
        snapshot = hear(source, {}, address.seconds, is_complete=lambda snapshot: False)
        for topic, type_name in source.types.items():  # those without messages, too
            snapshot.know(topic, type_name, "")
    return snapshot
