"""Names under which the window may be asked for, and what an address means for privacy."""

import ipaddress
import socket
from dataclasses import dataclass

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")


@dataclass(frozen=True, slots=True)
class Hosts:
    """The values of a Host header that are ours.

    A page of a foreign name that was made to resolve to this machine (DNS rebinding) sends its
    own name here, and is refused by it.

    Args:
        names: Names and addresses, IPv6 in brackets, lower case, without a port.
        port: Where the window listens.
        any_address: Whether every IP address will do: it listens on all of them, and no foreign
            page can have an address of this machine as its name.
    """

    names: frozenset[str]
    port: int
    any_address: bool = False

    @classmethod
    def of(cls, address: str, port: int) -> "Hosts":
        """Of a window that listens on the IP address `address`."""
        ip = ipaddress.ip_address(address)
        if ip.is_loopback:
            return cls(frozenset({*LOOPBACK_NAMES, in_link(address)}), port)
        own = socket.gethostname().lower()
        names = {*LOOPBACK_NAMES, in_link(address), own, f"{own}.local"}
        return cls(frozenset(names), port, ip.is_unspecified)

    def allow(self, host: str) -> bool:
        """Whether `host`, the value of a Host header, is ours."""
        name, port = _split(host.lower())
        if port != self.port:
            return False
        return name in self.names or (self.any_address and _is_address(name))


def in_link(address: str) -> str:
    """An IP address as links write it; a wildcard as the loopback address of its kind."""
    ip = ipaddress.ip_address(address.partition("%")[0])
    if ip.is_unspecified:
        ip = ipaddress.ip_address("::1" if ip.version == 6 else "127.0.0.1")
    return f"[{ip}]" if ip.version == 6 else str(ip)


def seen_from_outside(address: str) -> str:
    """Return how other machines call this one, as links write it.

    Empty where the link of `in_link` is the one for them too, or nobody else can come in.

    Args:
        address: The IP address that the window listens on.
    """
    ip = ipaddress.ip_address(address.partition("%")[0])
    if not ip.is_unspecified:
        return ""
    probe = ("2001:db8::1", 9) if ip.version == 6 else ("192.0.2.1", 9)  # for documents: nobody's
    family = socket.AF_INET6 if ip.version == 6 else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as udp:
            udp.connect(probe)  # sends nothing; it chooses the address that would be sent from
            own = str(udp.getsockname()[0])
    except OSError:
        return socket.gethostname().lower()  # no way out: a name that `Hosts` allows
    return in_link(own)


def warning(address: str) -> str:
    """What it means to listen on the IP address `address`; empty for a loopback address."""
    if ipaddress.ip_address(address.partition("%")[0]).is_loopback:
        return ""
    return (
        f"The window listens on {address}, beyond this machine: everybody on that network who "
        "has the link can see this study and answer its questions. The traffic is not encrypted: "
        "anybody who can listen in on the network can read it, the link too."
    )


def _split(host: str) -> tuple[str, int]:
    """Name and port of a Host header; port -1 where it is no number."""
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
