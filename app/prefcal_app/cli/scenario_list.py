"""Run `prefcal scenarios`: the scenarios that have a name, and what one of them is about."""

from typer import echo

from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import BUILT_IN, CLOSED_LOOPS


def describe(name: str) -> None:
    """Print the task, the knobs and the KPIs of a scenario. Raises ScenarioError if there is none."""
    from prefcal_app.terminal.showing import show_scenario  # takes half a second to import

    show_scenario(load(name))


def print_all() -> None:
    """Print the scenarios that `prefcal calibrate` knows by name."""
    cases = [known for known in BUILT_IN if known not in CLOSED_LOOPS]
    width = max(map(len, cases)) + 2
    for known in cases:
        scenario = load(known)
        echo(f"{known:<{width}}{scenario.title}; knobs {', '.join(scenario.space.names)}")
    echo(f"Closed loops: {', '.join(CLOSED_LOOPS)} (`prefcal scenarios servo` describes one)")
    echo("Random closed loops: loop-1, loop-2, ... (any seed)")
    echo("Your own: path/to/own.py:name, where name is a prefcal_scenarios.Scenario.")
