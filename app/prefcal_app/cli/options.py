"""Options of the commands; a new option of `prefcal calibrate` is one new field here."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from prefcal_agents.registry import WORDS

from .parameters import Kept, argument, check_programs, check_unchanged, kept_by, option, parameters_of

HUMAN = "human"
"""Name of the calibrator that is a person."""

SYNTHETIC = "synthetic"
"""Name of the calibrator that compares by a cost."""

SCORE = "score"
"""Name of the calibrator if the agent learns from the scenario's score, with no comparisons."""

MOST, MOST_PROCESSES, MOST_SEED = 10_000, 256, 2**63 - 1
"""Largest number of experiments that a person or their agent could still handle, of processes that a
machine could, and seed that a study file could hold."""

BY_VALUE = tuple(word for word, row in WORDS.items() if row.by_value)
"""The agents that are told scores."""

SIMULATING = tuple(word for word, row in WORDS.items() if row.simulates)
"""The agents that simulate experiments which nobody looks at."""


def _who_proposes() -> str:
    """Return the help of --agent: the words of the registry, with their remarks."""
    *words, last = (f"{word} ({row.about})" if row.about else word for word, row in WORDS.items())
    return f"Who proposes: {', '.join(words)} or {last}."


@dataclass(frozen=True, slots=True)
class Described:
    r"""Options that say what is tuned, for `calibrate` and `check`.

    Args:
        scenario: A name (see `prefcal scenarios`), or your own: own.py:NAME, tank.toml{files},
            or a controller such as pid with --plant.
        knob: Knob of {called}a standard controller: NAME=LOW:HIGH[:log][:int] UNIT, for example
            "K_p=0.1:50:log %/m". Repeat the option for more.
        show: Curves to show, for example level,valve{units}.
        reference: Desired value of an output, for example level=2. Repeat the option for more.
        plant: Plant of a standard controller: a prefcal plant, a system of {systems}scipy,
            or (A, B, C, D).
        stop_time: Duration of an experiment, in the model's unit of time.
        config: Configuration of the scenario, for example the road and traffic of overtake.
        run_timeout: Time limit for one run of your own scenario; a longer run is ended and counts
            as failed. inf: no limit.
    """

    scenario: str = argument("SCENARIO", kept=Kept("scenario", always=True, anew=True))
    knob: tuple[str, ...] = option((), "KNOB", shown="found, for a standard controller")
    show: tuple[str, ...] = option((), "NAMES", shown="all outputs and inputs")
    reference: tuple[str, ...] = option((), "NAME=NUMBER", shown="none; a standard controller finds one")
    plant: str | None = option(None, "FILE.py:NAME")
    stop_time: float | None = option(None, "TIME", shown="that of the model")
    config: Path | None = option(None, "FILE.json")
    run_timeout: float = option(3600.0, "SECONDS", shown="3600, an hour")


@dataclass(frozen=True, slots=True)
class Options(Described):
    """Options of `prefcal calibrate`, in the order of its help.

    To add an option, add a field with its default and placeholder, and its help below. One with
    `kept` is stored and checked in the study file and cannot change on resuming unless `anew` is
    set; one without applies to a single run. None stands for the default of the component that
    takes the value.

    Args:
        calibrator: Who compares: human, or one of the scenario's synthetic calibrators.
        agent: Who proposes.
        simulate: Number of experiments to simulate unseen. The agent screening learns from your
            answers which of them you would like, and shows only a few. 0: run only what is shown,
            with the agent glisp.
        twin: A rough model of the plant: simulate unseen on this scenario, and run only what is
            shown. It has the plant's knobs and KPIs; prefcal learns how both differ.
        robust: Look for a result that also keeps the limits in 300 perturbed runs: parameters and dead
            time vary as in `prefcal verify`, and the noise. What that costs is said at the end.
        study: Study to start or to resume: a name in your data folder, or a file (with a / or a
            suffix).
        seed: Seed of the agent, the calibrator and the order of the two sides.
        n_init: Number of experiments before learning starts.
        n_max: Largest number of experiments shown; you can add more later.
        questions_per_experiment: Maximum number of comparisons per experiment (glisp only). If
            experiments are expensive, 3 or more comparisons save some. You can change it when you
            resume.
        start: θ of the first experiment, for example your current tuning: "KNOB=VALUE, ..." for
            every knob; one of the scenario's references; or an experiment of another study, MINE:3 or
            MINE:best. Repeat the option for more.
        taste: Earlier study of the same person: start from its answers, as far as its KPIs have the
            names and units of yours. They count half as much as new ones.
        outcomes: Let glisp learn from θ only, not from the KPIs of the experiments.
        cost: What the calibrator synthetic or the agent glis goes by: own.py:NAME, a function of an
            experiment, lower is better; or the name of a KPI.
        out: Folder of the report; must not hold the report of another study.
        at_once: Number of experiments that run at the same time, each in a process of its own: for
            simulations that take minutes, with the agent glisp.
        terminal: Ask in this terminal instead of on a page.
        browser: Print the link of the page, but open no browser.
        host: Address to serve the page on. 0.0.0.0 makes it reachable from other machines.
        port: Port of the page.
        json: Print only JSON on standard output (messages go to standard error).

    Raises:
        SettingsError: If a number is too small, or `n_init` is above `n_max`.
    """

    calibrator: str = option(HUMAN, "NAME", shown="human", kept=Kept("calibrator", always=True))
    agent: str = option(
        "glisp",
        "NAME",
        shown="screening; glisp if the scenario is not a quick simulation",
        kept=Kept("agent", always=True),
        help=_who_proposes(),
    )
    simulate: int = option(
        0,
        "N",
        most=100_000,
        shown="1000; 0 if the scenario is not a quick simulation",
        kept=Kept("simulated unseen", least=0, agents=SIMULATING),
    )
    twin: str | None = option(None, "SCENARIO", shown="none", kept=Kept("twin", agents=SIMULATING))
    robust: bool = option(False, flag="--robust", kept=Kept("robust", agents=SIMULATING))
    study: str | None = option(None, "NAME_OR_PATH", shown="a new one, SCENARIO-1; unattended: none")
    seed: int = option(0, "N", most=MOST_SEED, shown="0", kept=Kept("seed", always=True, least=0))
    n_init: int = option(
        10,
        "N",
        most=MOST,
        shown="10; glisp: 2 per knob; screening: 1; at most half of --n-max",
        kept=Kept("initial experiments", always=True, least=1),
    )
    n_max: int = option(
        50,
        "N",
        most=MOST,
        shown="50; screening: 11",
        kept=Kept("experiments", always=True, anew=True, least=1),
    )
    questions_per_experiment: int = option(
        1,
        "N",
        min=1,
        most=100,
        shown="1",
        kept=Kept("questions per experiment", anew=True, agents=("glisp",)),
    )
    start: tuple[str, ...] = option((), "THETA", shown="the agent's", kept=Kept("begins with"))
    taste: str | None = option(
        None, "STUDY", shown="none", kept=Kept("begins with the taste of", agents=("screening",))
    )
    outcomes: bool = option(True, flag="--no-outcomes", kept=Kept("learns from KPIs", agents=("glisp",)))
    cost: str | None = option(None, "COST", shown="the scenario's score", kept=Kept("cost"))
    out: Path | None = option(None, "FOLDER", shown="./prefcal-STUDY; unattended: ./prefcal-SCENARIO-SEED")
    at_once: int = option(1, "N", min=1, most=MOST_PROCESSES, shown="1")
    terminal: bool = option(False, flag="--terminal")
    browser: bool = option(True, flag="--no-browser")
    host: str = option("127.0.0.1", "ADDRESS")
    port: int = option(0, "N", min=0, max=65535, shown="a free one")
    json: bool = option(False, flag="--json")

    def __post_init__(self) -> None:
        wrong = (p.problem(getattr(self, name)) for name, p in parameters_of(Options).items())
        problem = next(filter(None, wrong), "")
        if not problem and self.n_init > self.n_max:
            problem = (
                f"--n-max must be at least --n-init, got --n-max {self.n_max} and --n-init {self.n_init}"
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
        if stored.get("earlier"):  # what --from was before --start took studies
            kept["start"] += (f"{stored['earlier']}:best",)
        check_programs(kept, given)
        check_unchanged(kept_by(Options), kept, given)
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
        from prefcal_scenarios.described.description import words_of

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


@dataclass(frozen=True, slots=True)
class ChooseOptions:
    """Options of `prefcal choose` that are its own, in the order of its help; `CHOOSING` are the others.

    Args:
        table: CSV, Parquet or Excel file with a row for each run, or the URL of a storage of trials.
        lower: Columns in which lower is better.
        higher: Columns in which higher is better.
        kpis: Columns that count, too; your answers show in which direction.
        of: Study in the storage, if it holds several.
    """

    table: str = argument("TABLE")
    lower: tuple[str, ...] = option((), "NAME,...")
    higher: tuple[str, ...] = option((), "NAME,...")
    kpis: tuple[str, ...] = option((), "NAME,...", shown="all numbers, if no column is named")
    of: str | None = option(None, "NAME", shown="the only one")


CHOOSING = ("study", "seed", "n_max", "start", "out", "terminal", "browser", "host", "port", "json")
"""Options of `Options` that `prefcal choose` takes, too."""


@dataclass(frozen=True, slots=True)
class CheckOptions(Described):
    """Options of `prefcal check`, in the order of its help.

    Args:
        theta: What to run: "KNOB=VALUE, ..." for every knob, the name of a reference, or an experiment
            of a study, MINE:3 or MINE:best.
        out: File of the picture.
        json: Print the result as JSON, and nothing else, on stdout.
    """

    theta: str | None = option(None, "THETA", shown="the middle of the box")
    out: Path | None = option(None, "FILE.png", shown="./check-NAME.png")
    json: bool = option(False, flag="--json")


@dataclass(frozen=True, slots=True)
class LookOptions:
    """Options of `prefcal look`, in the order of its help.

    Args:
        runs: CSV, Parquet or Excel files, or STUDY:3, STUDY:best.
        time: Column of time.
        time_format: Format of time stamps.
        outputs: Columns to show.
        inputs: Columns that are inputs, drawn as steps.
        reference: Reference of an output: a number, or a column.
        unit: Unit of a column without one.
        columns: Name of your own for a column.
        align: Let all runs start at time 0.
        terminal: Show KPIs in this terminal.
        browser: Only print the link.
        host: Address of the page.
        port: Port of the page; 0: any free one.
        out: Write a picture instead.
        json: Print the KPIs as JSON instead.
    """

    runs: tuple[str, ...] = argument("RUN RUN ...")
    time: str | None = option(None, "NAME", shown="time, or the first one")
    time_format: str | None = option(None, "FORMAT", shown="ISO 8601")
    outputs: str = option("", "NAME,...", shown="all others")
    inputs: str = option("", "NAME,...")
    reference: tuple[str, ...] = option((), "NAME=VALUE")
    unit: tuple[str, ...] = option((), "NAME=UNIT")
    columns: tuple[str, ...] = option((), "NAME=HEADING")
    align: bool = option(False, flag="--align")
    terminal: bool = option(False, flag="--terminal")
    browser: bool = option(True, flag="--no-browser")
    host: str = option("127.0.0.1", "ADDRESS")
    port: int = option(0, "N", min=0, max=65535)
    out: Path | None = option(None, "FILE.png")
    json: bool = option(False, flag="--json")


@dataclass(frozen=True, slots=True)
class VerifyOptions:
    """Options of `prefcal verify`, in the order of its help.

    Args:
        best: The best.json of a report.
        runs: Number of random runs; 299 good ones show that less than 1 % are bad.
        range: Relative change of a factor or a kind of factors; 0 leaves it out.
        jobs: Number of processes.
        run_timeout: Time limit of each run, in seconds.
    """

    best: str = argument("BEST.json")
    runs: int = option(299, "N", most=100_000)
    range: tuple[str, ...] = option((), "NAME=CHANGE")
    jobs: int | None = option(None, "N", most=MOST_PROCESSES, shown="all cores")
    run_timeout: float | None = option(None, "SECONDS", shown="3600, an hour")


@dataclass(frozen=True, slots=True)
class OfStudy:
    """Options of a command that loads the scenario of a study.

    Args:
        study: A name, or the path of a file.
        scenario: Your own scenario: own.py:NAME, tank.toml{files}. A study file alone never makes
            prefcal run a program.
        plant: Plant of a standard controller, as for calibrate.
    """

    study: str = argument("STUDY")
    scenario: str | None = option(None, "SCENARIO", shown="the built-in one that the study names")
    plant: str | None = option(None, "FILE.py:NAME")


@dataclass(frozen=True, slots=True)
class ReportOptions(OfStudy):
    """Options of `prefcal report`, in the order of its help.

    Args:
        cost: The cost that the study was started with, if any.
        out: Folder of the report; must not hold the report of another study.
        json: Print only JSON on standard output.
    """

    cost: str | None = option(None, "COST", shown="the scenario's score")
    out: Path | None = option(None, "FOLDER", shown="./prefcal-STUDY")
    json: bool = option(False, flag="--json")


@dataclass(frozen=True, slots=True)
class RespaceOptions(OfStudy):
    """Options of `prefcal studies respace`, in the order of its help.

    Args:
        knob: Search this range, narrower or wider.
        freeze: Keep a knob at this value.
        add: A knob that is new in the scenario, and its value in the experiments so far.
    """

    knob: tuple[str, ...] = option((), "KNOB=LOW:HIGH")
    freeze: tuple[str, ...] = option((), "KNOB=VALUE")
    add: tuple[str, ...] = option((), "KNOB=VALUE")
