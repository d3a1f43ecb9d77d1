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

_IDLE = 0.02  # [s]
_NEWS = 50_000_000  # [ns] between two looks at who is there
LOST = WORDS  # word of the ring's head: messages not taken


def main(arguments: Sequence[str]) -> None:
    """Listen until the parent goes."""
    parent, settings = Parent(int(arguments[0])), json.loads(arguments[2])
    ring = Ring(int(arguments[1]), 1)
    try:
        outlet = Outlet(_descriptor(parent))
        scheduling = host().enter(40)  # the middleware's threads inherit it
        member = participant(network_of(settings))
        parent.tell("ready", scheduling=scheduling)
        gc.freeze()
        _listen(member, ring, parent, outlet, settings)
    except (DeviceError, LogError) as error:
        parent.tell("fault", text=str(error))
    except BrokenPipeError:  # the parent has gone
        pass


def _descriptor(parent: Parent) -> int:
    """Return the pipe for messages, which the parent hands over."""
    while not parent.descriptors and not parent.gone:
        parent.messages()
        time.sleep(0.002)
    if parent.gone:
        raise BrokenPipeError
    return parent.descriptors[0]


def _listen(member: Participant, ring: Ring, parent: Parent, outlet: Outlet, settings: dict[str, Any]) -> None:
    wanted: list[str] | None = settings["topics"]  # None: all whose type is known
    definitions: dict[str, str] = settings["definitions"]
    heard: dict[str, str] = {}  # types by topic
    looked = 0
    alarm: str | None = settings.get("alarm")
    if alarm is not None:
        member.talker.send(alarm, *boolean(False), latched=True)
    while not parent.gone:
        member.wait(_IDLE)
        now = time.monotonic_ns()
        ring.beat(now)
        for message in member.messages():
            outlet.put(message)
        outlet.flush()
        ring.head[LOST] = outlet.lost
        if now - looked > _NEWS:
            looked = now
            for found in member.news():
                problem = _begin(member, found, heard, definitions) if _counts(found, wanted) else None
                number = list(heard).index(found.topic) if found.topic in heard else None
                parent.tell("publication", number=number, problem=problem, **asdict(found))
        words = [message["say"] for message in parent.messages()]
        if "alarm" in words and alarm is not None:
            member.talker.send(alarm, *boolean(True), latched=True)
        if "close" in words:
            return


def _counts(found: Publication, wanted: list[str] | None) -> bool:
    return found.alive and (wanted is None or found.topic in wanted)


def _begin(member: Participant, found: Publication, heard: dict[str, str], definitions: dict[str, str]) -> str | None:
    """Listen to the topic of a new writer; what is in the way of that, in words."""
    if found.topic in heard:
        other = heard[found.topic] != found.type
        return f"is published as {found.type}, and read as {heard[found.topic]}" if other else None
    try:
        member.listen(len(heard), found.topic, found.type, definitions.get(found.type, ""))
    except LogError as error:
        return str(error)
    heard[found.topic] = found.type
    return None


if __name__ == "__main__":
    main(sys.argv[1:])
