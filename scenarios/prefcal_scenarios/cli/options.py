"""What a user asked for, as data."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

from prefcal_env.errors import SettingsError
from prefcal_scenarios.source import split_source

HUMAN = "human"
"""The calibrator that is a person."""

SCORE = "score"
"""Stands for the scenario's own score, where the agent learns from that: nobody compares."""

_ANEW = ("n_max", "questions_per_experiment", "scenario")
"""What may be given anew for a study that was begun before."""

BY_VALUE = ("glis",)
"""The agents that are told scores."""


def flag(name: str) -> str:
    """Return an option as people type it: "--n-max" for n_max."""
    return {"earlier": "--from", "outcomes": "--no-outcomes"}.get(
        name, f"--{name.replace('_', '-')}"
    )


def _given(name: str, value: object) -> str:
    """An option with its value, as people type it."""
    if name == "outcomes":
        return f"{flag(name)} {'off' if value else 'on'}"
    if name == "start":
        value = "; ".join(map(str, value)) if isinstance(value, list | tuple) else value
    return f"no {flag(name)}" if value in (None, "") else f"{flag(name)} {value}"


def _check_configuration(stored: str, given: str | None) -> None:
    """Refuse to go on with a scenario of another configuration; its file may have moved."""
    began = split_source(stored)[1]
    now = began if given is None else split_source(given)[1]
    if now != began:
        said = "no --config" if began is None else f"the configuration {began}"
        raise SettingsError(
            f"the study was started with {said}, got {'none' if now is None else now}: give the "
            "same one, or start another study"
        )


@dataclass(frozen=True, slots=True)
class Options:
    """The options of `prefcal calibrate`; None stands for the default of the part that takes it.

    `outcomes` says whether glisp learns from KPIs too; `cost` is a function out of a file,
    PATH:NAME, in place of the scenario's score. `earlier` is the study whose best θ is tried first.
    `processor` is the file of the processor that computation times are judged on.

    Raises:
        SettingsError: a seed below 0, or more initial experiments than experiments.
    """

    scenario: str
    calibrator: str = HUMAN
    agent: str = "glisp"
    seed: int = 0
    n_init: int = 10
    n_max: int = 50
    delta: float | None = None
    tie_band: float | None = None
    answer_noise: float | None = None
    outcomes: bool = True
    cost: str | None = None
    questions_per_experiment: int = 1
    start: tuple[str, ...] = ()
    earlier: str | None = None
    processor: str | None = None

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise SettingsError(f"--seed must be 0 or above, got {self.seed}")
        for name in ("n_init", "n_max"):
            if getattr(self, name) < 1:
                raise SettingsError(f"{flag(name)} must be at least 1, got {getattr(self, name)}")
        if self.n_init > self.n_max:
            raise SettingsError(
                f"--n-max must be at least --n-init, got --n-max {self.n_max} and "
                f"--n-init {self.n_init}"
            )
        for name in ("delta", "tie_band", "answer_noise"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < float("inf"):
                raise SettingsError(f"{flag(name)} must be 0 or above and finite, got {value}")

    @classmethod
    def of(cls, given: Mapping[str, Any], knobs: int = 5) -> "Options":
        """Return the options as given, with defaults for None; `knobs` are to be calibrated.

        GLISp starts to learn after two experiments a knob, ten at most: on the reactor with its
        three the index after 15 experiments was 0.714 with six and 0.732 with ten
        (docs/research/outcomes.md).
        """
        said = {name: value for name, value in given.items() if value is not None}
        n_max = said.get("n_max", cls.__dataclass_fields__["n_max"].default)
        if said.get("agent") in BY_VALUE:
            said.setdefault("calibrator", SCORE)
        most = 2 * knobs if said.get("agent", "glisp") == "glisp" else 10
        said.setdefault("n_init", min(10, most, max(1, n_max // 2)))
        return cls(**said)

    @classmethod
    def resumed(cls, stored: Mapping[str, Any], given: Mapping[str, Any]) -> "Options":
        """Return the options of a study by now; n_max and the questions per experiment may change.

        Raises:
            SettingsError: any other option is given with another value.
        """
        known = {f.name for f in fields(cls)}
        # A study from before KPIs taught: it goes on as it began.
        began: dict[str, Any] = {"outcomes": stored.get("agent") != "glisp"}
        options = began | {name: value for name, value in stored.items() if name in known}
        options["start"] = tuple(options.get("start", ()))  # a list in JSON
        if options.get("cost") is not None and given.get("cost") is None:
            # Those who send a study must not choose which program is run here.
            raise SettingsError(
                f"the study is scored by a program: if you trust it, add "
                f"--cost {shlex.quote(str(options['cost']))}"
            )
        _check_configuration(str(options.get("scenario", "")), given.get("scenario"))
        for name, value in given.items():
            if name in _ANEW or value is None or value == options.get(name):
                continue
            raise SettingsError(
                f"the study was started with {_given(name, options.get(name))}, got "
                f"{_given(name, value)}: leave the option out, or start another study"
            )
        wanted = given.get("n_max") or options["n_max"]
        if wanted < options["n_max"]:
            raise SettingsError(
                f"--n-max must not fall below the {options['n_max']} that the study has by now, "
                f"got {wanted}"
            )
        anew = {name: given[name] for name in _ANEW if given.get(name) is not None}
        return cls(**{**options, **anew, "n_max": wanted})

    @property
    def _more_questions(self) -> int | None:
        """None for one question, which is what everybody expects."""
        return None if self.questions_per_experiment == 1 else self.questions_per_experiment

    @property
    def by_a_person(self) -> bool:
        """Whether a person compares."""
        return self.calibrator == HUMAN

    def as_dict(self) -> dict[str, Any]:
        """Plain data, for the study file."""
        return asdict(self)

    def settings(self) -> Mapping[str, str | int | float]:
        """What was set, for people."""
        every: dict[str, str | int | float | None] = {
            "scenario": self.scenario, "calibrator": self.calibrator, "agent": self.agent,
            "seed": self.seed, "initial experiments": self.n_init, "experiments": self.n_max,
            "questions per experiment": self._more_questions,
            "tie band": self.tie_band, "answer noise": self.answer_noise,
            "begins with": "; ".join(self.start) or None, "earlier study": self.earlier,
            "learns from KPIs": None if self.outcomes else "no", "cost": self.cost,
        }  # fmt: skip
        return {name: value for name, value in every.items() if value is not None}

    def command(self) -> str:
        """One command line that repeats the study, the folder aside."""
        words = ["prefcal", "calibrate", self.scenario]
        flags = {
            "--calibrator": self.calibrator, "--agent": self.agent, "--seed": self.seed,
            "--n-init": self.n_init, "--n-max": self.n_max, "--delta": self.delta,
            "--questions-per-experiment": self._more_questions,
            "--tie-band": self.tie_band, "--answer-noise": self.answer_noise,
            "--cost": self.cost, "--from": self.earlier, "--processor": self.processor,
        }  # fmt: skip
        for flag, value in flags.items():
            if value is not None:
                words += [flag, str(value)]
        for theta in self.start:
            words += ["--start", theta]
        if not self.outcomes:
            words.append("--no-outcomes")
        return shlex.join(words)
