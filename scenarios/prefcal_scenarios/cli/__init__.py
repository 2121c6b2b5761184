"""The command line `prefcal`. Starts fast: agents, plants and plots are loaded when needed."""

import sys
from typing import Annotated

import typer

from prefcal_scenarios.cli.bench import EPILOG as BENCH_EPILOG
from prefcal_scenarios.cli.bench import bench
from prefcal_scenarios.cli.calibrate import EPILOG, calibrate
from prefcal_scenarios.cli.report import report
from prefcal_scenarios.cli.studies import app as studies

app = typer.Typer(
    name="prefcal",
    help="Tune a controller by comparing experiments: you say which one went better.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command(no_args_is_help=True, epilog=EPILOG)(calibrate)
app.command(no_args_is_help=True)(report)
app.command(epilog=BENCH_EPILOG)(bench)
app.add_typer(studies)


def _version(asked: bool) -> None:
    if asked:
        from prefcal_scenarios.export import versions

        typer.echo(f"prefcal {versions()['prefcal']}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Tune a controller by comparing experiments: you say which one went better."""


@app.command()
def scenarios() -> None:
    """List the scenarios that `prefcal calibrate` knows by name."""
    from prefcal_scenarios.scenario import BUILT_IN, load

    width = max(map(len, BUILT_IN)) + 2
    for name in BUILT_IN:
        scenario = load(name)
        typer.echo(f"{name:<{width}}{scenario.title}; knobs {', '.join(scenario.space.names)}")
    typer.echo("Your own: path/to/own.py:name, where name is a prefcal_scenarios.Scenario.")


def main() -> None:
    """Run the command line; our own errors become one line and exit code 2."""
    try:
        app()
    except KeyboardInterrupt:
        print("prefcal: interrupted", file=sys.stderr)
        sys.exit(130)
    except Exception as error:
        # Here, not above: --help must not wait for it.
        from prefcal_env.errors import PrefcalError

        if not isinstance(error, PrefcalError):
            raise
        print(f"prefcal: {error}", file=sys.stderr)
        sys.exit(2)
