"""The program `prefcal` with all its commands.

The topmost package puts them together, so the application knows nothing of the benchmark.
"""

from prefcal_app.cli import app as app
from prefcal_app.cli import main as main

from .command import app as bench
from .reproduce import EPILOG, reproduce

app.command(no_args_is_help=True, epilog=EPILOG)(reproduce)
app.add_typer(bench)
