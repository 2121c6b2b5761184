"""A twin: a rough model of the plant, on which θ are simulated that the plant does not run."""

from collections.abc import Mapping
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.wording import labeled
from prefcal_scenarios.kpis import has_goals
from prefcal_scenarios.scenario import Scenario, with_ranges


def named_twin(configuration: Mapping[str, Any]) -> str | None:
    """Return the name of the twin that a study was started with; None if it has none."""
    name = configuration.get("options", {}).get("twin")
    return None if name is None else str(name)


def twin_of(plant: Scenario, model: Scenario) -> Scenario:
    """Return `model` with the knobs of `plant`, to simulate what the plant does not run.

    Raises:
        SettingsError: If experiments of `model` are no quick simulations, it has other knobs, or
            it lacks a KPI of `plant`.
    """
    if not model.simulated:
        raise SettingsError(
            f"the twin {model.name!r} does not let experiments run unseen: if a run is a quick "
            "simulation, state Scenario(..., simulated=True)"
        )
    ours, theirs = _knobs(plant.space), _knobs(model.space)
    if ours != theirs:
        raise SettingsError(
            f"the twin {model.name!r} must have the knobs of {plant.name!r} in the same order: "
            f"expected {', '.join(ours)}, got {', '.join(theirs)}"
        )
    known = _kpis(model)
    missing = [name for name in _kpis(plant) if name not in known]
    has = ", ".join(known) or "none with a direction"
    if missing:
        raise SettingsError(
            f"the twin {model.name!r} must have the KPIs of {plant.name!r}: it lacks "
            f"{', '.join(missing)}, and has {has}"
        )
    if has_goals(model) and not has_goals(plant):
        raise SettingsError(
            f"the plant {plant.name!r} must have KPIs with a direction, as its twin {model.name!r} has: {has}"
        )
    return with_ranges(model, plant.space)


def _knobs(space: KnobSpace) -> list[str]:
    return [labeled(knob.name, knob.unit) for knob in space]


def _kpis(scenario: Scenario) -> list[str]:
    """Return the names of the KPIs with a direction, by which people and agents judge."""
    return [kpi.name for kpi in scenario.kpis if kpi.goal is not None]
