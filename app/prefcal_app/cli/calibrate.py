"""Run `prefcal calibrate`: an open study with all that works on it, until it ends or is stopped."""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from prefcal_app.report.export import versions
from prefcal_app.report.record import (
    VERDICTS,
    Owner,
    Ownership,
    StudyRecord,
    claim_default,
    claim_given,
    identity_of,
)
from prefcal_app.session import Background, Interview, Phase, actions, unattended
from prefcal_app.session.study import as_studied, is_simulating
from prefcal_app.simulating import SimulationFile, Simulator, key_of, twin_of
from prefcal_app.terminal import converse
from prefcal_app.terminal.showing import Tenths, say
from prefcal_env.compiling import Compiling
from prefcal_env.errors import RecordError, RunError, SettingsError, SimulationError, StaleError, StudyError
from prefcal_env.study import State, StudyFile, study_path
from prefcal_env.study.beside import SIMULATED, beside_study
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.description import listed
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.names import TABLES, is_table
from prefcal_scenarios.own import joined_source
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.wording import printable, theta_text

from .choices import by_now, kept_if_worth_it, make_calibrator, open_study, with_cost, worth_keeping
from .options import CHOOSING, Options
from .result import as_json, changes, record_of, references, show, show_outlook
from .studies.files import completed, existing, open_described

# --- Handle Ctrl-C at any moment: acknowledge it, stop, and keep all results in whole files.

INTERRUPTED = 130  # exit code after Ctrl-C, as in shells
_ALSO = ("SIGTERM", "SIGHUP")  # signals that end a program like Ctrl-C does: `kill`, and closing the terminal


class Interruption:
    """Signal handler that remembers the first Ctrl-C, and raises at once on the second.

    The first one raises only where this is allowed, after calling `on_press`.
    """

    def __init__(self) -> None:
        self.pressed = False
        self.on_press: Callable[[], None] = lambda: None
        self._allowed = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle the signal."""
        again, self.pressed = self.pressed, True
        if not again:
            with suppress(OSError):  # the terminal may be closed
                self.on_press()
        if again or self._allowed:
            raise KeyboardInterrupt

    def check(self) -> None:
        """Raise if a press was held back, or swallowed by a callback of compiled code."""
        if self.pressed:
            raise KeyboardInterrupt

    @contextmanager
    def allowed(self) -> Iterator[None]:
        """Let a press raise at once inside the block, including an earlier press held back."""
        self.check()
        self._allowed = True
        try:
            yield
        finally:
            self._allowed = False


@contextmanager
def interruption(*, others: bool = False) -> Iterator[Interruption]:
    """Handle Ctrl-C inside the block; threads that cannot set handlers keep Python's behavior.

    Args:
        others: Whether to handle `kill` and a closed terminal, too. Must be False if the block
            starts processes, which would inherit the handling.
    """
    handler = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield handler
        return
    before = {signal.SIGINT: signal.signal(signal.SIGINT, handler)}
    for name in _ALSO if others else ():
        number = getattr(signal, name, None)  # Windows lacks some of them
        # Replace only the default handler: `nohup` ignores SIGHUP on purpose.
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            before[number] = signal.signal(number, handler)
    try:
        yield handler
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


# --- An open study with all that works on it: its interview, its simulator and its report.

_SOON = 0.5  # seconds after which it is said what takes time, where no spinner can turn
SAID_SOON = 2.0  # longest wait, in seconds, for what is said of a result before its first report is written


class Reported(NamedTuple):
    """What a report is about: the report of another result is written anew."""

    best: int | None
    answers: int
    over: bool
    kept: int  # what was confirmed on the plant, 0 for nothing


@dataclass(frozen=True, slots=True)
class Calibration:
    """An open study at work; its report can be written again and again while it runs."""

    options: Options  # what is calibrated, and how
    interview: Interview  # interview, which holds the scenario, the agent and the study file
    claim: Ownership  # claim on the folder of the report
    messages: Console  # console for messages, standard error
    resumed: bool  # whether the study existed before

    @property
    def file(self) -> StudyFile:
        """Return the study file."""
        return self.interview.file

    @property
    def over(self) -> bool:
        """Return whether the study is over."""
        return self.interview.now().phase is Phase.OVER

    @property
    def result(self) -> Reported:
        """Return what a report is about.

        A choice at the end reopens a study and ends it within milliseconds, so that it seems never
        to have been open.
        """
        now = self.interview.now()
        kept = 0 if now.state.kept is None else now.state.kept[0]
        return Reported(now.incumbent, len(now.state.answers), now.phase is Phase.OVER, kept)

    @property
    def again(self) -> str:
        """Return the command that resumes the study."""
        return self.options.again()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return what is no longer as it was when a study that goes on now was begun, a line each."""
        return tuple(changes(self.options, self.file.state)) if self.resumed else ()

    @property
    def left(self) -> str:
        """Return the old values that a live plant does not have again, as text; empty if none."""
        left = self.interview.scenario.source.left
        return ", ".join(f"{name} = {value:g}" for name, value in (left or {}).items())

    @property
    def reportable(self) -> bool:
        """Return whether the study has a completed experiment and is kept, so can be reported.

        Takes no lock, since the handler of Ctrl-C calls it at any point.
        """
        if not self.file.state.history.answered:
            return False
        kept = not self.options.by_a_person or self.resumed
        return kept or worth_keeping(self.file, self.interview.scenario)

    def say(self, text: str) -> None:
        """Print one line for the user, whatever is in it."""
        say(self.messages, text)

    def wait_for_findings(self) -> None:
        """Wait for all that is said of the result, with a word if that takes a while."""
        known = self.interview.known
        if not self.over or known.wait_for_findings(SAID_SOON):
            return
        self.say("Working out what the answers say of the result ... (Ctrl-C goes without)")
        while self.over and not self.interview.is_closed and not known.wait_for_findings(SAID_SOON):
            pass

    def write(self, *, failed: bool = False) -> StudyRecord:
        """Write the report of the study as it stands, if there is anything to report.

        Args:
            failed: Whether the scenario has just failed: no references run, and nothing more is
                said about its cost.
        """
        options, scenario, wanted = self.options, self.interview.scenario, self.reportable
        self.interview.known.foresight(learn=True)
        shown = {} if failed or not wanted else references(scenario, options.seed, self.say)
        self.interview.known.references = shown  # so that page and report advise the same
        record, trouble = record_of(self.interview, options, shown).costed()
        if trouble and not failed:
            self.say(f"prefcal: the report has no costs: {trouble}")
        if wanted:
            self._write(record)
        return record

    def _write(self, record: StudyRecord) -> None:
        # Imported here: plotting takes half a second, and invalid options must fail fast.
        from prefcal_app.report.write import write_report

        scenario = self.interview.scenario
        pictures = () if scenario.pictures is None else scenario.pictures()
        try:
            self.claim.renew()
            write_report(record, self.claim.folder, pictures)
        except OSError as error:
            raise StudyError(
                f"cannot write the report into {self.claim.folder}: {error.strerror or error}. "
                "The study itself has lost nothing"
            ) from error

    def tell(self, record: StudyRecord) -> None:
        """Print the result."""
        options = self.options
        report = self.claim.folder / "report.html" if self.reportable else None
        if options.json:
            print(as_json(record, options, report, self._simulated), flush=True)
        elif report is None:
            self.say("Nothing to report: no experiment was compared.")
        else:
            console = Console(emoji=False)  # ":100:" in the range of a knob is none
            show(record, report, console)
            if not options.by_a_person:  # no program can repeat a person's answers
                console.print(f"Repeat it: {options.command()}", soft_wrap=True, markup=False)
        if report is not None and record.partial:
            self.say(f"This is a partial report: {record.reached}.")

    @property
    def _simulated(self) -> int | None:
        """Return how many θ were simulated unseen; None if this is not known any more."""
        if not is_simulating(self.file.state):
            return 0
        found = self.interview.known.simulated
        return None if found is None or not found.simulated else found.simulated


@contextmanager
def calibration(
    file: StudyFile,
    options: Options,
    scenario: Scenario,
    messages: Console,
    *,
    resumed: bool,
    asks: bool = True,
    keep: bool = True,
) -> Iterator[Calibration]:
    """Claim the folder of the report, and get a study to work.

    Args:
        asks: Whether experiments may run, and events be written.
        keep: Whether to keep what is simulated beside the study: only if its options name all code.
    """
    owner, out = Owner(identity_of(file), options.study, options.scenario), options.out
    default = default_folder(options, scenario.name)
    claim = claim_default(default, owner) if out is None else claim_given(out, owner)
    with ExitStack() as stack:
        stack.callback(claim.release)
        simulator = _simulator(stack, file, options, scenario, keep=keep) if asks else None
        with _learning(file.state, messages):
            interview = Interview(
                scenario,
                file,
                ahead=asks and options.by_a_person,
                asks=asks,
                simulator=simulator,
                at_once=options.at_once,
            )
        stack.callback(interview.close)
        yield Calibration(options, interview, claim, messages, resumed)


@contextmanager
def _learning(state: State, messages: Console) -> Iterator[None]:
    """Say what takes time while an agent learns the answers of a study anew, as far as nothing was kept."""
    words = f"Learning from the {len(state.answers)} answers of this study ..."
    late = threading.Timer(_SOON, say, (messages, words))
    late.daemon = True
    try:
        if not messages.is_terminal and state.answers:
            late.start()
        with messages.status(words) if state.answers else nullcontext():
            yield
    finally:
        late.cancel()


def _simulator(
    stack: ExitStack, file: StudyFile, options: Options, scenario: Scenario, *, keep: bool
) -> Simulator | None:
    """Return what the study's agent simulates with, for the knobs of the study; None if nothing."""
    state = file.state
    if not is_simulating(state):
        return None
    studied, limit = as_studied(scenario, state), options.run_timeout
    if options.twin is not None:
        isolated = stack.enter_context(isolation(options.twin, limit))
        studied = twin_of(studied, isolated(load(options.twin)))
    kept, given = None, studied.source.candidates is not None  # rows of a table: there is nothing to run
    if keep and options.study is not None and not given:
        source = options.scenario if options.twin is None else options.twin
        key = key_of(studied, source, state.configuration, versions())
        kept = SimulationFile(beside_study(Path(file.path), SIMULATED), key)
    jobs = 0 if given else None
    simulator = Simulator(
        studied, seed=options.seed, jobs=jobs, longest=limit, kept=kept, robust=options.robust
    )
    stack.enter_context(simulator).start()
    return simulator


def default_folder(options: Options, scenario: str) -> Path:
    """Return the default folder of the report: prefcal-STUDY.

    For a study in memory, the scenario and the seed stand in for the name.
    """
    name = f"{scenario}-{options.seed}" if options.study is None else study_path(options.study).stem
    return Path(f"prefcal-{name}")


def report_of(given: Mapping[str, Any]) -> None:
    """Write the report of a study, as typed."""
    given = completed(given)
    name, source, cost = given["study"], given["scenario"], given.get("cost")
    with open_described(existing(name)) as file, isolation(source, early=False) as isolated:
        scenario = isolated(with_cost(load(source), cost))
        stored = by_now(file.state)
        if cost is not None and stored.get("cost") is not None:
            stored["cost"] = cost  # the file may have moved
        # A report simulates nothing, so its twin is taken as it is.
        options = Options.resumed(stored, {"twin": stored.get("twin"), **given})
        if not file.state.history.answered:
            raise StudyError(f"study {name!r} has no completed experiment yet: nothing to report")
        messages = Console(stderr=True, emoji=False)
        # A page may have the study open: writing an event here would make its next answer fail.
        with calibration(file, options, scenario, messages, resumed=True, asks=False) as work:
            work.tell(work.write())


# --- Run `prefcal calibrate`: open the study, collect the answers, and write the report.

RUN_FAILED = 1  # exit code if the user's own scenario code ended an unattended study
GONE = 20.0  # seconds from closing the last page of a finished study to the end of the command


def run(given: Mapping[str, Any]) -> int:
    """Run the study that these fields of `Options` describe, and tell its result; return the exit code.

    A study that ends early still gets a report of the comparisons so far, and can be resumed.
    """
    given = completed(given)
    source, options = given["scenario"], Options.of(given)
    messages = Console(stderr=True, emoji=False)
    with interruption(others=True) as ctrl_c:
        ctrl_c.on_press = lambda: messages.print("Stopping ...", highlight=False)
        with isolation(source, options.run_timeout, at_once=options.at_once) as isolated:
            with ctrl_c.allowed():  # nothing is open yet
                scenario = isolated(with_cost(load(source), options.cost))
            if options.by_a_person and not options.terminal:
                # Imported here: unattended runs need no web server.
                from prefcal_app.web.serve import bind

                bind(options.host, options.port).close()  # a taken port is said before the study starts
            file, options, resumed = open_study(given, scenario)
            with (
                kept_if_worth_it(file, options, scenario, messages, resumed=resumed),
                calibration(file, options, scenario, messages, resumed=resumed) as work,
            ):
                ctrl_c.on_press = partial(_say_stopping, work)
                _introduce(work)
                return (_attended if options.by_a_person else _unattended)(work, ctrl_c)


def choose(typed: Mapping[str, Any]) -> int:
    """Let a person choose among the runs of a table, as typed; return the exit code."""
    name, config = typed["table"], {key: listed(typed.get(key, ())) for key in ("lower", "higher", "kpis")}
    if not is_table(name):
        raise RecordError(f"expected a table ({', '.join(TABLES)}) or the URL of a storage, got {name!r}")
    if empty := [key for key, names in config.items() if key in typed and not names]:
        raise SettingsError(f"--{empty[0]} must name a column, got {', '.join(typed[empty[0]])!r}")
    config = {key: value for key, value in {**config, "of": typed.get("of")}.items() if value}
    source = joined_source(name, config) if config else name
    wanted = {option: typed[option] for option in CHOOSING if option in typed}
    if "study" not in typed or not study_path(typed["study"]).is_file():
        found = load(source)
        if "://" in name:  # more trials may follow
            source = joined_source(name, {**config, "until": int(found.space.knobs[0].high)})
        assert found.source.candidates is not None
        count = len(found.source.candidates)
        if wanted.setdefault("n_max", min(count, 11)) > count:
            raise SettingsError(
                f"--n-max must be at most {count}, all that can be chosen, got {wanted['n_max']}"
            )
        wanted["simulate"] = count
    return run({**wanted, "scenario": source})


def _introduce(work: Calibration) -> None:
    """Print the report's folder if it may be unexpected, and what a run left on the plant."""
    folder, default = work.claim.folder, default_folder(work.options, work.interview.scenario.name)
    if folder.name != default.name and work.options.out is None:
        work.say(f"{default} holds another study's report: this one goes to {folder}.")
    for remark in work.remarks:
        work.say(remark)
    if work.left:
        work.say(f"A run was interrupted: the plant's old values are restored now ({work.left}).")


def _say_stopping(work: Calibration, what: str = "") -> None:
    """Print what the first Ctrl-C does."""
    what = what or ("Writing the report ..." if work.reportable else "Stopping ...")
    if work.interview.drives:
        what = "Stopping the run: the plant gets its old values back ..."
    work.say(f"{what} (Ctrl-C again ends at once)")


def _attended(work: Calibration, ctrl_c: Interruption) -> int:
    """Let a person answer, with pauses of any length; return the exit code."""
    how = "resumed" if work.resumed else "started"
    work.say(f"Study {work.options.study} {how}. Every answer is saved at once.")
    work.say(f"Stop any time, and resume with: {work.again}")
    (_in_terminal if work.options.terminal else _in_window)(work, ctrl_c)
    if work.left:
        work.say(
            f"The plant does not have its old values ({work.left}). They are kept on the disk, and "
            f"restored at the next start: {work.again}"
        )
    over = work.over
    if work.reportable and (trouble := work.file.trouble()) is not None:
        raise StudyError(trouble)
    if not over and work.reportable:
        work.say(f"Stopped; every answer is saved. Resume: {work.again}")
    return INTERRUPTED if ctrl_c.pressed and not over else 0


def _in_window(work: Calibration, ctrl_c: Interruption) -> None:
    """Serve the query window until it is closed."""
    # Imported here: unattended runs need no web server.
    from prefcal_app.web import Window, open_browser

    options, telling = work.options, _Telling(work)
    links = work.messages.file if options.json else None
    served = Window(
        work.interview,
        host=options.host,
        port=options.port,
        again=work.again,
        command=options.command(),
        remarks=work.remarks,
    )
    with served as window, Background(work.interview):
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
                window.reports = telling.follow(ctrl_c)
                away = window.away()
                if work.over and away is not None and away > GONE and not window.verifying:
                    break
            with suppress(StaleError):  # a page that is closed confirms nothing
                work.interview.do(actions.EndTrial())
            work.wait_for_findings()
    telling.end()


@dataclass(slots=True)
class _Telling:
    """What was said of a finished study, and written in its report, while its page is still open.

    The report comes at once; what takes longer than people wait is added to it.
    """

    work: Calibration
    result: Reported | None = None  # what the report is about
    said: Sequence[str] = ()
    whole: bool = False  # whether that is all

    def follow(self, ctrl_c: Interruption) -> Path | None:
        """Write what is not written yet; return the folder of the report, None while there is none."""
        work, result = self.work, self.work.result
        if self.result not in (None, result):
            self.result = None  # the report is of the result before
            ctrl_c.on_press = lambda: _say_stopping(work)
            return None
        if result.over and self.result is None:
            self.whole = work.interview.known.wait_for_findings(SAID_SOON)
            record = work.write()
            if not work.options.json:
                work.tell(record)
            work.say("The study is finished. The command ends when you close its page, or with Ctrl-C.")
            self.said = () if record.outlook is None else record.outlook.lines
            self.result = result
            ctrl_c.on_press = lambda: _say_stopping(work, "Closing ...")
        elif result.over:
            self._add()
        return work.claim.folder if result.over else None

    def end(self) -> None:
        """Write and print the result, unless it is of a finished study, about which all is said."""
        if self.work.options.json or self.result != self.work.result:
            self.work.tell(self.work.write())
        else:
            self._add()

    def _add(self) -> None:
        if self.whole or not self.work.interview.known.is_told:
            return
        self.whole, record = True, self.work.write()
        if not self.work.options.json:
            show_outlook(record, Console(emoji=False), self.said)


def _in_terminal(work: Calibration, ctrl_c: Interruption) -> None:
    """Ask in the terminal until the person stops."""
    # With --json, standard output belongs to the result.
    console = work.messages if work.options.json else Console(emoji=False)
    with Background(work.interview), suppress(KeyboardInterrupt), ctrl_c.allowed():
        converse(work.interview, console)
        work.wait_for_findings()
    work.tell(work.write())


def _unattended(work: Calibration, ctrl_c: Interruption) -> int:
    """Let a synthetic calibrator answer as fast as the experiments run; return the exit code."""
    failure, known = None, work.interview.known
    try:
        with ctrl_c.allowed():
            _answer_all(work, ctrl_c)
    except (KeyboardInterrupt, Exception) as error:
        # Keep the results so far after any error of a rig. Compiled code can turn a
        # KeyboardInterrupt into another error, so check whether Ctrl-C was pressed.
        if not (ctrl_c.pressed or isinstance(error, KeyboardInterrupt)):
            failure = error
        else:
            work.say(f"Interrupted after {known.counts.experiments} of {known.n_max} experiments.")
    # Do not run the references on a rig that has just failed.
    record = work.write(failed=failure is not None)
    work.tell(record)
    if isinstance(failure, RunError) and failure.trace:
        work.say(failure.trace)
    if isinstance(failure, RunError | SimulationError):
        work.say(f"prefcal: {failure}")
        return RUN_FAILED
    if failure is not None:
        raise failure
    if ctrl_c.pressed and not record.partial:
        work.say("Interrupted after the study was finished: the report is complete.")
    return INTERRUPTED if ctrl_c.pressed else 0


def _answer_all(work: Calibration, ctrl_c: Interruption) -> None:
    """Run and compare all experiments, showing a progress bar."""
    interview = work.interview
    calibrator = make_calibrator(work.options, interview.scenario)
    with _Display(work) as display:
        display.compared(len(interview.past.comparisons()))
        interview.simulating = display.simulating
        interview.prepare(display.compiling)
        ctrl_c.check()  # a press while something is compiled is swallowed there, and simulations take long
        for _ in unattended(interview, calibrator, display.running, work.say):
            display.compared()
            ctrl_c.check()
    if trouble := getattr(interview.scenario.cost, "trouble", None):  # no θ has a cost
        raise trouble


class _Display(Progress):
    """Progress bar with the current θ, the best θ and the verdicts so far, used with `with`."""

    def __init__(self, work: Calibration) -> None:
        self._interview = work.interview
        self._rows = {"θ now": "none yet", "best θ": "none yet", "verdicts": ""}
        self._tenths, self._is_still = Tenths(), not work.messages.is_terminal
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
        rows, now = dict(self._rows), self._interview.now()
        if now.incumbent is not None:  # read anew, since the end of a robust study can choose another one
            theta = np.array(now.state.history.samples[now.incumbent].theta)
            best = theta_text(self._interview.scenario.space, theta)
            rows["best θ"] = f"{best} (experiment {now.incumbent + 1})"
        if (simulated := self._interview.known.simulated) is not None:
            rows["unseen"] = simulated.going_on or simulated.line
            rows |= {"failed": simulated.failure} if simulated.failure else {}
        elif (running := now.running) > 1:
            rows["at once"] = f"{running} experiments are running"
        for name, text in rows.items():
            style = "bold blue" if name == "best θ" else ""
            yield Text.assemble((f"{name:<9} ", "dim"), (printable(text), style))

    def compiling(self, part: Compiling) -> None:
        """Show what is being compiled; without a live display, print it once."""
        if self._is_still and self._rows["θ now"] == "none yet":
            say(self.console, part.words)
        self._rows["θ now"] = part.words

    def simulating(self) -> None:
        """Say how far the runs of a robust study are if there is no live display, where they take long."""
        found = self._interview.known.simulated
        if found is not None and found.pace and self._tenths.passed(*found.varied) and self._is_still:
            say(self.console, found.going_on)

    def running(self, theta: Float[np.ndarray, " n"]) -> None:
        """Show the θ that is running."""
        self._rows["θ now"] = theta_text(self._interview.scenario.space, theta)

    def compared(self, count: int = 1) -> None:
        """Count experiments; show the verdicts."""
        self.advance(self._bar, count)
        verdicts = self._interview.known.counts.verdicts
        self._rows["verdicts"] = " · ".join(f"{VERDICTS[v]} {n}" for v, n in verdicts.items())
