"""An open study with all that works on it: its interview, its simulator and its report."""

import shlex
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from rich.console import Console

from prefcal_app.report.export import versions
from prefcal_app.report.ownership import Owner, Ownership, claim_default, claim_given
from prefcal_app.report.record import StudyRecord
from prefcal_app.session import Interview, Phase
from prefcal_app.session.study.memory import as_studied, is_simulating
from prefcal_app.simulating import Kept, Simulator, key_of, twin_of
from prefcal_app.terminal.showing import say
from prefcal_env.errors import StudyError
from prefcal_env.study import study_path, to_text
from prefcal_env.study.locations import simulated_beside
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.options import words_to_resume
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.names import is_own
from prefcal_scenarios.scenario import Scenario

from .choices import with_cost
from .opening import IN_MEMORY, Opened, by_now, worth_keeping
from .options import Options
from .report import as_json, record_of, references, show
from .studies.files import existing, open_described
from .studies.sources import completed

_KNOWN = 2.0
"""Longest wait, in seconds, for what a screening agent expects of its simulations in the end."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """An open study at work; its report can be written again and again while it runs.

    Args:
        opened: Study.
        interview: Interview, which holds the agent and the study file.
        claim: Claim on the folder of the report.
        messages: Console for messages, standard error.
    """

    opened: Opened
    interview: Interview
    claim: Ownership
    messages: Console

    @property
    def options(self) -> Options:
        """Return the options of the study."""
        return self.opened.options

    @property
    def over(self) -> bool:
        """Return whether the study is over."""
        return self.interview.now().phase is Phase.OVER

    @property
    def again(self) -> str:
        """Return the command that resumes the study."""
        options = self.options
        words = ["prefcal", "calibrate", *words_to_resume(options.scenario)]
        words += ["--study", self.opened.name or ""]
        words += [] if options.cost is None else ["--cost", options.cost]
        if options.twin is not None and is_own(options.twin):
            words += ["--twin", options.twin]
        return shlex.join(words)

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
        file = self.opened.file
        if not file.state.history.answered:
            return False
        if not self.options.by_a_person or self.opened.resumed:
            return True
        return worth_keeping(file, self.interview.scenario)

    def say(self, text: str) -> None:
        """Print one line for the user, whatever is in it."""
        say(self.messages, text)

    def write(self, *, failed: bool = False) -> StudyRecord:
        """Write the report of the study as it stands, if there is anything to report.

        Args:
            failed: Whether the scenario has just failed: no references run, and nothing more is
                said about its cost.

        Raises:
            StudyError: If it cannot be written, for example because the disk is full.
        """
        options, scenario, wanted = self.options, self.interview.scenario, self.reportable
        self.interview.known.wait_for_screened(_KNOWN)
        self.interview.known.foresight(learn=True)
        shown = {} if failed or not wanted else references(scenario, options.seed, self.say)
        record, trouble = record_of(self.interview, options, shown, self.opened.name).costed()
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
            found = as_json(record, options, report, self.opened.name, self._simulated)
            print(found, flush=True)
        elif report is None:
            self.say("Nothing to report: no experiment was compared.")
        else:
            # ":100:" in the range of a knob is no emoji
            console = Console(emoji=False)
            show(record, report, console)
            if not options.by_a_person:  # no program can repeat a person's answers
                console.print(f"Repeat it: {options.command()}", soft_wrap=True, markup=False)
        if report is not None and record.partial:
            self.say(f"This is a partial report: {len(record.trials)} of {record.n_max} experiments.")

    @property
    def _simulated(self) -> int | None:
        """Return how many θ were simulated unseen; None if this is not known any more."""
        if not is_simulating(self.interview.file.state):
            return 0
        found = self.interview.known.simulated
        return None if found is None or not found.simulated else found.simulated


@contextmanager
def calibration(
    opened: Opened, scenario: Scenario, messages: Console, *, asks: bool = True, keep: bool = True
) -> Iterator[Calibration]:
    """Claim the folder of the report, and get a study to work.

    Args:
        opened: Study.
        scenario: Scenario of the study.
        messages: Console for messages.
        asks: Whether experiments may run, and events be written.
        keep: Whether to keep what is simulated beside the study: only if its options name all code.

    Raises:
        SettingsError: If the folder holds another study's report or cannot be written to.
    """
    options, claim = opened.options, _claim(opened, scenario.name)
    with ExitStack() as stack:
        stack.callback(claim.release)
        simulator = _simulator(stack, opened, scenario, keep) if asks else None
        interview = Interview(
            scenario,
            opened.file,
            ahead=asks and options.by_a_person,
            asks=asks,
            simulator=simulator,
            at_once=options.at_once,
        )
        yield Calibration(opened, interview, claim, messages)


def _simulator(stack: ExitStack, opened: Opened, scenario: Scenario, keep: bool) -> Simulator | None:
    """Return what the study's agent simulates with, for the knobs of the study; None if nothing."""
    state, options = opened.file.state, opened.options
    if not is_simulating(state):
        return None
    studied, limit = as_studied(scenario, state), options.run_timeout
    if options.twin is not None:
        isolated = stack.enter_context(isolation(options.twin, limit))
        studied = twin_of(studied, isolated(load(options.twin)))
    kept = None
    if keep and opened.name is not None:
        source = options.scenario if options.twin is None else options.twin
        key = key_of(studied, source, state.configuration, versions())
        kept = Kept(simulated_beside(Path(opened.file.path)), key)
    simulator = Simulator(studied, seed=options.seed, longest=limit, kept=kept, robust=options.robust)
    stack.enter_context(simulator).start()
    return simulator


def _claim(opened: Opened, scenario: str) -> Ownership:
    """Claim the folder of the report: the requested one, or a free default one."""
    options, name = opened.options, opened.name
    owner = Owner(_identity(opened), name, options.scenario)
    if options.out is not None:
        return claim_given(options.out, owner)
    return claim_default(default_folder(opened, scenario), owner)


def default_folder(opened: Opened, scenario: str) -> Path:
    """Return the default folder of the report: prefcal-STUDY.

    For a study in memory, the scenario and the seed stand in for the name.
    """
    if opened.name is None:
        return Path(f"prefcal-{scenario}-{opened.options.seed}")
    return Path(f"prefcal-{study_path(opened.name).stem}")


def _identity(opened: Opened) -> str:
    """Return a text that is equal for two studies only if they are the same study.

    A file is identified by its configuration and its start time, so a copy is the same study. A
    study in memory is identified by its configuration alone, since the same command reproduces it
    bit for bit.
    """
    first = next(iter(opened.file.events()))
    at = "" if opened.file.path == IN_MEMORY else first.at
    return sha256(f"{at}\n{to_text(first.event)}".encode()).hexdigest()[:16]


def report_of(given: Mapping[str, Any]) -> None:
    """Write the report of a study.

    Args:
        given: Values of the options of `prefcal report`, None for those that were not typed.

    Raises:
        StudyError: If there is no such study, or its scenario must be given.
        SettingsError: If its cost is a program and must be given.
    """
    given = completed(given)
    name, source, cost = given["study"], given["scenario"], given["cost"]
    with open_described(existing(name)) as file, isolation(source, early=False) as isolated:
        scenario = isolated(with_cost(load(source), cost))
        stored = by_now(file.state)
        if cost is not None and stored.get("cost") is not None:
            stored["cost"] = cost  # the file may have moved
        # A report simulates nothing, so its twin is taken as it is.
        options = Options.resumed(stored, {**given, "twin": stored.get("twin")})
        if not file.state.history.answered:
            raise StudyError(f"study {name!r} has no completed experiment yet: nothing to report")
        # A page may have the study open: writing an event here would make its next answer fail.
        opened, messages = Opened(file, options, name, resumed=True), Console(stderr=True, emoji=False)
        with calibration(opened, scenario, messages, asks=False) as work:
            work.tell(work.write())
