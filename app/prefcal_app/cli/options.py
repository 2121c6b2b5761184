"""Options of the commands; a new option of `prefcal calibrate` is one new field here."""

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, NoReturn

from typer import Argument, Option

from prefcal_agents.registry import WORDS

from .parameters import Stored, kept_by, parameters_of

HUMAN = "human"  # name of the calibrator that is a person

SYNTHETIC = "synthetic"  # name of the calibrator that compares by a cost

SCORE = "score"  # name of the calibrator if the agent learns from the scenario's score, with no comparisons

MOST, MOST_SIMULATED, MOST_PROCESSES, MOST_SEED = 10_000, 100_000, 256, 2**63 - 1
"""Largest number of experiments that a person or their agent could still handle, that a study could
simulate, of processes that a machine could handle, and seed that a study file could hold."""

BY_VALUE = tuple(word for word, row in WORDS.items() if row.by_value)  # the agents that are told scores

_SEARCHED = 3  # experiments beyond the given ones of a study that compares another tuning
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
            (A, B, C, D), or the record of a step test (see `prefcal identify`).
        limit: Limit of a KPI or margin, for example "overshoot <= 2.5 %" or "phase_margin >= 45": its
            name, as in `prefcal check`, or its title, <= or >=, a number with a decimal point, and a unit.
            Repeat the option for more. It is for standard controllers (--plant), TOML files and FMUs; your
            own Python file states limits itself, as KPI(..., at_most=...), and verify takes it for any.
        stop_time: Duration of an experiment, in the model's unit of time.
        config: Configuration of the scenario, for example the road and traffic of overtake.
        run_timeout: Time limit for one run of your own scenario; a longer run is ended and counts
            as failed. inf: no limit.
    """

    scenario: Annotated[str, Argument(metavar="SCENARIO"), Stored("scenario", always=True, anew=True)]
    knob: Annotated[
        tuple[str, ...], Option(metavar="KNOB", show_default="found, for a standard controller")
    ] = ()
    show: Annotated[tuple[str, ...], Option(metavar="NAMES", show_default="all outputs and inputs")] = ()
    reference: Annotated[
        tuple[str, ...], Option(metavar="NAME=NUMBER", show_default="none; a standard controller finds one")
    ] = ()
    plant: Annotated[str | None, Option(metavar="FILE.py:NAME")] = None
    limit: Annotated[tuple[str, ...], Option(metavar="LIMIT", show_default="none")] = ()
    stop_time: Annotated[float | None, Option(metavar="TIME", show_default="that of the model")] = None
    config: Annotated[Path | None, Option(metavar="FILE.json")] = None
    run_timeout: Annotated[float, Option(metavar="SECONDS", show_default="3600, an hour")] = 3600.0


@dataclass(frozen=True, slots=True)
class Options(Described):
    """Options of `prefcal calibrate`, in the order of its help.

    To add an option, add a field, annotated as typer wants it, and its help below. One with `Stored`
    is stored in the study file, and cannot change on resuming unless `anew` is set; one without
    applies to a single run. None stands for the default of the component that takes the value.

    Args:
        calibrator: Who compares: human, or one of the scenario's synthetic calibrators.
        by: Your name, for the acceptance sheet.
        agent: Who proposes.
        simulate: Number of experiments to simulate unseen. The agent screening learns from your
            answers which of them you would like, and shows only a few. 0: run only what is shown,
            with the agent glisp.
        twin: A rough model of the plant: simulate unseen on this scenario, and run only what is
            shown. It has the plant's knobs and KPIs; prefcal learns how both differ.
        robust: Look for a result that also keeps the limits in 300 runs with varied plants, or in most of
            them if none keeps all. With stated limits, everything varies that `prefcal verify` varies, except
            signs of steps and loads; without, only parameters, dead time and noise. What that costs is said
            at the end, if no other one is found to hold in more.
        study: Study to start or to resume: a name in your data folder, or a file (with a / or a
            suffix).
        seed: Seed of the agent, the calibrator and the order of the two sides.
        n_init: Number of experiments before learning starts.
        n_max: Largest number of experiments shown; you can add more later.
        questions_per_experiment: Maximum number of comparisons per experiment (glisp only). If
            experiments are expensive, 3 or more comparisons save some. You can change it when you
            resume.
        start: θ of the first experiment, for example your current tuning: "KNOB=VALUE, ..." for
            every knob; one of the scenario's references; an experiment of another study, MINE:3 or
            MINE:best; or a best.json. Repeat the option for more.
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
    """

    calibrator: Annotated[str, Option(metavar="NAME"), Stored("calibrator", always=True)] = HUMAN
    by: Annotated[str | None, Option(metavar="NAME", show_default="none"), Stored()] = None
    agent: Annotated[
        str,
        Option(
            metavar="NAME",
            show_default="screening; glisp if the scenario is not a quick simulation",
            help=_who_proposes(),
        ),
        Stored("agent", always=True),
    ] = "glisp"
    simulate: Annotated[
        int,
        Option(metavar="N", min=0, show_default="1000; 0 if the scenario is not a quick simulation"),
        Stored("simulated unseen", agents=SIMULATING),
    ] = 0
    twin: Annotated[
        str | None, Option(metavar="SCENARIO", show_default="none"), Stored("twin", agents=SIMULATING)
    ] = None
    robust: Annotated[bool, Option("--robust"), Stored("robust", agents=SIMULATING)] = False
    study: Annotated[
        str | None, Option(metavar="NAME_OR_PATH", show_default="a new one, SCENARIO-1; unattended: none")
    ] = None
    seed: Annotated[int, Option(metavar="N", min=0), Stored("seed", always=True)] = 0
    n_init: Annotated[
        int,
        Option(
            metavar="N",
            min=1,
            max=MOST,
            show_default="10; glisp: 2 per knob; screening: 1; at most half of --n-max",
        ),
        Stored("initial experiments", always=True),
    ] = 10
    n_max: Annotated[
        int,
        Option(metavar="N", min=1, max=MOST, show_default="50; screening: 11"),
        Stored("experiments", always=True, anew=True),
    ] = 50
    questions_per_experiment: Annotated[
        int,
        Option(metavar="N", min=1, max=100),
        Stored("questions per experiment", anew=True, agents=("glisp",)),
    ] = 1
    start: Annotated[
        tuple[str, ...], Option(metavar="THETA", show_default="the agent's"), Stored("begins with")
    ] = ()
    taste: Annotated[
        str | None,
        Option(metavar="STUDY", show_default="none"),
        Stored("begins with the taste of", agents=("screening",)),
    ] = None
    outcomes: Annotated[bool, Option("--no-outcomes"), Stored("learns from KPIs", agents=("glisp",))] = True
    cost: Annotated[
        str | None, Option(metavar="COST", show_default="the scenario's score"), Stored("cost")
    ] = None
    out: Annotated[
        Path | None,
        Option(metavar="FOLDER", show_default="./prefcal-STUDY; unattended: ./prefcal-SCENARIO-SEED"),
    ] = None
    at_once: Annotated[int, Option(metavar="N", min=1, max=MOST_PROCESSES)] = 1
    terminal: Annotated[bool, Option("--terminal")] = False
    browser: Annotated[bool, Option("--no-browser")] = True
    host: Annotated[str, Option(metavar="ADDRESS")] = "127.0.0.1"
    port: Annotated[int, Option(metavar="N", min=0, max=65535, show_default="a free one")] = 0
    json: Annotated[bool, Option("--json")] = False

    def __post_init__(self) -> None:
        # Not in the annotations: so wide a range would leave the help no room in 80 columns.
        for name, most in (("seed", MOST_SEED), ("simulate", MOST_SIMULATED)):
            if getattr(self, name) > most:
                _refuse(f"--{name} must be at most {most}, got {getattr(self, name)}")
        if self.by is not None and not self.by_a_person:
            _refuse(f"--by names the person who answers, here {self.calibrator} does: leave it out")
        if self.n_init > self.n_max:
            _refuse(f"--n-max must be at least --n-init, got --n-max {self.n_max} and --n-init {self.n_init}")

    @classmethod
    def of(cls, given: Mapping[str, Any], knobs: int = 5, *, simulated: bool = False) -> "Options":
        """Return the given options, with defaults for the others.

        Args:
            given: Values by name.
            knobs: Number of knobs of the scenario.
            simulated: Whether an experiment of the scenario is a quick simulation.
        """
        return cls(**{**_defaults(given, knobs, simulated or "twin" in given), **given})

    @classmethod
    def resumed(cls, stored: Mapping[str, Any], given: Mapping[str, Any]) -> "Options":
        """Return the current options of a study: those it was started with, and allowed changes."""
        kept = {name: stored[name] for name in kept_by(cls) if name in stored}
        kept["start"] = tuple(kept.get("start", ()))  # a list in JSON
        _check_programs(kept, given)
        for name, (parameter, rule) in kept_by(cls).items():
            then, now = kept.get(name), given.get(name)
            if now not in (None, then) and not rule.anew:
                _refuse(
                    f"the study was started with {parameter.said(then)}, got {parameter.said(now)}: "
                    "leave the option out, or start another study"
                )
        if (wanted := given.get("n_max", kept["n_max"])) < kept["n_max"]:
            _refuse(f"--n-max must not be below the {kept['n_max']} that the study has by now, got {wanted}")
        return cls(**{**kept, **given})

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
            kept.label: _shown(getattr(self, name))
            for name, (_, kept) in kept_by(Options).items()
            if kept.label and (kept.always or self.changed(name))
        }

    def anew(self) -> str:
        """Return a command line that compares the tuning before, if it was given, with two that follow.

        An agent that simulates then searches on, with a few questions. A study that is kept also tells the
        new one what its answers taught.
        """
        kept, start = self.study if self.by_a_person else None, self.start[:1]
        taste = kept if kept and self.agent == "screening" else self.taste
        robust, given = self.agent in SIMULATING, 2 + len(start)
        n_init, n_max = min(self.n_init, given), given + _SEARCHED * robust
        return replace(self, start=start, taste=taste, n_init=n_init, n_max=n_max, robust=robust).command()

    def again(self) -> str:
        """Return a command line that resumes the study, which is kept."""
        from prefcal_scenarios.described.description import words_to_resume
        from prefcal_scenarios.names import is_own, is_table

        words = ["prefcal", "choose" if is_table(self.scenario) else "calibrate"]
        words += [*words_to_resume(self.scenario), "--study", self.study or ""]
        words += [] if self.cost is None else ["--cost", self.cost]
        words += ["--twin", self.twin] if self.twin is not None and is_own(self.twin) else []
        return shlex.join(words)

    def command(self) -> str:
        """Return a command line that repeats the study, without its folder."""
        from prefcal_scenarios.described.description import words_of

        words = ["prefcal", "calibrate", *words_of(self.scenario)]
        for name, (parameter, kept) in kept_by(Options).items():
            if name != "scenario" and (kept.always or self.changed(name)):
                words += parameter.words(getattr(self, name))
        return shlex.join(words)


def _shown(value: Any) -> Any:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "; ".join(value) if isinstance(value, tuple) else value


def _refuse(words: str) -> NoReturn:
    # Imported here, and below: --help must not import numpy.
    from prefcal_env.errors import SettingsError

    raise SettingsError(words)


def _check_programs(kept: Mapping[str, Any], given: Mapping[str, Any]) -> None:
    """Raise SettingsError if the study's program or configuration is not the one given."""
    from prefcal_scenarios.names import is_described, is_own
    from prefcal_scenarios.own import split_source

    for name, does in (("cost", "goes by a cost that was given to it"), ("twin", "simulates with a program")):
        program = str(kept.get(name) or "")
        if name not in given and is_own(program):
            _refuse(f"the study {does}: if you trust it, add --{name} {shlex.quote(program)}")
    if is_described(str(kept.get("scenario", ""))):
        return  # checked when its source was made
    # The configuration's file may have moved, so compare only its content.
    then = split_source(str(kept.get("scenario", "")))[1]
    now = split_source(given["scenario"])[1] if "scenario" in given else then
    if now != then:
        said = "no --config" if then is None else f"the configuration {then}"
        _refuse(
            f"the study was started with {said}, got {'none' if now is None else now}: give the "
            "same one, or start another study"
        )


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

    table: Annotated[str, Argument(metavar="TABLE")]
    lower: Annotated[tuple[str, ...], Option(metavar="NAME,...")] = ()
    higher: Annotated[tuple[str, ...], Option(metavar="NAME,...")] = ()
    kpis: Annotated[
        tuple[str, ...], Option(metavar="NAME,...", show_default="all numbers, if no column is named")
    ] = ()
    of: Annotated[str | None, Option(metavar="NAME", show_default="the only one")] = None


CHOOSING = ("by", "study", "seed", "n_max", "start", "out", "terminal", "browser", "host", "port", "json")
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

    theta: Annotated[str | None, Option(metavar="THETA", show_default="the middle of the box")] = None
    out: Annotated[Path | None, Option(metavar="FILE.png", show_default="./check-NAME.png")] = None
    json: Annotated[bool, Option("--json")] = False


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

    runs: Annotated[tuple[str, ...], Argument(metavar="RUN RUN ...")]
    time: Annotated[str | None, Option(metavar="NAME", show_default="time, or the first one")] = None
    time_format: Annotated[str | None, Option(metavar="FORMAT", show_default="ISO 8601")] = None
    outputs: Annotated[str, Option(metavar="NAME,...", show_default="all others")] = ""
    inputs: Annotated[str, Option(metavar="NAME,...")] = ""
    reference: Annotated[tuple[str, ...], Option(metavar="NAME=VALUE")] = ()
    unit: Annotated[tuple[str, ...], Option(metavar="NAME=UNIT")] = ()
    columns: Annotated[tuple[str, ...], Option(metavar="NAME=HEADING")] = ()
    align: Annotated[bool, Option("--align")] = False
    terminal: Annotated[bool, Option("--terminal")] = False
    browser: Annotated[bool, Option("--no-browser")] = True
    host: Annotated[str, Option(metavar="ADDRESS")] = "127.0.0.1"
    port: Annotated[int, Option(metavar="N", min=0, max=65535)] = 0
    out: Annotated[Path | None, Option(metavar="FILE.png")] = None
    json: Annotated[bool, Option("--json")] = False


@dataclass(frozen=True, slots=True)
class IdentifyOptions:
    """Options of `prefcal identify`, in the order of its help.

    Args:
        record: CSV, Parquet or Excel file of a step test.
        input: Column of what was stepped.
        output: Column of what responded.
        time: Column of time.
        time_format: Format of time stamps.
        unit: Unit of a column without one.
        limits: What the input may reach.
        resolution: Smallest move of the actuator, in the unit of the input.
        out: Picture of record and model.
    """

    record: Annotated[str, Argument(metavar="RECORD")]
    input: Annotated[str, Option(metavar="NAME", show_default="the one that steps")] = ""
    output: Annotated[str, Option(metavar="NAME", show_default="the other one")] = ""
    time: Annotated[str | None, Option(metavar="NAME", show_default="called time, or first")] = None
    time_format: Annotated[str | None, Option(metavar="FORMAT", show_default="ISO 8601")] = None
    unit: Annotated[tuple[str, ...], Option(metavar="NAME=UNIT")] = ()
    limits: Annotated[str, Option(metavar="LOW:HIGH", show_default="0:100 if in %")] = ""
    resolution: Annotated[float, Option(metavar="NUMBER", min=0.0)] = 0.0
    out: Annotated[Path | None, Option(metavar="FILE.png", show_default="beside the record")] = None


@dataclass(frozen=True, slots=True)
class VerifyOptions:
    """Options of `prefcal verify`, in the order of its help.

    Args:
        best: The best.json of a report, or its folder.
        runs: Number of random runs; 299 good ones show that less than 1 % are bad.
        limit: Limit by which to judge, beside those of the study, for example "overshoot <= 2.5 %" or
            "phase_margin >= 45": the name of a KPI or margin, or its title, <= or >=, a number with a
            decimal point, and a unit. Repeat the option for more.
        range: Relative change of a factor or a kind of factors; 0 leaves it out.
        seed: Seed of the variations: with another one, all plants are new.
        jobs: Number of processes.
        run_timeout: Time limit of each run, in seconds.
    """

    best: Annotated[str, Argument(metavar="BEST.json")]
    runs: Annotated[int, Option(metavar="N", max=100_000)] = 299
    limit: Annotated[tuple[str, ...], Option(metavar="LIMIT")] = ()
    range: Annotated[tuple[str, ...], Option(metavar="NAME=CHANGE")] = ()
    seed: Annotated[int, Option(metavar="N", min=0)] = 0
    jobs: Annotated[int | None, Option(metavar="N", max=MOST_PROCESSES, show_default="all cores")] = None
    run_timeout: Annotated[float | None, Option(metavar="SECONDS", show_default="3600, an hour")] = None


class Target(StrEnum):
    """What `prefcal export` writes."""

    ST = "st"
    C = "c"
    FORMS = "forms"


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Options of `prefcal export`, in the order of its help.

    Args:
        best: The best.json of a report, or its folder.
        to: st: IEC 61131-3 structured text of a PID; c: C99 of a PID, LQR, LQG or linear MPC; forms: the
            numbers of a PID in ISA, parallel and series form.
        name: Name of the function block, or of the C function.
        out: File to write.
        time: Unit of the times in the forms: s, min or h.
        ranges: Ranges of the measured output and of the input in your system: gain and proportional band
            in percent are for these.
    """

    best: Annotated[str, Argument(metavar="BEST.json")]
    to: Annotated[Target, Option("--to")]
    name: Annotated[str, Option(metavar="NAME")] = "tuned"
    out: Annotated[Path | None, Option(metavar="FILE", show_default="standard output")] = None
    time: Annotated[str, Option(metavar="UNIT", show_default="that of the plant")] = ""
    ranges: Annotated[str, Option(metavar="LOW:HIGH,LOW:HIGH", show_default="not in percent")] = ""


@dataclass(frozen=True, slots=True)
class OfStudy:
    """Options of a command that loads the scenario of a study.

    Args:
        study: A name, or the path of a file.
        scenario: Your own scenario: own.py:NAME, tank.toml{files}. A study file alone never makes
            prefcal run a program.
        plant: Plant of a standard controller, as for calibrate.
    """

    study: Annotated[str, Argument(metavar="STUDY")]
    scenario: Annotated[
        str | None, Option(metavar="SCENARIO", show_default="the built-in one that the study names")
    ] = None
    plant: Annotated[str | None, Option(metavar="FILE.py:NAME")] = None


@dataclass(frozen=True, slots=True)
class ReportOptions(OfStudy):
    """Options of `prefcal report`, in the order of its help.

    Args:
        cost: The cost that the study was started with, if any.
        out: Folder of the report; must not hold the report of another study.
        json: Print only JSON on standard output.
    """

    cost: Annotated[str | None, Option(metavar="COST", show_default="the scenario's score")] = None
    out: Annotated[Path | None, Option(metavar="FOLDER", show_default="./prefcal-STUDY")] = None
    json: Annotated[bool, Option("--json")] = False


@dataclass(frozen=True, slots=True)
class RespaceOptions(OfStudy):
    """Options of `prefcal studies respace`, in the order of its help.

    Args:
        knob: Search this range, narrower or wider.
        freeze: Keep a knob at this value.
        add: A knob that is new in the scenario, and its value in the experiments so far.
    """

    knob: Annotated[tuple[str, ...], Option(metavar="KNOB=LOW:HIGH")] = ()
    freeze: Annotated[tuple[str, ...], Option(metavar="KNOB=VALUE")] = ()
    add: Annotated[tuple[str, ...], Option(metavar="KNOB=VALUE")] = ()
