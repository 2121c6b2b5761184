"""Studies by their names: their files, their sources, and how they are changed and respaced."""

import json as json_
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
from rich.cells import cell_len, set_cell_size
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_agents.transfer import RESPACEABLE, move
from prefcal_app.cli.options import Options, RespaceOptions
from prefcal_app.cli.parameters import kept_by
from prefcal_app.report.export import jsonable
from prefcal_app.report.record import VERDICTS
from prefcal_app.session.study import agent_of, agent_state, with_constraints
from prefcal_app.summary import Counts
from prefcal_app.terminal.showing import knob_called
from prefcal_env.errors import PrefcalError, SettingsError, StudyError
from prefcal_env.knobs import KnobSpace, respaced
from prefcal_env.optional import WORLDS
from prefcal_env.preferences.answer import Mark
from prefcal_env.study import (
    Respaced,
    State,
    StudyFile,
    data_folder,
    export_json,
    import_json,
    knobs_as_dicts,
    make_data_folder,
    remove_study,
    rename_study,
    space_of,
    studies_in_data_folder,
    study_path,
    verify,
    within_as_dict,
)
from prefcal_env.study.archive import FORMATS as EXPORTS
from prefcal_env.study.fold import step
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.description import (
    FLAGS,
    join_limits,
    knob_of,
    listed,
    named_numbers,
    resumed_source,
    words_to_resume,
)
from prefcal_scenarios.names import CONTROLLERS, is_built_in, is_described, is_own, is_table
from prefcal_scenarios.own import fingerprint, joined_source, split_source, with_config_of
from prefcal_scenarios.wording import labeled, mark_text, number, printable

# --- Find study files, open them safely, list them, and show one.

EXPERIMENT = re.compile(r"(.+):(\d+|best)")  # an experiment of a study, as people name it: MINE:3, MINE:best


def numbered(name: str, which: str, state: State) -> int:
    """Return the index of the experiment that people call `which` in the study called `name`."""
    index = state.history.incumbent if which == "best" else int(which) - 1
    if index is None or index not in state.finished:
        there = ", ".join(str(k + 1) for k in sorted(state.finished)) or "none"
        raise SettingsError(f"study {name!r} has no experiment {which}; there are {there}")
    return index


def wall_clock() -> str:
    """Return the time in UTC, for the record; no result depends on it."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def existing(name: str) -> Path:
    """Return the file of a study. Raises StudyError if there is none."""
    path = study_path(name)
    if path.is_file():
        return path
    if path.parent != data_folder():
        raise StudyError(f"there is no study {name!r}: no file {path}")
    hint = did_you_mean(name, [p.stem for p in studies_in_data_folder()])
    raise StudyError(f"there is no study {name!r}.{hint} `prefcal studies list` shows yours")


class _Knob(msgspec.Struct):
    name: str
    unit: str


class _Agent(msgspec.Struct):
    agent: str


class _Configuration(msgspec.Struct):
    """Fields of a study's configuration that the command line reads."""

    scenario: str
    name: str
    title: str
    seed: int
    knobs: list[_Knob]
    agent: _Agent
    options: dict[str, Any]
    versions: dict[str, Any]


def open_described(path: Path, *, writing: bool = False) -> StudyFile:
    """Open a study that `prefcal calibrate` could have made, for reading unless `writing`.

    The configuration is checked, since a study file can hold any plain data, and one imported
    file must not break the list of all studies.
    """
    file = StudyFile.open(path, clock=wall_clock, reading=not writing)
    problem = _problem(file.state.configuration)
    if problem:
        file.close()
        raise StudyError(f"{path} is not a study of prefcal calibrate: {problem}")
    return file


def _problem(configuration: Mapping[str, Any]) -> str:
    """Return what is wrong with a configuration, or "" if it is valid."""
    try:
        options = msgspec.convert(dict(configuration), _Configuration).options
    except msgspec.ValidationError as error:  # such as "Expected `str`, got `int` - at `$.name`"
        problem, _, where = str(error).replace("`", "").partition(" - at $.")
        return f"its {where or 'configuration'}: {problem[:1].lower()}{problem[1:]}"
    if "calibrator" not in options:
        return "its options must name a calibrator"
    for name, (parameter, _) in kept_by(Options).items():
        try:
            if name in options:
                msgspec.convert(options[name], parameter.type)
        except msgspec.ValidationError:
            return f"its option {name} cannot be {options[name]!r:.40}"
    return ""


def print_list(*, json: bool) -> None:
    """Print a row for each study in the data folder, including unreadable ones."""
    rows = [_row(path) for path in studies_in_data_folder()]
    if json:
        print(as_text(rows))
        return
    if not rows:
        print("No studies yet: `prefcal calibrate cstr` starts one.")
        return
    # Plain lines, however long: a table that breaks names would keep them from being copied.
    headings = ["study", "scenario", "experiments", "answers", "started", "state"]
    cells = [headings, *([printable(cell) for cell in _cells(row)] for row in rows)]
    widths = [max(map(cell_len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        padded = (set_cell_size(text, width) for text, width in zip(line, widths, strict=True))
        print("  ".join(padded).rstrip())


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Return a row for people: the date, no folders, a scenario without its configuration."""
    if "scenario" not in row:
        return [str(row["study"]), "", "", "", "", str(row["state"])]
    named = str(row["scenario"]).partition("{")[0].strip()
    scenario = named.replace("\\", "/").rpartition("/")[2]
    done = f"{row['experiments']} of {row['n_max']}"
    return [row["study"], scenario, done, str(row["answers"]), row["begun"][:10], row["state"]]


def _row(path: Path) -> dict[str, Any]:
    try:
        with open_described(path) as file:
            state = file.state
    except PrefcalError as error:
        why = str(error).replace(f" {path}", "")
        return {"study": path.stem, "file": str(path), "state": f"cannot be read: {why}"}
    return {"study": path.stem, "file": str(path), **summary(state)}


def summary(state: State) -> dict[str, Any]:
    """Return a summary of a study, for people and programs."""
    counts = Counts.of(state)
    return {
        "scenario": state.configuration["scenario"],
        "experiments": counts.experiments,
        "n_max": state.n_max,
        "answers": counts.comparisons,
        "begun": _minute(state.created),
        "state": state.ended or "open",
    }


def print_study(name: str, *, json: bool) -> None:
    """Print one study: configuration, best θ, and every answer."""
    path = existing(name)
    with open_described(path) as file:
        state = file.state
    configuration = state.configuration
    content = {
        "study": name,
        "file": str(path),
        **summary(state),
        "best": best_theta(state),
        "calibrator": configuration["options"]["calibrator"],
        "agent": configuration["agent"]["agent"],
        "seed": configuration["seed"],
        "versions": configuration["versions"],
        "questions": list(_answers(state)),
        "notes": [{"at": at, "text": text} for at, text in state.notes],
    }
    if json:
        print(as_text(content))
        return
    console = Console(emoji=False)
    shown = ("study", "file", "scenario", "calibrator", "agent", "seed", "begun", "state")
    lines = [f"{key:<12}{content[key]}" for key in shown]
    lines.append(f"{'experiments':<12}{content['experiments']} of {state.n_max}")
    units = {knob["name"]: knob["unit"] for knob in configuration["knobs"]}
    for knob, value in (content["best"] or {}).items():
        lines.append(f"best {labeled(knob, units[knob])} = {number(value)}")
    for line in lines:
        console.print(printable(line), markup=False, highlight=False, soft_wrap=True)
    if content["questions"]:
        console.print(_table(content["questions"]))


def _minute(at: str) -> str:
    """Return a UTC time of the record without its seconds."""
    return at[:16].replace("T", " ")


def best_theta(state: State) -> dict[str, float] | None:
    """Return the best θ so far by knob name; None before the first experiment."""
    best = state.history.incumbent
    if best is None:
        return None
    names = [knob["name"] for knob in state.configuration["knobs"]]
    return dict(zip(names, map(float, state.history.samples[best].theta), strict=True))


def _answers(state: State) -> Iterator[dict[str, Any]]:
    for closed in state.answers:
        said = "retracted" if closed.retracted else ""
        yield {
            "at": _minute(closed.at),
            "challenger": closed.challenger + 1,
            "incumbent": None if closed.incumbent is None else closed.incumbent + 1,
            "verdict": VERDICTS[closed.answer.preference],
            "marks": [mark.value for mark in closed.answer.marks],
            "automatic": [mark.value for mark in closed.answer.automatic],
            "comment": closed.comment,
            "blind": closed.blind,
            "said": said if closed.repeats is None else "asked again",
        }


def _table(answers: list[Mapping[str, Any]]) -> Table:
    table = Table()
    columns = ("at", "challenger", "incumbent", "verdict", "marks", "comment", "said")
    for heading in ("when", "experiment", "against", "verdict", "marks", "comment", ""):
        table.add_column(heading, overflow="fold")
    for answer in answers:
        marks = (mark_text(Mark(m), automatic=m in answer["automatic"]) for m in answer["marks"])
        shown = {**answer, "marks": ", ".join(marks)}
        table.add_row(*(escape(printable(shown[key])) for key in columns))
    return table


def as_text(content: Any) -> str:
    """Return what programs read: strict, indented JSON, with null for missing numbers."""
    whole = (sys.stdout.encoding or "utf-8").lower().startswith("utf")  # others lack characters
    return json_.dumps(jsonable(content), indent=2, ensure_ascii=not whole, allow_nan=False)


# --- Complete what a user types by what a study keeps: its scenario and its cost, but no programs.


def completed(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return `given` with the source of the scenario that the options describe, and the cost.

    An existing study keeps what is not given, except programs: a study from another person must
    not decide which program runs here. So a scenario that is not given must be a built-in one, or
    be described by a plant that is.

    Args:
        given: Values of a command's options by name.
    """
    source, study, words = given.get("scenario"), given.get("study"), _described(given)
    kept: Mapping[str, Any] = {}
    if study is not None and (source is None or study_path(study).is_file()):
        with open_described(existing(study)) as file:
            kept = file.state.configuration
    if source is None and words:
        source = split_source(kept["scenario"])[0]  # the study keeps the rest
        if not is_described(source):
            raise SettingsError(f"study {study!r} has no plant of its own: leave --plant out")
    if source is not None:
        source = _with_words(with_config_of(source, given.get("config")), words)
    cost = given.get("cost")
    if kept:
        source = _trusted(str(study), kept["scenario"], source)
        if is_table(source) and "://" not in source and fingerprint(source) != kept.get("fingerprint"):
            raise StudyError(
                f"the table of study {study!r} has changed since it began: restore it, or start another study"
            )
        known = kept["options"].get("cost")
        # A study from another person must not decide which program runs here; a KPI's name is none.
        if cost is None and known is not None and not is_own(str(known)):
            cost = str(known)
    return {**given, "scenario": source} | ({} if cost is None else {"cost": cost})


def _with_words(source: str, words: Mapping[str, Any]) -> str:
    """Return `source` with what the options describe. Raises SettingsError if it takes none."""
    if is_described(source):
        name, config = split_source(source)
        wanted = {**(config or {}), **words}
        return joined_source(name, wanted) if wanted else name
    if words:
        files = [f"{world.called}, " for world in WORLDS if world.ending]
        judged = "; prefcal verify takes it for any result" if "limits" in words else ""
        raise SettingsError(
            f"{FLAGS[next(iter(words))]} describes {''.join(files)}a TOML file or a standard controller "
            f"({', '.join(CONTROLLERS)}), not {source!r}: leave it out{judged}"
        )
    return source


def _described(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the typed options as keys of a description."""
    found = {key: given[key] for key in ("plant", "stop_time") if key in given}
    if given.get("knob"):
        names = [knob_of(text).name for text in given["knob"]]
        texts = [text.partition("=")[2].strip() for text in given["knob"]]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise SettingsError(f"--knob gives {twice[0]!r} twice")
        found["knobs"] = dict(zip(names, texts, strict=True))
    if given.get("show"):
        found["show"] = listed(given["show"])
    if given.get("reference"):
        found["reference"] = named_numbers(given["reference"], "--reference")
    if given.get("limit"):
        found["limits"] = list(given["limit"])
    return found


def _trusted(name: str, named: str, source: str | None) -> str:
    """Return the scenario of the study called `name`, if the user trusts it, else raise StudyError.

    The study names the scenario `named`; `source` is the user's, None to use a built-in one of the study.
    """
    harmless = is_built_in(named) or (is_table(named) and "://" not in named)
    if source is None and not harmless:
        # A study from another person must not decide which program runs here.
        short, *plant = words_to_resume(named)  # the study keeps the rest
        option = plant or ["--scenario", short]
        raise StudyError(
            f"study {name!r} calibrates {' '.join([short, *plant])!r}, which is a program: if you "
            f"trust it, add {shlex.join(option)}"
        )
    if source is not None and is_described(source) and is_described(named):
        _refuse_limits(name, *((split_source(each)[1] or {}).get("limits", []) for each in (named, source)))
        return resumed_source(named, source)
    return source or named


def _refuse_limits(name: str, kept: list[str], wanted: list[str]) -> None:
    """Raise a SettingsError if the wanted limits are not those of the study called `name`."""
    if wanted in ([], kept):
        return
    both = join_limits(kept, wanted)
    own, every = (shlex.join(w for text in texts for w in ("--limit", text)) for texts in (wanted, both))
    raise SettingsError(
        f"study {name!r} keeps the limits with which it was started ({'; '.join(kept) or 'none'}), got "
        f"{'; '.join(wanted)}. To judge its result by that, run prefcal verify BEST.json {own}. To look for "
        "a result that keeps it, begin a new study from the same answers: in place of --study, add "
        f"--taste {shlex.quote(name)} {every}"
    )


# --- Manage study files: rename, remove, export, import and check them.


def rename(old: str, new: str) -> Path:
    """Rename the study called `old`; return its new file."""
    source, target = existing(old), study_path(new)
    if target.exists():
        raise StudyError(f"there is a study {new!r} already: choose another name")
    make_data_folder(target)
    rename_study(source, target)
    return target


def remove(names: Sequence[str], *, yes: bool) -> int:
    """Remove the studies called `names`, each after confirmation unless `yes`; return exit code."""
    named = {name: existing(name) for name in names}  # check all names before removing anything
    described = {name: _study_in_words(name, path) for name, path in named.items()}
    if not yes and not sys.stdin.isatty():
        raise StudyError("cannot ask for confirmation here: add --yes to remove without a question")
    code = 0
    for name, path in named.items():
        if yes or _confirmed(described[name]):
            remove_study(path)
            print(f"Removed: {printable(name)}")
        else:
            code = 1
    return code


def _study_in_words(name: str, path: Path) -> str:
    """Return a short description of the study. Raises StudyError if the file is not a study."""
    try:
        with open_described(path) as file:
            row = summary(file.state)
    except PrefcalError as error:
        if path.parent != data_folder():
            raise StudyError(f"{path} is not removed: {error}") from error
        return f"study {name!r}, which cannot be read"
    counts = f"{row['experiments']} experiments, {row['answers']} answers"
    return f"study {name!r} ({printable(row['scenario'])}, {counts})"


def _confirmed(what: str) -> bool:
    try:
        return input(f"Remove {what} for good? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def export_study(name: str, format_: str, out: Path | None) -> Path:
    """Write a study as JSON, CSV or Parquet; return the path."""
    path = existing(name)
    if out is not None and out.exists() and out.samefile(path):
        raise StudyError(f"{out} is the study itself: export it to another file")
    with StudyFile.open(path, clock=wall_clock, reading=True) as file:
        if format_ in EXPORTS:
            return EXPORTS[format_](file, Path(path.stem) if out is None else out)
        text = export_json(file)
    target = Path(f"{path.stem}.json") if out is None else out
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}") from error
    return target


def import_study(source: Path, name: str | None) -> Path:
    """Create a study file from exported JSON; return its path."""
    try:
        text = source.read_text(encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot read {source}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise StudyError(f"cannot read {source}: it is not an exported study") from error
    target = study_path(source.stem if name is None else name)
    if target.exists():
        raise StudyError(f"there is a study {target} already: name this one with --study")
    try:
        import_json(text, target)
    except StudyError as error:
        raise StudyError(f"{source}: {error}") from error
    return target


def findings_of(name: str) -> tuple[int, tuple[str, ...]]:
    """Return the number of events of a study, and the problems found in them."""
    path = existing(name)
    if findings := verify(path):
        return 0, tuple(findings)
    with StudyFile.open(path, clock=wall_clock, reading=True) as file:
        return sum(1 for _ in file.events()), ()


# --- Change the knobs of a study: search another range, keep a knob, or add one.

_Part = tuple[float, float]


def respaced_in_words(typed: Mapping[str, Any]) -> Iterator[str]:
    """Change the space of a study as typed, and yield the new one in words; for errors see `respace`."""
    # Its --knob is no description of the scenario.
    of_study = {name: typed[name] for name in ("study", "scenario", "plant") if name in typed}
    space = respace(RespaceOptions(**typed), completed(of_study)["scenario"])
    for knob, (low, high) in zip(space, space.within, strict=True):
        part = f"{low:g}, frozen" if low == high else f"{low:g} to {high:g}"
        yield f"{knob.name}: {part} {knob.unit}".rstrip()


def respace(changes: RespaceOptions, source: str) -> KnobSpace:
    """Change the space of a study of the scenario `source`; return the new space.

    The changes are as typed: "T_s=0.25:1.0", "N_p=26", "filter=0.5".
    """
    with open_described(existing(changes.study), writing=True) as file:
        if file.state.configuration["agent"]["agent"] not in RESPACEABLE:
            raise StudyError(f"the agent of study {changes.study!r} cannot change its space")
        event, space = _event(file.state, load(source).space, changes)
        # Check that the study can be resumed with the change before recording it.
        agent_of(step(file.state, 1 << 40, "", event), space)
        file.append(event)
    return space


def _event(state: State, scenario: KnobSpace, changes: RespaceOptions) -> tuple[Respaced, KnobSpace]:
    old = with_constraints(space_of(state.configuration), scenario)
    ranges, frozen = (changes.knob, "KNOB=LOW:HIGH"), (changes.freeze, "KNOB=VALUE")
    asked = [part for each in (ranges, frozen) for part in _read(*each, scenario)]
    parts = {**_parts(state, old, scenario), **dict(asked)}
    added = {name: value for name, (value, _) in _read(changes.add, "KNOB=VALUE", scenario)}
    # A knob is widened if necessary to include its part.
    knobs = [
        replace(k, low=min(k.low, parts[k.name][0]), high=max(k.high, parts[k.name][1]), about="")
        for k in scenario
    ]
    space = respaced(old, KnobSpace(knobs, scenario.constraints, within=parts), added)
    theirs = knobs_as_dicts(scenario)
    if space == old and state.configuration.get("scenario_knobs") in (None, theirs):
        raise SettingsError("nothing changes: give --knob, --freeze or --add")
    content = {"knobs": knobs_as_dicts(space), "within": within_as_dict(space), "scenario_knobs": theirs}
    before = agent_state(state)
    then = before.configuration()
    now = move(before, old, space, added).configuration()
    agent = {name: value for name, value in now.items() if value != then.get(name)}
    return Respaced(content, added, agent), space


def _parts(state: State, old: KnobSpace, scenario: KnobSpace) -> dict[str, _Part]:
    """Return the default part of each knob to search: the same as before, or its new range."""
    configuration = state.configuration
    then = space_of({"knobs": configuration.get("scenario_knobs", configuration["knobs"])})
    before = dict(zip(old.names, old.within, strict=True))
    return {
        knob.name: before[knob.name] if knob in then.knobs else (float(knob.low), float(knob.high))
        for knob in scenario
    }


def _read(texts: Sequence[str], form: str, scenario: KnobSpace) -> Iterator[tuple[str, _Part]]:
    """Yield knobs and the ends of their ranges, equal ones for a single value."""
    for text in texts:
        word, equals, value = text.rpartition("=")
        ends = value.split(":")
        if not (word and equals) or len(ends) != form.count(":") + 1:
            raise SettingsError(f"expected {form}, got {text!r}")
        numbers = []
        for end in ends:
            try:
                numbers.append(float(end))
            except ValueError as error:
                raise SettingsError(f"expected a number, got {end!r} in {text!r}") from error
        yield knob_called(word.strip(), scenario), (numbers[0], numbers[-1])
