"""One study of the command line: open, ask, report."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from prefcal_env.errors import RunError
from prefcal_scenarios.cli.choices import make_calibrator
from prefcal_scenarios.cli.display import Display
from prefcal_scenarios.cli.errors import complain
from prefcal_scenarios.cli.fronts import Front, in_terminal, in_window
from prefcal_scenarios.cli.interrupt import INTERRUPTED, Interruption, interruption
from prefcal_scenarios.cli.keeping import kept_if_worth_it
from prefcal_scenarios.cli.opening import Opened, default_folder, identity, open_study
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.sitting import Sitting
from prefcal_scenarios.cli.target import on_target
from prefcal_scenarios.cost_file import with_cost
from prefcal_scenarios.interview import Interview, unattended
from prefcal_scenarios.isolated import DEFAULT_LIMIT, isolation
from prefcal_scenarios.report.ownership import Owner, claim_default, claim_given
from prefcal_scenarios.report.wording import earlier_text
from prefcal_scenarios.scenario import Scenario, load

RUN_FAILED = 1
"""Exit code where the code of an own scenario has ended an unattended study."""


def run(
    given: Mapping[str, Any],
    study: str | None,
    out: Path | None,
    front: Front,
    *,
    run_timeout: float = DEFAULT_LIMIT,
    json: bool,
) -> int:
    """Run the study, write its report, print the result; return the exit code.

    Whatever ends the study early, a report of the comparisons so far is left, and a study file
    can be resumed.

    Raises:
        PrefcalError: the options do not fit the scenario, the study or the machine.
    """
    with interruption(others=True) as ctrl_c:
        messages = Console(stderr=True)
        ctrl_c.on_press = lambda: messages.print("Stopping ...", highlight=False)
        with isolation(given["scenario"], run_timeout) as isolated:
            scenario = isolated(with_cost(load(given["scenario"]), given.get("cost")))
            if Options.of(given).by_a_person and not front.terminal:
                front.check()  # a port that is taken must not cost a study
            ends = Ends(scenario, messages, json)
            with kept_if_worth_it(open_study(given, scenario, study), scenario, ends.say) as opened:
                judged = on_target(scenario, opened.file.state.configuration)
                return _run(opened, out, front, ctrl_c, replace(ends, scenario=judged))


@dataclass(frozen=True, slots=True)
class Ends:
    """Where a study comes from, and where its words go.

    Args:
        scenario: What is calibrated.
        messages: Where people read.
        json: Whether standard output is for a program.
    """

    scenario: Scenario
    messages: Console
    json: bool

    def say(self, text: str) -> None:
        """Print one line for people."""
        self.messages.print(text, soft_wrap=True, highlight=False, markup=False)


def _run(opened: Opened, out: Path | None, front: Front, ctrl_c: Interruption, ends: Ends) -> int:
    """Ask and report, in a folder that is the study's own."""
    owner = Owner(identity(opened.file), opened.name, opened.options.scenario)
    default = default_folder(opened, ends.scenario.name)
    claim = claim_default(default, owner) if out is None else claim_given(out, owner)
    options, file = opened.options, opened.file
    try:
        interview = Interview(ends.scenario, file, ahead=options.by_a_person)
        sitting = Sitting(interview, opened, claim, ends.messages, ends.json)
        ctrl_c.on_press = sitting.stopping
        if claim.folder.name != default.name and out is None:
            sitting.say(f"{default} holds another study's report: this one goes to {claim.folder}.")
        taken = file.state.configuration.get("earlier")
        if taken and not opened.resumed:
            sitting.say(f"From {earlier_text(taken)}.")
        if options.by_a_person:
            return _attended(sitting, front, ctrl_c)
        return _unattended(sitting, ctrl_c)
    except KeyboardInterrupt:
        name = opened.name
        later = f"; its report: prefcal report {name}" if name and file.state.closed else ""
        ends.say(f"Stopped at once. Every answer is saved{later}" if name else "Stopped at once.")
        raise
    finally:
        claim.release()


def _attended(sitting: Sitting, front: Front, ctrl_c: Interruption) -> int:
    """A person answers, and may come back any time."""
    begun = "resumed" if sitting.opened.resumed else "started"
    sitting.say(f"Study {sitting.opened.name} {begun}. Every answer is saved at once.")
    sitting.say(f"Stop any time, and resume with: {sitting.again}")
    ask = in_terminal if front.terminal else in_window
    over = ask(sitting, front, ctrl_c)
    if not over and sitting.reportable:
        sitting.say(f"Stopped; every answer is saved. Resume: {sitting.again}")
    return INTERRUPTED if ctrl_c.pressed and not over else 0


def _unattended(sitting: Sitting, ctrl_c: Interruption) -> int:
    """A synthetic calibrator answers, as fast as the experiments run."""
    interview, scenario = sitting.interview, sitting.interview.scenario
    calibrator = make_calibrator(sitting.opened.options, scenario)
    failure: BaseException | None = None
    try:
        with ctrl_c.allowed(), Display(scenario, interview.n_max, sitting.messages) as display:
            for comparison in interview.comparisons():
                display.compared(comparison)
            display.best(interview.now())
            interview.prepare(display.compiling)
            for comparison in unattended(interview, calibrator, display.running, sitting.say):
                display.compared(comparison)
                display.best(interview.now())
                ctrl_c.check()
    except (KeyboardInterrupt, Exception) as error:
        # Whatever a rig raises, its results so far are kept. Compiled code turns a
        # KeyboardInterrupt into an error of its own, so the press is what counts.
        if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
            failure = error
        else:
            done = f"{interview.counts.experiments} of {interview.n_max} experiments"
            sitting.say(f"Interrupted after {done}.")
    # A rig that has just broken down is not asked for more.
    record = sitting.write(rig_works=failure is None)
    sitting.tell(record)
    if isinstance(failure, RunError):
        sitting.say(failure.trace)
        complain(str(failure))
        return RUN_FAILED
    if failure is not None:
        raise failure
    if ctrl_c.pressed and not record.stopped:
        sitting.say("Interrupted when the study was over: the report is complete.")
    return INTERRUPTED if ctrl_c.pressed else 0
