"""One number for all results: whether two runs of a suite gave the same."""

import hashlib
from collections.abc import Iterable

from .cell import canonical
from .result import Result


def digest(results: Iterable[Result]) -> str:
    """Sha256 in hex over all results in the order of their cells, whatever order they came in.

    Times are left out, and so are the words of a failure: they may name a process or an address.
    That a cell failed counts.
    """
    total = hashlib.sha256()
    for result in sorted(results, key=lambda result: result.cell):
        content = result.to_dict() | {"seconds": None, "failure": bool(result.failure)}
        total.update(canonical(content).encode() + b"\n")
    return total.hexdigest()
