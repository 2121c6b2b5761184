"""The fields of a dataclass as the options of a command: what typer lacks, and the rules of a study file.

A field is annotated as a parameter of any typer command is. Its help is its line under "Args".
"""

import inspect
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import MISSING, dataclass, fields
from functools import cache, wraps
from importlib.util import find_spec
from pathlib import Path
from textwrap import fill, indent
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from typer import Context
from typer.models import ArgumentInfo, OptionInfo


@dataclass(frozen=True, slots=True)
class Stored:
    """Annotation of a field whose value the study file keeps; by default it cannot change later."""

    label: str = ""  # name in the report's list of settings; empty to leave it out
    # Whether the report and the command that repeats the study include the field even if it has its default
    always: bool = False
    anew: bool = False  # whether the value can change when a study is resumed
    agents: tuple[str, ...] = ()  # agents that accept a value other than the default; empty for all


@dataclass(frozen=True, slots=True)
class Parameter:
    """A field of a dataclass as a parameter of a command."""

    name: str
    type: Any
    default: Any  # default value; MISSING if the parameter is required
    info: OptionInfo | ArgumentInfo  # what typer is told: flag, help, placeholder, limits
    kept: Stored | None  # rules if the study file keeps the value; None if it applies to a single run

    @property
    def flag(self) -> str:
        """Return the option as typed on the command line: "--n-max" for n_max."""
        # typer takes the first name of an option in the place of its default.
        named = isinstance(self.info, OptionInfo) and isinstance(self.info.default, str)
        return str(self.info.default) if named else f"--{self.name.replace('_', '-')}"

    @property
    def signature(self) -> inspect.Parameter:
        """Return the parameter as typer expects it in the signature of a command."""
        several = get_origin(self.type) is tuple  # which typer takes for a fixed number of values
        type_ = list[get_args(self.type)[0]] if several else self.type  # type: ignore[misc]
        return inspect.Parameter(
            self.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=inspect.Parameter.empty if self.default is MISSING else self.default,
            annotation=Annotated[type_, self.info],
        )

    def read(self, typed: Any) -> Any:
        """Return the value of the field for what was typed; a flag inverts its default."""
        if self.type is bool:
            return not self.default
        return tuple(typed) if isinstance(typed, list) else typed

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


@cache
def parameters_of(options: type) -> Mapping[str, Parameter]:
    """Return the fields of the dataclass `options` as parameters, by name; inherited options come last."""
    hints, own = get_type_hints(options, include_extras=True), options.__annotations__
    helps = {name: words for base in options.__mro__ for name, words in _args(base.__doc__ or "")}
    found = {}
    for f in sorted(fields(options), key=lambda f: f.name not in own):
        type_, info, *rules = get_args(hints[f.name])
        info = copy(info)
        info.help = info.help or helps.get(f.name)  # python -OO has no docstrings
        if type_ is bool:
            info.metavar, info.show_default = "", False
        found[f.name] = Parameter(f.name, type_, f.default, info, next(iter(rules), None))
    return found


def kept_by(options: type) -> Mapping[str, tuple[Parameter, Stored]]:
    """Return the parameters whose values a study file keeps, by name."""
    parameters = parameters_of(options).items()
    return {name: (each, each.kept) for name, each in parameters if each.kept is not None}


def takes(options: type, *more: Parameter) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that gives a command the fields of `options`, and `more`, as parameters.

    The command is called with what was typed, by name, so that defaults can depend on the rest;
    and with typer's context, if it takes that, too.
    """
    parameters = {**parameters_of(options), **{each.name: each for each in more}}

    def declare(command: Callable[..., None]) -> Callable[..., None]:
        wants_context = len(inspect.signature(command).parameters) > 1

        command.__doc__ = _flowing(command.__doc__ or "")

        @wraps(command)
        def call(context: Context, **values: Any) -> None:
            typed = {
                name: parameter.read(values[name])
                for name, parameter in parameters.items()
                if (source := context.get_parameter_source(name)) is not None and source.name != "DEFAULT"
            }
            command(typed, *([context] if wants_context else []))

        first = inspect.Parameter("context", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Context)
        rest = [each.signature for each in parameters.values()]
        call.__signature__ = inspect.Signature([first, *rest])  # type: ignore[attr-defined]
        return call

    return declare


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


def examples(*shown: tuple[str, str], more: str = "") -> str:
    """Return an epilog with example commands, an explanation of each, and `more`."""
    lines = (f"[cyan]prefcal {line}[/cyan]\n{indent(fill(words, 74), '  ')}" for line, words in shown)
    return "\n\n".join(["[bold]Examples[/bold]", *lines, *([_flowing(more)] if more else [])])


def _flowing(text: str) -> str:
    """Return paragraphs without line breaks: the terminal breaks them, and typer would keep both."""
    return "\n\n".join(" ".join(each.split()) for each in inspect.cleandoc(text).split("\n\n"))


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
