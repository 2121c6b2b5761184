"""From an interview to the record that reports are made of."""

from collections.abc import Mapping

from rich.console import Console

from prefcal_env.experiment import Experiment
from prefcal_env.rig import Rig
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.interview.moment import GOOD_ENOUGH
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
    agent, advice = state.configuration["agent"], interview.advice
    settings = {f"{agent['agent']} {name}": _text(v) for name, v in agent["settings"].items()}
    taken = state.configuration.get("earlier")
    earlier = {} if taken is None else {"earlier study": earlier_text(taken)}
    return Record(
        scenario=interview.scenario,
        source=options.scenario,
        comparisons=interview.comparisons(),
        references=references,
        settings=dict(options.settings()) | earlier | settings,
        n_init=options.n_init,
        n_max=interview.n_max,
        command=options.command(),
        surrogate=interview.surrogate,
        minded=Minded.of(interview.index, interview.scenario),
        good_enough=state.ended == GOOD_ENOUGH,
        advice="" if advice is None else advice.text,
        believed_best=now.incumbent,
        further=tuple(c.answer for c in state.further if not c.retracted),
    )


def _text(value: object) -> str:
    return str(tuple(value)) if isinstance(value, list) else str(value)


def references(scenario: Scenario, seed: int, messages: Console) -> dict[str, Experiment]:
    """Runs of the reference θ; one that fails is left out, for the study itself is done."""
    experiments: dict[str, Experiment] = {}
    if isinstance(scenario.run, Rig):
        return experiments
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=seed)
        except Exception as error:  # whatever a rig raises
            messages.print(f"The reference {name!r} did not run: {error}", soft_wrap=True)
    return experiments
