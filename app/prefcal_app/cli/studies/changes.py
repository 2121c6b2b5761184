"""Manage studies: rename, remove, export, import and check them, and change their knobs."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_agents.respacing import RESPACEABLE, moved
from prefcal_app.cli.choices import knob_called
from prefcal_app.session import Interview
from prefcal_app.session.memory import agent_of, agent_state, with_constraints
from prefcal_env.errors import PrefcalError, SettingsError, StudyError
from prefcal_env.knobs.change import respaced
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
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
    study_path,
    verify,
    within_as_dict,
)
from prefcal_env.study.exports import FORMATS as EXPORTS
from prefcal_env.study.fold import step
from prefcal_scenarios.catalog import load
from prefcal_scenarios.presentation.wording import printable

from .files import existing, open_described, summary, trusted_source, wall_clock


def rename(old: str, new: str) -> Path:
    """Rename the study called `old`; return its new file.

    Raises:
        StudyError: If there is no such study, `new` exists, or another process has it open.
    """
    source, target = existing(old), study_path(new)
    if target.exists():
        raise StudyError(f"there is a study {new!r} already: choose another name")
    make_data_folder(target)
    rename_study(source, target)
    return target


def remove(names: Sequence[str], *, yes: bool) -> int:
    """Remove the studies called `names`, each after confirmation unless `yes`; return exit code.

    Raises:
        StudyError: If there is no such study, a file is not a study, or another process has it
            open; the studies named before it are removed.
    """
    named = {name: existing(name) for name in names}  # check all names before removing anything
    described = {name: _described(name, path) for name, path in named.items()}
    if not yes and not sys.stdin.isatty():
        raise StudyError("cannot ask for confirmation here: add --yes to remove without a question")
    kept = 0
    for name, path in named.items():
        if not yes and not _confirmed(described[name]):
            kept += 1
            continue
        remove_study(path)
        print(f"Removed: {printable(name)}")
    return 1 if kept else 0


def _described(name: str, path: Path) -> str:
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
        target = Path(f"{path.stem}.json") if out is None else out
        text = export_json(file)
    try:
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror}") from error
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
    import_json(text, target)
    return target


def findings_of(name: str) -> tuple[int, tuple[str, ...]]:
    """Return the number of events of a study, and the problems found in them."""
    path = existing(name)
    findings = verify(path)
    if findings:
        return 0, tuple(findings)
    with StudyFile.open(path, clock=wall_clock, reading=True) as file:
        return sum(1 for _ in file.events()), ()


_COST = '''

SCENARIO = {source!r}


def cost(experiment):
    """Return the index of an experiment, for `prefcal calibrate --agent glis --cost`."""
    from prefcal_scenarios import outcome

    return index(outcome(_scenario(), experiment))


@cache
def _scenario():
    from prefcal_scenarios import load

    return load(SCENARIO)
'''


def export_index(name: str, source: str | None, out: Path | None) -> tuple[Path, LearnedCost]:
    """Write what the answers of the study called `name` teach as a Python module.

    Args:
        name: Name of the study.
        source: Scenario that the user trusts; None for the study's built-in one.
        out: File to write; None for STUDY_index.py in the current folder.

    Returns:
        The file, and what it holds.

    Raises:
        StudyError: If there is no such study, its scenario must be given, its answers say nothing
            about KPIs, or the file cannot be written or is not an earlier index.
    """
    path = existing(name)
    with open_described(path) as file:
        source = trusted_source(name, file.state, source)
        scenario = load(source)
        interview = Interview(scenario, file, ahead=False, asks=False)
        index = interview.index
    if index is None:
        raise StudyError(
            f"study {name!r} says nothing about KPIs: that takes answers that prefer one "
            "experiment, and at least three experiments that differ in a KPI"
        )
    target = Path(f"{path.stem}_index.py") if out is None else out
    _write(target, module(index, source))
    return target, index


def module(index: LearnedCost, source: str) -> str:
    """Return the source of a module with `index(kpis)`, and `cost(experiment)` for `source`."""
    first = "\nfrom math import"
    text = index.to_python().replace(first, f"\nfrom functools import cache{first}", 1)
    return text + _COST.format(source=source)


def _write(target: Path, text: str) -> None:
    try:
        if target.exists() and not target.read_bytes().startswith(text[:40].encode()):
            raise StudyError(f"{target} is not an index written by prefcal: choose another --out")
        target.write_text(text, encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}") from error


Part = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Changes:
    """Changes of a space, as typed: "T_s=0.25:1.0", "N_p=26", "filter=0.5"."""

    knobs: Sequence[str] = ()
    freeze: Sequence[str] = ()
    add: Sequence[str] = ()


def respace(name: str, source: str | None, changes: Changes) -> KnobSpace:
    """Change the space of the study called `name`; return the new space.

    Raises:
        StudyError: If there is no such study, or its scenario must be given.
        SettingsError: If the changes cannot be read, or change nothing.
        KnobError: If a range is invalid.
    """
    with open_described(existing(name), writing=True) as file:
        source = trusted_source(name, file.state, source)
        if file.state.configuration["agent"]["agent"] not in RESPACEABLE:
            raise StudyError(f"the agent of study {name!r} cannot change its space")
        event, space = _event(file.state, load(source).space, changes)
        # Check that the study can be resumed with the change before recording it.
        agent_of(step(file.state, 1 << 40, "", event), space)
        file.append(event)
    return space


def _event(state: State, scenario: KnobSpace, changes: Changes) -> tuple[Respaced, KnobSpace]:
    old = with_constraints(space_of(state.configuration), scenario)
    parts = _parts(state, old, scenario)
    asked = _asked(changes, scenario)
    added = {knob_called(k, scenario): v for k, v in map(_value, changes.add)}
    wanted = KnobSpace(
        [_holding(knob, asked.get(knob.name, parts[knob.name])) for knob in scenario],
        scenario.constraints,
        within={**parts, **asked},
    )
    space = respaced(old, wanted, added)
    if space == old and state.configuration.get("scenario_knobs") in (
        None,
        knobs_as_dicts(scenario),
    ):
        raise SettingsError("nothing changes: give --knob, --freeze or --add")
    content = {
        "knobs": knobs_as_dicts(space),
        "within": within_as_dict(space),
        "scenario_knobs": knobs_as_dicts(scenario),
    }
    return Respaced(content, added, _changed_agent(state, old, space, added)), space


def _changed_agent(
    state: State, old: KnobSpace, space: KnobSpace, added: Mapping[str, float]
) -> dict[str, Any]:
    """Return the changes of the agent's configuration, apart from the samples."""
    before = agent_state(state)
    after = moved(before, old, space, added)
    then, now = before.configuration(), after.configuration()
    return {name: value for name, value in now.items() if value != then.get(name)}


def _parts(state: State, old: KnobSpace, scenario: KnobSpace) -> dict[str, Part]:
    """Return the default part of each knob to search: the same as before, or its new range."""
    configuration = state.configuration
    then = space_of({"knobs": configuration.get("scenario_knobs", configuration["knobs"])})
    before = dict(zip(old.names, old.within, strict=True))
    return {
        knob.name: before[knob.name] if knob in then.knobs else (float(knob.low), float(knob.high))
        for knob in scenario
    }


def _asked(changes: Changes, scenario: KnobSpace) -> dict[str, Part]:
    asked: dict[str, Part] = {}
    for text in changes.knobs:
        word, _, range_ = text.rpartition("=")
        low, colon, high = range_.partition(":")
        if not (word and colon):
            raise SettingsError(f"expected KNOB=LOW:HIGH, got {text!r}")
        asked[knob_called(word.strip(), scenario)] = (_number(low, text), _number(high, text))
    for text in changes.freeze:
        word, value = _value(text)
        asked[knob_called(word, scenario)] = (value, value)
    return asked


def _value(text: str) -> tuple[str, float]:
    word, sign, value = text.rpartition("=")
    if not sign:
        raise SettingsError(f"expected KNOB=VALUE, got {text!r}")
    return word.strip(), _number(value, text)


def _number(text: str, whole: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise SettingsError(f"expected a number, got {text!r} in {whole!r}") from error


def _holding(knob: Knob, part: Part) -> Knob:
    """Return `knob`, widened if necessary to include `part`."""
    low, high = min(knob.low, part[0]), max(knob.high, part[1])
    return Knob(knob.name, low, high, knob.unit, knob.scale, knob.integer)


def in_words(space: KnobSpace) -> Mapping[str, str]:
    """Return the searched range of each knob, for people."""
    return {
        knob.name: (f"{low:g}, frozen" if low == high else f"{low:g} to {high:g}")
        + (f" {knob.unit}" if knob.unit else "")
        for knob, (low, high) in zip(space, space.within, strict=True)
    }
