"""Turn command-line values into agents, calibrators and θ."""

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.registry import WORDS
from prefcal_app.simulating import twin_of
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.live import LiveRig
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.rig import Rig
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario

from .options import SCORE, SIMULATING, SYNTHETIC, Options
from .parameters import kept_by

if TYPE_CHECKING:
    from prefcal_agents.protocol.agent import Agent

Thetas = Sequence[Float[np.ndarray, " n"]]


def make_agent(options: Options, scenario: Scenario, start: Thetas = ()) -> "Agent":
    """Return the agent that the options select; it starts with the physical θ in `start`.

    Raises:
        SettingsError: If the agent is unknown, rejects its settings, or does not take an option.
        KnobError: If a θ in `start` is outside the space.
    """
    if options.agent not in WORDS:
        hint = did_you_mean(options.agent, WORDS)
        raise SettingsError(
            f"--agent must be one of {', '.join(WORDS)}, got {options.agent!r}.{hint}".rstrip(".")
        )
    check_agent_takes(options)
    _check_cost(options)
    _check_simulates(options, scenario)
    if WORDS[options.agent].by_value:
        _check_score(options, scenario)
    import prefcal_agents

    extra = _fed(options)
    settings = extra.pop("settings", None)
    if settings:
        extra["settings"] = prefcal_agents.GLISpSettings(**settings)
    if start:
        extra["start"] = start
    agent: Agent = WORDS[options.agent].load()(
        scenario.space, n_init=options.n_init, n_max=options.n_max, seed=options.seed, **extra
    )
    return agent


def check_agent_takes(options: Options) -> None:
    """Raise SettingsError if an option was set that the agent does not take."""
    for name, (parameter, kept) in kept_by(Options).items():
        if not kept.agents or options.agent in kept.agents or not options.changed(name):
            continue
        usual = f"only the agent {' or '.join(kept.agents)} takes {parameter.flag}, not {{agent!r}}"
        raise SettingsError((kept.refusal or usual).format(agent=options.agent))


def _check_cost(options: Options) -> None:
    """Raise SettingsError if a cost was given and someone else answers."""
    if options.cost is not None and options.calibrator not in (SCORE, SYNTHETIC):
        raise SettingsError(
            "--cost is what the calibrator synthetic and the agent glis go by: add --calibrator "
            f"synthetic, or --agent glis; got --calibrator {options.calibrator}"
        )


def _check_simulates(options: Options, scenario: Scenario) -> None:
    """Raise SettingsError if the options do not fit what may run unseen."""
    if options.agent not in SIMULATING:
        return
    _check_counts(options)
    if options.twin is not None:
        twin_of(scenario, load(options.twin))
        return
    if isinstance(scenario.run, Rig | LiveRig):
        raise SettingsError(
            f"scenario {scenario.name!r} is a rig, and nothing runs on it unseen: leave --simulate "
            f"and --agent {options.agent} out, or give a model of it with --twin"
        )
    if not scenario.simulated:
        raise SettingsError(
            f"scenario {scenario.name!r} does not let experiments run unseen: leave --simulate and "
            f"--agent {options.agent} out, or, if it is your own and a run is a quick simulation, "
            "state Scenario(..., simulated=True)"
        )


def _check_counts(options: Options) -> None:
    """Raise SettingsError if numbers do not fit an agent that simulates."""
    if options.simulate < 1:
        raise SettingsError(
            f"--agent {options.agent} needs simulations: leave --simulate 0 out, or choose "
            "--agent glisp"
        )
    if options.n_init > 1:
        raise SettingsError(
            f"--agent {options.agent} has no initial experiments: leave --n-init out"
        )


def _fed(options: Options) -> dict[str, Any]:
    """Return the agent's keyword arguments that come from the options."""
    arguments: dict[str, Any] = {}
    for name, (_, kept) in kept_by(Options).items():
        if not kept.feeds or not options.changed(name):
            continue
        value = getattr(options, name)
        where, _, setting = kept.feeds.partition(".")
        if setting:
            arguments.setdefault(where, {})[setting] = value
        else:
            arguments[where] = value
    return arguments


def _unknown(calibrator: str, scenario: Scenario, known: list[str]) -> str:
    """Return the error message for a calibrator that the scenario does not have."""
    if isinstance(scenario.run, Rig | LiveRig):
        return (
            f"scenario {scenario.name!r} is a rig that only a person can run: its calibrator is "
            f"human, got {calibrator!r}"
        )
    if not known:
        return (
            f"scenario {scenario.name!r} has no cost, so only people can compare: leave "
            f"--calibrator {calibrator} out, or say what to go by: a KPI ({_such_as(scenario)}), "
            "or a function in own.py with --cost own.py:NAME"
        )
    names = sorted(["human", *known])
    return (
        f"--calibrator must be one of {', '.join(names)} for scenario {scenario.name!r}, "
        f"got {calibrator!r}.{did_you_mean(calibrator, names)}"
    ).rstrip(".")


def _such_as(scenario: Scenario) -> str:
    """Return the option that makes a KPI the cost, or where their names are."""
    name = next((kpi.name for kpi in scenario.kpis if kpi.goal is not None), "")
    return f"--cost {shlex.quote(name)}" if name else "--cost NAME; `prefcal check` lists them"


def make_calibrator(options: Options, scenario: Scenario) -> Calibrator[Experiment] | None:
    """Return the scenario's calibrator that the options select; None if the agent gets scores.

    Raises:
        SettingsError: If the calibrator is unknown.
    """
    if WORDS[options.agent].by_value:
        return None
    from prefcal_env.calibrators import LatentCost

    calibrators = dict(scenario.calibrators)
    if scenario.cost is not None and (options.cost is not None or not calibrators):
        cost = scenario.cost
        calibrators[SYNTHETIC] = lambda seed: LatentCost(cost, seed=seed)
    if options.calibrator not in calibrators:
        raise SettingsError(_unknown(options.calibrator, scenario, sorted(calibrators)))
    return calibrators[options.calibrator](options.seed)


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


def _check_score(options: Options, scenario: Scenario) -> None:
    """Raise SettingsError for options that do not fit an agent that learns from scores."""
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


def start_of(text: str, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the physical θ that `text` describes, shape (n,).

    The text is either `knob=value, ...` for every knob in any order, or the name of one of the
    scenario's references.

    Raises:
        SettingsError: If a reference or knob is unknown, a knob is missing, or a value is not a
            number.
        KnobError: If a value is outside its knob's range.
    """
    if "=" in text:
        return scenario.space.check(theta_of(text, scenario.space))
    if text not in scenario.references:
        known = sorted(scenario.references)
        raise SettingsError(
            f"--start must be KNOB=VALUE, ... or one of the references {known} of scenario "
            f"{scenario.name!r}, got {text!r}.{did_you_mean(text, known)}".rstrip(".")
        )
    return np.array(scenario.references[text], dtype=float)


def theta_of(text: str, space: KnobSpace) -> Float[np.ndarray, " n"]:
    """Return the physical θ of `knob=value, ...`, shape (n,), without checking the ranges.

    Raises:
        SettingsError: If a knob is unknown, missing or given twice, or a value is not a number.
    """
    given: dict[str, float] = {}
    for part in text.split(","):
        word, sign, value = (piece.strip() for piece in part.rpartition("="))
        if not sign:
            raise SettingsError(f"expected KNOB=VALUE, got {part.strip()!r} in {text!r}")
        name = knob_called(word, space)
        if name in given:
            raise SettingsError(f"knob {name!r} is given twice in {text!r}")
        try:
            given[name] = float(value)
        except ValueError as error:
            raise SettingsError(f"knob {name!r} must be a number, got {value!r}") from error
    missing = [name for name in space.names if name not in given]
    if missing:
        raise SettingsError(f"every knob needs a value, {missing} are missing in {text!r}")
    return np.array([given[name] for name in space.names])


def knob_called(word: str, space: KnobSpace) -> str:
    """Return the name of the knob that matches `word`, a name or an unambiguous prefix.

    Underscores in `word` match spaces.

    Raises:
        SettingsError: If no knob or more than one knob matches.
    """
    plain = {name.replace(" ", "_"): name for name in space.names}
    wanted = word.replace(" ", "_")
    if wanted in plain:
        return plain[wanted]
    found = [name for key, name in plain.items() if wanted and key.startswith(wanted)]
    if len(found) != 1:
        hint = did_you_mean(word, plain)
        names = ", ".join(plain)
        raise SettingsError(f"knob must be one of {names}, got {word!r}.{hint}".rstrip("."))
    return found[0]
