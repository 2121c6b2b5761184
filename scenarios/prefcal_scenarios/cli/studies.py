"""`prefcal studies`: list, show, export, import, verify, change study files, what they teach."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    name="studies",
    help="List, show, export, import and verify studies; write what was learned as a function.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)

_Name = Annotated[str, typer.Argument(metavar="STUDY", help="A name, or the path of a file.")]
_Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on stdout.")]


class Format(Enum):
    """How a study is exported."""

    JSON = "json"
    CSV = "csv"


@app.command("list")
def list_(json: _Json = False) -> None:
    """List the studies in your data folder."""
    from prefcal_scenarios.cli.shelf import print_list

    print_list(json=json)


@app.command()
def show(study: _Name, json: _Json = False) -> None:
    """Show what a study calibrates, every answer, and how far it is."""
    from prefcal_scenarios.cli.shelf import print_study

    print_study(study, json=json)


@app.command()
def export(
    study: _Name,
    format: Annotated[
        Format,
        typer.Option(
            help="json: one file that `import` reads back; csv: a folder of tables, curves too."
        ),
    ] = Format.JSON,
    out: Annotated[
        Path | None,
        typer.Option(help="File (json) or folder (csv).", show_default="STUDY.json or ./STUDY"),
    ] = None,
) -> None:
    """Write a study as JSON or CSV."""
    from prefcal_scenarios.cli.shelf import export_study

    typer.echo(f"Written: {export_study(study, format.value, out)}")


@app.command()
def index(
    study: _Name,
    out: Annotated[
        Path | None, typer.Option(help="The Python file.", show_default="STUDY_index.py")
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            help="Your own scenario, own.py:name: a study file never makes us run a program.",
            show_default="the built-in one that the study names",
        ),
    ] = None,
) -> None:
    """Write what the answers say that counts as a Python function, `cost(experiment)`.

    With it an agent runs unattended:
    prefcal calibrate SCENARIO --agent glis --cost STUDY_index.py:cost
    """
    from prefcal_scenarios.cli.indexing import export_index

    file, minded = export_index(study, scenario, out)
    typer.echo(minded.sentence())
    typer.echo(minded.trust)
    typer.echo(f"Written: {file}")


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="JSON that `export` has written.")],
    study: Annotated[
        str | None,
        typer.Option(
            metavar="NAME_OR_PATH", help="What to call it.", show_default="the file's name"
        ),
    ] = None,
) -> None:
    """Make a study of an exported file. It is only data: nothing in it is executed."""
    from prefcal_scenarios.cli.shelf import import_study

    typer.echo(f"Imported: {import_study(file, study)}")


@app.command()
def verify(study: _Name) -> None:
    """Check that no event of a study was changed, moved or removed; exit code 1 if one was."""
    from prefcal_scenarios.cli.shelf import findings_of

    count, findings = findings_of(study)
    for finding in findings:
        typer.echo(finding)
    if findings:
        raise typer.Exit(1)
    typer.echo(f"Sound: {count} events, each as it was written.")


_Texts = list[str] | None


@app.command()
def respace(
    study: _Name,
    knob: Annotated[
        _Texts,
        typer.Option(metavar="KNOB=LOW:HIGH", help="Search this range: narrower, or wider."),
    ] = None,
    freeze: Annotated[
        _Texts, typer.Option(metavar="KNOB=VALUE", help="Keep a knob at this value.")
    ] = None,
    add: Annotated[
        _Texts,
        typer.Option(
            metavar="KNOB=VALUE",
            help="A knob that the scenario has now, and its value in the experiments so far.",
        ),
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            help="Where the scenario is, own.py:name: it is a program.",
            show_default="the built-in one that the study names",
        ),
    ] = None,
) -> None:
    """Change the knobs of a running study; every experiment and answer stays.

    Close its page first. Experiments outside of a narrowed range still teach; only
    proposals keep to it. Each option may be given several times.
    """
    from prefcal_scenarios.cli.respacing import Changes, in_words
    from prefcal_scenarios.cli.respacing import respace as respace_study

    space = respace_study(study, scenario, Changes(knob or (), freeze or (), add or ()))
    for name, words in in_words(space).items():
        typer.echo(f"{name}: {words}")
