"""Open the study that a command works on: create a new one or resume an existing one."""

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from rich.console import Console

from prefcal_app.cli.studies.files import open_described, wall_clock
from prefcal_app.report.export import jsonable, versions
from prefcal_app.session.study.memory import (
    QUESTIONS,
    agent_as_dict,
    constraint_names,
    knobs_as_dicts,
    questions_of,
)
from prefcal_app.terminal.showing import say
from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.study import (
    Adjusted,
    Answered,
    Created,
    Event,
    Extended,
    Failed,
    Finished,
    Reopened,
    Shown,
    State,
    StudyFile,
    Suggested,
    make_data_folder,
    remove_study,
    study_path,
)
from prefcal_env.study.connection import left_beside
from prefcal_scenarios.names import is_built_in
from prefcal_scenarios.own.source import fingerprint
from prefcal_scenarios.scenario import Scenario

from .choices import check_agent_takes, make_agent, make_calibrator, start_of
from .options import Options

IN_MEMORY = ":memory:"


@dataclass(frozen=True, slots=True)
class Opened:
    """An open study.

    Args:
        file: Study file.
        options: Options that the study was started with, updated by those given now.
        name: Name of the study, as in `--study`; None if it is kept in memory only.
        resumed: Whether the study existed before.
    """

    file: StudyFile
    options: Options
    name: str | None
    resumed: bool


def open_study(given: Mapping[str, Any], scenario: Scenario, name: str | None) -> Opened:
    """Open the study called `name`, and create it if it does not exist.

    Without a name, a person's study gets the next free name in their data folder, and a synthetic
    calibrator's study is kept in memory, since it can be repeated at any time.

    Raises:
        StudyError: If the study cannot be opened or written, or belongs to another scenario.
        SettingsError: If an option contradicts those that the study was started with.
    """
    options = Options.of(given, len(scenario.space), simulated=scenario.simulated)
    if name is None and not options.by_a_person:
        return Opened(_create(IN_MEMORY, options, scenario), options, None, False)
    if name is None:
        return _open_new(options, scenario)
    path = study_path(name)
    if path.is_dir():
        raise StudyError(f"--study must be a name or a file, but {name!r} is a folder")
    if path.exists():
        return _resume(path, name, given, scenario)
    return Opened(_create(path, options, scenario), options, name, False)


def _open_new(options: Options, scenario: Scenario) -> Opened:
    """Create a study under the first of the names SCENARIO-1, SCENARIO-2, ... that is free."""
    base = re.sub(r"[^A-Za-z0-9_-]+", "-", scenario.name).strip("-") or "study"
    for number in count(1):
        path = study_path(name := f"{base}-{number}")
        if path.exists() or left_beside(path):
            continue
        try:
            return Opened(_create(path, options, scenario), options, name, False)
        except StudyError as error:
            if not isinstance(error.__cause__, FileExistsError):
                raise  # otherwise another command has just taken the name
    raise AssertionError("numbers never end")


def _create(path: Path | str, options: Options, scenario: Scenario) -> StudyFile:
    # Check everything before creating the file.
    configuration = _configuration(options, scenario)
    if not options.by_a_person:
        make_calibrator(options, scenario)
    if path != IN_MEMORY:
        # Not in memory: there, an edited scenario would count as another study's report folder.
        configuration["fingerprint"] = fingerprint(options.scenario)
        make_data_folder(Path(path))
    return StudyFile.create(path, configuration, clock=wall_clock)


def _configuration(options: Options, scenario: Scenario) -> dict[str, Any]:
    start = [start_of(text, scenario) for text in options.start]
    names = constraint_names(scenario.space)
    configuration = {
        "scenario": options.scenario,
        "name": scenario.name,
        "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        # Absent without constraints, so that configurations without them stay the same.
        **({"constraints": names} if names else {}),
        "kpis": [{"name": k.name, "title": k.title, "unit": k.unit} for k in scenario.kpis],
        "agent": agent_as_dict(make_agent(options, scenario, start)),
        "n_max": options.n_max,
        "seed": options.seed,
        "options": options.as_dict(),
        "versions": versions(),
    }
    plain: dict[str, Any] = jsonable(configuration)
    return plain


def _resume(path: Path, name: str, given: Mapping[str, Any], scenario: Scenario) -> Opened:
    with ExitStack() as undo:
        file = undo.enter_context(open_described(path, writing=True))
        state = file.state
        if state.configuration["name"] != scenario.name:
            raise StudyError(
                f"study {name!r} calibrates {state.configuration['name']!r}, "
                f"not {scenario.name!r}: name that scenario, or another study"
            )
        if given.get("n_max") == state.configuration["options"]["n_max"]:
            # The same command again: keep the experiments that were added on the page.
            given = {**given, "n_max": None}
        options = Options.resumed(by_now(state), given)
        if options.questions_per_experiment != questions_of(state.configuration):
            check_agent_takes(options)
            file.append(Adjusted({QUESTIONS: options.questions_per_experiment}))
        if options.n_max > state.n_max:
            file.append(Extended(options.n_max), *([Reopened()] if state.ended else []))
        undo.pop_all()  # it stays open
    return Opened(file, options, name, True)


def by_now(state: State) -> dict[str, Any]:
    """Return the study's current options: those that it was started with, and later changes."""
    return {
        **state.configuration["options"],
        "n_max": state.n_max,
        QUESTIONS: questions_of(state.configuration),
    }


def worth_keeping(file: StudyFile, scenario: Scenario) -> bool:
    """Return whether a study holds more than the same command would reproduce.

    It does if it holds any answer, mark or note, even one that was undone. Experiments count too,
    except those of built-in scenarios, which are cheap simulations.
    """
    if any(_by_a_person(recorded.event) for recorded in file.events()):
        return True
    cheap = is_built_in(file.state.configuration["scenario"]) and not scenario.source.asks
    return bool(file.state.finished) and not cheap


def _by_a_person(event: Event) -> bool:
    if isinstance(event, Answered):
        return event.incumbent is not None  # the first experiment has nothing to compare with
    return not isinstance(event, Created | Suggested | Finished | Failed | Shown)


@contextmanager
def kept_if_worth_it(opened: Opened, scenario: Scenario, messages: Console) -> Iterator[None]:
    """Close a study at the end; remove it if it was started here and is not worth keeping.

    Args:
        opened: Study to close.
        scenario: Scenario of the study.
        messages: Where to print that the study was not kept, unless an error is printed anyway.
    """
    keep, refused = True, False
    try:
        with opened.file as file:
            try:
                yield
            except PrefcalError:
                refused = True
                raise
            finally:
                keep = opened.resumed or opened.name is None or worth_keeping(file, scenario)
                # Another file that was put in its place is not ours to remove.
                keep = keep or not file.in_place or file.trouble() is not None
    finally:
        # A study that is open in another process, which may add answers, is not removed.
        with suppress(StudyError):
            if not keep:
                remove_study(opened.file.path)
                if not refused:
                    say(messages, f"No answer was given, so study {opened.name} was not kept.")
