"""ROS 2: topics as a device, and results as topics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import FlagMeaning, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_ros2.device import Ros2Device as Ros2Device
    from palpate_ros2.sink import Ros2Sink as Ros2Sink


@plugin
def palpate_devices() -> dict[str, str]:
    """Return the device that reads topics of a running system."""
    return {"ros2": "palpate_ros2.device:Ros2Device"}


@plugin
def palpate_sinks() -> dict[str, str]:
    """Return the sink that publishes results as topics."""
    return {"ros2": "palpate_ros2.sink:Ros2Sink"}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the flags on topics of a ROS 2 system."""
    return {
        "ros2-limit": FlagMeaning(
            "doubtful",
            "A reading exceeded a limit of the device; nothing was stopped: palpate moves no robot over ROS.",
            "Look at the motion and at the controller's own limits.",
        ),
        "ros2-publishers": FlagMeaning(
            "doubtful",
            "Two publishers sent on one topic; only the first was read.",
            "Stop one of them, or give it another topic.",
        ),
        "ros2-restarted": FlagMeaning.sign(
            "ros2-publishers", "A publisher left and another one took over its topic: tare and settings may differ."
        ),
        "ros2-unread": FlagMeaning(
            "doubtful",
            "A topic cannot be read as published: it has another type, or is best effort where reliable is asked for.",
            "Check who publishes it (palpate info ros2://DOMAIN), and whether it is still the same driver.",
        ),
        "ros2-clock": FlagMeaning.sign(
            "clock-wander",
            "The stamps of a publisher jumped, as when a clock is set; they were mapped again from there on.",
        ),
        "ros2-clocks": FlagMeaning(
            "invalid",
            'Topics declared to share one clock (clocks = "one") are stamped by several that do not agree.',
            'Synchronise the computers (chrony, PTP), or set clocks = "each".',
        ),
        "ros2-missing": FlagMeaning(
            "note",
            "Messages are missing between the stamps of those received.",
            'Use a wire, a larger history, or reliability = "reliable".',
        ),
        "ros2-damaged": FlagMeaning(
            "note",
            "Messages could not be read, and were left out.",
            "Check who publishes them, and whether the type given is theirs.",
        ),
    }


__getattr__, __all__ = lazy_names(__name__, *palpate_devices().values(), *palpate_sinks().values())
