"""From the words of the command line to agents, calibrators, θ and processors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.registry import WORDS
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.mpc.processors import as_dict, processor_of, read_processor
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.rig import Rig
from prefcal_scenarios.own.nearest import did_you_mean
from prefcal_scenarios.scenario import Scenario

from .options import SCORE, Options
from .parameters import kept_by

if TYPE_CHECKING:
    from prefcal_agents.protocol.agent import AnyAgent

Thetas = Sequence[Float[np.ndarray, " n"]]

_PROCESSOR = "processor"
"""Key of the processor in a study's configuration."""


def make_agent(options: Options, scenario: Scenario, start: Thetas = ()) -> "AnyAgent":
    """Make the agent of the options, which begins with the physical θ in `start`.

    Raises:
        SettingsError: an unknown agent, settings that it refuses, or options for another one.
        KnobError: a first θ that is outside the space.
    """
    if options.agent not in WORDS:
        hint = did_you_mean(options.agent, WORDS)
        raise SettingsError(
            f"--agent must be one of {', '.join(WORDS)}, got {options.agent!r}.{hint}".rstrip(".")
        )
    check_agent_takes(options)
    if WORDS[options.agent].by_value:
        _check_score(options, scenario)
    import prefcal_agents

    extra = _fed(options)
    settings = extra.pop("settings", None)
    if settings:
        extra["settings"] = prefcal_agents.GLISpSettings(**settings)
    if start:
        extra["start"] = start
    agent: AnyAgent = WORDS[options.agent].load()(
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


def _fed(options: Options) -> dict[str, Any]:
    """Return the keyword arguments that the options feed to the agent."""
    arguments: dict[str, Any] = {}
    for name, (_, kept) in kept_by(Options).items():
        if not kept.feeds or not options.changed(name):
            continue
        value = kept.convert(getattr(options, name))
        where, _, setting = kept.feeds.partition(".")
        if setting:
            arguments.setdefault(where, {})[setting] = value
        else:
            arguments[where] = value
    return arguments


def _unknown(calibrator: str, scenario: Scenario, known: list[str]) -> str:
    """Return what to say about a calibrator that the scenario does not have."""
    if isinstance(scenario.run, Rig):
        return (
            f"scenario {scenario.name!r} is a rig that only a person can run: its calibrator is "
            f"human, got {calibrator!r}"
        )
    hint = "" if known else " (give it a cost, or calibrators, to calibrate it unattended)"
    names = sorted(["human", *known])
    return (
        f"--calibrator must be one of {', '.join(names)} for scenario {scenario.name!r}"
        f"{hint}, got {calibrator!r}.{did_you_mean(calibrator, names)}"
    ).rstrip(".")


def make_calibrator(options: Options, scenario: Scenario) -> Calibrator[Experiment] | None:
    """Make the calibrator of the options, one of the scenario's; None where scores are told.

    Raises:
        SettingsError: unknown, or it does not take the tie band or the answer noise.
    """
    if WORDS[options.agent].by_value:
        return None
    from prefcal_env.calibrators import LatentCost, Thurstone

    calibrators = dict(scenario.calibrators)
    if not calibrators and scenario.cost is not None:
        cost = scenario.cost
        calibrators["synthetic"] = lambda seed: LatentCost(cost, seed=seed)
    if options.calibrator not in calibrators:
        raise SettingsError(_unknown(options.calibrator, scenario, sorted(calibrators)))
    calibrator = calibrators[options.calibrator](options.seed)
    if options.tie_band is None and options.answer_noise is None:
        return calibrator
    if not isinstance(calibrator, LatentCost):
        raise SettingsError(
            f"calibrator {options.calibrator!r} takes neither --tie-band nor --answer-noise: "
            "it does not compare costs"
        )
    if options.tie_band is not None:
        calibrator = replace(calibrator, tie_band=options.tie_band)
    if options.answer_noise is not None:
        sure = options.answer_noise == 0
        calibrator = replace(calibrator, noise=None if sure else Thurstone(options.answer_noise))
    return calibrator


def follows_cost(options: Options, scenario: Scenario) -> bool:
    """Return whether the answers follow the scenario's cost; a person has never chosen it.

    They do with scores, a cost of the user's own (`--cost`), a calibrator called "synthetic", and
    any that compares by a latent cost.
    """
    from prefcal_env.calibrators import LatentCost

    if scenario.cost is None:
        return False
    if options.calibrator in (SCORE, "synthetic") or options.cost is not None:
        return True
    made = scenario.calibrators.get(options.calibrator)
    return made is not None and isinstance(made(options.seed), LatentCost)


def _check_score(options: Options, scenario: Scenario) -> None:
    """Refuse what does not go with an agent that is told scores."""
    if scenario.cost is None:
        raise SettingsError(
            f"agent {options.agent!r} learns from a score, and scenario {scenario.name!r} has "
            "none: take another agent, or give one with --cost own.py:NAME"
        )
    if options.calibrator != SCORE:
        raise SettingsError(
            f"agent {options.agent!r} learns from the scenario's score and asks nobody: "
            f"leave --calibrator out, got {options.calibrator!r}"
        )
    if options.tie_band is not None or options.answer_noise is not None:
        raise SettingsError(
            f"agent {options.agent!r} is told exact scores: it takes neither --tie-band nor "
            "--answer-noise"
        )


def start_of(text: str, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the physical θ that `text` means, shape (n,).

    Either `knob=value, ...` for every knob, in any order, or the name of a reference of the
    scenario.

    Raises:
        SettingsError: no such reference, an unknown or missing knob, or no number.
        KnobError: a value outside its knob's range.
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
    """Return θ of `knob=value, ...`, shape (n,), physical; ranges are not checked.

    Raises:
        SettingsError: an unknown or missing knob, one given twice, or no number.
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
    """Return the name of the knob that `word` means: the name, or a beginning that only it has.

    Underscores stand for spaces.

    Raises:
        SettingsError: none, or several.
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


def target_of(path: str | None, scenario: Scenario) -> dict[str, Any]:
    """Return what the configuration of a new study says of the processor in the file `path`.

    Empty without one, so that studies with and without the option read the same.

    Raises:
        SettingsError: not the file of a processor, or `scenario` judges no computation times.
    """
    if path is None:
        return {}
    if scenario.on_processor is None:
        raise SettingsError(
            f"--processor is for scenarios that judge computation times (overtake, "
            f"overtake-robust), not {scenario.name!r}"
        )
    return {_PROCESSOR: as_dict(read_processor(path))}


def check_target(path: str | None, configuration: Mapping[str, Any]) -> None:
    """Refuse another processor than the one that a study was started with.

    Raises:
        SettingsError: the file `path` holds another one, or the study was started without one.
    """
    if path is None:
        return
    kept = configuration.get(_PROCESSOR)
    if kept is None:
        raise SettingsError(
            f"the study was started with no --processor, got --processor {path}: leave the option "
            "out, or start another study"
        )
    if as_dict(read_processor(path)) != kept:
        raise SettingsError(
            f"the study judges computation times on {kept.get('name')!r}, which it keeps; "
            f"--processor {path} holds another one: leave the option out, or start another study"
        )


def on_target(scenario: Scenario, configuration: Mapping[str, Any]) -> Scenario:
    """Return `scenario`, judged on the processor that the study keeps if it keeps one.

    Raises:
        SettingsError: what the study keeps is no processor, or `scenario` takes none.
    """
    kept = configuration.get(_PROCESSOR)
    if kept is None:
        return scenario
    if scenario.on_processor is None:
        raise SettingsError(f"scenario {scenario.name!r} judges no computation times any more")
    return scenario.on_processor(scenario, processor_of(kept, "the processor of the study"))


def target_settings(configuration: Mapping[str, Any]) -> dict[str, str]:
    """Return the processor by name, for the report's list of what was set."""
    kept = configuration.get(_PROCESSOR)
    return {} if kept is None else {"processor": str(kept.get("name"))}
