"""`prefcal calibrate`: one study from start to report."""

from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal calibrate cstr[/cyan]
  The paper's reactor: a page opens and asks 49 times which experiment is better.

[cyan]prefcal calibrate cstr --study mine[/cyan]
  The same in a study called mine; the same command resumes it.

[cyan]prefcal calibrate cstr --terminal[/cyan]
  Answer in this terminal, on a machine without a browser.

[cyan]prefcal calibrate cstr --calibrator synthetic --seed 7 --out reactor[/cyan]
  Unattended: a synthetic calibrator answers; the report goes to reactor.

[cyan]prefcal calibrate cstr --calibrator synthetic --answer-noise 0.05[/cyan]
  Unattended, with answers that are sometimes wrong.

[cyan]prefcal calibrate cstr --start "T_s=0.5, N_p=30, log_Q=-1"[/cyan]
  Start from your present tuning: the first experiment runs it.

[cyan]prefcal calibrate cstr --from mine --study second[/cyan]
  Another person or a similar plant: try the best θ of the study mine early.

[cyan]prefcal calibrate cstr --agent glisp-paper[/cyan]
  The algorithm as published, without what this project adds.

[cyan]prefcal calibrate cstr --agent glis[/cyan]
  What optimization finds when it sees the scenario's score.

[cyan]prefcal calibrate cstr --agent glis --cost mine_index.py:cost[/cyan]
  Unattended, scored by what your answers have taught (`prefcal studies index`).

[cyan]prefcal calibrate overtake --config traffic.json[/cyan]
  The overtaking on another road, in other traffic (see docs/overtaking.md).
[cyan]prefcal calibrate overtake --processor target.json[/cyan]
  The controller must run in real time on your own target.

[cyan]prefcal calibrate own.py:plant --agent random --n-max 20[/cyan]
  Your own scenario, simulated or a rig that you run yourself; random search.

[cyan]prefcal calibrate cstr --host 0.0.0.0 --no-browser[/cyan]
  Answer from another machine: prints a link for it.
"""


_Scenario = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name (see `prefcal scenarios`) or own.py:NAME.")
]
_Calibrator = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Who compares: human, or one of the scenario's synthetic calibrators.",
        show_default="human",
    ),
]
_Agent = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Who proposes: glisp, glisp-paper (the algorithm as published), glis (learns from "
        "the scenario's score, asks nobody), random or lhs.",
        show_default="glisp",
    ),
]
_Study = Annotated[
    str | None,
    typer.Option(
        metavar="NAME_OR_PATH",
        help="Study to start or to resume: a name in your data folder, or a file "
        "(with a / or a suffix).",
        show_default="a new one, SCENARIO-1; unattended: none",
    ),
]
_Seed = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Seed of the agent, of the calibrator and of the order of the two sides.",
        show_default="0",
    ),
]
_Initial = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Experiments before learning starts.",
        show_default="10; glisp: 2 per knob; at most half of --n-max",
    ),
]
_Experiments = Annotated[
    int | None,
    typer.Option(
        metavar="N", help="Experiments in all; you can add more later.", show_default="50"
    ),
]
_Delta = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER",
        help="How much glisp explores (δ of the paper).",
        show_default="the agent's",
    ),
]
_Questions = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Most comparisons per experiment (glisp only). If experiments are expensive and "
        "comparing is cheap, 3 or more save experiments. You can change it when you resume.",
        show_default="1",
    ),
]
_Start = Annotated[
    list[str] | None,
    typer.Option(
        metavar="THETA",
        help="θ of the first experiment, for example your present tuning: "
        '"KNOB=VALUE, ..." for every knob, or the name of one of the scenario\'s references. '
        "Repeat the option for more.",
        show_default="the agent's",
    ),
]
_Earlier = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="STUDY",
        help="An earlier study, of another person or a similar plant: its best θ is one of the "
        "first experiments. A name or the path of a file.",
    ),
]
_TieBand = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER",
        help="The synthetic calibrator calls costs that are this close a tie.",
        show_default="the scenario's",
    ),
]
_Noise = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER",
        help="Standard deviation of the synthetic calibrator's error in each cost.",
        show_default="the scenario's",
    ),
]
_NoOutcomes = Annotated[
    bool,
    typer.Option(
        "--no-outcomes",
        metavar="",
        help="glisp learns from θ only, not from the KPIs of the experiments.",
    ),
]
_Cost = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:NAME",
        help="For glis: a function of an experiment, lower is better.",
        show_default="the scenario's score",
    ),
]
_Config = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.json",
        help="Another configuration of the scenario: road and traffic of overtake, say.",
    ),
]
_Processor = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.json",
        help="Judge computation times on this processor (`prefcal processor` makes the file). The "
        "study keeps a copy.",
        show_default="the scenario's",
    ),
]
_Folder = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Folder of the report; may exist, but not with the report of another study.",
        show_default="./prefcal-STUDY; unattended: ./prefcal-SCENARIO-SEED",
    ),
]
_Json = Annotated[
    bool,
    typer.Option(
        "--json",
        metavar="",
        help="Print only JSON on standard output (messages go to standard error).",
    ),
]


_Terminal = Annotated[
    bool, typer.Option("--terminal", metavar="", help="Ask in this terminal instead of on a page.")
]
_RunTimeout = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        help="Most seconds that one run of your own scenario may take; a longer one is ended and "
        "counts as failed. inf: no limit.",
        show_default="3600, an hour",
    ),
]
_NoBrowser = Annotated[
    bool,
    typer.Option(
        "--no-browser", metavar="", help="Print the link of the page, but open no browser."
    ),
]
_Host = Annotated[
    str,
    typer.Option(
        metavar="ADDRESS",
        help="Address to serve the page on. 0.0.0.0 lets other machines on the network in.",
    ),
]
_Port = Annotated[
    int,
    typer.Option(
        min=0, max=65535, metavar="N", help="Port of the page.", show_default="a free one"
    ),
]


def calibrate(
    scenario: _Scenario,
    calibrator: _Calibrator = None,
    agent: _Agent = None,
    study: _Study = None,
    seed: _Seed = None,
    n_init: _Initial = None,
    n_max: _Experiments = None,
    delta: _Delta = None,
    questions_per_experiment: _Questions = None,
    start: _Start = None,
    earlier: _Earlier = None,
    tie_band: _TieBand = None,
    answer_noise: _Noise = None,
    no_outcomes: _NoOutcomes = False,
    cost: _Cost = None,
    config: _Config = None,
    processor: _Processor = None,
    out: _Folder = None,
    run_timeout: _RunTimeout = 3600.0,
    terminal: _Terminal = False,
    no_browser: _NoBrowser = False,
    host: _Host = "127.0.0.1",
    port: _Port = 0,
    json: _Json = False,
) -> None:
    """Tune SCENARIO by comparing experiments, and write a report.

    prefcal proposes θ, runs the experiment, shows it next to the best so far, and
    learns from your answer, on a local page, or from a synthetic calibrator's.
    Every answer is saved before the next question. Ctrl-C stops and writes a
    report of the comparisons so far; the same --study resumes.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.fronts import Front
    from prefcal_scenarios.cli.session import run
    from prefcal_scenarios.source import with_config_of

    given = {
        "scenario": with_config_of(scenario, config), "calibrator": calibrator, "agent": agent,
        "seed": seed, "n_init": n_init, "n_max": n_max, "delta": delta, "tie_band": tie_band,
        "answer_noise": answer_noise, "questions_per_experiment": questions_per_experiment,
        "start": tuple(start) if start else None, "earlier": earlier,
        "outcomes": False if no_outcomes else None, "cost": cost, "processor": processor,
    }  # fmt: skip
    front = Front(terminal, not no_browser, host, port)
    raise typer.Exit(run(given, study, out, front, run_timeout=run_timeout, json=json))
