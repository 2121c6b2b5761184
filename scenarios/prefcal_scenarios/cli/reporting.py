"""What `prefcal report` does."""

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import StudyError
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.opening import Opened, by_now, default_folder, identity
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.shelf import existing
from prefcal_scenarios.cli.sitting import Sitting
from prefcal_scenarios.cli.target import on_target
from prefcal_scenarios.cost_file import with_cost
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.report.ownership import Owner, claim_default, claim_given
from prefcal_scenarios.scenario import is_built_in, load


def report_of(
    name: str, programs: Mapping[str, str | None], out: Path | None, *, json: bool
) -> None:
    """Write the report of the study called `name`.

    `programs` are the "scenario" and the "cost" that the user trusts, None where not named.

    Raises:
        StudyError: no such study, or of a scenario that has to be named.
        SettingsError: the same of a cost.
    """
    source, cost = programs["scenario"], programs["cost"]
    with open_described(existing(name)) as file, ExitStack() as stack:
        stored, named = by_now(file.state), file.state.configuration["scenario"]
        if source is None and not is_built_in(named):
            # Those who send a study must not choose which program is run here.
            raise StudyError(
                f"study {name!r} calibrates {named!r}, which is a program: "
                f"if you trust it, add --scenario {named}"
            )
        isolated = stack.enter_context(isolation(source or named, early=False))
        scenario = isolated(with_cost(load(source or named), cost))
        if cost is not None and stored.get("cost") is not None:
            stored = {**stored, "cost": cost}  # the file may have moved
        options = Options.resumed(stored, {"scenario": source or named, "cost": cost})
        if not file.state.closed:
            raise StudyError(f"study {name!r} has no completed experiment yet: nothing to report")
        # A window may be open on it: one event from here, and its next answer would be refused.
        scenario = on_target(scenario, file.state.configuration)
        interview = Interview(scenario, file, ahead=False, asks=False)
        opened = Opened(file, options, name, resumed=True)
        owner = Owner(identity(file), name, options.scenario)
        default = default_folder(opened, scenario.name)
        claim = claim_default(default, owner) if out is None else claim_given(out, owner)
        try:
            sitting = Sitting(interview, opened, claim, Console(stderr=True), json)
            sitting.tell(sitting.write())
        finally:
            claim.release()
