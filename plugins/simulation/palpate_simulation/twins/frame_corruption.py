"""What a bad line does to frames."""

from __future__ import annotations

import numpy as np

KINDS = ("bit", "byte", "garble", "header", "drop", "insert", "missing", "noise", "text", "headers")


def corrupt_frame(frame: bytes, kind: str, rng: np.random.Generator) -> bytes:
    """What arrives of a frame: damaged in place, cut, missing, or with something strange in front of it."""
    data = bytearray(frame)
    n = len(data)
    if kind == "bit":
        data[int(rng.integers(n))] ^= 1 << int(rng.integers(8))
    elif kind == "byte":
        data[int(rng.integers(n))] ^= int(rng.integers(1, 256))
    elif kind == "garble":
        first, length = int(rng.integers(n - 8)), int(rng.integers(3, 9))
        data[first : first + length] = (np.frombuffer(bytes(data[first : first + length]), np.uint8) ^ 0x5A).tobytes()
    elif kind == "header":
        data[0] ^= int(rng.integers(1, 256))
    elif kind == "drop":
        first = int(rng.integers(n - 1))
        del data[first : first + int(rng.integers(1, n - 1))]
    elif kind == "insert":
        first = int(rng.integers(1, n))
        data[first:first] = rng.bytes(int(rng.integers(1, 21)))
    elif kind == "missing":
        data.clear()
    elif kind == "noise":
        data[0:0] = rng.bytes(int(rng.integers(20, 301)))
    elif kind == "text":
        data[0:0] = b"warning: \xaa something \xaa\r\n" * int(rng.integers(1, 5))
    else:
        data[0:0] = b"\xaa" * int(rng.integers(1, 80))
    return bytes(data)


def is_intact(kind: str) -> bool:
    """Return True if the frame itself survives: what came is only in front of it."""
    return kind in ("noise", "text", "headers")
