"""Run `prefcal calibrate`: open the study, collect the answers, and write the report."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from prefcal_app.report.record import VERDICTS
from prefcal_app.session import Background, unattended
from prefcal_app.terminal import converse
from prefcal_app.terminal.showing import say
from prefcal_env.compiling import Compiling
from prefcal_env.errors import RunError, SimulationError, StudyError
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.presentation.wording import printable, theta_text
from prefcal_scenarios.scenario import Scenario

from .calibration import Calibration, calibration, default_folder
from .choices import make_calibrator, with_cost
from .interrupt import INTERRUPTED, Interruption, interruption
from .opening import Opened, kept_if_worth_it, open_study
from .options import Options
from .studies.sources import completed

RUN_FAILED = 1
"""Exit code if the user's own scenario code ended an unattended study."""
GONE = 20.0
"""Seconds from closing the last page of a finished study to the end of the command."""


def run(given: Mapping[str, Any]) -> int:
    """Run the study, write its report, and print the result; return the exit code.

    A study that ends early still gets a report of the comparisons so far, and a study file can be
    resumed.

    Args:
        given: Values of the fields of `Options`, None for options that were not typed.

    Raises:
        PrefcalError: If the options do not fit the scenario, the study or the machine.
    """
    given = completed(given)
    source, options = given["scenario"], Options.of(given)
    messages = Console(stderr=True, emoji=False)
    with interruption(others=True) as ctrl_c:
        ctrl_c.on_press = lambda: messages.print("Stopping ...", highlight=False)
        with isolation(source, given["run_timeout"], at_once=options.at_once) as isolated:
            with ctrl_c.allowed():  # nothing is open yet
                scenario = isolated(with_cost(load(source), given["cost"]))
            if options.by_a_person and not options.terminal:
                _check_address(options)
            opened = open_study(given, scenario, given["study"])
            with kept_if_worth_it(opened, scenario, messages):
                return _run(opened, scenario, ctrl_c, messages)


def _check_address(options: Options) -> None:
    """Raise SettingsError if the page's port is taken, before the study starts."""
    # Imported here: unattended runs need no web server.
    from prefcal_app.web.server.site import bind

    bind(options.host, options.port).close()


def _run(opened: Opened, scenario: Scenario, ctrl_c: Interruption, messages: Console) -> int:
    """Collect the answers and write the report in a folder that belongs to the study."""
    file, name = opened.file, opened.name
    try:
        with calibration(opened, scenario, messages) as work:
            ctrl_c.on_press = lambda: _say_stopping(work)
            _introduce(work)
            ask = _attended if opened.options.by_a_person else _unattended
            return ask(work, ctrl_c)
    except KeyboardInterrupt:
        has_report = name and file.state.history.answered
        later = f"; its report: prefcal report {name}" if has_report else ""
        saved = file.trouble() or (f"Every answer is saved{later}" if name else "")
        say(messages, f"Stopped at once. {saved}".strip())
        raise


def _introduce(work: Calibration) -> None:
    """Print the report's folder if it may be unexpected, and what a run left on the plant."""
    folder, opened = work.claim.folder, work.opened
    default = default_folder(opened, work.interview.scenario.name)
    if folder.name != default.name and work.options.out is None:
        work.say(f"{default} holds another study's report: this one goes to {folder}.")
    if work.left:
        work.say(f"A run was interrupted: the plant's old values are restored now ({work.left}).")


def _say_stopping(work: Calibration) -> None:
    """Print what the first Ctrl-C does."""
    what = "Writing the report ..." if work.reportable else "Stopping ..."
    if work.interview.drives:
        what = "Stopping the run: the plant gets its old values back ..."
    work.say(f"{what} (Ctrl-C again ends at once)")


def _attended(work: Calibration, ctrl_c: Interruption) -> int:
    """Let a person answer, with pauses of any length; return the exit code."""
    how = "resumed" if work.opened.resumed else "started"
    work.say(f"Study {work.opened.name} {how}. Every answer is saved at once.")
    work.say(f"Stop any time, and resume with: {work.again}")
    ask = _in_terminal if work.options.terminal else _in_window
    ask(work, ctrl_c)
    if work.left:
        work.say(
            f"The plant does not have its old values ({work.left}). They are kept on the disk, and "
            f"restored at the next start: {work.again}"
        )
    over = work.over
    if work.reportable and (trouble := work.opened.file.trouble()) is not None:
        raise StudyError(trouble)
    if not over and work.reportable:
        work.say(f"Stopped; every answer is saved. Resume: {work.again}")
    return INTERRUPTED if ctrl_c.pressed and not over else 0


def _in_window(work: Calibration, ctrl_c: Interruption) -> None:
    """Serve the query window until it is closed."""
    # Imported here: unattended runs need no web server.
    from prefcal_app.web import Window, open_browser

    options, announced = work.options, False
    links = work.messages.file if options.json else None
    with (
        Window(
            work.interview, host=options.host, port=options.port, again=work.again, command=options.command()
        ) as window,
        Background(work.interview),
    ):
        if window.warning:
            work.say(window.warning)
        # A link stands on a line of its own, unwrapped and flushed, so that programs can read it.
        print(window.link, file=links, flush=True)
        if window.link_for_others:
            work.say("From other machines:")
            print(window.link_for_others, file=links, flush=True)
        if options.browser and not open_browser(window.link):
            work.say("No browser found: open the link yourself, or answer here with --terminal.")
        with suppress(KeyboardInterrupt), ctrl_c.allowed():
            while not window.closed.wait(0.1):
                over = work.over
                if over and not announced:
                    _tell_in_passing(work)
                    window.reports = work.claim.folder
                    ctrl_c.on_press = lambda: work.say("Closing ...")
                elif announced and not over:
                    window.reports = None  # it is of the result before
                    ctrl_c.on_press = lambda: _say_stopping(work)
                announced = over
                away = window.away()
                if over and away is not None and away > GONE and not window.verifying:
                    break
    if options.json or not announced:
        work.tell(work.write())


def _tell_in_passing(work: Calibration) -> None:
    """Write the report of a finished study while its page is still open."""
    record = work.write()
    if not work.options.json:
        work.tell(record)
    work.say("The study is finished. The command ends when you close its page, or with Ctrl-C.")


def _in_terminal(work: Calibration, ctrl_c: Interruption) -> None:
    """Ask in the terminal until the person stops."""
    # With --json, standard output belongs to the result.
    console = work.messages if work.options.json else Console(emoji=False)
    with Background(work.interview), suppress(KeyboardInterrupt), ctrl_c.allowed():
        converse(work.interview, console)
    work.tell(work.write())


def _unattended(work: Calibration, ctrl_c: Interruption) -> int:
    """Let a synthetic calibrator answer as fast as the experiments run; return the exit code."""
    failure = None
    try:
        with ctrl_c.allowed():
            _answer_all(work, ctrl_c)
    except (KeyboardInterrupt, Exception) as error:
        # Keep the results so far after any error of a rig. Compiled code can turn a
        # KeyboardInterrupt into another error, so check whether Ctrl-C was pressed.
        if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
            failure = error
        else:
            done = f"{work.interview.known.counts.experiments} of {work.interview.known.n_max} experiments"
            work.say(f"Interrupted after {done}.")
    # Do not run the references on a rig that has just failed.
    record = work.write(failed=failure is not None)
    work.tell(record)
    if isinstance(failure, RunError | SimulationError):
        if isinstance(failure, RunError) and failure.trace:
            work.say(failure.trace)
        work.say(f"prefcal: {failure}")
        return RUN_FAILED
    if failure is not None:
        raise failure
    if ctrl_c.pressed and not record.stopped:
        work.say("Interrupted after the study was finished: the report is complete.")
    return INTERRUPTED if ctrl_c.pressed else 0


def _answer_all(work: Calibration, ctrl_c: Interruption) -> None:
    """Run and compare all experiments, showing a progress bar."""
    interview = work.interview
    calibrator = make_calibrator(work.options, interview.scenario)
    with _Display(work) as display:
        display.compared(len(interview.past.comparisons()))
        interview.prepare(display.compiling)
        for _ in unattended(interview, calibrator, display.running, work.say):
            display.compared()
            ctrl_c.check()


class _Display(Progress):
    """Progress bar with the current θ, the best θ and the verdicts so far, used with `with`."""

    def __init__(self, work: Calibration) -> None:
        self._interview = work.interview
        self._rows = {"θ now": "none yet", "best θ": "none yet", "verdicts": ""}
        super().__init__(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeRemainingColumn(compact=True),
            console=work.messages,
            expand=True,
        )
        name = escape(printable(self._interview.scenario.name))
        self._bar = self.add_task(f"calibrating {name}", total=self._interview.known.n_max)

    def get_renderables(self) -> Iterator[RenderableType]:
        """Yield the bar, and a line for each row below it."""
        yield from super().get_renderables()
        rows = dict(self._rows)
        if (simulated := self._interview.known.simulated) is not None:
            rows["unseen"] = simulated.line
        elif (running := self._interview.now().running) > 1:
            rows["at once"] = f"{running} experiments are running"
        for name, text in rows.items():
            style = "bold blue" if name == "best θ" else ""
            yield Text.assemble((f"{name:<9} ", "dim"), (printable(text), style))

    def compiling(self, part: Compiling) -> None:
        """Show what is being compiled; without a live display, print it once."""
        if not self.console.is_terminal and self._rows["θ now"] == "none yet":
            say(self.console, part.words)
        self._rows["θ now"] = part.words

    def running(self, theta: Float[np.ndarray, " n"]) -> None:
        """Show the θ that is running."""
        self._rows["θ now"] = theta_text(self._interview.scenario.space, theta)

    def compared(self, count: int = 1) -> None:
        """Count experiments; show the verdicts and what the study would return now."""
        self.advance(self._bar, count)
        now, verdicts = self._interview.now(), self._interview.known.counts.verdicts
        self._rows["verdicts"] = " · ".join(f"{VERDICTS[v]} {n}" for v, n in verdicts.items())
        if (index := now.incumbent) is not None:
            theta = np.array(now.state.history.samples[index].theta)
            best = theta_text(self._interview.scenario.space, theta)
            self._rows["best θ"] = f"{best} (experiment {index + 1})"
