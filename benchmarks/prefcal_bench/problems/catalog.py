"""Problems by name, and users' own problems."""

import hashlib
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache
from pathlib import Path

from prefcal_bench.people import TASTES, VERSION
from prefcal_bench.problems.functions import FUNCTIONS
from prefcal_env.errors import ScenarioError, SettingsError
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import CLOSED_LOOPS, is_built_in
from prefcal_scenarios.own import module_at
from prefcal_scenarios.scenario import Scenario

from .cases import GUIDELINES, closed_loop, guidelines, of_function, overtaking, reactor
from .problem import NOISES, Problem

PROBLEMS = (*CLOSED_LOOPS, *FUNCTIONS, "cstr", GUIDELINES, "overtake")
"""Names of the problems, in the order of the tables; "loop-SEED" and own ones come on top."""
CALIBRATORS = ("perfect", "lexicographic", *NOISES, *TASTES)
"""Names of everyone who can answer, in the order of the tables; each problem has some of them."""


def problem(name: str) -> Problem:
    """Return the problem called `name`.

    Args:
        name: One of `PROBLEMS`; "loop-SEED" for a random closed loop; the name of a built-in
            scenario; or "path/to/own.py:NAME" of a `Scenario` or a `Problem`.

    Raises:
        SettingsError: If there is no such problem, or tastes cannot judge it.
        ScenarioError: If the file does not exist or cannot be imported, or an experiment of its
            `Scenario` has other KPIs when it is repeated.
    """
    path = name.rpartition(":")[0]
    if not path.endswith(".py"):
        return _known(name)
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ScenarioError(f"no file {path!r} to load a problem from") from error
    return _own(name, hashlib.sha256(content).hexdigest())


@cache
def _known(name: str) -> Problem:
    if name in FUNCTIONS:
        return of_function(FUNCTIONS[name])
    own = {"cstr": reactor, GUIDELINES: guidelines, "overtake": overtaking}
    if name in own:
        return own[name]()
    if is_built_in(name):
        return closed_loop(name, load(name))
    raise SettingsError(
        f"no problem is called {name!r}.{did_you_mean(name, PROBLEMS)} Expected "
        f"{', '.join(PROBLEMS)}, loop-SEED, or path/to/own.py:NAME"
    )


@cache
def _own(name: str, version: str) -> Problem:
    """Return a user's problem; `version` is the hash of its file, so that a change reloads it."""
    path, _, attribute = name.rpartition(":")
    found = getattr(module_at(Path(path)), attribute, None)
    if isinstance(found, Scenario):
        with redirect_stdout(sys.stderr):  # it runs; `bench --json` prints only JSON
            return _repeatable(name, found)
    if isinstance(found, Problem):
        return replace(found, name=name, version=f"{found.version}, {version[:16]}, tastes {VERSION}")
    raise SettingsError(f"{name!r} must name a Scenario or a Problem, got {found!r}")


def _repeatable(name: str, scenario: Scenario) -> Problem:
    """Return the problem of a user's scenario whose experiments have the same KPIs each time."""
    made = closed_loop(name, scenario)
    if made.version != closed_loop(name, scenario).version:  # which comes from a few experiments
        raise ScenarioError(
            f"{name}: repeated experiments of one θ have other KPIs. In the benchmark, draw noise "
            "from a fixed seed, and leave measured times out of the KPIs"
        )
    return made
