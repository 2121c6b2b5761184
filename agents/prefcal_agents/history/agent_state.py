"""Save the whole state of an agent as plain data that JSON keeps exactly."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from prefcal_agents.space.setup import Setup
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plain import from_plain, to_plain
from prefcal_env.preferences.history import History, Sample

_SAME_PLACE = 1e-6
"""Maximum difference of θ and the θ of z in a saved sample, as a share of a knob's range."""


@dataclass(frozen=True, slots=True)
class AgentState:
    """Everything that determines an agent's next query, apart from the knob space.

    Args:
        agent: Name of its class.
        version: Version of its algorithm. A newer version keeps the samples and continues.
        n_init: Number of samples of the space-filling start.
        n_max: Number of experiments after which the agent is done.
        seed: Seed of all its randomness.
        history: Answers and stored samples, including the sample of the open query.
        settings: Name and value of each further setting.
        start: Points of the cube, for θ that were given as the first samples.
    """

    agent: str
    version: int
    n_init: int
    n_max: int
    seed: int
    history: History
    settings: tuple[tuple[str, Any], ...] = ()
    start: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of_setup(cls, agent: str, version: int, setup: Setup[Any], history: History) -> "AgentState":
        """Return the state of an agent with this setup after `history`."""
        counts = setup.n_init, setup.n_max, setup.seed
        return cls(agent, version, *counts, history, setup.settings.pairs(), setup.start)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, which restores every float exactly."""
        return {**self.configuration(), "history": to_plain(self.history)}

    def configuration(self) -> dict[str, Any]:
        """Return the parts that do not change with samples and answers, as plain data for JSON."""
        kept = ("agent", "version", "n_init", "n_max", "seed")
        return {
            **{name: getattr(self, name) for name in kept},
            "settings": {name: _plain(value) for name, value in self.settings},
            **({"start": _plain(self.start)} if self.start else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "AgentState":
        """Read the data that `to_dict` returned.

        Raises:
            SettingsError: If something is missing or malformed.
        """
        if "history" not in data:
            raise SettingsError("the state of an agent lacks its history: resume the study's file instead")
        history = from_plain(data["history"], History, SettingsError, "the state of an agent")
        return cls.of(data, history)

    @classmethod
    def of(cls, configuration: Mapping[str, Any], history: History) -> "AgentState":
        """Return the state of an agent from what `configuration` returned, after `history`.

        Raises:
            SettingsError: If something is missing or malformed.
        """
        try:
            return cls(
                agent=configuration["agent"],
                version=configuration["version"],
                n_init=configuration["n_init"],
                n_max=configuration["n_max"],
                seed=configuration["seed"],
                history=history,
                settings=tuple((k, _frozen(v)) for k, v in configuration["settings"].items()),
                start=tuple(tuple(map(float, z)) for z in configuration.get("start", ())),
            )
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            words = f"{type(error).__name__} {error}"
            raise SettingsError(f"the state of an agent cannot be read: {words}") from error


def check_record(history: History, space: KnobSpace, most: int, *, by_value: bool) -> None:
    """Raise SettingsError unless `history` can be that of an agent of up to `most` experiments."""
    answered, stored = history.answered, len(history.samples)
    for h, c in enumerate(history.comparisons):
        alone = h == 0 or by_value
        if c.challenger != h:
            raise SettingsError(f"answer {h} of a state cannot be about sample {c.challenger}")
        if (c.incumbent is None) != alone or not -1 < (c.incumbent or 0) < max(h, 1):
            raise SettingsError(f"answer {h} of a state cannot be against sample {c.incumbent}")
    for c in history.follow_ups:
        pair, after = {c.challenger, c.incumbent}, range(c.after or 0)
        if len(after) > answered or by_value or len(pair) < 2 or not pair <= {*after}:
            raise SettingsError(f"a follow-up answer of a state cannot be {c}")
    for lead in history.leads:
        if not (0 <= lead.index < answered and 0 < lead.after <= history.given):
            raise SettingsError(f"the best one of a state cannot be {lead}")
    for index, sample in enumerate(history.samples):
        _check_sample(index, sample, space)
        if not 0 <= (sample.after or 0) <= min(index, answered):
            raise SettingsError(f"sample {index} of a state cannot be after {sample.after} answers")
    if not answered <= stored <= most:
        raise SettingsError(
            f"a state of up to {most} experiments cannot hold {stored} samples and {answered} answers"
        )


def _check_sample(index: int, sample: Sample, space: KnobSpace) -> None:
    try:
        theta = space.check_allowed(np.array(sample.theta))
        there = space.decode(np.array(sample.z))
    except KnobError as error:
        raise SettingsError(f"sample {index} of a state: {error}") from error
    span = np.array([knob.high - knob.low for knob in space])
    if np.any(np.abs(there - theta) > _SAME_PLACE * span):
        raise SettingsError(f"sample {index} of a state: z and theta are not the same place, got {sample}")


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value
