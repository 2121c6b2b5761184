"""Export the tuned controller to a file, `best.json`, rebuild it from there, and say what it was tuned on."""

import json
import platform
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from itertools import starmap
from math import isfinite
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from prefcal_app.summary import keeps_all
from prefcal_app.view.end import margins_beside
from prefcal_env.arrays import is_number
from prefcal_env.controllers import as_data
from prefcal_env.controllers.forms import ANTI_WINDUP, EQUATIONS, FILTERED, PIDParameter, pid_forms
from prefcal_env.controllers.written import as_code
from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError, SettingsError, StaleError
from prefcal_env.experiments.experiment import Channel, Channels, Controller, End
from prefcal_env.knobs import KnobSpace
from prefcal_env.plain import from_plain
from prefcal_env.plants.plant import Disturbed
from prefcal_env.plants.systems import LinearPlant, LinearSystem
from prefcal_env.sources.source import plant_of
from prefcal_env.units import named, same
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.making import controller_of
from prefcal_scenarios.names import CASES, is_built_in
from prefcal_scenarios.own import file_in, files_of, fingerprint, joined_source, runs_code, split_source
from prefcal_scenarios.scenario import Scenario, with_ranges
from prefcal_scenarios.verification.said import BEST, FILE, Verified
from prefcal_scenarios.wording import MISSING, number, with_unit

from .record import StudyRecord, refuse_changed, refuse_outdated, written_as

FORMAT = 1
"""Format of best.json."""


@dataclass(frozen=True, slots=True, eq=False)
class BestTuning:
    """A tuning with its scenario."""

    scenario: Scenario  # scenario, with the ranges of the study
    theta: Float[np.ndarray, " n"]  # tuning, physical, shape (n,)
    # what it was compared with, shape (n,); None if the file does not say, or it is this one
    before: Float[np.ndarray, " n"] | None
    baseline: str  # what that is, such as "current tuning"
    kpis: Mapping[str, float]  # its KPIs in the study; those that are not finite are left out
    end: End  # how its experiment in the study ended
    seed: int  # seed of its experiment, and so of the noise in it
    own: bool  # whether it runs a person's own code, which can do anything
    digest: str  # SHA-256 of the file that it was read from, in hexadecimal digits
    source: str  # name that loads the scenario again
    changed: bool  # whether the files of the scenario are others than in the study
    anew: str  # command line that begins another such study; "" if the file does not say
    robust: bool  # whether the study counted varied runs, too


REBUILD = """\
from prefcal_app import load_controller

controller = load_controller("best.json")
# At every sampling instant, with a prefcal_env.Measurement:
# u = controller.move(measurement).u"""
"""Code with which a user rebuilds the tuned controller."""


def versions() -> dict[str, str]:
    """Return the versions of the packages that affect results."""
    found = {"python": platform.python_version()}
    for package in ("prefcal", "numpy", "scipy", "piqp", "numba"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def best_as_json(record: StudyRecord) -> str:
    """Return the text of best.json: θ by knob name, the controller's settings, and their origin."""
    best, scenario = record.best, record.scenario
    if best is None:
        raise ScenarioError("there is no best θ to export before the first experiment")
    theta = best.experiment.theta
    content = {
        "format": FORMAT,
        "scenario": record.source,
        "title": scenario.title,
        "theta": scenario.space.named(theta),
        "units": {k.name: k.unit for k in scenario.space},
        "channels": _channels(best.experiment.channels),
        **({"assumed": list(scenario.assumed)} if scenario.assumed else {}),
        "ranges": {k.name: [k.low, k.high] for k in scenario.space},
        "settings": {} if scenario.settings is None else scenario.settings(theta),
        "cost": best.cost,
        "kpis": dict(best.experiment.kpis),
        "ended": best.experiment.end.value,
        "experiment": best.number,
        "before": _before(record),
        **({"kept": dict(record.kept)} if record.kept else {}),
        **_keeping(record),
        "origin": record.origin,
        "experiments": len(record.trials),
        "complete": not record.partial,
        "study": {**record.settings, **record.agent_settings},
        **({"another study": record.anew} if record.anew else {}),
        "versions": versions(),
    }
    content = jsonable(content)
    content["written as"] = written_as(content)
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _channels(channels: Channels) -> dict[str, Any]:
    """Return what the controller is connected to, and the unit of time."""
    said = {key: [[c.name, c.unit] for c in getattr(channels, key)] for key in ("x", "u", "y")}
    return {"time_unit": channels.time_unit, **said}


def _before(record: StudyRecord) -> dict[str, Any]:
    """Return the tuning that the result was compared with: the way back."""
    theta, scenario = record.before.experiment.theta, record.scenario
    return {
        "what": record.baseline,
        "experiment": record.before.number,
        "theta": scenario.space.named(theta),
        "settings": {} if scenario.settings is None else scenario.settings(theta),
    }


def _keeping(record: StudyRecord) -> dict[str, Any]:
    """Return the first experiment that keeps all limits, if the best one does not and one does."""
    space, limited = record.scenario.space, [kpi for kpi in record.kpis if kpi.met(0.0) is not None]
    named = {f"experiment {trial.number}": trial.experiment for trial in record.trials}
    first = keeps_all(named, space, limited)
    if not first or all(kpi.met_by(record.result.experiment) for kpi in limited):
        return {}
    return {"keeping": {"what": first, "theta": space.named(named[first].theta)}}


def load_controller(path: str | Path, *, check: bool = True) -> Controller:
    """Rebuild the controller that `best.json` at `path` describes.

    If its settings describe a PID, LQR, LQG or linear MPC completely, nothing but the file is read. Otherwise
    the scenario is loaded; a user's own one is a Python file, which is executed.

    Args:
        path: Path of the file.
        check: Whether to raise an error if the current scenario would set up the controller
            differently from the file, for example after an update or an edit. A controller that
            the file describes completely needs no check.

    Raises:
        ScenarioError: If the file does not exist or is not a best.json, the scenario is unknown
            or has no controller, θ does not fit it, the settings differ from the file's, or θ or the
            settings in the file were changed by hand, which is an error without `check`, too.
    """
    content, _ = _read(Path(path))
    try:
        refuse_changed(Path(path), content)
    except StaleError as error:
        raise ScenarioError(str(error)) from error
    if (described := _described(content, path)) is not None:
        return described
    scenario = _loaded(content, path)
    make = scenario.controller or scenario.source.controller  # the run of an own scenario knows how
    if make is None:
        raise ScenarioError(f"scenario {scenario.name!r} does not say how to build a controller")
    values = _values(scenario, content["theta"], path)
    if check and scenario.settings is not None:
        _same_settings(content["settings"], jsonable(scenario.settings(values)), path)
    made: Controller = make(values)
    return made


STATE_SETTINGS = (
    "state settings=lambda theta: as_data(make(theta)) in the Scenario of its Python file, with as_data of "
    "prefcal_env.controllers and make(theta) its PID, LQR, LQG or LinearMPC"
)
"""How best.json gets a controller that the scenario does not state."""
FORMS = "forms"
"""Word for the numbers of a PID in each form, beside those of `LANGUAGES`."""


def export_controller(
    path: str | Path, to: str, *, name: str = "", time: str = "", spans: tuple[float, float] | None = None
) -> str:
    """Return the controller of a best.json in the form of the plant's system.

    Nothing but the file is read, and no code of a user is executed.

    Args:
        path: Path of the file.
        to: "st" for IEC 61131-3 structured text and "c" for C99, which do sample by sample what the
            controller does; "forms" for the numbers of a PID in ISA, parallel and series form.
        name: Name of the function block or C function; "tuned" if empty.
        time: Unit of the times in the forms; that of the plant if empty.
        spans: Ranges of the measured output and of the input, high minus low, for gain and proportional
            band in percent in the forms.

    Raises:
        ScenarioError: If the file cannot be read, or its settings do not describe its controller.
        SettingsError: If this controller cannot be written so, or an argument is not valid.
        StaleError: If it is not the best of its study any more.
    """
    content, digest = _read(Path(path))
    theta = content["theta"]
    if not (isinstance(theta, dict) and all(map(is_number, theta.values()))):
        raise ScenarioError(f"theta in {str(path)!r} must be a table of numbers, got {theta!r:.200}")
    refuse_outdated(Path(path), content)
    channels, described, held = _channels_of(content), _described(content, path), holds(Path(path))
    if described is None:
        raise ScenarioError(_explain_no_controller(content, path))
    if to == FORMS:
        found = pid_forms(
            as_data(described), content.get("units", {}), channels.time_unit, shown=time, spans=spans
        )
        if not found:
            raise SettingsError(f"only a PID has forms; {str(path)!r} holds another controller")
        return f"{held}\n{_as_text(found)}"
    if time or spans is not None:
        raise SettingsError(f"units of time and ranges are for {FORMS!r} only: code has those of the plant")
    _check_channels(as_data(described), channels, path)
    return as_code(
        described, to, channels, name=name or "tuned", about=_about(content, channels, digest, held)
    )


def _explain_no_controller(content: Mapping[str, Any], path: str | Path) -> str:
    """Return why a best.json has no controller to write, and how it gets one."""
    if not content["settings"]:
        return (
            f"{str(path)!r} holds no controller, since its scenario states no settings: {STATE_SETTINGS}, "
            "and write the report of its study again (prefcal report STUDY)"
        )
    return (
        f"the settings in {str(path)!r} describe no PID, LQR, LQG or LinearMPC, and export executes no "
        "scenario to make one. If it is one, write it in Python, with prefcal_env.controllers.as_code and "
        "load_controller, which does"
    )


def _check_channels(settings: Mapping[str, Any], channels: Channels, path: str | Path) -> None:
    """Refuse a controller of more signals than the channels that a best.json names, if it names any."""
    model = (settings.get("lqr") or settings).get("model")
    if model is None:
        pids = settings.get("pids", [settings])
        needed = {"u": max(pid["input"] for pid in pids) + 1, "y": max(pid["output"] for pid in pids) + 1}
    else:
        needed = {"u": len(model["D"][0]), "y": len(model["D"])}
        if channels.x:  # some loops name no states
            needed["x"] = len(model["A"])
    for key, count in needed.items():
        named_there = len(getattr(channels, key))
        if any((channels.x, channels.u, channels.y)) and named_there < count:
            raise ScenarioError(
                f'"channels" in {str(path)!r} must name at least {count} of {key!r}, which the controller '
                f"has, got {named_there}"
            )


NOT_VERIFIED = "Not verified on other plants than the modeled one: run prefcal verify best.json."


def verified_beside(best: Path) -> Verified | str:
    """Return what was verified of a best.json; if that is not known, why, and "" if nothing was verified."""
    try:
        found = Verified.read(best.parent) if best.name == BEST else None
    except ScenarioError:
        return f"{FILE} is damaged, or of another version of prefcal"
    if found is None and best.name == BEST and (best.parent / FILE).is_file():
        return f"{FILE} is of another {BEST}: of another tuning, or of other versions of the libraries"
    return found or ""


def holds(best: Path) -> str:
    """Return whether a tuning holds, by what is beside its best.json, its margins, and what is assumed."""
    said = verified_beside(best)
    held = f"{NOT_VERIFIED} {said}.".removesuffix(" .") if isinstance(said, str) else said.verdict
    return " ".join(filter(None, (held, margins_beside(best), *map(str, _read(best)[0].get("assumed", [])))))


def _about(content: Mapping[str, Any], channels: Channels, digest: str, held: str) -> str:
    """Return where a controller is from, whether it holds, and what signals that are no readings are."""
    study, held = (content.get("origin") or {}).get("study"), re.sub(r"(?<=\.) (?=[A-Z])", "\n", held)
    where = f"study {study}, " if study else ""
    about = (
        f"{content.get('title', '')}: tuned with prefcal {versions()['prefcal']}, {where}"
        f"experiment {content.get('experiment', '?')}. SHA-256 of best.json: {digest[:16]}...\n"
        f"{held}"
    )
    said = " ".join(f"{c.name} {c.unit}" for c in (*channels.x, *channels.u, *channels.y))
    # Of a step test, for example: its limits are no readings then, and a valve must not get them.
    if "changes from" not in str(content.get("title")) and not re.search(
        r"\bchanges?\b", said, re.IGNORECASE
    ):
        return about
    return (
        "ATTENTION: tuned on changes. All signals and limits are changes from a start: "
        f"subtract it from what is measured and set, and add that of the input to what this returns. {about}"
    )


def _channels_of(content: Mapping[str, Any]) -> Channels:
    """Return the channels of a best.json; those of an earlier version say none."""
    what = '"channels" of a best.json, which must name channels with units,'
    said = from_plain(content.get("channels", {}), _Connected, ScenarioError, what)
    x, u, y = (tuple(starmap(Channel, named)) for named in (said.x, said.u, said.y))
    return Channels(x, u, y, said.time_unit)


class _Connected(msgspec.Struct):
    """What a controller is connected to, by name and unit, as a best.json says it."""

    x: list[tuple[str, str]] = []
    u: list[tuple[str, str]] = []
    y: list[tuple[str, str]] = []
    time_unit: str = ""


def _as_text(parameters: Sequence[PIDParameter]) -> str:
    """Return parameters as lines of text, by form, each form with its equation."""
    lines = [f"Of the error e = r − y. {FILTERED} {ANTI_WINDUP}", ""]
    for form in dict.fromkeys(p.form for p in parameters):
        equation = EQUATIONS.get(form, "")
        lines.append(f"{form}: {equation}" if equation else form)
        for p in (p for p in parameters if p.form == form):
            copied = number(p.value).replace("−", "-")  # control systems read no typographic minus
            value = with_unit(copied, p.unit) if p.value == p.value else f"{MISSING} ({p.derived})"
            lines.append(f"  {p.name:<34} {value}")
    return "\n".join([*lines, ""])


def _described(content: Mapping[str, Any], path: str | Path) -> Controller | None:
    """Return the controller that the settings of a best.json describe; None if they need the scenario."""
    settings = content["settings"]
    try:
        return controller_of(settings) if isinstance(settings, Mapping) else None
    except SettingsError as error:
        raise ScenarioError(f"the controller in {str(path)!r} does not fit: {error}") from error


def tuning_of(path: str | Path) -> BestTuning:
    """Return the tuning that a best.json holds, and its scenario, which may be a file that is executed.

    Raises:
        ScenarioError: If the file is no best.json, or the scenario is unknown or has other knobs.
        StaleError: If it is not the best of its study any more.
    """
    content, digest = _read(Path(path))
    scenario = _loaded(content, path)
    theta = _values(scenario, content["theta"], path)
    refuse_outdated(Path(path), content)
    before = content.get("before", {})
    start = before.get("theta")
    known = None if start is None else _values(scenario, start, path)
    if known is not None and (known == theta).all():
        known = None  # its runs would say all twice
    if keeping := content.get("keeping", {}):  # a verification tries it, as it does the references
        others = {str(keeping.get("what")): _values(scenario, keeping.get("theta"), path)}
        scenario = replace(scenario, references={**others, **scenario.references})
    kpis = {name: value for name, value in content.get("kpis", {}).items() if is_number(value)}
    source, end = _source(content, path), _end(content, path)
    return BestTuning(
        scenario,
        theta,
        known,
        str(before.get("what", "")),
        kpis,
        end,
        _read_seed(content),
        runs_code(source),
        digest,
        source,
        _is_changed(content, source),
        str(content.get("another study", "")),
        "robust" in content.get("study", {}),
    )


def best_theta(path: str | Path, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the θ that a best.json holds for a scenario, shape (n,). Raises ScenarioError as `tuning_of`."""
    return _values(scenario, _read(Path(path))[0]["theta"], path)


def _is_changed(content: Mapping[str, Any], source: str) -> bool:
    """Return whether the files of a scenario, where they are now, are others than in its study."""
    known = (content.get("origin") or {}).get("fingerprint of the scenario", "")
    return bool(known) and known.split(";")[0] != fingerprint(source)


def _read_seed(content: Mapping[str, Any]) -> int:
    """Return the seed of the study of a best.json; 0 if it does not say one."""
    seed = content.get("study", {}).get("seed")
    return seed if isinstance(seed, int) and seed >= 0 else 0


def _end(content: Mapping[str, Any], path: str | Path) -> End:
    """Return how the experiment of a best.json ended."""
    given = content.get("ended", End.TIME_UP.value)
    if given not in (known := [end.value for end in End]):
        raise ScenarioError(f'"ended" in {str(path)!r} must be one of {known}, got {given!r}')
    return End(given)


def _widened(space: KnobSpace, ranges: Mapping[str, Any]) -> KnobSpace:
    """Return `space` with the ranges of the study that found θ, if they were wider."""
    parts = [(knob, *ranges.get(knob.name, (knob.low, knob.high))) for knob in space]
    knobs = [replace(k, low=min(k.low, low), high=max(k.high, high)) for k, low, high in parts]
    return KnobSpace(knobs, space.constraints)


def _loaded(content: Mapping[str, Any], path: str | Path) -> Scenario:
    """Return the scenario of a best.json with the ranges of its study."""
    scenario = load(_source(content, path))
    for knob in scenario.space:
        unit = str(content.get("units", {}).get(knob.name, knob.unit))
        if not same(unit, knob.unit):
            raise ScenarioError(
                f"theta in {str(path)!r} does not fit: knob {knob.name!r} is in {named(unit)} there, and in "
                f"{named(knob.unit)} in scenario {scenario.name!r}"
            )
    try:
        return with_ranges(scenario, _widened(scenario.space, content.get("ranges", {})))
    except (TypeError, ValueError, OverflowError) as error:
        raise ScenarioError(f"theta in {str(path)!r} does not fit: {error}") from error


def _source(content: Mapping[str, Any], path: str | Path) -> str:
    """Return what loads the scenario of a best.json from the working directory."""
    above, study = Path(path).resolve().parent, (content.get("origin") or {}).get("study")
    places = [above, *above.parents, *([Path(str(study)).parent] if study else [])]
    return _moved(content["scenario"], places)


def _values(scenario: Scenario, theta: Any, path: str | Path) -> Float[np.ndarray, " n"]:
    """Return the values of θ in a best.json, shape (n,)."""
    if not isinstance(theta, Mapping) or sorted(theta) != sorted(scenario.space.names):
        raise ScenarioError(
            f"theta in {str(path)!r} must name the knobs {list(scenario.space.names)}, got {theta!s:.200}"
        )
    try:
        return scenario.space.check(np.array([theta[name] for name in scenario.space.names], dtype=float))
    except (TypeError, ValueError, OverflowError) as error:
        raise ScenarioError(f"theta in {str(path)!r} does not fit: {error!s:.200}") from error


def jsonable(value: Any) -> Any:
    """Return `value` as strict JSON: lists for arrays and tuples, null for non-finite numbers."""
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value if isinstance(value, (bool, int, float, str, type(None))) else str(value)


_KINDS = {
    "scenario": str,
    **dict.fromkeys(("units", "ranges", "kpis", "before", "origin", "study", "keeping"), dict),
    "assumed": list,
}
"""Type of what is read of a best.json, where it is there."""


def _read(path: Path) -> tuple[dict[str, Any], str]:
    """Return the content of a best.json and the SHA-256 of the same bytes."""
    try:
        read = path.read_bytes()
        content = json.loads(read.decode("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(f"cannot read a tuned controller from {str(path)!r}: {error}") from error
    missing = {"format", "scenario", "theta", "settings"} - set(content if isinstance(content, dict) else ())
    if missing:
        raise ScenarioError(f"{str(path)!r} is not a best.json: it lacks {sorted(missing)}")
    if content["format"] != FORMAT:
        raise ScenarioError(
            f"{str(path)!r} has format {content['format']!r:.80}, this prefcal reads {FORMAT}"
        )
    for name, kind in _KINDS.items():
        if not isinstance(content.get(name, kind()), kind):
            what = {str: "text", list: "a list"}.get(kind, "a table")
            raise ScenarioError(f"{name!r} in {str(path)!r} must be {what}, got {content[name]!r:.80}")
    return dict(content), sha256(read).hexdigest()


def _moved(source: str, places: Sequence[Path]) -> str:
    """Return a source whose files are where they are found: in the working directory, or these places.

    The folder of a report is usually below the folder in which the study was started.
    """

    def moved(text: Any) -> Any:
        if not isinstance(text, str) or file_in(text)[0]:
            return text
        return next((str(place / text) for place in places if file_in(str(place / text))[0]), text)

    name, config = split_source(source)
    if config is None:
        return str(moved(name))
    return joined_source(moved(name), {key: moved(value) for key, value in config.items()})


def _same_settings(stored: Any, now: Any, path: str | Path) -> None:
    if stored == now:
        return
    keys = sorted({*stored, *now}) if isinstance(stored, Mapping) else []
    changed = [
        f"{k}: {stored.get(k, 'missing')} in the file, {now.get(k, 'missing')} now"
        for k in keys
        if stored.get(k) != now.get(k)
    ]
    raise ScenarioError(
        f"the controller settings in {str(path)!r} differ from this version's "
        f"({'; '.join(changed) or stored}); pass check=False to build it with this version's"
    )


# --- Say on which model a controller was tuned: its equations, or its files with their digests.

_ORDER = 4  # largest number of states of a transfer function that people can read
_PAGES = {"cstr": "environments.md", "overtake": "overtaking.md"}
"""Pages of the documentation that describe built-in models; those of all others are in loops.md."""


def model(record: StudyRecord) -> str:
    """Return on which model a study was made, in sentences: source, version, equations, and files."""
    made = f", fingerprint of the scenario {record.fingerprint}" if record.fingerprint else ""
    said = [f"{_named(record.source)}{made}, prefcal {versions()['prefcal']}"]
    plant = plant_of(record.scenario.source)
    if isinstance(plant, Disturbed):
        plant = plant.plant
    if isinstance(plant, LinearPlant):
        said += [equations(plant)]
    elif plant is not None:
        said += [f"Equations in code, states: {', '.join(state.name for state in plant.states)}"]
    said += [each.removesuffix(".") for each in record.scenario.assumed]
    if is_built_in(record.source):
        name = split_source(record.source)[0]
        said += [f"Built in, documented in docs/{_PAGES[name] if name in CASES else 'loops.md'}"]
    files = ", ".join(f"{path.name} (SHA-256 {digest_of(path)[:16]}…)" for path in files_of(record.source))
    return ". ".join([*said, *([f"Files: {files}"] if files else [])]) + "."


def _named(source: str) -> str:
    """Return the name that loads a scenario, with its configuration in words."""
    name, config = split_source(source)
    told = (f"{key.replace('_', ' ')} {_in_words(value)}" for key, value in (config or {}).items())
    return f"{name}: {', '.join(told)}" if config else name


def _in_words(value: Any) -> str:
    """Return a value of a configuration in words; of what is no list of texts or numbers how long it is."""
    if isinstance(value, Mapping):
        return " and ".join(f"{key} = {_in_words(each)}" for key, each in value.items())
    if isinstance(value, list):
        plain = all(isinstance(each, str | int | float) for each in value)
        return " and ".join(map(_in_words, value)) if plain else f"({len(value)} entries)"
    return number(value) if is_number(value) else str(value)


def equations(plant: LinearPlant) -> str:
    """Return a linear plant as text: its transfer functions, or the digest of large matrices."""
    # Imported here: what only asks for versions needs no plants.
    from prefcal_env.controllers.margins import minimal

    u, y = plant.rest or (np.zeros(len(plant.inputs)), np.zeros(len(plant.outputs)))
    J, names = plant.system, [_from(c.name, at) for c, at in zip(plant.inputs, u.tolist(), strict=True)]
    names += [c.name for c in plant.disturbances]
    late, unit = _dead_times(plant), plant.time_unit
    rows, sizes = list[str](), list[int]()
    for i, output in enumerate(plant.outputs):
        entries = [minimal(J.part([i], [j])) for j in range(len(names))]
        sizes += [len(entry.A) for entry in entries]
        terms = [f"{_fraction(e, late[i, j])} {names[j]}" for j, e in enumerate(entries) if e.B.any() or e.D]
        change = _from(output.name, float(y[i]))
        rows.append(f"{change} = {' + '.join(terms) or 0}".replace("+ −", "− "))
    if max(sizes) > _ORDER:
        numbers = (J.A, J.B, J.C, J.D, late, np.array(J.dt))
        digest = sha256(b"".join(np.ascontiguousarray(M).tobytes() for M in numbers)).hexdigest()
        held = "matrices, dead times and sampling time"
        return f"{plant.name}: linear, {len(J.A)} states, SHA-256 of its {held} {digest[:16]}…"
    time = f"z of a sample of {number(J.dt)} {unit}" if J.dt else f"time in {unit}"
    return f"{'; '.join(rows)} ({time})"


def _from(name: str, rest: float) -> str:
    """Return a signal's change from its value at rest."""
    return f"({name} {'−' if rest > 0 else '+'} {number(abs(rest))})" if rest else name


def _dead_times(plant: LinearPlant) -> Float[np.ndarray, "n_y n"]:
    """Return the dead time from each input and disturbance to each output; none is before a disturbance."""
    from prefcal_env.envs.plant_env import dead_times

    after = np.tile(np.array(plant.output_delay)[:, None], len(plant.disturbances))
    return np.hstack([dead_times(plant), after])


def _fraction(J: LinearSystem, late: float) -> str:
    """Return a transfer function of one input and one output, after a dead time, as people write it."""
    den, changed = (np.poly(M) if len(M) else np.ones(1) for M in (J.A, J.A - J.B @ J.C))
    num = changed + (J.D.item() - 1) * den
    num[np.abs(num) < 1e-9 * np.maximum(np.abs(den), np.abs(changed))] = 0.0  # the rounding of a difference
    if not J.dt:  # as K/(T s + 1), with time constants
        last = np.abs(den[np.flatnonzero(np.abs(den) > 1e-12 * np.abs(den).max())[-1]])
        num, den = num / last, den / last
    wait = "" if not late else f" z^−{late / J.dt:.0f}" if J.dt else f" e^(−{number(late)} s)"
    above, below = (_polynomial(p, "z" if J.dt else "s") for p in (num, den))
    above, below = (f"({p})" if " + " in p or " − " in p else p for p in (above, below))
    return f"{above}{wait}" if below == "1" else f"{above}{wait}/{below}"


def _polynomial(coefficients: Float[np.ndarray, " n"], name: str) -> str:
    """Return a polynomial as text, the highest power first."""
    terms = []
    for power, value in zip(range(len(coefficients) - 1, -1, -1), coefficients.tolist(), strict=True):
        if abs(value) > 1e-12 * np.abs(coefficients).max():
            symbol = "" if not power else name + str(power).translate(_POWERS).replace("¹", "")
            text = f"{value:.6g}"
            terms.append({"1": "", "-1": "-"}.get(text, f"{text} ") + symbol if symbol else text)
    return " + ".join(terms or ["0"]).replace("+ -", "- ").replace("-", "−")


_POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
