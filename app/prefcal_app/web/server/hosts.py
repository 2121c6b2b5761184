"""Decide which host names may reach the window, and warn about addresses that others can reach."""

import ipaddress
import socket
from dataclasses import dataclass

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True, slots=True)
class Hosts:
    """Accepted values of a Host header.

    This stops DNS rebinding: a foreign page whose name resolves to this machine still sends its
    own name, which is refused.

    Args:
        names: Names and addresses in lower case, without a port; IPv6 in brackets.
        port: Port of the window.
        any_address: Whether to accept every IP address, for a window that listens on all of them.
            No foreign page can have an IP address of this machine as its name.
    """

    names: frozenset[str]
    port: int
    any_address: bool = False

    @classmethod
    def of(cls, address: str, port: int) -> "Hosts":
        """Return the hosts of a window that listens on the IP address `address`."""
        ip = ipaddress.ip_address(address)
        if ip.is_loopback:
            return cls(frozenset({*LOOPBACK_NAMES, in_link(address)}), port)
        own = socket.gethostname().lower()
        names = {*LOOPBACK_NAMES, in_link(address), own, f"{own}.local"}
        return cls(frozenset(names), port, ip.is_unspecified)

    def allow(self, host: str) -> bool:
        """Return whether `host`, the value of a Host header, is accepted."""
        name, port = _split(host.lower())
        if port != self.port:
            return False
        return name in self.names or (self.any_address and _is_address(name))


def in_link(address: str) -> str:
    """Return an IP address as written in links; a wildcard becomes the loopback address."""
    ip = ipaddress.ip_address(address.partition("%")[0])
    if ip.is_unspecified:
        ip = ipaddress.ip_address("::1" if ip.version == 6 else "127.0.0.1")
    return f"[{ip}]" if ip.version == 6 else str(ip)


def seen_from_outside(address: str) -> str:
    """Return this machine's address for other machines, as written in links.

    Empty if the address of `in_link` works for them too, or if they cannot reach the window.

    Args:
        address: IP address that the window listens on.
    """
    ip = ipaddress.ip_address(address.partition("%")[0])
    if not ip.is_unspecified:
        return ""
    probe = ("2001:db8::1", 9) if ip.version == 6 else ("192.0.2.1", 9)  # reserved, unused
    family = socket.AF_INET6 if ip.version == 6 else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as udp:
            udp.connect(probe)  # sends nothing, but chooses the local address
            own = str(udp.getsockname()[0])
    except OSError:
        return socket.gethostname().lower()  # no route: a name that `Hosts` allows
    return in_link(own)


def warning(address: str) -> str:
    """Return the privacy warning for an IP address to listen on; empty for a loopback address."""
    if ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        return ""
    return (
        f"The window listens on {address}, beyond this machine: everybody on that network who "
        "has the link can see this study and answer its questions. The traffic is not encrypted: "
        "anybody who can monitor the network can read it, including the link."
    )


def _split(host: str) -> tuple[str, int]:
    """Return name and port of a Host header; port -1 if it is not a number."""
    name, colon, port = host.rpartition(":")
    if not colon or port.endswith("]"):
        return host, 80
    return name, int(port) if port.isascii() and port.isdigit() and len(port) <= 5 else -1


def _is_address(name: str) -> bool:
    bare = name[1:-1] if name.startswith("[") and name.endswith("]") else name
    try:
        ip = ipaddress.ip_address(bare)
    except ValueError:
        return False
    return (ip.version == 6) == (bare is not name)
