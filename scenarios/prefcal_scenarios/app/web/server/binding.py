"""Binding the window's socket, with errors in the words of whoever chose host and port."""

import errno
import socket

from prefcal_env.errors import SettingsError


def bind(host: str, port: int) -> socket.socket:
    """A socket that listens on `host` and `port`; port 0 takes a free one.

    Raises:
        SettingsError: the port is taken or impossible, or the host is none of this machine.
    """
    if not 0 <= port <= 65535:
        raise SettingsError(f"port must lie in [0, 65535] (0: a free one), got {port}")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise SettingsError(
            f"host {host!r} has no address: expected a name or address of this machine"
        ) from error
    # "localhost" has two addresses where IPv6 is on; the older kind works everywhere.
    family, *_, address = min(found, key=lambda one: one[0] is not socket.AF_INET)
    try:
        return socket.create_server(address, family=family, backlog=128)
    except OSError as error:
        raise SettingsError(_in_words(error, host, port)) from error


def _in_words(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} of {host} is taken: choose another, or 0 for a free one"
    if error.errno == errno.EACCES:
        return f"port {port} is not yours to use: expected one from 1024 on, or 0 for a free one"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"host {host!r} is none of this machine's addresses: 127.0.0.1 always is"
    return f"cannot listen on port {port} of {host}: {error.strerror or error}"
