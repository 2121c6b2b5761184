"""Show the history and the state of a study in a terminal."""

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_app.session import Interview
from prefcal_app.session.kpi_index import trust_text
from prefcal_app.view.history import history_view
from prefcal_app.view.status import in_words
from prefcal_scenarios.presentation.wording import printable, theta_text


def show_history(interview: Interview, console: Console) -> None:
    """Print every answer."""
    answers = history_view(interview)["answers"]
    if not answers:
        console.print("No answers yet.")
        return
    table = Table(title="History", title_justify="left")
    for heading in ("", "experiment", "against", "verdict", "marks", "comment"):
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
    """Print the best so far, the progress, and how consistent the answers are."""
    now = interview.now()
    counts = interview.counts
    plural = "" if counts.comparisons == 1 else "s"
    lines = [
        f"{counts.experiments} of {interview.n_max} experiments, "
        f"{counts.comparisons} comparison{plural}"
    ]
    if now.simulated is not None:
        lines.append(now.simulated.line)
    if now.incumbent is not None:
        best = theta_text(interview.scenario.space, interview.experiment(now.incumbent).theta)
        lines.append(f"best so far, experiment {now.incumbent + 1}: {best}")
    lines.append(in_words(interview.consistency))
    if (outlook := interview.outlook) is not None:
        lines += outlook.lines
    if (index := interview.index) is not None:
        lines.append(trust_text(index))
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)
