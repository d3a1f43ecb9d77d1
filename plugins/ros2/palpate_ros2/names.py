"""Names of topics and types of ROS 2 in DDS."""

from __future__ import annotations

_TOPIC_PREFIX = "rt/"  # by the convention of ROS 2; services and actions have other prefixes
_DDS_SUFFIX = "_"  # of the name of a message type


def dds_topic(topic: str) -> str:
    """Return the DDS topic of a ROS topic.

    >>> dds_topic("/ft_sensor/wrench")
    'rt/ft_sensor/wrench'
    """
    return _TOPIC_PREFIX + topic.removeprefix("/")


def ros_topic(dds_name: str) -> str | None:
    """Return the ROS topic of a DDS topic; None for any other DDS topic.

    >>> ros_topic("rt/wrench"), ros_topic("rq/spawnRequest")
    ('/wrench', None)
    """
    return "/" + dds_name.removeprefix(_TOPIC_PREFIX) if dds_name.startswith(_TOPIC_PREFIX) else None


def dds_type(type_name: str) -> str:
    """Return the DDS type of a ROS message type, which may be written with or without its ``msg``.

    >>> dds_type("geometry_msgs/Wrench")
    'geometry_msgs::msg::dds_::Wrench_'
    """
    package, *_, message_name = type_name.split("/")
    return f"{package}::msg::dds_::{message_name}{_DDS_SUFFIX}"


def ros_type(dds_name: str) -> str:
    """Return the ROS message type of a DDS type; a name of another form is returned unchanged.

    >>> ros_type("geometry_msgs::msg::dds_::WrenchStamped_")
    'geometry_msgs/msg/WrenchStamped'
    """
    match dds_name.split("::"):
        case [package, folder, "dds_", message_name]:
            return f"{package}/{folder}/{message_name[: -len(_DDS_SUFFIX)]}"
    return dds_name


def resolve_name(topic: str, namespace: str) -> str:
    """Return a topic with its namespace, as ROS resolves names: one that begins with a slash is absolute.

    >>> resolve_name("wrench", "/left"), resolve_name("/wrench", "/left")
    ('/left/wrench', '/wrench')
    """
    return topic if topic.startswith("/") else f"{namespace.rstrip('/')}/{topic}"
