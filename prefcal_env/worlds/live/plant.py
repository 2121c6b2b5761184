"""Define what prefcal needs of a connection to a live plant, for any protocol."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable


class LivePlant(Protocol):
    """Connection to a live plant whose values have a node address each.

    No method blocks for longer than a few seconds: a plant that does not answer is lost.
    """

    @property
    def address(self) -> str:
        """Address of the plant, which tells it apart from other plants."""

    @property
    def connected(self) -> bool:
        """Whether the connection stands, as far as is known."""

    def connect(self) -> None:
        """Connect, or connect again after a loss.

        Raises:
            ConnectionLostError: If the plant cannot be reached.
        """

    def read(self, nodes: Sequence[str]) -> list[float]:
        """Return the value of each node, in order; NaN for a value of bad quality.

        Raises:
            ConnectionLostError: If the connection is lost.
            LiveError: If there is no such node.
        """

    def write(self, node: str, value: float) -> None:
        """Write one value, and return once the plant has accepted it.

        Raises:
            ConnectionLostError: If the connection is lost; the value may have arrived.
            LiveError: If the plant refuses the value.
        """

    def close(self) -> None:
        """Disconnect."""


@runtime_checkable
class TypedPlant(Protocol):
    """What a connection may offer, too, if nodes have types: a check before the first write."""

    def whole(self, nodes: Sequence[str]) -> list[bool]:
        """Return for each node, in order, whether its type holds whole numbers only.

        Raises:
            ConnectionLostError: If the connection is lost.
            LiveError: If there is no such node.
        """
