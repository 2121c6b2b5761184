"""History and state of a study in a terminal."""

from collections.abc import Iterator

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_scenarios.interview import Interview
from prefcal_scenarios.report.minded import Minded
from prefcal_scenarios.report.wording import printable, theta_text
from prefcal_scenarios.window.view.history import history_view
from prefcal_scenarios.window.view.status import in_words

_WIDTH = 24
"""Characters of the longest bar."""


def show_history(interview: Interview, console: Console) -> None:
    """Every answer."""
    answers = history_view(interview)["answers"]
    if not answers:
        console.print("No answers yet.")
        return
    table = Table(title="History", title_justify="left")
    for heading in ("", "new", "best", "verdict", "marks", "comment"):
        table.add_column(heading, overflow="fold")
    for answer in answers:
        said = "retracted" if answer["retracted"] else "again" if answer["repeated"] else ""
        number = f"+{-answer['answer']}" if answer["further"] else str(answer["answer"])
        table.add_row(
            number, str(answer["challenger"]), str(answer["incumbent"]),
            answer["text"] + (f" ({said})" if said else ""), escape(", ".join(answer["marks"])),
            escape(printable(answer["comment"])),
        )  # fmt: skip
    console.print(table)


def show_status(interview: Interview, console: Console) -> None:
    """The best so far, how far it is, and how consistent the answers are."""
    now = interview.now()
    done = len(now.state.finished)
    answers = max(len(now.state.closed) - 1, 0) + len(now.state.further)
    plural = "" if answers == 1 else "s"
    lines = [f"{done} of {now.state.n_max} experiments, {answers} answer{plural}"]
    if now.incumbent is not None:
        best = theta_text(interview.scenario.space, interview.experiment(now.incumbent).theta)
        lines.append(f"best so far, experiment {now.incumbent + 1}: {best}")
    lines.append(in_words(interview.consistency))
    if (advice := interview.advice) is not None:
        lines.append(advice.text)
    minded = Minded.of(interview.index, interview.scenario)
    if minded is not None:
        lines += [minded.sentence(), *_bars(minded), minded.trust]
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)


def _bars(minded: Minded) -> Iterator[str]:
    """A line for each share: its bar, number and title."""
    for bar in minded.bars:
        drawn = ("░" if bar.rest else "█") * max(round(_WIDTH * bar.width), 1)
        yield f"  {drawn:<{_WIDTH}} {bar.text:>5}  {bar.title}"
