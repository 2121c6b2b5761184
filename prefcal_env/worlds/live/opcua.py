"""Connect to a live plant over OPC UA, with the package asyncua (extra `opcua`)."""

import asyncio
import logging
import threading
from collections.abc import Coroutine, Sequence
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as TooLate
from contextlib import suppress
from math import isfinite, nan
from typing import Any, TypeVar

from prefcal_env.errors import ConnectionLostError, LiveError, SettingsError
from prefcal_env.optional import world

T = TypeVar("T")


class OPCUAPlant:
    """Plant behind an OPC UA server.

    Args:
        address: Address of the server, for example "opc.tcp://192.0.2.1:4840".
        user: User name; empty for an anonymous session.
        password: Password of the user.
        security: Security as asyncua takes it, "Policy,Mode,certificate,key"; empty for none.
        timeout: Longest time, in seconds, for a request.

    Raises:
        MissingExtraError: If asyncua is not installed.
        LiveError: If the address is none of OPC UA.
        SettingsError: If the time limit is not above 0 s and finite.
    """

    def __init__(
        self, address: str, *, user: str = "", password: str = "", security: str = "", timeout: float = 4.0
    ) -> None:
        # Without types: asyncua exports its names implicitly.
        self._asyncua: Any = world("live").imported()
        # What it logs, such as the time limit of a session, is nothing for the terminal: errors are raised.
        logging.getLogger("asyncua").addHandler(logging.NullHandler())
        if not address.startswith("opc.tcp://"):
            raise LiveError(f"the address of an OPC UA server begins with opc.tcp://, got {address!r}")
        if not (isfinite(timeout) and timeout > 0):
            raise SettingsError(f"timeout must be above 0 s and finite, got {timeout}")
        self.address, self._timeout = address, timeout
        self._ua: Any = self._asyncua.ua
        self._user, self._password, self._security = user, password, security
        self._client: Any = None
        self._types: dict[str, Any] = {}
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._client is not None

    def connect(self) -> None:
        """Connect, or connect again after a loss; see `LivePlant`."""
        self._drop()
        self._do(self._connect())

    def read(self, nodes: Sequence[str]) -> list[float]:
        """Return the value of each node; NaN for bad quality and for text; see `LivePlant`."""
        return self._do(self._read(nodes))

    def write(self, node: str, value: float) -> None:
        """Write a value in the type of the node.

        Raises:
            ConnectionLostError: If the connection is lost; the value may have arrived.
            LiveError: If the server refuses the value, or the node cannot hold it exactly.
        """
        self._do(self._write(node, value))

    def whole(self, nodes: Sequence[str]) -> list[bool]:
        """Return for each node whether its type holds whole numbers only; see `TypedPlant`."""
        return self._do(self._whole(nodes))

    def close(self) -> None:
        """Disconnect and end the thread of the connection."""
        self._drop()
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._loop = None

    async def _connect(self) -> None:
        # Its own watchdog would give up after 1 s, however slow the server may be.
        client = self._asyncua.Client(self.address, self._timeout, watchdog_intervall=self._timeout)
        if self._user:
            client.set_user(self._user)
            client.set_password(self._password)
        if self._security:
            await client.set_security_string(self._security)
        connecting = asyncio.ensure_future(client.connect())
        try:
            # asyncua waits for the time limit if the connection is closed at once, as a proxy or a
            # tunnel to a server that is down does: the plant would be restored that much later.
            while not (await asyncio.wait({connecting}, timeout=0.02))[0]:
                if _is_closed(client):
                    raise ConnectionError("the connection was closed at once")
            connecting.result()
        except BaseException:
            connecting.cancel()
            with suppress(Exception):
                client.disconnect_socket()
            raise
        self._client = client

    async def _read(self, nodes: Sequence[str]) -> list[float]:
        there = [self._node(node) for node in nodes]
        found = await self._connection().read_attributes(there)
        codes = self._ua.StatusCodes
        for node, value in zip(nodes, found, strict=True):
            if value.StatusCode.value in (codes.BadNodeIdUnknown, codes.BadNodeIdInvalid):
                raise LiveError(f"the server {self.address} has no node {node!r}")
        return [_number(value) for value in found]

    async def _write(self, node: str, value: float) -> None:
        kind, names = await self._type(node), self._ua.VariantType
        plain: float | int | bool = value
        if not self._is_real(kind):
            # Rounded, it could be outside the limits that were checked.
            if value != round(value) or (kind == names.Boolean and value not in (0, 1)):
                raise LiveError(
                    f"the node {node!r} has the type {kind.name} and cannot hold {value:g}: "
                    "declare integer = true. Nothing was written"
                )
            plain = bool(value) if kind == names.Boolean else round(value)
        await self._node(node).write_value(self._ua.DataValue(self._ua.Variant(plain, kind)))

    async def _whole(self, nodes: Sequence[str]) -> list[bool]:
        return [not self._is_real(await self._type(node)) for node in nodes]

    async def _type(self, node: str) -> Any:
        there = self._node(node)
        if node not in self._types:
            self._types[node] = await there.read_data_type_as_variant_type()
        return self._types[node]

    def _is_real(self, kind: Any) -> bool:
        return kind in (self._ua.VariantType.Double, self._ua.VariantType.Float)

    def _node(self, node: str) -> Any:
        try:
            return self._connection().get_node(node)
        except self._ua.uaerrors.UaStringParsingError as error:
            raise LiveError(f"the address of a node looks like ns=2;s=Tank.Level, got {node!r}") from error

    def _connection(self) -> Any:
        if self._client is None:
            raise ConnectionError("not connected")
        return self._client

    def _do(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a request in the connection's thread; a connection that fails is dropped."""
        future = asyncio.run_coroutine_threadsafe(asyncio.wait_for(work, 2 * self._timeout), self._running())
        try:
            return future.result(2 * self._timeout + 1.0)  # later, its thread counts as stuck
        except LiveError:
            raise
        except self._ua.UaStatusCodeError as error:
            if self._is_loss(error):
                raise self._lost(error) from error
            raise LiveError(f"the server {self.address} refuses: {error}") from error
        except (OSError, EOFError, CancelledError, TooLate, TimeoutError) as error:
            future.cancel()
            raise self._lost(error) from error
        except self._ua.UaError as error:
            raise self._lost(error) from error

    def _is_loss(self, error: Any) -> bool:
        """Return whether a status means that the session is gone, not that a value is refused."""
        return error.code in {
            getattr(self._ua.StatusCodes, name)
            for name in (
                "BadSessionIdInvalid",
                "BadSessionClosed",
                "BadSecureChannelIdInvalid",
                "BadSecureChannelClosed",
                "BadConnectionClosed",
                "BadTimeout",
                "BadShutdown",
                "BadServerHalted",
                "BadNotConnected",
                "BadCommunicationError",
                "BadTcpEndpointUrlInvalid",
                "BadServerNotConnected",
                "BadSessionNotActivated",
                "BadConnectionRejected",
                "BadNoCommunication",
                "BadRequestTimeout",
            )
        }

    def _lost(self, error: BaseException) -> ConnectionLostError:
        self._drop()
        what = str(error) or type(error).__name__
        return ConnectionLostError(f"no connection to {self.address}: {what}")

    def _drop(self) -> None:
        client, self._client = self._client, None
        if client is None or self._loop is None:
            return
        gone = asyncio.run_coroutine_threadsafe(asyncio.wait_for(client.disconnect(), 1.0), self._loop)
        with suppress(Exception):
            gone.result(2.0)

    def _running(self) -> asyncio.AbstractEventLoop:
        """Return the event loop of the connection, in a thread of its own."""
        if self._loop is None:
            loop = self._loop = asyncio.new_event_loop()

            def serve() -> None:
                asyncio.set_event_loop(loop)
                loop.run_forever()
                loop.close()

            threading.Thread(target=serve, name="opcua", daemon=True).start()
        return self._loop


def _is_closed(client: Any) -> bool:
    """Return whether the socket of a client was open and is closed; False if that is unknown."""
    state = getattr(getattr(client.uaclient, "protocol", None), "state", None)
    return getattr(state, "value", state) == "closed"


def _number(value: Any) -> float:
    """Return a value as a number; NaN if its quality is bad or it is none."""
    if not value.StatusCode.is_good() or value.Value is None:
        return nan
    try:
        return float(value.Value.Value)
    except (TypeError, ValueError):
        return nan
