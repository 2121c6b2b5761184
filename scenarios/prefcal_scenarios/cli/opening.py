"""Which study a command works on: a new one, or one resumed where it stands."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from prefcal_env.errors import StudyError
from prefcal_env.studies import (
    Adjusted,
    Extended,
    Reopened,
    State,
    StudyFile,
    make_data_folder,
    study_path,
    to_text,
)
from prefcal_scenarios.cli.choices import check_questions, make_agent, make_calibrator
from prefcal_scenarios.cli.clock import wall_clock
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.earlier import taken_from
from prefcal_scenarios.cli.options import Options
from prefcal_scenarios.cli.start import start_of
from prefcal_scenarios.cli.target import check_target, on_target, target_of
from prefcal_scenarios.export import jsonable, versions
from prefcal_scenarios.interview.memory import (
    QUESTIONS,
    agent_as_dict,
    constraint_names,
    knobs_as_dicts,
    questions_of,
)
from prefcal_scenarios.scenario import Scenario

IN_MEMORY = ":memory:"


@dataclass(frozen=True, slots=True)
class Opened:
    """An open study.

    Args:
        file: The study file.
        options: What it was begun with, and what was asked for on top of it.
        name: How `--study` calls it; None where it is kept in memory only.
        resumed: Whether it was there before.
    """

    file: StudyFile
    options: Options
    name: str | None
    resumed: bool


def open_study(given: Mapping[str, Any], scenario: Scenario, name: str | None) -> Opened:
    """Open the study called `name`, a new one if there is none.

    Without a name, a person's study gets the next free one of their data folder, and a synthetic
    calibrator's is kept in memory: it can be run again any time.

    Raises:
        StudyError: it cannot be opened, is another scenario's, or cannot be written.
        SettingsError: an option contradicts what the study was begun with.
    """
    options = Options.of(given, len(scenario.space))
    if name is None and not options.by_a_person:
        return Opened(_create(IN_MEMORY, options, scenario), options, None, False)
    name = _free(scenario.name) if name is None else name
    path = study_path(name)
    if path.is_dir():
        raise StudyError(f"--study must be a name or a file, but {name!r} is a folder")
    if path.exists():
        return _resume(path, name, given, scenario)
    return Opened(_create(path, options, scenario), options, name, False)


def identity(file: StudyFile) -> str:
    """Return a text that two studies share only if they are the same study.

    A file is told apart by what it was started with and when; a copy of it is the same study.
    One in memory by the former alone: the same command gives the same study, bit for bit.
    """
    first = next(iter(file.events()))
    at = "" if file.path == IN_MEMORY else first.at
    return sha256(f"{at}\n{to_text(first.event)}".encode()).hexdigest()[:16]


def default_folder(opened: Opened, scenario: str) -> Path:
    """Where the report goes unless the user says otherwise: prefcal-STUDY, one for each study.

    A study that is kept in no file has its scenario and its seed for a name.
    """
    if opened.name is None:
        return Path(f"prefcal-{scenario}-{opened.options.seed}")
    return Path(f"prefcal-{study_path(opened.name).stem}")


def _create(path: Path | str, options: Options, scenario: Scenario) -> StudyFile:
    # Everything is refused before there is a file.
    configuration = _configuration(options, scenario)
    if not options.by_a_person:
        make_calibrator(options, on_target(scenario, configuration))
    if path != IN_MEMORY:
        make_data_folder(Path(path))
    return StudyFile.create(path, configuration, clock=wall_clock)


def _configuration(options: Options, scenario: Scenario) -> dict[str, Any]:
    mine = [start_of(text, scenario) for text in options.start]
    taken = taken_from(options, scenario.space, mine)
    theirs = [] if taken is None else taken.beside(mine, scenario.space)
    configuration = {
        "scenario": options.scenario,
        "name": scenario.name,
        "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        **_constraints(scenario),
        "kpis": [{"name": k.name, "title": k.title, "unit": k.unit} for k in scenario.kpis],
        "agent": agent_as_dict(make_agent(options, scenario, [*mine, *theirs])),
        **({} if taken is None else {"earlier": taken.as_dict()}),
        **target_of(options.processor, scenario),
        "n_max": options.n_max,
        "seed": options.seed,
        "options": options.as_dict(),
        "versions": versions(),
    }
    plain: dict[str, Any] = jsonable(configuration)
    return plain


def _constraints(scenario: Scenario) -> dict[str, Any]:
    # Absent where there are none: so the studies of before and of today read the same.
    names = constraint_names(scenario.space)
    return {"constraints": names} if names else {}


def _resume(path: Path, name: str, given: Mapping[str, Any], scenario: Scenario) -> Opened:
    file = open_described(path)
    try:
        state = file.state
        if state.configuration["name"] != scenario.name:
            raise StudyError(
                f"study {name!r} calibrates {state.configuration['name']!r}, "
                f"not {scenario.name!r}: name that scenario, or another study"
            )
        begun = state.configuration["options"]
        if given.get("n_max") == begun["n_max"]:
            # The same line again: experiments that the page has added since stay.
            given = {**given, "n_max": None}
        check_target(given.get("processor"), state.configuration)
        options = Options.resumed(by_now(state), {**given, "processor": None})
        if options.questions_per_experiment != questions_of(state.configuration):
            check_questions(options)
            file.append(Adjusted({QUESTIONS: options.questions_per_experiment}))
        if options.n_max > state.n_max:
            file.append(Extended(options.n_max), *([Reopened()] if state.ended else []))
    except BaseException:
        file.close()
        raise
    return Opened(file, options, name, True)


def by_now(state: State) -> dict[str, Any]:
    """The options that a study was begun with, as far as they were not changed since."""
    return {
        **state.configuration["options"],
        "n_max": state.n_max,
        QUESTIONS: questions_of(state.configuration),
    }


def _free(scenario: str, taken: Callable[[str], bool] | None = None) -> str:
    """The first of scenario-1, scenario-2, ... that no study bears."""
    base = re.sub(r"[^A-Za-z0-9_-]+", "-", scenario).strip("-") or "study"
    used = taken or (lambda name: study_path(name).exists())
    number = 1
    while used(f"{base}-{number}"):
        number += 1
    return f"{base}-{number}"
