"""The command line `prefcal`. Starts fast: agents, plants and plots are loaded when needed."""

import sys
from typing import Annotated

import typer

from prefcal_scenarios.cli.bench import EPILOG as BENCH_EPILOG
from prefcal_scenarios.cli.bench import bench
from prefcal_scenarios.cli.calibrate import EPILOG, calibrate
from prefcal_scenarios.cli.check import EPILOG as CHECK_EPILOG
from prefcal_scenarios.cli.check import check
from prefcal_scenarios.cli.errors import complain, wrong_call
from prefcal_scenarios.cli.processor import app as processor
from prefcal_scenarios.cli.reproduce import EPILOG as REPRODUCE_EPILOG
from prefcal_scenarios.cli.reproduce import reproduce
from prefcal_scenarios.cli.study_commands import REPORT_EPILOG, report
from prefcal_scenarios.cli.study_commands import app as studies

app = typer.Typer(
    name="prefcal",
    help="Tune a controller by comparing experiments: you say which one went better.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)
app.command(epilog=EPILOG)(calibrate)
app.command(no_args_is_help=True, epilog=CHECK_EPILOG)(check)
app.command(epilog=REPORT_EPILOG)(report)
app.command(epilog=BENCH_EPILOG)(bench)
app.command(no_args_is_help=True, epilog=REPRODUCE_EPILOG)(reproduce)
app.add_typer(studies)
app.add_typer(processor)


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
def scenarios(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="One to describe: task, knobs and KPIs."),
    ] = None,
) -> None:
    """List the scenarios that `prefcal calibrate` knows by name, or describe one."""
    from prefcal_scenarios.scenario import BUILT_IN, load

    if name is not None:
        from rich.console import Console

        from prefcal_scenarios.terminal.briefing import show_scenario

        show_scenario(load(name), Console())
        return
    width = max(map(len, BUILT_IN)) + 2
    for known in BUILT_IN:
        scenario = load(known)
        typer.echo(f"{known:<{width}}{scenario.title}; knobs {', '.join(scenario.space.names)}")
    typer.echo("Your own: path/to/own.py:name, where name is a prefcal_scenarios.Scenario.")


def main() -> None:
    """Run the command line; a caller's mistake becomes one line and exit code 2."""
    try:
        code = app(standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        complain("interrupted")
        sys.exit(130)
    except Exception as error:
        # Here, not above: --help must not wait for it.
        from prefcal_env.errors import PrefcalError

        wrong = (str(error), 2) if isinstance(error, PrefcalError) else wrong_call(error)
        if wrong is None:
            raise
        if wrong[0]:
            complain(wrong[0])
        sys.exit(wrong[1])
    sys.exit(code if isinstance(code, int) else 0)
