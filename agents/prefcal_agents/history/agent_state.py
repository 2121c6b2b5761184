"""The whole state of an agent, frozen, as plain data that goes through JSON unchanged."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_env.preferences.answer import Answer

from .history import Comparison, History


@dataclass(frozen=True, slots=True)
class AgentState:
    """Everything that decides an agent's next query, apart from the knob space.

    Args:
        agent: Name of its class.
        version: Version of its algorithm. A newer one keeps the samples and carries on.
        n_init: Samples of the space-filling start.
        n_max: Experiments after which it is done.
        seed: Of all its randomness.
        history: Stored samples, the one of the open query among them, and answers.
        settings: Name and value of each further setting.
        start: Points of the cube of the θ that were given as the first samples.
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
        """Plain data for JSON; floats survive their repr exactly."""
        further = [
            {"challenger": c.challenger, "after": c.after, **_comparison_to_dict(c)}
            for c in self.history.further
        ]
        return {
            "agent": self.agent,
            "version": self.version,
            "n_init": self.n_init,
            "n_max": self.n_max,
            "seed": self.seed,
            "settings": {name: _plain(value) for name, value in self.settings},
            "samples": [list(z) for z in self.history.samples],
            "answers": [_comparison_to_dict(c) for c in self.history.comparisons],
            **({"further": further} if further else {}),
            **({"start": [list(z) for z in self.start]} if self.start else {}),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "AgentState":
        """Read what `to_dict` gave.

        Raises:
            SettingsError: something is missing or malformed.
        """
        try:
            history = History(
                tuple(tuple(map(float, z)) for z in data["samples"]),
                tuple(_comparison_from_dict(h, c) for h, c in enumerate(data["answers"])),
                tuple(
                    replace(_comparison_from_dict(c["challenger"], c), after=c["after"])
                    for c in data.get("further", ())
                ),
            )
            return cls(
                agent=data["agent"],
                version=data["version"],
                n_init=data["n_init"],
                n_max=data["n_max"],
                seed=data["seed"],
                history=history,
                settings=tuple((k, _frozen(v)) for k, v in data["settings"].items()),
                start=tuple(tuple(map(float, z)) for z in data.get("start", ())),
            )
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise SettingsError(
                f"the state of an agent cannot be read: {type(error).__name__} {error}"
            ) from error


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    return tuple(_frozen(v) for v in value) if isinstance(value, list) else value


def _comparison_to_dict(comparison: Comparison) -> dict[str, Any]:
    return {
        "incumbent": comparison.incumbent,
        **comparison.answer.to_dict(),
        "retracted": comparison.retracted,
    }


def _comparison_from_dict(challenger: int, data: Mapping[str, Any]) -> Comparison:
    answer = Answer.from_dict(data)
    return Comparison(challenger, data["incumbent"], answer, retracted=data["retracted"])
