"""Turn command-line values into scenarios, agents, calibrators and θ, and open the study."""

import logging
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import count
from math import inf, isfinite, nan
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from rich.console import Console

import prefcal_agents
from prefcal_agents.registry import WORDS
from prefcal_agents.taste import Told
from prefcal_agents.transfer import Earlier
from prefcal_app.report.export import best_theta, jsonable, versions
from prefcal_app.session.study import QUESTIONS, agent_as_dict, constraint_names, knobs_as_dicts, questions_of
from prefcal_app.simulating import twin_of
from prefcal_app.terminal.showing import say, theta_of
from prefcal_env.errors import KnobError, PrefcalError, ScenarioError, SettingsError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import KnobSpace, theta_key
from prefcal_env.optional import BENCHMARK, load_extensions
from prefcal_env.preferences.answer import Calibrator, Outcome
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
    space_of,
    study_path,
)
from prefcal_env.study.file import left_beside
from prefcal_env.units import conversion
from prefcal_env.wording import did_you_mean, in_words, locate
from prefcal_scenarios.catalog import load
from prefcal_scenarios.names import is_built_in
from prefcal_scenarios.own import fingerprint, module_at
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import Scenario, finds_kpis

from .options import SCORE, SIMULATING, SYNTHETIC, Options
from .parameters import kept_by
from .studies.files import EXPERIMENT, existing, numbered, open_described, wall_clock

if TYPE_CHECKING:
    from prefcal_agents.agent import Agent


# --- Turn command-line values into scenarios, costs, agents, calibrators and θ.


def with_cost(scenario: Scenario, source: str | None) -> Scenario:
    """Return `scenario` with another cost, lower is better.

    `source` is PATH:NAME of a function, or the name of a KPI; None leaves the scenario unchanged.
    """
    if source is None:
        return scenario if scenario.cost is None else replace(scenario, cost=KnownCost(scenario.cost))
    path, _, name = source.rpartition(":")
    if not (path.endswith(".py") and name):
        names = [kpi.name for kpi in scenario.kpis if kpi.goal is not None]
        if source not in names and not finds_kpis(scenario):
            raise ScenarioError(_no_cost(source, names))
        return replace(scenario, cost=KnownCost(partial(_kpi_cost, source, scenario)))
    found = getattr(module_at(Path(path)), name, None)
    if not callable(found):
        got = "nothing of that name" if found is None else repr(found)
        raise ScenarioError(f"cost {source!r} must be a function of an experiment, got {got}")
    return replace(scenario, cost=KnownCost(partial(_function_cost, source, found)))


_SAYS = logging.getLogger("prefcal.cost")


class _UnknownCostError(ScenarioError):
    """An experiment has no cost."""


class KnownCost:
    """A cost that is infinite, and said to be unknown, where a function gives none: θ has failed there.

    Args:
        cost: Function that returns the cost of an experiment; it may raise, or return what is no number.
    """

    def __init__(self, cost: Callable[[Experiment], Any]) -> None:
        self._cost, self._known = cost, False
        self.unknown: dict[bytes, str] = {}
        """Why the cost is unknown, by the key of θ; the report says it."""
        self._first: Exception | None = None

    @property
    def trouble(self) -> Exception | None:
        """What went wrong, if no experiment has had a cost."""
        return None if self._known else self._first

    def __call__(self, experiment: Experiment) -> float:
        """Return the cost of an experiment, infinite if it is unknown."""
        try:
            return self._number(experiment)
        except Exception as error:
            if isinstance(error, PrefcalError) and not isinstance(error, _UnknownCostError):
                raise
            words, key = in_words(locate(error)), theta_key(experiment.theta)
            self._first = self._first or error
            if key not in self.unknown:
                _SAYS.info("an experiment counts as failed, as its cost is unknown: %s", words)
            self.unknown[key] = words
            return inf

    def _number(self, experiment: Experiment) -> float:
        found = self._cost(experiment)
        try:
            value = float(found)
        except (TypeError, ValueError):
            value = nan
        if value != value:
            raise _UnknownCostError(
                f"cost must be a number, got {found!r} at θ = {experiment.theta.tolist()}"
            )
        self._known = self._known or isfinite(value)
        return value


def _function_cost(source: str, function: Callable[[Experiment], Any], experiment: Experiment) -> float:
    """Return the cost of `experiment`. Raises _UnknownCostError if it is not a finite number."""
    value = function(experiment)
    if isinstance(value, bool) or not isinstance(value, Real) or not isfinite(float(value)):
        raise _UnknownCostError(
            f"cost {source!r} must give a finite number, got {value!r} at θ = "
            f"{experiment.theta.tolist()}. A KPI can be infinite, such as a settling time: "
            "bound it, for example min(kpis['settling_time'], 1e3)"
        )
    return float(value)


def _kpi_cost(name: str, scenario: Scenario, experiment: Experiment) -> float:
    """Return a KPI of `experiment`; infinite if it was stopped."""
    if not len(experiment.t) or experiment.end.interrupted:
        return inf  # it may have stopped before the KPI could be measured
    found = outcome(scenario, experiment)
    if name not in found and name in [kpi.name for kpi in scenario.kpis]:
        got = experiment.kpis.get(name)
        what = "missing" if got is None else got
        raise _UnknownCostError(f"the KPI {name!r} is {what} at θ = {experiment.theta.tolist()}")
    if name not in found:
        raise ScenarioError(_no_cost(name, found))
    return found[name]


def _no_cost(source: str, names: Iterable[str]) -> str:
    there = ", ".join(map(repr, names)) or "none"
    return (
        f"a cost must be path/to/own.py:NAME or a KPI of the scenario with a good direction "
        f"({there}), got {source!r}.{did_you_mean(source, names)}".rstrip(".")
    )


def make_agent(
    options: Options, scenario: Scenario, start: Sequence[Float[np.ndarray, " n"]] = ()
) -> "Agent":
    """Return the agent that the options select; it starts with the physical θ in `start`."""
    _check_agent(options, scenario)
    extra: dict[str, Any] = {}
    if options.agent in SIMULATING:
        extra["n_simulated"] = options.simulate
    if options.agent == "glisp":
        extra["settings"] = prefcal_agents.GLISpSettings(
            questions_per_experiment=options.questions_per_experiment, kpis=options.outcomes
        )
    if options.taste is not None:
        extra["taste"] = taste_of(options.taste, scenario)
    if start:
        extra["start"] = start
    agent: Agent = WORDS[options.agent].load()(
        scenario.space, n_init=options.n_init, n_max=options.n_max, seed=options.seed, **extra
    )
    return agent


def _check_agent(options: Options, scenario: Scenario) -> None:
    """Raise SettingsError if something does not fit the agent."""
    if options.agent not in WORDS:
        hint = did_you_mean(options.agent, WORDS)
        raise SettingsError(
            f"--agent must be one of {', '.join(WORDS)}, got {options.agent!r}.{hint}".rstrip(".")
        )
    _check_taken(options)
    if options.cost is not None and options.calibrator not in (SCORE, SYNTHETIC):
        raise SettingsError(
            "--cost is what the calibrator synthetic and the agent glis go by: add --calibrator "
            f"synthetic, or --agent glis; got --calibrator {options.calibrator}"
        )
    if options.agent in SIMULATING:
        _check_simulating(options, scenario)
    if WORDS[options.agent].by_value:
        _check_score(options, scenario)


def _check_taken(options: Options) -> None:
    for name, (parameter, kept) in kept_by(Options).items():
        if kept.agents and options.agent not in kept.agents and options.changed(name):
            raise SettingsError(
                f"only the agent {' or '.join(kept.agents)} takes {parameter.flag}, not "
                f"{options.agent!r}: leave it out, or choose --agent {kept.agents[0]}"
            )


def _check_simulating(options: Options, scenario: Scenario) -> None:
    agent, name = f"--agent {options.agent}", f"scenario {scenario.name!r}"
    if options.simulate < 1:
        raise SettingsError(f"{agent} needs simulations: leave --simulate 0 out, or choose --agent glisp")
    if options.n_init > 1:
        raise SettingsError(f"{agent} has no initial experiments: leave --n-init out")
    model = scenario if options.twin is None else load(options.twin)
    if options.twin is not None:
        twin_of(scenario, model)
    elif scenario.source.asks:
        raise SettingsError(
            f"{name} is a rig, and nothing runs on it unseen: leave --simulate and {agent} out, "
            "or give a model of it with --twin"
        )
    elif not scenario.simulated:
        raise SettingsError(
            f"{name} does not let experiments run unseen: leave --simulate and {agent} out, or, "
            "if it is your own and a run is a quick simulation, state "
            "Scenario(..., simulated=True)"
        )
    if options.robust:
        model.source.elsewhere.here.varied()


def _check_score(options: Options, scenario: Scenario) -> None:
    if scenario.cost is None:
        raise SettingsError(
            f"agent {options.agent!r} learns from a score, and scenario {scenario.name!r} has "
            "none: choose another agent, or give a score with --cost, the name of a KPI or "
            "own.py:NAME"
        )
    if options.calibrator != SCORE:
        raise SettingsError(
            f"agent {options.agent!r} learns from the scenario's score and needs no answers: "
            f"leave --calibrator out, got {options.calibrator!r}"
        )


def make_calibrator(options: Options, scenario: Scenario) -> Calibrator[Experiment] | None:
    """Return the scenario's calibrator that the options select; None if the agent gets scores."""
    if WORDS[options.agent].by_value:
        return None
    from prefcal_env.calibrators import LatentCost

    calibrators = dict(scenario.calibrators)
    if scenario.cost is not None and (options.cost is not None or not calibrators):
        cost = scenario.cost
        calibrators[SYNTHETIC] = lambda seed: LatentCost(cost, seed=seed)
    if options.calibrator not in calibrators and is_built_in(options.scenario):
        load_extensions()  # which have people for our closed loops
        calibrators.update(load(options.scenario).calibrators)
    if options.calibrator not in calibrators:
        raise SettingsError(_unknown(options.calibrator, scenario, sorted(calibrators)))
    return calibrators[options.calibrator](options.seed)


def _unknown(calibrator: str, scenario: Scenario, known: list[str]) -> str:
    name = f"scenario {scenario.name!r}"
    if scenario.source.asks:
        return f"{name} is a rig that only a person can run: its calibrator is human, got {calibrator!r}"
    if not known:
        kpi = next((kpi.name for kpi in scenario.kpis if kpi.goal is not None), "")
        such_as = f"--cost {shlex.quote(kpi)}" if kpi else "--cost NAME; `prefcal check` lists them"
        more = f". The benchmark has simulated people: {BENCHMARK}" if is_built_in(scenario.name) else ""
        return (
            f"{name} has no cost, so only people can compare: leave --calibrator {calibrator} out, "
            f"or say what to go by: a KPI ({such_as}), or a function in own.py with "
            f"--cost own.py:NAME{more}"
        )
    names = sorted(["human", *known])
    # The benchmark adds more than forty to each scenario: a line of all of them is read by nobody.
    said = names if len(names) <= 20 else [*names[:12], f"{len(names) - 12} more"]
    return (
        f"--calibrator must be one of {', '.join(said)} for {name}, "
        f"got {calibrator!r}.{did_you_mean(calibrator, names)}"
    ).rstrip(".")


def follows_cost(options: Options, scenario: Scenario) -> bool:
    """Return whether the answers follow the scenario's cost, which no person chose.

    This is the case for scores, for a user's own cost (`--cost`), for a calibrator called
    "synthetic", and for any calibrator that compares by a latent cost.
    """
    from prefcal_env.calibrators import LatentCost

    if scenario.cost is None:
        return False
    if options.calibrator in (SCORE, SYNTHETIC) or options.cost is not None:
        return True
    made = scenario.calibrators.get(options.calibrator)
    return made is not None and isinstance(made(options.seed), LatentCost)


def start_of(text: str, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the physical θ that `text` describes, shape (n,).

    The text is `knob=value, ...` for every knob in any order, the name of one of the scenario's
    references, an experiment of a study, as MINE:3 or MINE:best, or a best.json.
    """
    if text.endswith(".json"):
        return best_theta(text, scenario)
    if "=" in text:
        return theta_of(text, scenario.space)
    if text in scenario.references:
        return np.array(scenario.references[text], dtype=float)
    if (study := EXPERIMENT.fullmatch(text)) is not None:
        return _theta_of_study(study[1], study[2], scenario.space)
    known = sorted(scenario.references)
    raise SettingsError(
        f"--start must be KNOB=VALUE, ..., one of the references {known} of scenario "
        f"{scenario.name!r}, STUDY:best or a best.json, got {text!r}.{did_you_mean(text, known)}".rstrip(".")
    )


def _theta_of_study(name: str, which: str, space: KnobSpace) -> Float[np.ndarray, " n"]:
    """Return the θ of an experiment of another study in `space`, shape (n,); see `Earlier`."""
    with open_described(existing(name)) as file:
        state = file.state
    theta = state.history.samples[numbered(name, which, state)].theta
    earlier = Earlier(space_of(state.configuration).knobs, theta)
    if missing := earlier.missing(space, {}):
        raise KnobError(f"study {name!r} has no knobs {missing}: give every knob, as KNOB=VALUE, ...")
    start = earlier.start(space)
    if start is None:
        raise SettingsError(f"the constraints refuse the θ of {name}:{which}: give one as KNOB=VALUE, ...")
    return np.array(start)


def taste_of(name: str, scenario: Scenario) -> tuple[Told, ...]:
    """Return the answers of an earlier study about KPIs that `scenario` has, too, in its units."""
    with open_described(existing(name)) as file:
        history, then = file.state.history, file.state.configuration["kpis"]
    now = {kpi.name: kpi.unit for kpi in scenario.kpis}
    shared = {}
    for kpi in then:
        same = conversion(kpi["unit"], now[kpi["name"]]) if kpi["name"] in now else None
        if same is not None and not same.offset:
            shared[kpi["name"]] = same

    def here(outcome: Outcome) -> Outcome:
        return Outcome({name: shared[name].to(value) for name, value in outcome.items() if name in shared})

    told = [Told(each.answer, here(each.first), here(each.second)) for each in Told.all_of(history)]
    found = tuple(each for each in told if each.first and each.second)
    if not found:
        raise SettingsError(
            f"--taste {name}: none of its answers is about a KPI of scenario {scenario.name!r}. It has "
            f"{len(told)} answers about {[kpi['name'] for kpi in then]}; KPIs need the same name, and a unit "
            f"that converts, as one of {list(now)}"
        )
    return found


# --- Open the study that a command works on: create a new one or resume an existing one.

IN_MEMORY = ":memory:"


def open_study(given: Mapping[str, Any], scenario: Scenario) -> tuple[StudyFile, Options, bool]:
    """Open the study that `given` names, and create it if it does not exist.

    Without a name, a person's study gets the next free name in their data folder, and a synthetic
    calibrator's study is kept in memory, since it can be repeated at any time.

    Returns:
        The study's file, its options, with its name, as it goes on now, and whether it existed before.
    """
    options = Options.of(given, len(scenario.space), simulated=scenario.simulated)
    if options.study is not None:
        path = study_path(options.study)
        if path.is_dir():
            raise StudyError(f"--study must be a name or a file, but {options.study!r} is a folder")
        if path.exists():
            return *_resume(path, given, scenario), True
        return _create(path, options, scenario), options, False
    if not options.by_a_person:
        return _create(IN_MEMORY, options, scenario), options, False
    return *_create_named(options, scenario), False


def _create_named(options: Options, scenario: Scenario) -> tuple[StudyFile, Options]:
    """Create a study under the first of the names SCENARIO-1, SCENARIO-2, ... that is free."""
    base = re.sub(r"[^A-Za-z0-9_-]+", "-", scenario.name).strip("-") or "study"
    for number in count(1):
        path = study_path(name := f"{base}-{number}")
        if path.exists() or left_beside(path):
            continue
        try:
            return _create(path, options, scenario), replace(options, study=name)
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


def _resume(path: Path, given: Mapping[str, Any], scenario: Scenario) -> tuple[StudyFile, Options]:
    with ExitStack() as undo:
        file = undo.enter_context(open_described(path, writing=True))
        state = file.state
        if state.configuration["name"] != scenario.name:
            raise StudyError(
                f"study {given['study']!r} calibrates {state.configuration['name']!r}, "
                f"not {scenario.name!r}: name that scenario, or another study"
            )
        if given.get("n_max") == state.configuration["options"]["n_max"]:
            # The same command again: keep the experiments that were added on the page.
            given = {name: value for name, value in given.items() if name != "n_max"}
        options = Options.resumed(by_now(state), given)
        if options.questions_per_experiment != questions_of(state.configuration):
            _check_taken(options)
            file.append(Adjusted({QUESTIONS: options.questions_per_experiment}))
        if options.n_max > state.n_max:
            file.append(Extended(options.n_max), *([Reopened()] if state.ended else []))
        undo.pop_all()  # it stays open
    return file, options


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
def kept_if_worth_it(
    file: StudyFile, options: Options, scenario: Scenario, messages: Console, *, resumed: bool
) -> Iterator[None]:
    """Close a study at the end; remove it if it was started here and is not worth keeping.

    `resumed` is whether it existed before. What becomes of it is printed unless an error is anyway.
    """
    keep, refused, name = True, False, options.study
    try:
        with file:
            try:
                yield
            except PrefcalError:
                refused = True
                raise
            except KeyboardInterrupt:
                later = f"; its report: prefcal report {name}" if file.state.history.answered else ""
                saved = file.trouble() or (f"Every answer is saved{later}" if name else "")
                say(messages, f"Stopped at once. {saved}".strip())
                raise
            finally:
                keep = resumed or name is None or worth_keeping(file, scenario)
                # Another file that was put in its place is not ours to remove.
                keep = keep or not file.in_place or file.trouble() is not None
    finally:
        # A study that is open in another process, which may add answers, is not removed.
        with suppress(StudyError):
            if not keep:
                remove_study(file.path)
                if not refused:
                    say(messages, f"No answer was given, so study {name} was not kept.")
