"""Load a scenario by its name."""

from importlib import import_module
from pathlib import Path
from types import ModuleType

from prefcal_agents.registry import FAMILIES
from prefcal_env.errors import ScenarioError
from prefcal_env.optional import BENCHMARK, load_extensions
from prefcal_env.wording import did_you_mean

from .names import (
    BUILT_IN,
    CASES,
    CONTROLLERS,
    NAMES,
    OWN,
    either,
    is_built_in,
    is_described,
    is_own,
    is_random_loop,
    is_table,
)
from .own import module_at, split_source
from .scenario import Scenario


def load(name: str) -> Scenario:
    """Return the scenario called `name`: one of `BUILT_IN`, or a user's own.

    A user's own is "path/to/own.py:attribute", or described by plain data: "path/to/tank.toml",
    'pid {"plant": "path/to/model.py:plant"}', or a file of an optional world, such as an FMU.

    "loop-17" is the random closed loop with seed 17, and "rough-17" the rough one; both are made
    by the benchmark, the distribution prefcal-bench.

    A configuration in JSON may follow the name: 'overtake {"lanes_count": 3}'.

    Raises:
        ScenarioError: If there is no such scenario, file or attribute, it is not a Scenario, it
            cannot be configured, or the configuration is not JSON.
        SettingsError: If the scenario rejects the configuration.
    """
    if not isinstance(name, str):
        raise ScenarioError(f"a scenario is loaded by its name, got {name!r}")
    bare, config = split_source(name)
    if is_table(bare):
        from .choosing import choice_of

        return choice_of(bare, config or {})
    if is_described(bare):
        # Imported here, and the cases below: a scenario needs none of the others.
        from .described.making import scenario_of

        return scenario_of(bare, config)
    if config is not None:
        scenario = load(bare)
        if scenario.configured is None:
            raise ScenarioError(f"scenario {bare!r} takes no configuration, got {config}")
        return scenario.configured(config)
    path, _, attribute = name.rpartition(":")
    if attribute.endswith(".py"):
        raise ScenarioError(f"{name!r} is a file: say which scenario in it, {name}:NAME")
    if is_own(name):
        return _with_margins(_scenario_in(module_at(Path(path)), attribute, name))
    if is_random_loop(name):
        return _random_loop(name)
    if is_built_in(name):
        case = name if name in CASES else "loops"
        return _scenario_in(import_module(f"prefcal_scenarios.cases.{case}"), name, name)
    raise ScenarioError(
        f"no scenario is called {name!r}.{did_you_mean(name, BUILT_IN)} "
        f"Expected {NAMES}, or your own: {', '.join(OWN)}, {either(CONTROLLERS)} "
        "(see `prefcal scenarios`)"
    )


def _with_margins(own: Scenario) -> Scenario:
    """Return a user's scenario whose closed loop measures the margins that its KPIs name."""
    if not any(kpi.margin for kpi in own.kpis):
        return own
    from .described.making import with_margins

    return with_margins(own)


def _random_loop(name: str) -> Scenario:
    """Return "loop-17" or "rough-17". Raises ScenarioError if no extension makes such loops."""
    family, _, seed = name.rpartition("-")
    if family not in FAMILIES:
        load_extensions()
    if family not in FAMILIES:
        raise ScenarioError(f"{name} is made by the benchmark's generator: {BENCHMARK}")
    scenario: Scenario = FAMILIES[family](int(seed))
    return scenario


def _scenario_in(module: ModuleType, attribute: str, name: str) -> Scenario:
    found = getattr(module, attribute, None)
    if isinstance(found, Scenario):
        return found
    got = repr(found) if hasattr(module, attribute) else "nothing of that name"
    there = [key for key, value in vars(module).items() if isinstance(value, Scenario)]
    raise ScenarioError(
        f"{name!r} must name a prefcal_scenarios.Scenario, got {got}; "
        f"in that file there is {', '.join(there) or 'none'}"
    )
