"""Run `prefcal calibrate`: open the study, collect the answers, and write the report."""

import shlex
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from jaxtyping import Float
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from prefcal_app.report.export import versions
from prefcal_app.report.record import VERDICTS
from prefcal_app.session import (
    Background,
    Interview,
    Now,
    Phase,
    unattended,
)
from prefcal_app.session.memory import as_studied, is_simulating
from prefcal_app.simulating import Kept, Simulator, key_of, twin_of
from prefcal_app.summary.counts import Counts
from prefcal_env.compiling import Compiling
from prefcal_env.errors import RunError, SimulationError, StudyError
from prefcal_env.live import LiveRig
from prefcal_env.preferences.answer import Preference
from prefcal_env.study.locations import simulated_beside
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.options import words_to_resume
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.names import is_own
from prefcal_scenarios.presentation.wording import (
    earlier_text,
    printable,
    theta_text,
)
from prefcal_scenarios.scenario import Scenario

from .choices import make_calibrator
from .cost_file import with_cost
from .describing.source import cost_of, source_of
from .interrupt import INTERRUPTED, Interruption, interruption
from .opening import Opened, claim_folder, default_folder, kept_if_worth_it, open_study
from .options import Options
from .report import Reporter, say

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
    given = {**given, "scenario": source_of(given), "cost": cost_of(given)}
    source = given["scenario"]
    with interruption(others=True) as ctrl_c:
        messages = Console(stderr=True, emoji=False)
        ctrl_c.on_press = lambda: messages.print("Stopping ...", highlight=False)
        at_once = Options.of(given).at_once
        with isolation(source, given["run_timeout"], at_once=at_once) as isolated:
            with ctrl_c.allowed():  # nothing is open yet
                scenario = isolated(with_cost(load(source), given["cost"]))
            _check_address(Options.of(given))

            opened = open_study(given, scenario, given["study"])
            with kept_if_worth_it(opened, scenario, partial(say, messages)):
                return _run(opened, scenario, ctrl_c, messages)


def _check_address(options: Options) -> None:
    """Raise SettingsError if the page's port is taken, before the study starts."""
    if options.by_a_person and not options.terminal:
        # Imported here: unattended runs need no web server.
        from prefcal_app.web.server.binding import bind

        bind(options.host, options.port).close()


def _run(opened: Opened, scenario: Scenario, ctrl_c: Interruption, messages: Console) -> int:
    """Collect the answers and write the report in a folder that belongs to the study."""
    claim, file = claim_folder(opened, scenario.name), opened.file
    options, name = opened.options, opened.name
    try:
        with simulator_of(opened, scenario) as simulator:
            ahead = options.by_a_person
            interview = Interview(
                scenario, file, ahead=ahead, simulator=simulator, at_once=options.at_once
            )
            work = CalibrateRun(Reporter(interview, opened, claim, messages), ctrl_c)
            ctrl_c.on_press = work.stopping
            work.introduce()
            return _attended(work) if options.by_a_person else _unattended(work)
    except KeyboardInterrupt:
        has_report = name and file.state.history.answered
        later = f"; its report: prefcal report {name}" if has_report else ""
        saved = file.trouble() or (f"Every answer is saved{later}" if name else "")
        say(messages, f"Stopped at once. {saved}".strip())
        raise
    finally:
        claim.release()


@contextmanager
def simulator_of(
    opened: Opened, scenario: Scenario, *, keep: bool = True
) -> Iterator[Simulator | None]:
    """Yield what the study's agent simulates with, for the knobs of the study; None if nothing.

    Args:
        opened: Study.
        scenario: Scenario of the study.
        keep: Whether to keep the results beside the study: only if its options name all code.
    """
    state = opened.file.state
    if not is_simulating(state):
        yield None
        return
    studied, options = as_studied(scenario, state), opened.options
    limit = options.run_timeout
    with ExitStack() as open_until_the_end:
        if options.twin is not None:
            isolated = open_until_the_end.enter_context(isolation(options.twin, limit))
            studied = twin_of(studied, isolated(load(options.twin)))
        kept = _kept(opened, studied) if keep and opened.name is not None else None
        simulator = Simulator(studied, seed=options.seed, longest=limit, kept=kept)
        open_until_the_end.enter_context(simulator).start()
        yield simulator


def _kept(opened: Opened, scenario: Scenario) -> Kept:
    """Return what is kept beside the study of what `scenario` simulated."""
    options = opened.options
    source = options.scenario if options.twin is None else options.twin
    key = key_of(scenario, source, opened.file.state.configuration, versions())
    return Kept(simulated_beside(Path(opened.file.path)), key)


@dataclass(frozen=True, slots=True)
class CalibrateRun:
    """Calibration that runs until the study is over or is stopped.

    Args:
        reporter: Reporter that writes and prints the result.
        ctrl_c: Handler of Ctrl-C.
    """

    reporter: Reporter
    ctrl_c: Interruption

    @property
    def interview(self) -> Interview:
        """Return the interview, which holds the agent and the study file."""
        return self.reporter.interview

    @property
    def opened(self) -> Opened:
        """Return the opened study."""
        return self.reporter.opened

    @property
    def options(self) -> Options:
        """Return the options of the study."""
        return self.opened.options

    @property
    def again(self) -> str:
        """Return the command that resumes the study."""
        options, name = self.options, self.opened.name or ""
        cost = [] if options.cost is None else ["--cost", options.cost]
        own = options.twin is not None and is_own(options.twin)
        twin = ["--twin", options.twin] if options.twin is not None and own else []
        named = words_to_resume(options.scenario)
        return shlex.join(["prefcal", "calibrate", *named, "--study", name, *cost, *twin])

    @property
    def over(self) -> bool:
        """Return whether the study is over."""
        return self.interview.now().phase is Phase.OVER

    def say(self, text: str) -> None:
        """Print one line for the user."""
        self.reporter.say(text)

    def introduce(self) -> None:
        """Print the report's folder and the origin of the first θ if they may be unexpected."""
        folder = self.reporter.claim.folder
        default = default_folder(self.opened, self.interview.scenario.name)
        if folder.name != default.name and self.options.out is None:
            self.say(f"{default} holds another study's report: this one goes to {folder}.")
        if self.left:
            self.say(
                f"A run was interrupted: the plant's old values are restored now ({self.left})."
            )
        taken = self.opened.file.state.configuration.get("earlier")
        if taken and not self.opened.resumed:
            self.say(f"From {earlier_text(taken)}.")

    @property
    def left(self) -> str:
        """Return the old values that a live plant does not have again, as text; empty if none."""
        run = self.interview.scenario.run
        left = run.left if isinstance(run, LiveRig) else None
        return ", ".join(f"{name} = {value:g}" for name, value in (left or {}).items())

    def stopping(self) -> None:
        """Print what the first Ctrl-C does."""
        what = "Writing the report ..." if self.reporter.reportable else "Stopping ..."
        if self.interview.drives:
            what = "Stopping the run: the plant gets its old values back ..."
        self.say(f"{what} (Ctrl-C again ends at once)")

    def closing(self) -> None:
        """Print what Ctrl-C does after the report is written."""
        self.say("Closing ...")


def _attended(work: CalibrateRun) -> int:
    """Let a person answer, with pauses of any length; return the exit code."""
    how = "resumed" if work.opened.resumed else "started"
    work.say(f"Study {work.opened.name} {how}. Every answer is saved at once.")
    work.say(f"Stop any time, and resume with: {work.again}")
    ask = _in_terminal if work.options.terminal else _in_window
    ask(work)
    if work.left:
        work.say(
            f"The plant does not have its old values ({work.left}). They are kept on the disk, and "
            f"restored at the next start: {work.again}"
        )
    over = work.over
    if work.reporter.reportable and (trouble := work.opened.file.trouble()) is not None:
        raise StudyError(trouble)
    if not over and work.reporter.reportable:
        work.say(f"Stopped; every answer is saved. Resume: {work.again}")
    return INTERRUPTED if work.ctrl_c.pressed and not over else 0


def _in_window(work: CalibrateRun) -> None:
    """Serve the query window until it is closed."""
    # Imported here: unattended runs need no web server.
    from prefcal_app.web import Window, open_browser

    options, reporter, announced = work.options, work.reporter, False
    with Window(
        work.interview, host=options.host, port=options.port, again=work.again,
        command=options.command(),
    ) as window, Background(work.interview):  # fmt: skip
        if window.warning:
            work.say(window.warning)
        _print_link(window.link, work)
        if window.link_for_others:
            work.say("From other machines:")
            _print_link(window.link_for_others, work)
        if options.browser and not open_browser(window.link):
            work.say("No browser found: open the link yourself, or answer here with --terminal.")
        try:
            with work.ctrl_c.allowed():
                while not window.closed.wait(0.1):
                    over = work.over
                    if over and not announced:
                        window.reports = _tell_in_passing(work)
                    announced = over
                    work.ctrl_c.on_press = work.closing if announced else work.stopping
                    away = window.away()
                    if over and away is not None and away > GONE:
                        break
        except KeyboardInterrupt:
            pass
    if options.json or not announced:
        reporter.tell(reporter.write())


def _tell_in_passing(work: CalibrateRun) -> Path:
    """Write the report of a finished study while its page is still open; return its folder."""
    record = work.reporter.write()
    if not work.options.json:
        work.reporter.tell(record)
    work.say("The study is finished. The command ends when you close its page, or with Ctrl-C.")
    return work.reporter.claim.folder


def _print_link(link: str, work: CalibrateRun) -> None:
    """Print a link on a line of its own, unwrapped and flushed, so that programs can read it."""
    stream = work.reporter.messages.file if work.options.json else None
    print(link, file=stream, flush=True)


def _in_terminal(work: CalibrateRun) -> None:
    """Ask in the terminal until the person stops."""
    from prefcal_app.terminal import converse

    # With --json, standard output belongs to the result.
    console = work.reporter.messages if work.options.json else Console(emoji=False)
    with Background(work.interview):
        try:
            with work.ctrl_c.allowed():
                converse(work.interview, console)
        except KeyboardInterrupt:
            pass
    work.reporter.tell(work.reporter.write())


def _unattended(work: CalibrateRun) -> int:
    """Let a synthetic calibrator answer as fast as the experiments run; return the exit code."""
    ctrl_c, failure = work.ctrl_c, None
    try:
        with ctrl_c.allowed():
            _answer_all(work)
    except (KeyboardInterrupt, Exception) as error:
        # Keep the results so far after any error of a rig. Compiled code can turn a
        # KeyboardInterrupt into another error, so check whether Ctrl-C was pressed.
        if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
            failure = error
        else:
            done = f"{work.interview.counts.experiments} of {work.interview.n_max} experiments"
            work.say(f"Interrupted after {done}.")
    # Do not run the references on a rig that has just failed.
    record = work.reporter.write(failed=failure is not None)
    work.reporter.tell(record)
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


def _answer_all(work: CalibrateRun) -> None:
    """Run and compare all experiments, showing a progress bar."""
    interview, scenario = work.interview, work.interview.scenario
    calibrator = make_calibrator(work.options, scenario)
    messages = work.reporter.messages
    with Display(scenario, interview.n_max, messages, lambda: _unseen(interview)) as display:
        for _ in interview.comparisons():
            display.compared()
        display.best(interview.now())
        interview.prepare(display.compiling)
        for _ in unattended(interview, calibrator, display.running, work.say):
            display.compared()
            display.best(interview.now())
            work.ctrl_c.check()


def _unseen(interview: Interview) -> tuple[str, str] | None:
    """Return name and words of what goes on beside the present θ; None if nothing does."""
    if (simulated := interview.simulated) is not None:
        return "unseen", simulated.line
    if (running := interview.now().running) > 1:
        return "at once", f"{running} experiments are running"
    return None


class Display:
    """Progress bar with the current θ, the best θ and the verdicts so far.

    Args:
        scenario: Scenario that is calibrated.
        n_max: Number of experiments.
        console: Console to show it on.
        beside: Function that returns name and words of what goes on beside the present θ; None if
            nothing does.
    """

    def __init__(
        self,
        scenario: Scenario,
        n_max: int,
        console: Console,
        beside: Callable[[], tuple[str, str] | None] = lambda: None,
    ) -> None:
        self._scenario, self._console, self._beside = scenario, console, beside
        self._counts: Mapping[Preference | None, int] = dict.fromkeys(VERDICTS, 0)
        self._current = "none yet"
        self._best = "none yet"
        self._compiling = False
        self._bar = Progress(
            TextColumn("[bold]{task.description}"), BarColumn(bar_width=None),
            MofNCompleteColumn(), TimeRemainingColumn(compact=True), console=console,
            expand=True,
        )  # fmt: skip
        self._task = self._bar.add_task(
            f"calibrating {escape(printable(scenario.name))}", total=n_max
        )
        self._live = Live(console=console, get_renderable=self._lines, refresh_per_second=8)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        if not self._console.is_terminal:
            self._console.print()  # outside a terminal, rich leaves the last line open

    def compiling(self, part: Compiling) -> None:
        """Print what is being compiled, only once without a live display."""
        if not self._console.is_terminal and not self._compiling:
            self._console.print(part.words, markup=False, highlight=False, soft_wrap=True)
        self._compiling = True
        self._current = part.words

    def running(self, theta: Float[np.ndarray, " n"]) -> None:
        """Show the θ that is running."""
        self._current = theta_text(self._scenario.space, theta)

    def compared(self) -> None:
        """Count one experiment."""
        self._bar.advance(self._task)

    def best(self, now: Now) -> None:
        """Show the verdicts so far, and the experiment that the study would return now."""
        self._counts = Counts.of(now.state).verdicts
        index = now.incumbent
        if index is not None:
            theta = np.array(now.state.history.samples[index].theta)
            self._best = f"{theta_text(self._scenario.space, theta)} (experiment {index + 1})"

    def _lines(self) -> RenderableType:
        counts = " · ".join(f"{VERDICTS[v]} {n}" for v, n in self._counts.items())
        rows = [("θ now", self._current, ""), ("best θ", self._best, "bold blue"),
                ("verdicts", counts, "")]  # fmt: skip
        if (beside := self._beside()) is not None:
            rows.append((*beside, ""))
        texts = [
            Text.assemble((f"{name:<9} ", "dim"), (printable(text), look))
            for name, text, look in rows
        ]
        return Group(self._bar, *texts)
