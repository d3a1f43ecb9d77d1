"""The socket of a page, which a page's server is handed."""

from __future__ import annotations

import socket

_BACKLOG = 16  # connections that wait to be accepted; a browser opens about ten at once


def listening_socket(port: int) -> socket.socket:
    """Return a socket that listens on a port of this machine alone, any free one for 0; raises OSError."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
        listener.listen(_BACKLOG)
    except OSError:
        listener.close()
        raise
    return listener
