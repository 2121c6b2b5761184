"""What `prefcal studies respace` does."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from prefcal_agents.respacing import moved
from prefcal_agents.restore import AGENTS
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.respace import respaced
from prefcal_env.studies import Respaced, State, knobs_as_dicts, space_of, within_as_dict
from prefcal_env.studies.fold import step
from prefcal_scenarios.cli.described import open_described
from prefcal_scenarios.cli.shelf import existing
from prefcal_scenarios.cli.start import knob_called
from prefcal_scenarios.interview.memory import (
    agent_configuration,
    agent_of,
    agent_state,
    with_constraints,
)
from prefcal_scenarios.scenario import is_built_in, load

Part = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Changes:
    """What was asked for, as typed: "T_s=0.25:1.0", "N_p=26", "filter=0.5"."""

    knobs: Sequence[str] = ()
    freeze: Sequence[str] = ()
    add: Sequence[str] = ()


def respace(name: str, source: str | None, changes: Changes) -> KnobSpace:
    """Change the space of the study called `name`; the space from now on.

    Raises:
        StudyError: no such study, or of a scenario that has to be named.
        SettingsError: changes that cannot be read, or nothing changes.
        KnobError: an impossible range.
    """
    with open_described(existing(name)) as file:
        named = file.state.configuration["scenario"]
        if source is None and not is_built_in(named):
            raise StudyError(
                f"study {name!r} calibrates {named!r}, which is a program: "
                f"if you trust it, add --scenario {named}"
            )
        if file.state.configuration["agent"]["agent"] not in AGENTS:
            raise StudyError(f"the agent of study {name!r} cannot change its space")
        event, space = _event(file.state, load(source or named).space, changes)
        # Whatever would not go on is refused before it is recorded.
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
    """Return what changes in the agent's configuration, apart from the samples."""
    before = agent_state(state)
    after = moved(before, old, space, added)
    then, now = (agent_configuration(s) for s in (before, after))
    return {name: value for name, value in now.items() if value != then.get(name)}


def _parts(state: State, old: KnobSpace, scenario: KnobSpace) -> dict[str, Part]:
    """What is searched of each knob unless said otherwise: as before, or its new range."""
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
    """`knob`, wide enough for `part`."""
    low, high = min(knob.low, part[0]), max(knob.high, part[1])
    return Knob(knob.name, low, high, knob.unit, knob.scale, knob.integer)


def in_words(space: KnobSpace) -> Mapping[str, str]:
    """What is searched of each knob, for people."""
    return {
        knob.name: (f"{low:g}, frozen" if low == high else f"{low:g} to {high:g}")
        + (f" {knob.unit}" if knob.unit else "")
        for knob, (low, high) in zip(space, space.within, strict=True)
    }
