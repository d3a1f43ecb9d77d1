"""What topics and types of ROS 2 are called in DDS."""

from __future__ import annotations

_TOPIC = "rt/"  # services and actions have other prefixes


def dds_topic(topic: str) -> str:
    """Return the DDS topic of a ROS topic.

    >>> dds_topic("/ft_sensor/wrench")
    'rt/ft_sensor/wrench'
    """
    return _TOPIC + topic.removeprefix("/")


def ros_topic(name: str) -> str | None:
    """Return the ROS topic of a DDS topic; None for any other.

    >>> ros_topic("rt/wrench"), ros_topic("rq/spawnRequest")
    ('/wrench', None)
    """
    return "/" + name.removeprefix(_TOPIC) if name.startswith(_TOPIC) else None


def dds_type(name: str) -> str:
    """Return the DDS type of a ROS message type, with or without its ``msg``.

    >>> dds_type("geometry_msgs/Wrench")
    'geometry_msgs::msg::dds_::Wrench_'
    """
    package, *_, kind = name.split("/")
    return f"{package}::msg::dds_::{kind}_"


def ros_type(name: str) -> str:
    """Return the ROS message type of a DDS type; another name as it is.

    >>> ros_type("geometry_msgs::msg::dds_::WrenchStamped_")
    'geometry_msgs/msg/WrenchStamped'
    """
    parts = name.split("::")
    return f"{parts[0]}/{parts[1]}/{parts[3][:-1]}" if len(parts) == 4 and parts[2] == "dds_" else name


def resolve_name(topic: str, namespace: str) -> str:
    """Return a topic with its namespace, as ROS resolves names: one that begins with a slash is whole.

    >>> resolve_name("wrench", "/left"), resolve_name("/wrench", "/left")
    ('/left/wrench', '/wrench')
    """
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"
