"""The process that listens to topics, so that no busy thread of the main job delays a message."""

from __future__ import annotations

import gc
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from palpate import DeviceError, LogError
from palpate_kit.acquisition.child import Parent
from palpate_kit.acquisition.computer import host
from palpate_kit.acquisition.ring import WORDS, Ring

from palpate_ros2.message_pipe import Outlet
from palpate_ros2.messages import boolean
from palpate_ros2.network import Participant, Publication, network_of
from palpate_ros2.participant import participant

_MAX_WAIT = 0.02  # [s] for a message, a choice: the parent sees a beat at least so often
_PUBLISHER_INTERVAL = 50_000_000  # [ns] between two looks for publishers: a choice
_PIPE_WAIT = 0.002  # [s] between two looks for the pipe, at the start: a choice
_RING_COLUMNS = 1  # the ring carries heartbeats and counts alone
_PRIORITY = 40  # of real time, a choice
LOST = WORDS  # word of the ring's head that counts lost messages


def main(arguments: Sequence[str]) -> None:
    """Listen until the parent leaves; the arguments are the descriptors of socket and ring, and settings as JSON."""
    parent = Parent(int(arguments[0]))
    ring = Ring(int(arguments[1]), _RING_COLUMNS)
    settings = json.loads(arguments[2])
    try:
        outlet = Outlet(_pipe_descriptor(parent))
        scheduling = host().enter(_PRIORITY)  # before the middleware starts: its threads inherit it
        member = participant(network_of(settings))
        parent.tell("ready", scheduling=scheduling)
        gc.freeze()
        _TopicRelay(member, parent, settings).run(ring, outlet)
    except (DeviceError, LogError) as error:
        parent.tell("fault", text=str(error))
    except BrokenPipeError:  # the parent has gone
        pass


def _pipe_descriptor(parent: Parent) -> int:
    """Return the descriptor of the pipe for messages, which the parent hands over; raises BrokenPipeError."""
    while not parent.descriptors and not parent.gone:
        parent.messages()
        time.sleep(_PIPE_WAIT)
    if parent.gone:
        raise BrokenPipeError
    return parent.descriptors[0]


class _TopicRelay:
    """Relay of the messages and publishers of topics to the parent.

    Settings: `topics` (None: all topics whose type is known), `definitions` of custom types by name, and the topic of
    the `alarm` or None.
    """

    def __init__(self, member: Participant, parent: Parent, settings: dict[str, Any]) -> None:
        self._member, self._parent = member, parent
        self._requested: list[str] | None = settings["topics"]
        self._definitions: dict[str, str] = settings["definitions"]
        self._alarm: str | None = settings.get("alarm")
        self._types: dict[str, str] = {}  # of the subscribed topics, in the order of their numbers

    def run(self, ring: Ring, outlet: Outlet) -> None:
        """Send the parent messages and reports, and publish the alarm on request, until it closes or is gone."""
        last_look = 0  # [ns]
        self._publish_alarm(False)
        while not self._parent.gone:
            self._member.wait(_MAX_WAIT)
            now = time.monotonic_ns()
            ring.beat(now)
            for message in self._member.messages():
                outlet.put(message)
            outlet.flush()
            ring.head[LOST] = outlet.lost
            if now - last_look > _PUBLISHER_INTERVAL:
                last_look = now
                for publication in self._member.news():
                    self._report(publication)
            requests = [message["say"] for message in self._parent.messages()]
            if "alarm" in requests:
                self._publish_alarm(True)
            if "close" in requests:
                return

    def _publish_alarm(self, state: bool) -> None:
        """Publish the state of the alarm, if it has a topic."""
        if self._alarm is not None:
            self._member.talker.send(self._alarm, *boolean(state), latched=True)

    def _report(self, publication: Publication) -> None:
        """Report a publisher that has appeared or left to the parent; subscribe to a requested topic."""
        topic = publication.topic
        problem = None
        if publication.alive and (self._requested is None or topic in self._requested):
            problem = self._subscribe(publication)
        number = list(self._types).index(topic) if topic in self._types else None
        self._parent.tell("publication", number=number, problem=problem, **asdict(publication))

    def _subscribe(self, publication: Publication) -> str | None:
        """Subscribe to the topic of a publisher, once; return a clause on why it cannot be read, or None."""
        topic, type_name = publication.topic, publication.type
        if topic in self._types:
            subscribed = self._types[topic]
            return f"is published as {type_name}, and read as {subscribed}" if subscribed != type_name else None
        try:
            self._member.listen(len(self._types), topic, type_name, self._definitions.get(type_name, ""))
        except LogError as error:
            return str(error)
        self._types[topic] = type_name
        return None


if __name__ == "__main__":
    main(sys.argv[1:])
