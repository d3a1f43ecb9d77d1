"""The socket of a page, which a page's server is handed."""

from __future__ import annotations

import socket


def listening_socket(port: int) -> socket.socket:
    """Return a socket that listens on a port of this machine alone, any free one for 0; raises OSError."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind(("127.0.0.1", port))
        found.listen(16)
    except OSError:
        found.close()
        raise
    return found
