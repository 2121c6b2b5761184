"""Options of commands as data: how they become parameters, and whether a resumed study keeps them."""

import inspect
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import MISSING, dataclass, field, fields
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

from typer import Argument, Option
from typer.models import ArgumentInfo, OptionInfo

# --- Parameters of a command, each declared once as a field of a dataclass.
#
# The line of a field under "Args" in the docstring of its dataclass is its help. The command line, the
# checks of the study file and all messages use that declaration.

_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Kept:
    """Rules for a parameter whose value the study file keeps; by default it cannot change later.

    Args:
        label: Name in the report's list of settings; empty to leave it out.
        always: Whether the report and the command that repeats the study include the parameter
            even if it has its default.
        anew: Whether the value can change when a study is resumed.
        least: Smallest value; None if there is no limit.
        agents: Agents that accept a value other than the default; empty for all.
    """

    label: str = ""
    always: bool = False
    anew: bool = False
    least: int | None = None
    agents: tuple[str, ...] = ()


def argument(metavar: str, *, kept: Kept | None = None) -> Any:
    """Return the field of a required argument; `metavar` is its placeholder."""
    return field(metadata={"info": Argument(metavar=metavar), "kept": kept})


def option(default: Any, metavar: str = "", *, kept: Kept | None = None, **more: Any) -> Any:
    """Return the field of an option.

    Args:
        default: Default value; a flag of type bool inverts it.
        metavar: Placeholder of the value; empty for a flag.
        kept: Rules if the study file keeps the value.
        more: `flag`, if it is not --NAME; `shown`, the default as the help shows it; `most`, the
            largest number; and further arguments of `typer.Option`, such as a help that is computed.
    """
    names, shown = [more.pop("flag")] if "flag" in more else [], more.pop("shown", True)
    most = more.pop("most", None)
    info = Option(*names, metavar=metavar, show_default=shown, **more)
    return field(default=default, metadata={"info": info, "kept": kept, "most": most})


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a command.

    Args:
        name: Name of the field.
        type: Type of the value.
        default: Default value; MISSING if the parameter is required.
        info: Declaration for the parser: flag, help, placeholder.
        kept: Rules if the study file keeps the value; None if it applies to a single run.
        most: Largest number that can be typed; None if there is no limit.
    """

    name: str
    type: Any
    default: Any
    info: OptionInfo | ArgumentInfo
    kept: Kept | None
    most: int | None = None

    @property
    def flag(self) -> str:
        """Return the option as typed on the command line: "--n-max" for n_max."""
        declared = (self.info.default, *(self.info.param_decls or ()))
        flags = [text for text in declared if isinstance(text, str)]
        return flags[0] if flags else f"--{self.name.replace('_', '-')}"

    @property
    def signature(self) -> inspect.Parameter:
        """Return the parameter as typer expects it in the signature of a command.

        The default of a parameter that a study keeps is None, since a resumed study has its own
        value.
        """
        type_, default = self.type, self.default
        if get_origin(type_) is tuple:
            type_ = list[get_args(type_)[0]]  # type: ignore[misc]
        if type_ is bool:
            default = False
        elif self.kept is not None and default is not MISSING:
            type_, default = type_ | None, None
        return inspect.Parameter(
            self.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if default is MISSING else default,
            annotation=Annotated[type_, self.info],
        )

    def given(self, typed: Any) -> Any:
        """Return the field's value for a parsed value; None if the study decides.

        Raises:
            SettingsError: If it is a number that nobody can mean.
        """
        if self.most is not None and typed is not None and typed > self.most:
            # Imported here: --help must not import numpy.
            from prefcal_env.errors import SettingsError

            raise SettingsError(f"{self.flag} must be at most {self.most}, got {typed}")
        if self.type is bool:
            if typed:  # a flag inverts its default
                return not self.default
            return None if self.kept else self.default
        if get_origin(self.type) is tuple:
            return tuple(typed) if typed else None
        return typed

    def said(self, value: Any) -> str:
        """Return the option with its value, for messages: "--n-max 30", "no --start"."""
        if self.type is bool:
            return f"{self.flag} {'off' if value == self.default else 'on'}"
        if isinstance(value, list | tuple):
            value = "; ".join(map(str, value))
        return f"no {self.flag}" if value in (None, "") else f"{self.flag} {value}"

    def words(self, value: Any) -> list[str]:
        """Return the command-line words that set `value`."""
        if self.type is bool:
            return [self.flag]
        many = value if isinstance(value, list | tuple) else (value,)
        return [word for one in many for word in (self.flag, str(one))]

    def shown(self, value: Any) -> Any:
        """Return `value` as listed in the report."""
        if self.type is bool:
            return "yes" if value else "no"
        return "; ".join(value) if isinstance(value, tuple) else value

    def problem(self, value: Any) -> str:
        """Return an error message if a kept value is too small, else ""."""
        least = None if self.kept is None else self.kept.least
        if least is None or value >= least:
            return ""
        wanted = f"{least} or above" if least == 0 else f"at least {least}"
        return f"{self.flag} must be {wanted}, got {value}"


@cache
def parameters_of(options: type) -> Mapping[str, Parameter]:
    """Return the parameters that the dataclass `options` declares, by name and in order.

    Options that it inherits come last.
    """
    hints, own = get_type_hints(options), options.__annotations__
    helps = {name: words for base in options.__mro__ for name, words in _args(base.__doc__ or "")}
    found = {}
    for f in fields(options):
        info, kept, most = copy(f.metadata["info"]), f.metadata["kept"], f.metadata.get("most")
        info.help = info.help or helps.get(f.name)  # python -OO has no docstrings
        found[f.name] = Parameter(f.name, hints[f.name], f.default, info, kept, most)
    first = [n for n, p in found.items() if n in own or isinstance(p.info, ArgumentInfo)]
    return {name: found[name] for name in dict.fromkeys([*first, *found])}


def _args(docstring: str) -> Iterator[tuple[str, str]]:
    """Yield names and words of the section "Args" of a docstring; {these} are of optional worlds."""
    section = inspect.cleandoc(docstring).partition("\nArgs:\n")[2].partition("\n\n")[0]
    for name, words in re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", section, re.MULTILINE):
        for place, said in _of_worlds().items():
            words = words.replace(f"{{{place}}}", said)
        yield name, " ".join(words.split())


@cache
def _of_worlds() -> Mapping[str, str]:
    """Return what optional worlds add to the help of options, by the place that is left for it."""
    files = [world for world in worlds() if "ending" in world]
    systems = [world["system"] for world in worlds() if "system" in world]
    units = [f"; of {each['called']} also in another unit, {each['unit']['show']}" for each in files]
    return {
        "files": "".join(f", {each['file']}" for each in files),
        "called": "".join(f"{each['called']} or " for each in files),
        "units": "".join(units).replace("[", r"\["),
        "systems": "".join(f"{each} or " for each in systems),
    }


def kept_by(options: type) -> Mapping[str, tuple[Parameter, Kept]]:
    """Return the parameters whose values a study file keeps, by name."""
    parameters = parameters_of(options).items()
    return {name: (each, each.kept) for name, each in parameters if each.kept is not None}


def takes(options: type, *more: Parameter) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command the parameters declared by `options`, and `more`.

    Parameters of its own come first, such as typer's context.
    """

    def declare(command: Callable[..., None]) -> Callable[..., None]:
        own = inspect.signature(command).parameters.values()
        parameters = [p for p in own if p.kind is not inspect.Parameter.VAR_KEYWORD]
        parameters += [parameter.signature for parameter in (*parameters_of(options).values(), *more)]
        command.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        return command

    return declare


def given(options: type, typed: Mapping[str, Any]) -> dict[str, Any]:
    """Return values for the fields of `options` from the typed ones; None if a study decides."""
    return {name: p.given(typed[name]) for name, p in parameters_of(options).items()}


def made(options: type[_T], typed: Mapping[str, Any]) -> _T:
    """Return `options` of the typed values, with defaults for those that were not typed."""
    values = given(options, typed)
    return options(**{name: value for name, value in values.items() if value is not None})


def examples(*shown: tuple[str, str], more: str = "") -> str:
    """Return an epilog with example commands, an explanation of each, and `more`."""
    lines = (f"[cyan]prefcal {line}[/cyan]\n  {words}" for line, words in shown)
    return "\n\n".join(["[bold]Examples[/bold]", *lines, *([more] if more else [])])


@cache
def worlds() -> tuple[Mapping[str, Any], ...]:
    """Return the rows of `prefcal_env/optional.toml`, which say what the optional worlds are.

    The file alone is read: importing `prefcal_env` takes longer than the help of the program may.
    """
    package = find_spec("prefcal_env")
    assert package is not None
    assert package.origin is not None
    table = Path(package.origin).with_name("optional.toml").read_text(encoding="utf-8")
    return tuple(tomllib.loads(table).get("world", ()))


def examples_of_worlds(command: str) -> list[tuple[str, str]]:
    """Return the examples of a command with optional worlds, for `examples`."""
    found = (world.get("usage", {}).get(command) for world in worlds())
    return [(f"{command} {line}", words) for line, words in filter(None, found)]


# --- Check that a resumed study goes on as it was started.


def check_programs(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise SettingsError if the study's program or configuration is not the one given."""
    from prefcal_env.errors import SettingsError  # here, and below: `prefcal --help` need not load them
    from prefcal_scenarios.names import is_described, is_own
    from prefcal_scenarios.own import split_source

    for name, does in (("cost", "goes by a cost that was given to it"), ("twin", "simulates with a program")):
        program = str(kept.get(name) or "")
        if given.get(name) is None and is_own(program):
            raise SettingsError(f"the study {does}: if you trust it, add --{name} {shlex.quote(program)}")
    if is_described(str(kept.get("scenario", ""))):
        return  # checked when its source was made
    # The configuration's file may have moved, so compare only its content.
    then = split_source(str(kept.get("scenario", "")))[1]
    now = then if given.get("scenario") is None else split_source(given["scenario"])[1]
    if now != then:
        said = "no --config" if then is None else f"the configuration {then}"
        raise SettingsError(
            f"the study was started with {said}, got {'none' if now is None else now}: give the "
            "same one, or start another study"
        )


def check_unchanged(
    rules: Mapping[str, tuple[Parameter, Kept]], kept: Mapping[str, Any], given: Mapping[str, Any]
) -> None:
    """Raise SettingsError if an option that cannot change has a new value."""
    from prefcal_env.errors import SettingsError

    for name, (parameter, rule) in rules.items():
        value, then = given.get(name), kept.get(name)
        if rule.anew or value is None or value == then:
            continue
        raise SettingsError(
            f"the study was started with {parameter.said(then)}, got {parameter.said(value)}: "
            "leave the option out, or start another study"
        )
    wanted = given.get("n_max")
    if wanted is not None and wanted < kept["n_max"]:
        raise SettingsError(
            f"--n-max must not be below the {kept['n_max']} that the study has by now, got {wanted}"
        )
