"""Declare the commands `prefcal studies ...`."""

from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Exit, Option, Typer, echo

from prefcal_app.cli.options import RespaceOptions
from prefcal_app.cli.parameters import examples, takes

app = Typer(
    name="studies",
    help="List, show, rename, remove, export, import, verify and change studies.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

Study = Annotated[str, Argument(metavar="STUDY", help="A name, or the path of a file.")]
Json = Annotated[bool, Option("--json", metavar="", help="Print only JSON on standard output.")]


def _command(*shown: tuple[str, str], name: str | None = None) -> Callable[..., Any]:
    """Return a decorator that makes a function a command of `prefcal studies`, with examples."""
    epilog = examples(*((f"studies {line}", words) for line, words in shown))
    return app.command(name, epilog=epilog)


class Format(StrEnum):
    """Format of an exported study."""

    JSON = "json"
    CSV = "csv"
    PARQUET = "parquet"


@_command(
    ("list", "All studies in your data folder."),
    ("list --json", "The same for programs, with the file of each study."),
    name="list",
)
def list_(json: Json = False) -> None:
    """List the studies in your data folder."""
    from .files import print_list

    print_list(json=json)


@_command(
    ("show mine", "The best θ so far, and every answer."),
    ("show ./shared.prefcal --json", "A study file from anywhere, for programs."),
)
def show(study: Study, json: Json = False) -> None:
    """Show one study: its progress, its best θ and every answer."""
    from .files import print_study

    print_study(study, json=json)


@_command(
    ("rename cstr-1 mine", "Call the study cstr-1 mine."),
    ("rename mine ./mine.prefcal", "Move it out of the data folder, into this one."),
)
def rename(
    old: Annotated[str, Argument(metavar="OLD", help="A name, or the path of a file.")],
    new: Annotated[str, Argument(metavar="NEW", help="A name or a path that does not exist yet.")],
) -> None:
    """Rename a study. Existing reports keep their folders."""
    from .files import rename as rename_study

    echo(f"Renamed: {rename_study(old, new)}")


@_command(
    ("rm cstr-1", "Remove the study cstr-1, after you confirm."),
    ("rm cstr-1 cstr-2 --yes", "Remove two without a question, in a script."),
)
def rm(
    study: Annotated[list[str], Argument(metavar="STUDY", help="Names, or paths of files.")],
    yes: Annotated[bool, Option("--yes", "-y", metavar="", help="Remove without asking.")] = False,
) -> None:
    """Remove studies for good. Existing reports stay."""
    from .files import remove

    raise Exit(remove(study, yes=yes))


@_command(
    ("export mine", "Write mine.json, one file to pass on."),
    ("export mine --format csv --out tables", "Tables and curves for a spreadsheet."),
    ("export mine --format parquet --out tables", "The same for pandas, polars or DuckDB."),
)
def export(
    study: Study,
    format: Annotated[
        Format,
        Option(
            help="json: one file that `import` reads back; csv, parquet: a folder of tables and "
            "curves, with a dictionary of their columns."
        ),
    ] = Format.JSON,
    out: Annotated[
        Path | None,
        Option(
            metavar="PATH", help="File (json) or folder (csv, parquet).", show_default="STUDY.json or ./STUDY"
        ),
    ] = None,
) -> None:
    """Write a study as JSON, CSV or Parquet."""
    from .files import export_study

    echo(f"Written: {export_study(study, format.value, out)}")


@_command(("import mine.json --study second", "Make a study called second from an export."), name="import")
def import_(
    file: Annotated[Path, Argument(metavar="FILE", help="JSON that `export` has written.")],
    study: Annotated[
        str | None,
        Option(metavar="NAME_OR_PATH", help="Name or path of the new study.", show_default="the file's name"),
    ] = None,
) -> None:
    """Make a study from an exported file. It is only data: nothing in it is executed."""
    from .files import import_study

    echo(f"Imported: {import_study(file, study)}")


@_command(("verify mine", "Check the whole file, for example after a copy."))
def verify(study: Study) -> None:
    """Check a study file and everything in it for damage; the exit code is 1 if any is found."""
    from .files import findings_of

    count, findings = findings_of(study)
    for finding in findings:
        echo(finding)
    if findings:
        raise Exit(1)
    echo(f"Sound: {count} events.")


@_command(
    ("respace mine --knob T_s=0.1:0.5", "Search T_s from 0.1 to 0.5 from now on."),
    ("respace mine --freeze N_p=26", "Keep N_p at 26."),
)
@takes(RespaceOptions)
def respace(typed: dict[str, Any]) -> None:
    """Change the knobs of a running study; every experiment and answer stays.

    Close its page first. Experiments outside a narrowed range still count for
    learning; only new proposals stay inside. Each option can be repeated.
    """
    from .files import respaced_in_words

    for line in respaced_in_words(typed):
        echo(line)
