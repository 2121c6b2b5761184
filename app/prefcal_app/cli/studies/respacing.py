"""Change the knobs of a study: search another range, keep a knob, or add one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from prefcal_agents.respacing import RESPACEABLE, moved
from prefcal_app.cli.options import RespaceOptions
from prefcal_app.session.study.memory import agent_of, agent_state, with_constraints
from prefcal_app.terminal.lines import knob_called
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.knobs.change import respaced
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study import Respaced, State, knobs_as_dicts, space_of, within_as_dict
from prefcal_env.study.fold import step
from prefcal_scenarios.catalog import load

from .files import existing, open_described
from .sources import completed

_Part = tuple[float, float]


def respaced_in_words(changes: RespaceOptions, typed: Mapping[str, Any]) -> Iterator[str]:
    """Change the space of a study, and yield the new one in words; for errors see `respace`.

    Args:
        changes: The changes as typed.
        typed: All options as typed, of which some name the study and its scenario.
    """
    source = completed({name: typed[name] for name in ("study", "scenario", "plant")})["scenario"]
    yield from in_words(respace(changes, source))


def respace(changes: RespaceOptions, source: str) -> KnobSpace:
    """Change the space of a study of the scenario `source`; return the new space.

    The changes are as typed: "T_s=0.25:1.0", "N_p=26", "filter=0.5".

    Raises:
        StudyError: If there is no such study, or its agent cannot change its space.
        SettingsError: If the changes cannot be read, or change nothing.
        KnobError: If a range is invalid.
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
    parts = {**_parts(state, old, scenario), **_asked(changes, scenario)}
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
    now = moved(before, old, space, added).configuration()
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


def _asked(changes: RespaceOptions, scenario: KnobSpace) -> dict[str, _Part]:
    ranges = _read(changes.knob, "KNOB=LOW:HIGH", scenario)
    return dict([*ranges, *_read(changes.freeze, "KNOB=VALUE", scenario)])


def _read(texts: Sequence[str], form: str, scenario: KnobSpace) -> Iterator[tuple[str, _Part]]:
    """Yield knobs and the ends of their ranges, equal ones for a single value."""
    for text in texts:
        word, equals, value = text.rpartition("=")
        ends = value.split(":")
        if not (word and equals) or len(ends) != form.count(":") + 1:
            raise SettingsError(f"expected {form}, got {text!r}")
        numbers = [_number(end, text) for end in ends]
        yield knob_called(word.strip(), scenario), (numbers[0], numbers[-1])


def _number(text: str, whole: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise SettingsError(f"expected a number, got {text!r} in {whole!r}") from error


def in_words(space: KnobSpace) -> Iterator[str]:
    """Yield the searched range of each knob, for people."""
    for knob, (low, high) in zip(space, space.within, strict=True):
        part = f"{low:g}, frozen" if low == high else f"{low:g} to {high:g}"
        yield f"{knob.name}: {part} {knob.unit}".rstrip()
