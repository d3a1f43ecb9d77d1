"""Keys, tokens and attachments of ROS 2 in zenoh, as rmw_zenoh defines them (its docs/design.md).

Messages of a topic have the key ``DOMAIN/TOPIC/TYPE/HASH``, with the type by its name in DDS. Each publisher holds a
liveliness token ``@ros2_lv/DOMAIN/SESSION/NODE/ENTITY/MP/ENCLAVE/NAMESPACE/NODENAME/TOPIC/TYPE/HASH/QOS``, with % for
slashes in a part. Each message has an attachment: its number (int64), the time when it was written [ns] (int64), the
length of the publisher's identity (uint8, 16), and the identity.
"""

from __future__ import annotations

import struct
from hashlib import blake2b

from palpate_ros2.names import dds_type, ros_type
from palpate_ros2.network import Publication

NO_HASH = "TypeHashNotSupported"  # in place of a type hash; Humble has none
_ROOT, _PUBLISHER, _NODE = "@ros2_lv", "MP", "NN"
_TOKEN_PARTS = 13  # of a publisher's token
# Quality of service: reliability, durability, history and its depth; what is left out is the default.
_BEST_EFFORT = "2"  # reliability
_VOLATILE_QOS = "::,10:,:,:,,"
_LATCHED_QOS = ":1:,1:,:,:,,"
_NUMBER_AND_TIME = struct.Struct("<qq")
_WRITER = struct.Struct("<Q")  # number of a writer: the first bytes of its identity
_IDENTITY_SIZE = 16  # [bytes]


def data_key(domain: int, topic: str, type_name: str, type_hash: str) -> str:
    """Return the key of the messages of a topic.

    >>> data_key(0, "/ft/wrench", "geometry_msgs/msg/Wrench", "*")
    '0/ft/wrench/geometry_msgs::msg::dds_::Wrench_/*'
    """
    return f"{domain}/{topic.strip('/')}/{dds_type(type_name)}/{type_hash}"


def tokens_of_publishers(domain: int) -> str:
    """Return the key expression that matches the tokens of all publishers of a domain."""
    return f"{_ROOT}/{domain}/*/*/*/{_PUBLISHER}/**"


def node_token(domain: int, session: str, name: str) -> str:
    """Return the token of a node without a namespace."""
    return f"{_ROOT}/{domain}/{session}/0/0/{_NODE}/%/%/{name}"


def publisher_token(
    domain: int, session: str, entity: int, node_name: str, topic: str, type_and_hash: str, latched: bool
) -> str:
    """Return the token of a publisher, the `entity`-th of its session; `type_and_hash` as in its data key."""
    node = f"{_ROOT}/{domain}/{session}/0/{entity}/{_PUBLISHER}/%/%/{node_name}"
    qos = _LATCHED_QOS if latched else _VOLATILE_QOS
    return f"{node}/{topic.replace('/', '%')}/{type_and_hash}/{qos}"


def publication_of(token: str) -> Publication | None:
    """Return the publisher that holds a token; None for a token of another form, as of another version of rmw_zenoh."""
    parts = token.split("/")
    if len(parts) != _TOKEN_PARTS or parts[0] != _ROOT or parts[5] != _PUBLISHER:
        return None
    session = parts[2]
    topic, type_name, _, qos = parts[9:]
    reliability = qos.split(":")[0]
    return Publication(
        topic=topic.replace("%", "/"),
        type=ros_type(type_name),
        key=token,
        participant=session,
        reliable=reliability != _BEST_EFFORT,
    )


def identity(token: str) -> bytes:
    """Return 16 bytes that identify the publisher of a token."""
    return blake2b(token.encode(), digest_size=_IDENTITY_SIZE).digest()


def attachment(number: int, stamp: int, writer_identity: bytes) -> bytes:
    """Return the attachment of a message: number, time of writing [ns], length of the identity, and the identity."""
    return _NUMBER_AND_TIME.pack(number, stamp) + bytes([len(writer_identity)]) + writer_identity


def read_attachment(raw: bytes) -> tuple[int, int] | None:
    """Return time of writing [ns] and a number for the writer; None for bytes that are not such an attachment.

    >>> read_attachment(attachment(3, 1_000, b"0123456789abcdef"))
    (1000, 3978425819141910832)
    """
    identity_start = _NUMBER_AND_TIME.size + 1
    if len(raw) < identity_start + _WRITER.size or len(raw) != identity_start + raw[identity_start - 1]:
        return None
    _, stamp = _NUMBER_AND_TIME.unpack_from(raw)
    (writer,) = _WRITER.unpack_from(raw, identity_start)
    return int(stamp), int(writer)
