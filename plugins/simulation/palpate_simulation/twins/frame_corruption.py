"""Damage that a bad line does to frames."""

from __future__ import annotations

import numpy as np

GARBLE_MASK = 0x5A  # turns half of the bits of a byte (a choice)
KINDS = ("bit", "byte", "garble", "header", "drop", "insert", "missing", "noise", "text", "headers")


def corrupt_frame(frame: bytes, damage: str, rng: np.random.Generator) -> bytes:
    """Return what arrives of a frame of 9 bytes or more, after one kind of damage.

    "bit", "byte", "garble" (3 to 8 bytes) and "header" change bytes, "drop" and "insert" cut some out or put some in,
    "missing" leaves nothing, "noise", "text" and "headers" come in front of the whole frame. The lengths are choices.
    """
    data = bytearray(frame)
    n = len(data)
    if damage == "bit":
        data[int(rng.integers(n))] ^= 1 << int(rng.integers(8))
    elif damage == "byte":
        data[int(rng.integers(n))] ^= int(rng.integers(1, 256))
    elif damage == "garble":
        first, length = int(rng.integers(n - 8)), int(rng.integers(3, 9))
        data[first : first + length] = (
            np.frombuffer(bytes(data[first : first + length]), np.uint8) ^ GARBLE_MASK
        ).tobytes()
    elif damage == "header":
        data[0] ^= int(rng.integers(1, 256))
    elif damage == "drop":
        first = int(rng.integers(n - 1))
        del data[first : first + int(rng.integers(1, n - 1))]
    elif damage == "insert":
        first = int(rng.integers(1, n))
        data[first:first] = rng.bytes(int(rng.integers(1, 21)))
    elif damage == "missing":
        data.clear()
    elif damage == "noise":
        data[0:0] = rng.bytes(int(rng.integers(20, 301)))
    elif damage == "text":
        data[0:0] = b"warning: \xaa something \xaa\r\n" * int(rng.integers(1, 5))
    else:
        data[0:0] = b"\xaa" * int(rng.integers(1, 80))
    return bytes(data)


def is_intact(damage: str) -> bool:
    """Return True for a kind of damage that leaves the frame itself whole, behind other bytes."""
    return damage in ("noise", "text", "headers")
