"""The kinds of starters: what each is for, the file it is written to, and what to do next."""

import re
import shlex
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of starter.

    Args:
        about: What it is for, in a few words.
        template: Name of the file in the folder `templates`.
        source: Name of the scenario on the command line, with FILE for the path; an option may
            follow.
        first: What must be there before the starter runs; empty if it runs as it is.
    """

    about: str
    template: str
    source: tuple[str, ...]
    first: str = ""

    @property
    def suffix(self) -> str:
        """Return the suffix of the file, .py or .toml."""
        return Path(self.template.removesuffix(".txt")).suffix

    def text(self, path: Path) -> str:
        """Return the starter for the file at `path`, whose scenario is called as the file is."""
        folder = files("prefcal_app.cli.starters") / "templates"
        name = re.sub(r"[^\w-]+", "-", path.stem)
        return (folder / self.template).read_text(encoding="utf-8").replace("NAME", name)

    def command(self, verb: str, path: Path) -> str:
        """Return the command line that runs `verb` (check or calibrate) on the file at `path`."""
        words = (word.replace("FILE", str(path)) for word in self.source)
        return shlex.join(["prefcal", verb, *words])


_OWN = ("FILE:scenario",)
KINDS = {
    "function": Kind("any function of θ that returns curves", "function.py.txt", _OWN),
    "pid": Kind("a plant; its PID is tuned", "pid.py.txt", ("pid", "--plant", "FILE:plant")),
    "controller": Kind("a plant and a controller of your own", "controller.py.txt", _OWN),
    "mpc": Kind("a plant and the MPC of prefcal", "mpc.py.txt", _OWN),
    "fmu": Kind(
        "a closed loop in an FMU", "fmu.toml", ("FILE",),
        "Put the path of your FMU and the names of its parameters into it.",
    ),
    "rig": Kind("a plant that only you can run", "rig.toml", ("FILE",)),
    "opcua": Kind(
        "a live plant behind OPC UA", "opcua.toml", ("FILE",),
        "Put the address of your server and its nodes into it.",
    ),
}  # fmt: skip
"""Kinds by name, in the order of the help."""


def kind_of(name: str) -> Kind:
    """Return the kind called `name`. Raises SettingsError if there is none."""
    # Imported here to keep --help fast.
    from prefcal_env.errors import SettingsError
    from prefcal_env.wording import did_you_mean

    if name not in KINDS:
        raise SettingsError(
            f"a starter must be one of {', '.join(KINDS)}, got {name!r}."
            f"{did_you_mean(name, KINDS)}".rstrip(".")
        )
    return KINDS[name]


def path_for(name: str, kind: Kind, path: Path | None) -> Path:
    """Return the file to write, by default in the working directory.

    Raises:
        SettingsError: If the suffix is not the one of the kind.
    """
    # Imported here to keep --help fast.
    from prefcal_env.errors import SettingsError

    if path is None:
        return Path(f"{name}{kind.suffix}")
    if path.suffix != kind.suffix:
        raise SettingsError(
            f"the starter {name!r} is a {kind.suffix} file: expected a name like "
            f"{path.stem or name}{kind.suffix}, got {str(path)!r}"
        )
    return path
