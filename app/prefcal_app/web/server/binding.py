"""Bind the window's socket, with errors that name the host and port the person chose."""

import errno
import socket

from prefcal_env.errors import SettingsError


def bind(host: str, port: int) -> socket.socket:
    """Return a socket that listens on `host` and `port`; port 0 takes a free one.

    Raises:
        SettingsError: If the port is taken or invalid, or the host is not this machine.
    """
    if not 0 <= port <= 65535:
        raise SettingsError(f"port must be in [0, 65535] (0: any free port), got {port}")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise SettingsError(
            f"host {host!r} cannot be resolved: expected a name or address of this machine"
        ) from error
    # With IPv6, "localhost" has two addresses; the IPv4 one works everywhere.
    family, *_, address = min(found, key=lambda one: one[0] is not socket.AF_INET)
    try:
        listening = socket.create_server(address, family=family, backlog=128)
    except OSError as error:
        raise SettingsError(_in_words(error, host, port)) from error
    # Connections inherit it. Otherwise the second part of each response waits about 40 ms for the
    # peer's delayed acknowledgment; asyncio sets it only on sockets that name their protocol.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listening


def _in_words(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} on {host} is taken: choose another, or 0 for any free port"
    if error.errno == errno.EACCES:
        return f"port {port} needs administrator rights: choose 1024 or higher, or 0 for a free one"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"host {host!r} is not an address of this machine; 127.0.0.1 always works"
    return f"cannot listen on port {port} on {host}: {error.strerror or error}"
