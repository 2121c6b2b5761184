"""A scenario as plain data: in a TOML file, as options of the command line, or both."""

import re
import shlex
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import msgspec

from prefcal_env.errors import ScenarioError, SettingsError, StudyError
from prefcal_env.knobs import Knob, KnobScale
from prefcal_env.optional import WORLDS, World
from prefcal_env.plain import Keys, entries
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.names import CONTROLLERS, either, is_described
from prefcal_scenarios.own import joined_source, split_source

# --- Read the short texts that describe a knob or a reference, in a file or on the command line.

KNOB_EXAMPLE = '"K_p=0.1:100:log %/m"'
"""A knob as typed on the command line, for help and messages."""
_RANGE = re.compile(r"([^\s\[]+)\s*(?:\[([^\]]*)\]|(.*))", re.DOTALL)
COMMA = re.compile(r",(?![^\[]*\])")
"""A comma between entries, and not the one in the name of an array's element, A[1,2]."""


def knob_of(text: str) -> Knob:
    """Return the knob NAME=LOW:HIGH[:log][:int][ UNIT]; raises as `ranged_knob` does."""
    name, equals, rest = text.partition("=")
    if not equals or not name.strip():
        raise ScenarioError(
            f"a knob must be NAME=LOW:HIGH[:log][:int] UNIT, for example {KNOB_EXAMPLE}, got {text!r}"
        )
    return ranged_knob(name.strip(), rest)


def ranged_knob(name: str, text: str) -> Knob:
    """Return the knob called `name` with the range LOW:HIGH[:log][:int][ UNIT] in `text`.

    The unit may be in brackets.

    Raises:
        ScenarioError: If the text does not read like that.
        KnobError: If the range is not valid.
    """
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise ScenarioError(_wrong(name, text))
    bounds, bracketed, bare = found.groups()
    # Without a colon the upper bound is "", which is no number: `_number` says what was expected.
    low, high, *flags = [*bounds.split(":"), ""] if ":" not in bounds else bounds.split(":")
    unknown = [flag for flag in flags if flag not in ("log", "int")]
    if unknown:
        raise ScenarioError(
            f"knob {name!r}: after LOW:HIGH comes :log for a logarithmic scale or :int for whole "
            f"numbers, for example {KNOB_EXAMPLE}, got :{unknown[0]} in {text.strip()!r}"
        )
    scale: KnobScale = "log10" if "log" in flags else "linear"
    unit = (bracketed if bracketed is not None else bare or "").strip()
    numbers = _number(name, low, text), _number(name, high, text)
    return Knob(name, *numbers, unit, scale=scale, integer="int" in flags)


def _number(name: str, word: str, text: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise ScenarioError(_wrong(name, text)) from None
    # Whole numbers stay whole: people read them in tables.
    return int(value) if isfinite(value) and value == int(value) else value


def _wrong(name: str, text: str) -> str:
    return f"knob {name!r}: expected its range LOW:HIGH, for example {KNOB_EXAMPLE}, got {text.strip()!r}"


_LIMIT = re.compile(
    r"\s*(\S.*?)\s*(<=|>=|≤|≥)\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*(?:\[([^\]]*)\]|(.*))", re.DOTALL
)


def limit_of(text: str) -> tuple[str, dict[str, Any]]:
    """Return the KPI that a text such as "overshoot <= 10 %" limits, and its entry in a file's [kpis].

    Raises:
        ScenarioError: If the text does not read like that.
    """
    found = _LIMIT.fullmatch(text)
    name, sign, word, *units = found.groups() if found else ("", "", "", "")
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise ScenarioError(
            'a limit must be KPI <= NUMBER UNIT, or with >=, for example "overshoot <= 2.5 %" (with a '
            f"decimal point), got {text!r}"
        )
    end, unit = "at_most" if sign in ("<=", "≤") else "at_least", next(filter(None, units), "").strip()
    return name, {end: value} | ({"unit": unit} if unit else {})


def join_limits(
    kept: Iterable[str], wanted: Sequence[str], titles: Mapping[str, str] | None = None
) -> list[str]:
    """Return the wanted limits after those kept of other KPIs, each a text as `limit_of` takes it.

    A KPI may be named by one of the `titles`, whose values are the names.
    """

    def name(text: str) -> str:
        stated = limit_of(text)[0]
        return (titles or {}).get(stated, stated)

    limited = {name(text) for text in wanted}
    return [*(text for text in kept if name(text) not in limited), *wanted]


def listed(texts: Iterable[str]) -> list[str]:
    """Return the names in texts such as "level,valve", in order."""
    names = [name.strip() for text in texts for name in COMMA.split(text)]
    return [name for name in names if name]


def named_numbers(texts: Iterable[str], flag: str) -> dict[str, float]:
    """Return the numbers by name in texts such as "level=2, flow=0.5".

    Raises:
        ScenarioError: If a text does not read like that; it names `flag` and an example.
    """
    found: dict[str, float] = {}
    for part in listed(texts):
        # From the right: names of variables may hold an equals sign, numbers never.
        name, equals, word = (piece.strip() for piece in part.rpartition("="))
        try:
            value = float(word)
        except ValueError:
            value = float("nan")
        if not (equals and name and isfinite(value)):
            others = [f", or, for {w.called}, {flag} {w.unit['reference']}" for w in WORLDS if w.unit]
            raise ScenarioError(
                f"{flag} must be NAME=NUMBER, for example {flag} level=2{''.join(others)}; got {part!r}"
            )
        if name in found:
            raise ScenarioError(f"{flag} gives {name!r} twice: {found[name]:g} and {value:g}")
        found[name] = value
    return found


# --- Describe a scenario as plain data: in a TOML file, by options, or by both.

_MERGED = ("knobs", "reference", "kpis", "panels", "starts")
"""Tables to which options add entries; they replace any other value of a file."""
_WORLDS = {world.key: world for world in WORLDS if world.key}
_TYPES: Mapping[str, Any] = {"text": str | None, "table": dict[str, Any] | None}
_KEYS: Keys = {key: (_TYPES[world.type], False) for key, world in _WORLDS.items()}
"""Keys of optional worlds, which a description may have instead of `controller` and `rig`."""
_CONTROLLER = "controller = " + either(f'"{word}"' for word in CONTROLLERS)
"""What names a standard controller, for messages."""


class Description(msgspec.Struct, frozen=True, kw_only=True):
    """A scenario as plain data.

    Exactly one of `controller`, `rig` and the key of an optional world says what is calibrated.
    `world` is that world, and `of` the value of its key.
    """

    name: str = ""
    title: str = ""
    brief: str = ""
    simulated: bool | None = None
    controller: str | None = None
    plant: str | dict[str, Any] | None = None
    rig: dict[str, Any] | None = None
    world: World | None = None
    of: Any = None
    knobs: dict[str, str | dict[str, Any]] = {}
    show: list[str] = []
    reference: dict[str, float] = {}
    stop_time: float | None = None
    timeout: float | None = None
    kpis: dict[str, float | str | dict[str, Any]] | Literal["none"] | None = None
    limits: list[str] = []
    panels: dict[str, dict[str, Any]] = {}
    starts: dict[str, dict[str, float]] = {}


def description_of(name: str, config: Mapping[str, Any]) -> Description:
    """Return the description of the scenario called `name`, with paths as seen from here.

    Args:
        name: Path of a TOML file or of a file of an optional world, or the name of a standard
            controller.
        config: Keys that are added to the file's, or replace them.

    Raises:
        ScenarioError: If the file cannot be read, or a key is unknown or has the wrong type.
    """
    path = Path(name)
    values: dict[str, Any] = {}
    if path.suffix == ".toml":
        values = _with_paths(_read(path), path.parent)
    else:
        key = next((world.key for world in WORLDS if world.ending == path.suffix != ""), "controller")
        values = {key: name}
    for key, value in config.items():
        # An option adds one knob or limit to those of a file; it replaces a plant or a stop time.
        if key == "limits" and isinstance(values.get(key), list):
            values[key] = join_limits(values[key], value)
            continue
        both = key in _MERGED and isinstance(value, Mapping)
        merges = both and isinstance(values.get(key), Mapping)
        values[key] = {**values[key], **value} if merges else value
    found = stated(values, name, _KEYS, Description, known=("world", "of"))
    _check_subject(found, name)
    there = next((key for key in _KEYS if found.get(key) is not None), "")
    of = {key: found.pop(key, None) for key in _KEYS}.get(there)
    return Description(**found, world=_WORLDS.get(there), of=of)


def _read(path: Path) -> dict[str, Any]:
    try:
        # Editors of Windows put a byte order mark at the start, which TOML does not know.
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        said = getattr(error, "strerror", None) or error
        raise ScenarioError(f"cannot read the scenario {str(path)!r}: {said}") from error
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(
            f"{str(path)!r} is not TOML: {error}. A text needs quotation marks, and a name with a "
            'space, too: "set point" = 2.0'
        ) from error


def _with_paths(values: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return `values` with the paths that a file in `folder` states, as seen from here."""
    for key in (*(key for key, world in _WORLDS.items() if world.ending), "plant"):
        if isinstance(values.get(key), str):
            # From where the file is: it may be sent along with what it names.
            values[key] = str(folder / values[key])
    for key, world in _WORLDS.items():
        for name in world.paths:
            table = values.get(key)
            if isinstance(table, dict) and isinstance(table.get(name), str) and table[name]:
                values[key] = {**table, name: str(folder / Path(table[name]).expanduser())}
    return values


def _check_subject(found: Mapping[str, Any], where: str) -> None:
    there = [key for key in (*_KEYS, "controller", "rig") if found.get(key) is not None]
    if len(there) != 1:
        got = " and ".join(there) or "none"
        ways = [*(world.example for world in _WORLDS.values()), _CONTROLLER]
        raise ScenarioError(f"{where}: expected one of {', '.join(ways)} and [rig], got {got}")
    if found.get("plant") is not None and found.get("controller") is None:
        raise ScenarioError(f"{where}: a plant needs {_CONTROLLER} to be calibrated, or leave it out")


def stated(
    values: Mapping[str, Any],
    where: str,
    *tables: type | Keys,
    known: tuple[str, ...] = ("name",),
    partial: bool = True,
) -> dict[str, Any]:
    """Return what a table of a file states, each value in the type of its key: see `plain.entries`.

    Raises:
        ScenarioError: If a key is unknown or missing, or a value has the wrong type.
    """
    return entries(values, tables, where, ScenarioError, did_you_mean, known=known, partial=partial)


# --- Write a description as options of the command line, and go on with the one that a study keeps.

FLAGS = {
    "knobs": "--knob",
    "show": "--show",
    "reference": "--reference",
    "plant": "--plant",
    "stop_time": "--stop-time",
    "limits": "--limit",
}
"""Keys of a description and the options that set them."""


def words_of(source: str) -> list[str]:
    """Return the words of a command line that describe a scenario like `source` does."""
    name, config = split_source(source)
    if config is None or not is_described(name) or not config.keys() <= FLAGS.keys():
        return [source]
    words, knobs = [name], config.get("knobs", {})
    if not all(isinstance(text, str) for text in knobs.values()):
        return [source]  # options cannot say all of it
    for knob, text in knobs.items():
        words += ["--knob", f"{knob}={text}"]
    if config.get("show"):
        words += ["--show", ",".join(config["show"])]
    for output, value in config.get("reference", {}).items():
        words += ["--reference", f"{output}={value!r}"]
    for key in ("plant", "stop_time"):
        if key in config:
            words += [FLAGS[key], str(config[key])]
    for text in config.get("limits", []):
        words += ["--limit", text]
    return words


def words_to_resume(source: str) -> list[str]:
    """Return the words that name the scenario of an existing study: the study keeps the rest."""
    name, config = split_source(source)
    if not is_described(name):
        return [source]
    plant = (config or {}).get("plant")
    return [name] if plant is None else [name, "--plant", str(plant)]


def resumed_source(kept: str, source: str) -> str:
    """Return the source of a study's scenario, where `source` may leave out what is kept.

    A plant is a program, so it must be named again: a study from another person must not decide
    which program runs here. It may have moved, like the scenario's own file.

    Raises:
        StudyError: If they are different scenarios.
        SettingsError: If `source` states another value, or leaves out the plant.
    """
    then, config = split_source(kept)
    name, wanted = split_source(source)
    # The folder may have moved since; the file must be the same one.
    if Path(then).name != Path(name).name:
        raise StudyError(f"the study calibrates {then!r}, not {name!r}: name that scenario")
    before, now = config or {}, wanted or {}
    for key, value in now.items():
        if not _same(key, before.get(key), value):
            said = f"{key} = {before[key]!r}" if key in before else f"no {key}"
            raise SettingsError(
                f"the study was started with {said}, got {value!r}: leave it out, or start another study"
            )
    if "plant" in before and "plant" not in now:
        raise SettingsError(
            "the study's plant is a program: if you trust it, add "
            f"--plant {shlex.quote(str(before['plant']))}"
        )
    merged = {**before, **now}
    return joined_source(name, merged) if merged else name


def _same(key: str, then: Any, now: Any) -> bool:
    if key == "plant" and isinstance(then, str) and isinstance(now, str):
        return Path(then).name == Path(now).name
    return bool(then == now)
