"""One study of the command line: open, ask, report."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from prefcal_scenarios.cli.choices import make_calibrator
from prefcal_scenarios.cli.display import Display
from prefcal_scenarios.cli.fronts import Front, in_terminal, in_window
from prefcal_scenarios.cli.interrupt import Interruption, interruption
from prefcal_scenarios.cli.opening import open_study
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.sitting import Sitting
from prefcal_scenarios.cost_file import with_cost
from prefcal_scenarios.interview import Interview, unattended
from prefcal_scenarios.report.folder import folder_for
from prefcal_scenarios.report.wording import earlier_text
from prefcal_scenarios.scenario import load

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def run(
    given: Mapping[str, Any], study: str | None, out: Path | None, front: Front, *, json: bool
) -> int:
    """Run the study, write its report, print the result; return the exit code.

    Whatever ends the study early, a report of the comparisons so far is left, and a study file
    can be taken up again.

    Raises:
        PrefcalError: the options do not fit the scenario, the study or the machine.
    """
    with interruption() as ctrl_c:
        scenario = with_cost(load(given["scenario"]), given.get("cost"))
        if Options.of(given).by_a_person and not front.terminal:
            front.check()  # a port that is taken must not cost a study
        opened = open_study(given, scenario, study)
        with opened.file as file:
            options = opened.options
            folder = folder_for(options.folder(scenario.name) if out is None else out)
            interview = Interview(scenario, file, ahead=options.by_a_person)
            sitting = Sitting(interview, opened, folder, Console(stderr=True), json)
            taken = file.state.configuration.get("earlier")
            if taken and not opened.resumed:
                sitting.say(f"From {earlier_text(taken)}.")
            if options.by_a_person:
                return _attended(sitting, front, ctrl_c)
            return _unattended(sitting, ctrl_c)


def _attended(sitting: Sitting, front: Front, ctrl_c: Interruption) -> int:
    """A person answers; he may come back any time."""
    begun = "taken up again" if sitting.opened.resumed else "begun"
    sitting.say(f"Study {sitting.opened.name} {begun}; every answer is saved at once.")
    sitting.say(f"Go on with it any time: {sitting.again}")
    ask = in_terminal if front.terminal else in_window
    over = ask(sitting, front, ctrl_c)
    if not over:
        sitting.say(f"Stopped, nothing is lost. Go on: {sitting.again}")
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
            for comparison in unattended(interview, calibrator, display.running):
                display.compared(comparison)
                ctrl_c.check()
    except (KeyboardInterrupt, Exception) as error:
        # Whatever a rig raises, its results so far are kept. Compiled code turns a
        # KeyboardInterrupt into an error of its own, so the press is what counts.
        if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
            failure = error
        else:
            done = f"{len(interview.now().state.closed)} of {interview.n_max} experiments"
            sitting.say(f"Interrupted after {done}; writing a report.")
    # A rig that has just broken down is not asked for more.
    record = sitting.write(rig_works=failure is None)
    sitting.tell(record)
    if failure is not None:
        raise failure
    if ctrl_c.pressed and not record.stopped:
        sitting.say("Interrupted when the study was over: the report is complete.")
    return INTERRUPTED if ctrl_c.pressed else 0
