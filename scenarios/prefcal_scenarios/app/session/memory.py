"""Between a study file and an agent: the configuration, and waking the agent up from a state."""

from collections.abc import Mapping
from typing import Any

from prefcal_agents import AgentState, Earlier, restore
from prefcal_agents.protocol.agent import AnyAgent
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.knobs.knob import KnobSpace
from prefcal_env.preferences.best import (
    Verdict,
    best_of,
    representative,
    undominated,
    unsafe_indices,
)
from prefcal_env.study import Closed, State, space_of
from prefcal_env.study import knobs_as_dicts as knobs_as_dicts
from prefcal_scenarios.scenario import Scenario, with_ranges


def constraint_names(space: KnobSpace) -> list[str]:
    """What a study remembers of the constraints: they are code, which the scenario brings."""
    return [constraint.name for constraint in space.constraints]


def agent_as_dict(agent: AnyAgent) -> dict[str, Any]:
    """Return an agent's settings as plain data, without what it has learned."""
    return agent_configuration(agent.state)


def agent_configuration(state: AgentState) -> dict[str, Any]:
    """Return `state` as plain data, without samples and answers."""
    learned = ("samples", "answers", "further")
    return {name: value for name, value in state.to_dict().items() if name not in learned}


QUESTIONS = "questions_per_experiment"
"""Name of the agent's setting."""


def questions_of(configuration: Mapping[str, Any]) -> int:
    """Return the most comparisons per experiment that the agent of a study asks.

    Raises:
        StudyError: it is no whole number.
    """
    settings = configuration["agent"].get("settings")
    most = settings.get(QUESTIONS, 1) if isinstance(settings, Mapping) else 1
    if type(most) is not int:
        raise StudyError(f"{QUESTIONS} of a study must be a whole number, got {most!r}")
    return most


def check_space(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    """Refuse a study of other knobs or constraints than the scenario has today.

    Raises:
        StudyError: they differ.
    """
    _check_constraints(configuration, space)
    then, now = configuration["knobs"], knobs_as_dicts(space)
    if then == now:
        return
    then = then if isinstance(then, list) else []
    changed = [knob["name"] for knob in then if knob not in now]
    changed += [knob["name"] for knob in now if knob not in then]
    raise StudyError(
        f"the study was made with other knobs than the scenario has now: {sorted(set(changed))} "
        "differ in name, range, unit or scale (`prefcal studies respace` takes them over)"
    )


def _check_constraints(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    # Studies from before there were constraints have none.
    then, now = configuration.get("constraints", []), constraint_names(space)
    if not isinstance(then, list) or {str(name) for name in then} != set(now):
        raise StudyError(
            f"the study was made with the constraints {then} on the knobs, the scenario has {now} "
            "now: a study keeps those that it was begun with"
        )


def as_studied(scenario: Scenario, state: State) -> Scenario:
    """`scenario` with the space of the study, where that was changed since it was begun.

    Raises:
        StudyError: the scenario has other knobs now than when the study's were changed.
    """
    configuration = state.configuration
    if "respaced" not in configuration:
        return scenario
    check_space({**configuration, "knobs": configuration.get("scenario_knobs")}, scenario.space)
    space = with_constraints(space_of(configuration), scenario.space)
    about = {knob.name: knob.about for knob in scenario.space if knob.name in space.names}
    return with_ranges(scenario, space.described(about))


def with_constraints(space: KnobSpace, scenario: KnobSpace) -> KnobSpace:
    """`space` with the constraints of the scenario's: they are code, which no study holds."""
    return KnobSpace(
        space.knobs, scenario.constraints, within=dict(zip(space.names, space.within, strict=True))
    )


def agent_of(state: State, space: KnobSpace) -> AnyAgent:
    """The agent of a study, with the identical next query.

    Raises:
        StudyError: a study of other knobs.
        SettingsError: an agent that this version does not know.
    """
    check_space(state.configuration, space)
    return restore(space, agent_state(state))


def agent_state(state: State) -> AgentState:
    """The state of the agent of a study. Raises SettingsError if it is none."""
    told = {
        "n_max": state.n_max,
        "samples": [list(sample.z) for sample in state.samples],
        "answers": [_told(closed) for closed in state.closed],
        "further": [
            {"challenger": c.challenger, "after": c.after, **_told(c)} for c in state.further
        ],
    }
    return AgentState.from_dict({**state.configuration["agent"], **told})


def incumbent(state: State) -> int | None:
    """Return the index of the best experiment by the record; None before the first one."""
    if not state.closed:
        return None
    return best_of(*_record(state, len(state.closed)))


def incumbents(state: State) -> tuple[int, ...]:
    """Return the best experiment after each closed query, by the answers given until the next."""
    return tuple(best_of(*_record(state, count)) for count in range(1, len(state.closed) + 1))


def unbeaten(state: State) -> tuple[int, ...]:
    """Return the best experiment, and others that no answer says are worse, in order."""
    if not state.closed:
        return ()
    verdicts, unsafe = _record(state, len(state.closed))
    best = best_of(verdicts, unsafe)
    others = [g for g in undominated(verdicts, unsafe) if best not in g]
    return (best, *sorted(representative(verdicts, group) for group in others))


def _record(state: State, count: int) -> tuple[list[Verdict], frozenset[int]]:
    """Answers that stand about the first `count` experiments, and those they mark unsafe."""
    closed = [*state.closed[:count], *(c for c in state.further if (c.after or 0) <= count)]
    standing = [c for c in sorted(closed, key=lambda c: c.seq) if not c.retracted]
    verdicts = [
        Verdict(c.challenger, c.incumbent, c.answer.preference, c.after is not None)
        for c in standing
        if c.incumbent is not None and c.answer.preference is not None
    ]
    return verdicts, unsafe_indices(standing)


def earlier_of(state: State) -> Earlier:
    """Return the best that a study has found, for another one to start from.

    Raises:
        SettingsError: it has no answered experiment.
        StudyError: its knobs cannot be read.
    """
    best = incumbent(state)
    if best is None:
        raise SettingsError("the earlier study has no answered experiment yet")
    return Earlier(space_of(state.configuration).knobs, state.samples[best].theta)


def _told(closed: Closed) -> dict[str, Any]:
    told = {
        "incumbent": closed.incumbent,
        "retracted": closed.retracted,
        **closed.answer.to_dict(),
    }
    # Nobody was asked: a score was told, and the preference beside it is for readers.
    return told if closed.question is not None else {**told, "incumbent": None, "preference": None}
