"""Options of `prefcal calibrate`; a new option is one new field here."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from prefcal_agents.registry import WORDS

from .describing.options import (
    KnobOption,
    PlantOption,
    ReferenceOption,
    ShowOption,
    StopTimeOption,
)
from .parameters import Kept, kept_by, parameters_of

HUMAN = "human"
"""Name of the calibrator that is a person."""

SYNTHETIC = "synthetic"
"""Name of the calibrator that compares by a cost."""

SCORE = "score"
"""Name of the calibrator if the agent learns from the scenario's score, with no comparisons."""

BY_VALUE = tuple(word for word, row in WORDS.items() if row.by_value)
"""The agents that are told scores."""

SIMULATING = tuple(word for word, row in WORDS.items() if row.simulates)
"""The agents that simulate experiments which nobody looks at."""


def _who_proposes() -> str:
    """Return the help of --agent: the words of the registry, with their remarks."""
    *words, last = (f"{word} ({row.about})" if row.about else word for word, row in WORDS.items())
    return f"Who proposes: {', '.join(words)} or {last}."


@dataclass(frozen=True, slots=True)
class Options:
    """Options of `prefcal calibrate`, in the order of its help.

    To add an option, add a field with its type, help and default. An option with `Kept` is stored
    and checked in the study file and cannot change on resuming unless `anew` is set; one without
    applies to a single run. None stands for the default of the component that takes the value.

    Raises:
        SettingsError: If a number is too small, or `n_init` is above `n_max`.
    """

    scenario: Annotated[
        str,
        Argument(
            metavar="SCENARIO",
            help="A name (see `prefcal scenarios`), or your own: own.py:NAME, tank.toml, loop.fmu, "
            "or pid or lqr with --plant.",
        ),
        Kept(label="scenario", always=True, anew=True),
    ]
    calibrator: Annotated[
        str,
        Option(
            metavar="NAME",
            help="Who compares: human, or one of the scenario's synthetic calibrators.",
            show_default="human",
        ),
        Kept(label="calibrator", always=True),
    ] = HUMAN
    agent: Annotated[
        str,
        Option(
            metavar="NAME",
            help=_who_proposes(),
            show_default="screening; glisp if the scenario is not a quick simulation",
        ),
        Kept(label="agent", always=True),
    ] = "glisp"
    simulate: Annotated[
        int,
        Option(
            metavar="N",
            help="Number of experiments to simulate unseen. The agent screening learns from your "
            "answers which of them you would like, and shows only a few. 0: run only what is "
            "shown, with the agent glisp.",
            show_default="1000; 0 if the scenario is not a quick simulation",
        ),
        Kept(
            label="simulated unseen",
            least=0,
            agents=SIMULATING,
            refusal="--agent {agent} simulates nothing unseen: leave --simulate out, or choose "
            "--agent screening",
            feeds="n_simulated",
        ),
    ] = 0
    twin: Annotated[
        str | None,
        Option(
            metavar="SCENARIO",
            help="A rough model of the plant: simulate unseen on this scenario, and run only what "
            "is shown. It has the plant's knobs and KPIs; prefcal learns how both differ.",
            show_default="none",
        ),
        Kept(label="twin", agents=SIMULATING),
    ] = None
    study: Annotated[
        str | None,
        Option(
            metavar="NAME_OR_PATH",
            help="Study to start or to resume: a name in your data folder, or a file "
            "(with a / or a suffix).",
            show_default="a new one, SCENARIO-1; unattended: none",
        ),
    ] = None
    seed: Annotated[
        int,
        Option(
            metavar="N",
            help="Seed of the agent, the calibrator and the order of the two sides.",
            show_default="0",
        ),
        Kept(label="seed", always=True, least=0),
    ] = 0
    n_init: Annotated[
        int,
        Option(
            metavar="N",
            help="Number of experiments before learning starts.",
            show_default="10; glisp: 2 per knob; screening: 1; at most half of --n-max",
        ),
        Kept(label="initial experiments", always=True, least=1),
    ] = 10
    n_max: Annotated[
        int,
        Option(
            metavar="N",
            help="Number of experiments shown; you can add more later.",
            show_default="50; screening: 11",
        ),
        Kept(label="experiments", always=True, anew=True, least=1),
    ] = 50
    questions_per_experiment: Annotated[
        int,
        Option(
            min=1,
            metavar="N",
            help="Maximum number of comparisons per experiment (glisp only). If experiments are "
            "expensive, 3 or more comparisons save some. You can change it when you resume.",
            show_default="1",
        ),
        Kept(
            label="questions per experiment",
            anew=True,
            agents=("glisp",),
            refusal="only the agent glisp takes --questions-per-experiment above 1, not {agent!r}",
            feeds="settings.questions_per_experiment",
        ),
    ] = 1
    start: Annotated[
        tuple[str, ...],
        Option(
            metavar="THETA",
            help="θ of the first experiment, for example your current tuning: "
            '"KNOB=VALUE, ..." for every knob, or the name of one of the scenario\'s references. '
            "Repeat the option for more.",
            show_default="the agent's",
        ),
        Kept(label="begins with"),
    ] = ()
    earlier: Annotated[
        str | None,
        Option(
            "--from",
            metavar="STUDY",
            help="An earlier study, for example by another person or of a similar plant: its best "
            "θ is one of the first experiments. A name or the path of a file.",
        ),
        Kept(label="earlier study"),
    ] = None
    outcomes: Annotated[
        bool,
        Option(
            "--no-outcomes",
            metavar="",
            help="Let glisp learn from θ only, not from the KPIs of the experiments.",
        ),
        Kept(
            label="learns from KPIs",
            agents=("glisp",),
            refusal="only the agent glisp learns from KPIs: leave --no-outcomes out for {agent!r}",
            feeds="settings.kpis",
        ),
    ] = True
    cost: Annotated[
        str | None,
        Option(
            metavar="COST",
            help="What the calibrator synthetic or the agent glis goes by: own.py:NAME, a function "
            "of an experiment, lower is better; or the name of a KPI.",
            show_default="the scenario's score",
        ),
        Kept(label="cost"),
    ] = None
    knob: KnobOption = ()
    show: ShowOption = ()
    reference: ReferenceOption = ()
    plant: PlantOption = None
    stop_time: StopTimeOption = None
    config: Annotated[
        Path | None,
        Option(
            metavar="FILE.json",
            help="Configuration of the scenario, for example the road and traffic of overtake.",
        ),
    ] = None
    out: Annotated[
        Path | None,
        Option(
            metavar="FOLDER",
            help="Folder of the report; must not hold the report of another study.",
            show_default="./prefcal-STUDY; unattended: ./prefcal-SCENARIO-SEED",
        ),
    ] = None
    run_timeout: Annotated[
        float,
        Option(
            metavar="SECONDS",
            help="Time limit for one run of your own scenario; a longer run is ended and counts "
            "as failed. inf: no limit.",
            show_default="3600, an hour",
        ),
    ] = 3600.0
    at_once: Annotated[
        int,
        Option(
            min=1,
            metavar="N",
            help="Number of experiments that run at the same time, each in a process of its own: "
            "for simulations that take minutes, with the agent glisp.",
            show_default="1",
        ),
    ] = 1
    terminal: Annotated[
        bool,
        Option("--terminal", metavar="", help="Ask in this terminal instead of on a page."),
    ] = False
    browser: Annotated[
        bool,
        Option("--no-browser", metavar="", help="Print the link of the page, but open no browser."),
    ] = True
    host: Annotated[
        str,
        Option(
            metavar="ADDRESS",
            help="Address to serve the page on. 0.0.0.0 makes it reachable from other machines.",
        ),
    ] = "127.0.0.1"
    port: Annotated[
        int,
        Option(min=0, max=65535, metavar="N", help="Port of the page.", show_default="a free one"),
    ] = 0
    json: Annotated[
        bool,
        Option(
            "--json",
            metavar="",
            help="Print only JSON on standard output (messages go to standard error).",
        ),
    ] = False

    def __post_init__(self) -> None:
        wrong = (p.problem(getattr(self, name)) for name, p in parameters_of(Options).items())
        problem = next(filter(None, wrong), "")
        if not problem and self.n_init > self.n_max:
            problem = (
                f"--n-max must be at least --n-init, got --n-max {self.n_max} and "
                f"--n-init {self.n_init}"
            )
        if problem:
            # Imported here: --help must not import numpy.
            from prefcal_env.errors import SettingsError

            raise SettingsError(problem)

    @classmethod
    def of(cls, given: Mapping[str, Any], knobs: int = 5, *, simulated: bool = False) -> "Options":
        """Return the given options, with defaults in place of None.

        Args:
            given: Values by name, None for options that were not typed.
            knobs: Number of knobs of the scenario.
            simulated: Whether an experiment of the scenario is a quick simulation.
        """
        said = {name: value for name, value in given.items() if value is not None}
        simulated = simulated or "twin" in said
        return cls(**{**_defaults(said, knobs, simulated), **said})

    @classmethod
    def resumed(cls, stored: Mapping[str, Any], given: Mapping[str, Any]) -> "Options":
        """Return the current options of a study: those it was started with, and allowed changes.

        Raises:
            SettingsError: If another option is given with a new value.
        """
        kept = {name: stored[name] for name in kept_by(cls) if name in stored}
        kept["start"] = tuple(kept.get("start", ()))  # a list in JSON
        _check_programs(kept, given)
        _check_unchanged(kept, given)
        new = {name: value for name, value in given.items() if value is not None}
        return cls(**{**kept, **new})

    @property
    def by_a_person(self) -> bool:
        """Return whether a person compares."""
        return self.calibrator == HUMAN

    def as_dict(self) -> dict[str, Any]:
        """Return the options that the study file keeps, as plain data."""
        return {name: getattr(self, name) for name in kept_by(Options)}

    def changed(self, name: str) -> bool:
        """Return whether an option differs from its default."""
        return bool(getattr(self, name) != parameters_of(Options)[name].default)

    def settings(self) -> Mapping[str, str | int | float]:
        """Return the options to list in the report, by label."""
        return {
            kept.label: parameter.shown(getattr(self, name))
            for name, (parameter, kept) in kept_by(Options).items()
            if kept.label and (kept.always or self.changed(name))
        }

    def command(self) -> str:
        """Return a command line that repeats the study, without its folder."""
        from prefcal_scenarios.described.options import words_of

        words = ["prefcal", "calibrate", *words_of(self.scenario)]
        for name, (parameter, kept) in kept_by(Options).items():
            if name != "scenario" and (kept.always or self.changed(name)):
                words += parameter.words(getattr(self, name))
        return shlex.join(words)


def _defaults(said: Mapping[str, Any], knobs: int, simulated: bool) -> dict[str, Any]:
    """Return the defaults that depend on the scenario and on what was typed.

    Where experiments are quick simulations, many are simulated unseen and a dozen are shown; where
    they are not, all are shown. GLISp starts to learn after two experiments per knob, at most ten.
    For the reactor with three knobs, the index after 15 experiments was 0.714 with six initial
    experiments and 0.732 with ten (docs/research/archive.md).
    """
    unseen = said.get("simulate", 1 if simulated else 0) > 0
    agent = said.get("agent", "screening" if unseen else "glisp")
    if agent in SIMULATING:
        return {"agent": agent, "simulate": 1000, "n_init": 1, "n_max": 11}
    n_max = said.get("n_max", 50)
    n_init = min(2 * knobs if agent == "glisp" else 10, 10, max(1, n_max // 2))
    calibrator = SCORE if agent in BY_VALUE else HUMAN
    return {"agent": agent, "n_init": n_init, "n_max": n_max, "calibrator": calibrator}


def _check_programs(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise SettingsError if the study's program or configuration is not the one given."""
    from prefcal_env.errors import SettingsError
    from prefcal_scenarios.names import is_described, is_own
    from prefcal_scenarios.own.source import split_source

    from .cost_file import kept_cost

    if given.get("cost") is None and kept.get("cost") != kept_cost(kept):
        raise SettingsError(
            f"the study goes by a cost that was given to it: if you trust it, add "
            f"--cost {shlex.quote(str(kept['cost']))}"
        )
    twin = kept.get("twin")
    if twin is not None and given.get("twin") is None and is_own(str(twin)):
        raise SettingsError(
            f"the study simulates with a program: if you trust it, add --twin "
            f"{shlex.quote(str(twin))}"
        )
    if is_described(str(kept.get("scenario", ""))):
        return  # checked when its source was made
    # The configuration's file may have moved, so compare only its content.
    then = split_source(str(kept.get("scenario", "")))[1]
    now = then if given.get("scenario") is None else split_source(given["scenario"])[1]
    if now != then:
        said = "no --config" if then is None else f"the configuration {then}"
        raise SettingsError(
            f"the study was started with {said}, got {'none' if now is None else now}: give the "
            "same one, or start another study"
        )


def _check_unchanged(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise SettingsError if an option that cannot change has a new value."""
    from prefcal_env.errors import SettingsError

    for name, (parameter, rule) in kept_by(Options).items():
        value, then = given.get(name), kept.get(name)
        if rule.anew or value is None or value == then:
            continue
        raise SettingsError(
            f"the study was started with {parameter.said(then)}, got {parameter.said(value)}: "
            "leave the option out, or start another study"
        )
    wanted = given.get("n_max")
    if wanted is not None and wanted < kept["n_max"]:
        raise SettingsError(
            f"--n-max must not be below the {kept['n_max']} that the study has by now, got {wanted}"
        )
