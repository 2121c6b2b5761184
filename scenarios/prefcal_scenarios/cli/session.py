"""One study of the command line: set up, run, report."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console

from prefcal_env.experiment import Experiment
from prefcal_env.preference import Agent, Calibrator
from prefcal_env.study import Comparison, calibrate
from prefcal_scenarios.cli.choices import make_agent, make_calibrator
from prefcal_scenarios.cli.display import Display
from prefcal_scenarios.cli.interrupt import interruption
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.outcome import as_json, show
from prefcal_scenarios.report.folder import folder_for
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.scenario import Scenario, load

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def run(options: Options, out: Path | None, *, json: bool) -> int:
    """Run the study, write its report, print the result; return the exit code.

    Whatever ends the study early, a report of the comparisons so far is left.

    Raises:
        PrefcalError: the options do not fit the scenario, or the folder cannot be made.
    """
    messages = Console(stderr=True)
    with interruption() as ctrl_c:
        scenario = load(options.scenario)
        agent, calibrator = make_agent(options, scenario), make_calibrator(options, scenario)
        folder = folder_for(options.folder(scenario.name) if out is None else out)
        comparisons: list[Comparison] = []
        failure: BaseException | None = None
        try:
            with ctrl_c.allowed(), Display(scenario, agent.n_max, messages) as display:
                for comparison in _study(options, scenario, agent, calibrator, display):
                    comparisons.append(comparison)
                    display.compared(comparison)
                    ctrl_c.check()
        except (KeyboardInterrupt, Exception) as error:
            # Whatever a rig raises, its results so far are kept. Compiled code turns a
            # KeyboardInterrupt into an error of its own, so the press is what counts.
            if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
                failure = error
            else:
                done = f"{len(comparisons)} of {agent.n_max} experiments"
                messages.print(f"Interrupted after {done}; writing a report.", soft_wrap=True)
            agent = _again(options, scenario, comparisons)
        # A rig that has just broken down is not asked for more.
        references = {} if failure else _references(options, scenario, messages)
        record = _record(options, scenario, agent, comparisons, references)
        report = _write(record, folder)
    _tell(record, report, options, messages, json=json)
    if failure is not None:
        raise failure
    if ctrl_c.pressed and not record.stopped:
        messages.print("Interrupted when the study was over: the report is complete.")
    return INTERRUPTED if ctrl_c.pressed else 0


def _study(
    options: Options,
    scenario: Scenario,
    agent: Agent,
    calibrator: Calibrator[Experiment],
    display: Display,
) -> Iterator[Comparison]:
    def experiment(theta: Float[np.ndarray, " n"]) -> Experiment:
        display.running(theta)
        return scenario.run(theta, seed=options.seed)

    return calibrate(agent, experiment, calibrator)


def _again(options: Options, scenario: Scenario, comparisons: Sequence[Comparison]) -> Agent:
    """A twin told what is recorded: the agent itself may have been stopped in mid-thought."""
    agent = make_agent(options, scenario)
    for comparison in comparisons:
        agent.tell(agent.ask(), comparison.answer)
    return agent


def _references(options: Options, scenario: Scenario, messages: Console) -> dict[str, Experiment]:
    """Runs of the reference θ; one that fails is left out, for the study itself is done."""
    experiments = {}
    for name, theta in scenario.references.items():
        try:
            experiments[name] = scenario.run(theta, seed=options.seed)
        except Exception as error:  # whatever a rig raises
            messages.print(f"The reference {name!r} did not run: {error}", soft_wrap=True)
    return experiments


def _record(
    options: Options,
    scenario: Scenario,
    agent: Agent,
    comparisons: Sequence[Comparison],
    references: Mapping[str, Experiment],
) -> Record:
    learned = any(c.answer.preference is not None for c in comparisons)
    return Record(
        scenario=scenario,
        source=options.scenario,
        comparisons=tuple(comparisons),
        references=references,
        settings=dict(options.settings()) | _agent_settings(agent),
        n_init=options.n_init,
        n_max=agent.n_max,
        command=options.command(),
        surrogate=getattr(agent, "surrogate", None) if learned else None,
    )


def _agent_settings(agent: Agent) -> dict[str, str]:
    """The agent's own settings, defaults too, where it tells them."""
    state: Any = getattr(agent, "state", None)
    if state is None:
        return {}
    return {f"{state.agent} {name}": str(value) for name, value in state.settings}


def _write(record: Record, folder: Path) -> Path:
    # Here, not above: plots take half a second to load, and a refused option must not wait.
    from prefcal_scenarios.report.write import write_report

    own = record.scenario.pictures
    return write_report(record, folder, () if own is None else own())


def _tell(record: Record, report: Path, options: Options, messages: Console, *, json: bool) -> None:
    if json:
        print(as_json(record, options, report))
    else:
        show(record, report, Console())
    if record.stopped:
        messages.print(
            f"This is a partial report: {len(record.trials)} of {record.n_max} experiments.",
            soft_wrap=True,
        )
