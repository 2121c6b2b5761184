"""`prefcal new`: write a commented starter for a scenario of one's own."""

from pathlib import Path
from typing import Annotated

import typer

from .kinds import KINDS, kind_of, path_for

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal new controller tank.py[/cyan]
  A tank and its PI controller, to replace by your own.

[cyan]prefcal new fmu[/cyan]
  fmu.toml: an FMU, its knobs and references.

[bold]Kinds[/bold]

""" + "\n\n".join(f"[cyan]{name:<11}[/cyan]{kind.about}" for name, kind in KINDS.items())


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help=f"One of {', '.join(KINDS)}.")],
    file: Annotated[
        Path | None,
        typer.Argument(metavar="[FILE]", help="File to write.", show_default="KIND.py, KIND.toml"),
    ] = None,
) -> None:
    """Write a commented starter for a scenario of your own.

    It is complete: check it, calibrate it, then replace its parts by yours.
    """
    # Imported here to keep --help fast.
    from prefcal_env.errors import SettingsError

    found = kind_of(kind)
    path = path_for(kind, found, file)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as target:
            target.write(found.text(path))
    except FileExistsError as error:
        raise SettingsError(f"{str(path)!r} exists: give another name") from error
    except OSError as error:
        raise SettingsError(f"cannot write {str(path)!r}: {error.strerror}") from error
    typer.echo(f"Wrote {path}: {found.about}. {found.first}".rstrip())
    typer.echo(f"Check it:  {found.command('check', path)}")
    typer.echo(f"Tune it:   {found.command('calibrate', path)}")
