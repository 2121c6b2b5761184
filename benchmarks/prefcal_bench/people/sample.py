"""Experiments of random θ of a scenario, computed once and kept in the user's cache folder."""

import hashlib
import zlib
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from jaxtyping import Float
from platformdirs import user_cache_path

from prefcal_agents.agent import one_thread
from prefcal_env.disk import whole_file
from prefcal_env.errors import KnobError
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios.names import CLOSED_LOOPS, is_random_loop
from prefcal_scenarios.scenario import Scenario

from .runs import Runs, runs_of

USUAL = "usual"
"""Name of the sample that shows tastes what is usual."""
_USUAL = 512
_QUICK_POOL, _SLOW_POOL = 8192, 2048
"""Sizes of pools: of closed loops, which take a millisecond an experiment, and of others."""
_HORIZON = "N_p"  # knob of every MPC, which makes an experiment slow
_CHECKED = 4  # number of experiments by which a changed scenario is noticed
_DIGITS = 4  # digits that are compared, since the last ones differ between machines
_PARTS = ("values", "survived", "z", "seen")  # arrays of a file, as they follow the names in `Runs`
_BLOCK = 256
_FRUITLESS = 1000  # number of blocks without an allowed θ after which there seems to be none


def thetas(scenario: Scenario, name: str, count: int) -> list[Float[np.ndarray, " n"]]:
    """Return `count` physical θ, each of shape (n,), uniform in the cube and allowed.

    Args:
        scenario: Scenario.
        name: Name of the sample; another name gives other θ.
        count: Number of θ.

    Raises:
        KnobError: If the constraints allow next to nothing of the box.
    """
    space, found = scenario.space, list[Float[np.ndarray, " n"]]()
    rng = np.random.default_rng(list(name.encode()))
    blocks = 0
    while len(found) < count:
        z = space.snap_all(space.scaled(rng.random((_BLOCK, len(space)))))
        block = space.decode_all(z)
        found += list(block[space.allows(block)])
        blocks += 1
        if blocks >= _FRUITLESS and not found:
            raise KnobError(f"none of {blocks * _BLOCK} random θ satisfies the constraints")
    return found[:count]


def sample(scenario: Scenario, name: str) -> Runs:
    """Return the KPIs of random experiments of `scenario`.

    They are read from the user's cache folder if they were computed before, by any process, with
    a scenario that gives the same KPIs.

    Args:
        scenario: Scenario whose KPIs are wanted.
        name: `USUAL` for those that show tastes what is usual, "pool" for those that the worth of
            a θ is measured with.
    """
    count, path = size(scenario, name), _path(scenario, name)
    found = _read(path, count)
    if found is None:
        found = _run(scenario, thetas(scenario, name, count))
        _write(path, found)
    return found


def size(scenario: Scenario, name: str) -> int:
    """Return the number of experiments of a sample: more in the pool of a quick closed loop."""
    if name == USUAL:
        return _USUAL
    known = scenario.name in CLOSED_LOOPS or is_random_loop(scenario.name)
    return _QUICK_POOL if known and _HORIZON not in scenario.space.names else _SLOW_POOL


def is_cached(scenario: Scenario, name: str) -> bool:
    """Return whether `sample` would read its result from the cache folder."""
    return _read(_path(scenario, name), size(scenario, name)) is not None


def _path(scenario: Scenario, name: str) -> Path:
    content = f"{fingerprint(scenario)} {name} {size(scenario, name)}"
    key = hashlib.sha256(content.encode()).hexdigest()
    return user_cache_path("prefcal", appauthor=False) / "samples" / f"{key[:32]}.npz"


def fingerprint(scenario: Scenario) -> str:
    """Return the sha256 in hex of the knobs, the KPIs, and a few experiments, rounded."""
    runs = _run(scenario, thetas(scenario, "fingerprint", _CHECKED))
    words = [f"{value:.{_DIGITS}g}" for value in (*runs.values.ravel(), *runs.survived)]
    content = [repr(scenario.space.knobs), repr(runs.names), *words, *_allowed(scenario.space)]
    return hashlib.sha256("\n".join(content).encode()).hexdigest()


def _allowed(space: KnobSpace) -> list[str]:
    """Return which of many θ the constraints allow, as words; none without constraints.

    Constraints can be functions, so only their effect can be compared.
    """
    if not space.constraints:
        return []
    w = np.random.default_rng(0).random((_USUAL, len(space)))
    allowed = space.allows(space.decode_all(space.snap_all(space.scaled(w))))
    return [np.packbits(allowed).tobytes().hex()]


def _run(scenario: Scenario, tried: list[Float[np.ndarray, " n"]]) -> Runs:
    with one_thread():  # small matrices: more threads would wait for each other
        rows = [runs_of(scenario.kpis, [scenario.run(theta)]) for theta in tried]
    return Runs(
        rows[0].names,
        np.concatenate([row.values for row in rows]),
        np.concatenate([row.survived for row in rows]),
        np.array([scenario.space.encode(theta) for theta in tried]),
        np.concatenate([row.seen for row in rows]),
    )


def _read(path: Path, count: int) -> Runs | None:
    try:
        with np.load(path) as content:
            names = tuple(map(str, content["names"]))
            columns = (content[part] for part in _PARTS)
            found = Runs(names, *columns)
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, BadZipFile, zlib.error):
        return None  # absent or damaged: it is computed again
    return found if len(found) == count else None


def _write(path: Path, runs: Runs) -> None:
    """Write the file at once or not at all; a cache that cannot be written is no error."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as part, part.open("xb") as file:
            np.savez(file, names=runs.names, **{name: getattr(runs, name) for name in _PARTS})
