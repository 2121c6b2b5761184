"""Save the whole state of an agent as plain data that JSON keeps exactly."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History, Lead, Sample

_UNREADABLE = (KeyError, TypeError, AttributeError, ValueError)


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

    def check(self, agent: str) -> None:
        """Raise SettingsError unless this is the state of an agent called `agent`."""
        if self.agent != agent:
            raise SettingsError(f"expected the state of {agent}, got that of {self.agent!r}")

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON, which restores every float exactly."""
        follow_ups = [
            {"challenger": c.challenger, "after": c.after, **_comparison_to_dict(c)}
            for c in self.history.follow_ups
        ]
        return {
            **self.configuration(),
            "samples": [_sample_to_dict(sample) for sample in self.history.samples],
            "answers": [_comparison_to_dict(c) for c in self.history.comparisons],
            **({"follow_ups": follow_ups} if follow_ups else {}),
            **(
                {"leads": [asdict(lead) for lead in self.history.leads]}
                if self.history.leads
                else {}
            ),
        }

    def configuration(self) -> dict[str, Any]:
        """Return the parts that do not change with samples and answers, as plain data for JSON."""
        return {
            "agent": self.agent,
            "version": self.version,
            "n_init": self.n_init,
            "n_max": self.n_max,
            "seed": self.seed,
            "settings": {name: _plain(value) for name, value in self.settings},
            **({"start": [list(z) for z in self.start]} if self.start else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "AgentState":
        """Read the data that `to_dict` returned.

        Raises:
            SettingsError: If something is missing or malformed.
        """
        try:
            history = History(
                tuple(_sample_from_dict(s) for s in data["samples"]),
                tuple(_comparison_from_dict(h, c) for h, c in enumerate(data["answers"])),
                tuple(
                    replace(_comparison_from_dict(c["challenger"], c), after=c["after"])
                    for c in data.get("follow_ups", ())
                ),
                leads=tuple(Lead(int(c["index"]), int(c["after"])) for c in data.get("leads", ())),
            )
        except _UNREADABLE as error:
            raise _unreadable(error) from error
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
        except _UNREADABLE as error:
            raise _unreadable(error) from error


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


def _unreadable(error: Exception) -> SettingsError:
    return SettingsError(f"the state of an agent cannot be read: {type(error).__name__} {error}")


def _sample_to_dict(sample: Sample) -> dict[str, Any]:
    return {"z": list(sample.z), "theta": list(sample.theta), "after": sample.after}


def _sample_from_dict(data: Any) -> Sample:
    if not isinstance(data, Mapping):
        raise SettingsError(
            f"a sample of a state must hold z and theta by name, got {data!r}: states of earlier "
            "versions must be made anew"
        )
    after = data.get("after")
    if after is not None and type(after) is not int:
        raise SettingsError(f"a sample of a state is proposed after a number, got {after!r}")
    return Sample(tuple(map(float, data["z"])), tuple(map(float, data["theta"])), after)


def _comparison_to_dict(comparison: Comparison) -> dict[str, Any]:
    return {
        "incumbent": comparison.incumbent,
        **comparison.answer.to_dict(),
        "retracted": comparison.retracted,
    }


def _comparison_from_dict(challenger: int, data: Mapping[str, Any]) -> Comparison:
    answer = Answer.from_dict(data)
    return Comparison(challenger, data["incumbent"], answer, retracted=data["retracted"])
