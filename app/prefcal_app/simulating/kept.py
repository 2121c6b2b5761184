"""Keep the KPIs of simulated θ in a file beside the study: nothing is simulated twice."""

import json
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO, final
from zlib import crc32

import numpy as np
from jaxtyping import Float

from prefcal_env.disk import whole_file
from prefcal_env.knobs.key import theta_key
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.study import knobs_as_dicts, within_as_dict
from prefcal_env.study.locations import SIMULATED, is_simulated
from prefcal_scenarios.own.source import fingerprint, fingerprint_of_code
from prefcal_scenarios.scenario import Scenario


@final
class Kept:
    """The KPIs that a file keeps, and the file that keeps more of them.

    It is a cache: what is damaged, or was simulated by something else, is simulated again, and a
    file that cannot be written keeps nothing.

    Args:
        path: File beside the study.
        key: What the KPIs follow from, see `key_of`.
    """

    def __init__(self, path: Path, key: str) -> None:
        self._path, self._head = path, SIMULATED + key.encode() + b"\n"
        self._file: BinaryIO | None = None
        self._lines: list[bytes] = []
        self.known: dict[bytes, Outcome] = {}
        """KPIs by the key of θ, none where the run raised an error."""
        self._whole = self._read()

    def add(self, theta: Float[np.ndarray, " n"], kpis: Outcome) -> None:
        """Keep the KPIs of θ, physical, shape (n,)."""
        line = _line(theta, kpis)
        with suppress(OSError, ValueError):  # no space left, read only, or closed
            if self._file is None:
                self._file = self._opened()
            self._file.write(line)
            self._file.flush()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            with suppress(OSError):
                self._file.close()

    def _read(self) -> bool:
        """Read the file; return whether more can be added at its end."""
        try:
            head, *lines = self._path.read_bytes().splitlines(keepends=True)
        except (OSError, ValueError):  # none, or empty
            return False
        if head != self._head:
            return False
        for line in lines:
            with suppress(ValueError, KeyError, TypeError):
                theta, kpis = _content(line)
                self.known[theta_key(theta)] = kpis
                self._lines.append(line)
        if not any(self.known.values()):  # what is missing on a machine fails all runs
            self.known, self._lines = {}, []
        return len(self._lines) == len(lines)

    def _opened(self) -> BinaryIO:
        """Open the file to add to it, written anew without what is not usable."""
        if not self._whole:
            if not is_simulated(self._path):
                raise ValueError(f"{self._path} is something else")
            with whole_file(self._path) as part:
                part.write_bytes(self._head + b"".join(self._lines))
        return self._path.open("ab")


def _line(theta: Float[np.ndarray, " n"], kpis: Outcome) -> bytes:
    content = json.dumps([np.asarray(theta, dtype=float).tolist(), dict(kpis)]).encode()
    return b"%08x %s\n" % (crc32(content), content)


def _content(line: bytes) -> tuple[list[float], Outcome]:
    """Return θ and its KPIs. Raises ValueError if the line is damaged."""
    checksum, _, content = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or int(checksum, 16) != crc32(content):
        raise ValueError("a damaged line")
    theta, kpis = json.loads(content)
    return theta, Outcome(kpis)


def key_of(
    scenario: Scenario, source: str, configuration: Mapping[str, Any], versions: Mapping[str, str]
) -> str:
    """Return hexadecimal digits that change with everything that simulated KPIs follow from.

    Files that a program reads count only if its code names them.

    Args:
        scenario: Scenario that simulates, with the knobs of the study.
        source: Its name, or path/to/own.py:NAME.
        configuration: Configuration of the study.
        versions: Versions of the packages that affect results.
    """
    content = {
        "source": fingerprint(source),
        "code": fingerprint_of_code(),
        "seed": configuration["seed"],
        "knobs": knobs_as_dicts(scenario.space),
        "within": within_as_dict(scenario.space),
        "kpis": [(k.name, k.goal, k.at_most, k.at_least) for k in scenario.kpis],
        "versions": dict(versions),
    }
    return sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()
