"""What `prefcal report` does."""

from collections.abc import Mapping
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import StudyError
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.opening import Opened, by_now
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.shelf import existing
from prefcal_scenarios.cli.sitting import Sitting
from prefcal_scenarios.cost_file import with_cost
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.report.folder import folder_for
from prefcal_scenarios.scenario import BUILT_IN, load


def report_of(
    name: str, programs: Mapping[str, str | None], out: Path | None, *, json: bool
) -> None:
    """Write the report of the study called `name`.

    `programs` are the "scenario" and the "cost" that the user trusts, where he has named them.

    Raises:
        StudyError: no such study, or of a scenario that has to be named.
        SettingsError: the same of a cost.
    """
    source, cost = programs["scenario"], programs["cost"]
    with open_described(existing(name)) as file:
        stored, named = by_now(file.state), file.state.configuration["scenario"]
        if source is None and named not in BUILT_IN:
            # Whoever sent the study must not choose which program is run here.
            raise StudyError(
                f"study {name!r} calibrates {named!r}, which is a program: "
                f"say so if you trust it, --scenario {named}"
            )
        scenario = with_cost(load(source or named), cost)
        if cost is not None and stored.get("cost") is not None:
            stored = {**stored, "cost": cost}  # the file may have moved
        options = Options.resumed(stored, {"scenario": source or named, "cost": cost})
        folder = folder_for(options.folder(scenario.name) if out is None else out)
        # A window may be open on it: one event from here, and its next answer would be refused.
        interview = Interview(scenario, file, ahead=False, asks=False)
        opened = Opened(file, options, name, resumed=True)
        sitting = Sitting(interview, opened, folder, Console(stderr=True), json)
        sitting.tell(sitting.write())
