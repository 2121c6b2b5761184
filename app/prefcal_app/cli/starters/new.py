"""`prefcal new`: write a commented starter for a scenario of one's own."""

import re
import shlex
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from prefcal_app.cli.parameters import examples, examples_of_worlds, worlds


@dataclass(frozen=True, slots=True)
class Starter:
    """One kind of starter."""

    about: str  # what it is for, in a few words
    # Name of the file in the folder `starters`, or, of an optional world, of its folder and file
    template: str
    # Name of the scenario on the command line, with FILE for the path; an option may follow
    source: tuple[str, ...] = ("FILE:scenario",)
    first: str = ""  # what must be there before the starter runs; empty if it runs as it is

    @property
    def suffix(self) -> str:
        """Return the suffix of the file, .py or .toml."""
        return Path(self.template.removesuffix(".txt")).suffix

    def text(self, path: Path) -> str:
        """Return the starter for the file at `path`, whose scenario is called as the file is."""
        folder = "prefcal_env.worlds" if "/" in self.template else "prefcal_app.cli.starters"
        template = files(folder) / self.template
        name = re.sub(r"[^\w-]+", "-", path.stem)
        return template.read_text(encoding="utf-8").replace("NAME", name)

    def command(self, verb: str, path: Path) -> str:
        """Return the command line that runs `verb` (check or calibrate) on the file at `path`."""
        words = (word.replace("FILE", str(path)) for word in self.source)
        return shlex.join(["prefcal", verb, *words])


KINDS = {
    "function": Starter("any function of θ that returns curves", "function.py.txt"),
    "pid": Starter("a plant; its PID is tuned", "pid.py.txt", ("pid", "--plant", "FILE:plant")),
    "controller": Starter("a plant and a controller of your own", "controller.py.txt"),
    "mpc": Starter("a plant and the MPC of prefcal", "mpc.py.txt"),
    "rig": Starter("a plant that only you can run", "rig.toml", ("FILE",)),
    **{
        world["key"]: Starter(world["about"], f"{world['name']}/starter.toml", ("FILE",), world["starter"])
        for world in worlds()
        if "starter" in world
    },
}
"""Kinds by name, in the order of the help."""
EPILOG = examples(
    ("new controller tank.py", "A tank and its PI controller, to replace by your own."),
    *examples_of_worlds("new"),
    more="\n\n".join(
        ["[bold]Kinds[/bold]", *(f"[cyan]{name:<11}[/cyan]{kind.about}" for name, kind in KINDS.items())]
    ),
)


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
    from prefcal_env.wording import did_you_mean

    if kind not in KINDS:
        hint = did_you_mean(kind, KINDS)
        raise SettingsError(f"a starter must be one of {', '.join(KINDS)}, got {kind!r}.{hint}".rstrip("."))
    found = KINDS[kind]
    path = Path(f"{kind}{found.suffix}") if file is None else file
    if path.suffix != found.suffix:
        raise SettingsError(
            f"the starter {kind!r} is a {found.suffix} file: expected a name like "
            f"{path.stem or kind}{found.suffix}, got {str(path)!r}"
        )
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
