"""One run of the command on an open study: what it works on, and where its words go."""

import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import StudyError
from prefcal_scenarios.cli.opening import Opened
from prefcal_scenarios.cli.outcome import as_json, show
from prefcal_scenarios.cli.recording import record_of, references
from prefcal_scenarios.interview import Interview
from prefcal_scenarios.report.record import Record


@dataclass(frozen=True, slots=True)
class Sitting:
    """A study being worked on.

    Args:
        interview: The agent and the study file.
        opened: How it was opened.
        folder: Of the report.
        messages: Where people read, standard error.
        json: Whether standard output is for a program.
    """

    interview: Interview
    opened: Opened
    folder: Path
    messages: Console
    json: bool

    def write(self, *, rig_works: bool = True) -> Record:
        """Write the report of the study as it stands.

        Raises:
            StudyError: it cannot be written, the disk is full say.
        """
        # Here, not above: plots take half a second to load, and a refused option must not wait.
        from prefcal_scenarios.report.write import write_report

        options, scenario = self.opened.options, self.interview.scenario
        shown = references(scenario, options.seed, self.messages) if rig_works else {}
        record = record_of(self.interview, options, shown)
        pictures = () if scenario.pictures is None else scenario.pictures()
        try:
            write_report(record, self.folder, pictures)
        except OSError as error:
            raise StudyError(
                f"cannot write the report into {self.folder}: {error.strerror or error}. "
                "The study itself has lost nothing"
            ) from error
        return record

    def tell(self, record: Record) -> None:
        """Print the result."""
        options, report = self.opened.options, self.folder / "report.html"
        if self.json:
            print(as_json(record, options, report, self.opened.name), flush=True)
        else:
            show(record, report, Console())
            if options.by_a_person:
                Console().print(f"Repeat it: {options.command()}", soft_wrap=True, markup=False)
        if record.stopped and not record.good_enough:
            self.say(
                f"This is a partial report: {len(record.trials)} of {record.n_max} experiments."
            )

    @property
    def again(self) -> str:
        """The command that takes the study up again."""
        options, name = self.opened.options, self.opened.name or ""
        cost = [] if options.cost is None else ["--cost", options.cost]
        return shlex.join(["prefcal", "calibrate", options.scenario, "--study", name, *cost])

    def say(self, text: str) -> None:
        """One line for people."""
        self.messages.print(text, soft_wrap=True, highlight=False, markup=False)
