"""What topics, publishers and messages of ROS 2 are in zenoh, as rmw_zenoh has it (its docs/design.md).

Messages of a topic go to ``DOMAIN/TOPIC/TYPE/HASH``, the type by its name in DDS. Each publisher holds a liveliness
token ``@ros2_lv/DOMAIN/SESSION/NODE/ENTITY/MP/ENCLAVE/NAMESPACE/NODENAME/TOPIC/TYPE/HASH/QOS``, with % for slashes in a
part. With each message goes its number, the time when it was written, and the 16 bytes that identify its publisher.
"""

from __future__ import annotations

import struct
from hashlib import blake2b

from palpate_ros2.names import dds_type, ros_type
from palpate_ros2.network import Publication

NO_HASH = "TypeHashNotSupported"  # what Humble, which has no type hashes, writes in their place
_ROOT, _PUBLISHER, _NODE = "@ros2_lv", "MP", "NN"
_PARTS = 13  # of a publisher's token
_BEST_EFFORT = "2"
_VOLATILE, _LATCHED = "::,10:,:,:,,", ":1:,1:,:,:,,"  # what is the default is left out: reliable, volatile
_ATTACHED = struct.Struct("<qq")  # number, time [ns]; then the length of the publisher's identity, and that
_WRITER = struct.Struct("<Q")


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Where messages of a topic go.

    >>> data_key(0, "/ft/wrench", "geometry_msgs/msg/Wrench", "*")
    '0/ft/wrench/geometry_msgs::msg::dds_::Wrench_/*'
    """
    return f"{domain}/{topic.strip('/')}/{dds_type(type_name)}/{type_hash}"


def tokens_of_publishers(domain: int) -> str:
    """Return the tokens of all publishers of a domain."""
    return f"{_ROOT}/{domain}/*/*/*/{_PUBLISHER}/**"


def node_token(domain: int, session: str, name: str) -> str:
    """Return the token of a node without a namespace."""
    return f"{_ROOT}/{domain}/{session}/0/0/{_NODE}/%/%/{name}"


def publisher_token(domain: int, session: str, entity: int, name: str, topic: str, kind: str, latched: bool) -> str:
    """Return the token of a publisher of a node; `kind`: type and hash as in its key."""
    qos = _LATCHED if latched else _VOLATILE
    return f"{_ROOT}/{domain}/{session}/0/{entity}/{_PUBLISHER}/%/%/{name}/{topic.replace('/', '%')}/{kind}/{qos}"


def publication_of(token: str) -> Publication | None:
    """Return the publisher that holds a token; None for any other, as of another version of rmw_zenoh."""
    parts = token.split("/")
    if len(parts) != _PARTS or parts[0] != _ROOT or parts[5] != _PUBLISHER:
        return None
    topic, kind, qos = parts[9].replace("%", "/"), ros_type(parts[10]), parts[12]
    return Publication(topic, kind, token, parts[2], qos.split(":")[0] != _BEST_EFFORT)


def identity(token: str) -> bytes:
    """16 bytes that identify a publisher."""
    return blake2b(token.encode(), digest_size=16).digest()


def attachment(number: int, stamp: int, who: bytes) -> bytes:
    """What goes with a message: its number, the time [ns] when it is written, who writes it."""
    return _ATTACHED.pack(number, stamp) + bytes([len(who)]) + who


def read_attachment(raw: bytes) -> tuple[int, int] | None:
    """When a message was written [ns], and a number for who has; None where nothing of the kind goes with it.

    >>> read_attachment(attachment(3, 1_000, b"0123456789abcdef"))
    (1000, 3978425819141910832)
    """
    head = _ATTACHED.size + 1
    if len(raw) < head + _WRITER.size or len(raw) != head + raw[head - 1]:
        return None
    _, stamp = _ATTACHED.unpack_from(raw)
    (writer,) = _WRITER.unpack_from(raw, head)
    return int(stamp), int(writer)
