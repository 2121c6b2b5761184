"""From an interview to the record that reports are made of."""

from collections.abc import Mapping

from rich.console import Console

from prefcal_env.experiment import Experiment
from prefcal_env.rig import Rig
from prefcal_scenarios.cli.choices import follows_cost
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.target import target_settings
from prefcal_scenarios.interview import Interview, Now
from prefcal_scenarios.interview.memory import incumbents
from prefcal_scenarios.interview.moment import GOOD_ENOUGH
from prefcal_scenarios.isolated import IsolatedRun
from prefcal_scenarios.report.minded import Minded
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.wording import earlier_text
from prefcal_scenarios.scenario import Scenario


def record_of(
    interview: Interview, options: Options, references: Mapping[str, Experiment]
) -> Record:
    """The study as it stands."""
    now = interview.now()
    state = now.state
    agent = state.configuration["agent"]
    taken = state.configuration.get("earlier")
    earlier = {} if taken is None else {"earlier study": earlier_text(taken)}
    return Record(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=interview.comparisons(),
        answered=interview.answered(),
        held=held(now),
        waiting=waiting(interview, now),
        references=references,
        settings=dict(options.settings()) | earlier | target_settings(state.configuration),
        agent_settings={f"{agent['agent']} {k}": v for k, v in agent["settings"].items()},
        n_init=options.n_init,
        n_max=interview.n_max,
        command=options.command(),
        surrogate=interview.surrogate,
        minded=Minded.of(interview.index, interview.importance, interview.scenario),
        good_enough=state.ended == GOOD_ENOUGH,
        outlook=interview.outlook,
        judged=follows_cost(options, interview.scenario),
    )


def held(now: Now) -> tuple[int, ...]:
    """Index of the best experiment after each closed query; the last is the best now."""
    winners = incumbents(now.state)
    return winners if now.incumbent is None else (*winners[:-1], now.incumbent)


def waiting(interview: Interview, now: Now) -> dict[int, Experiment]:
    """The experiments that ran and are compared with nothing yet, by index."""
    state = now.state
    indices = sorted(index for index in state.finished if index >= len(state.closed))
    return {index: interview.experiment(index) for index in indices}


def references(scenario: Scenario, seed: int, messages: Console) -> dict[str, Experiment]:
    """Runs of the reference θ; one that fails is left out, for the study itself is done."""
    experiments: dict[str, Experiment] = {}
    run = scenario.run
    if isinstance(run, Rig):
        return experiments
    if isinstance(run, IsolatedRun) and run.worker.hangs and scenario.references:
        messages.print("The references did not run: the last run had to be ended.")
        return experiments
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=seed)
        except Exception as error:  # whatever a rig raises
            words = f"The reference {name!r} did not run: {error}"
            messages.print(words, soft_wrap=True, markup=False)
    return experiments
