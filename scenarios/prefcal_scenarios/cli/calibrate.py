"""`prefcal calibrate`: one study from start to report."""

from pathlib import Path
from typing import Annotated

import typer

from prefcal_scenarios.cli.threads import one_thread

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal calibrate cstr[/cyan]
  The paper's reactor: a page opens and asks you 49 times which of two experiments is better.

[cyan]prefcal calibrate cstr --study mine[/cyan]
  The same under a name of your own; the same line again goes on where you stopped.

[cyan]prefcal calibrate cstr --terminal[/cyan]
  Asked in this terminal, on a machine without a browser.

[cyan]prefcal calibrate cstr --calibrator synthetic --seed 7 --out reactor[/cyan]
  Unattended: the scenario's own calibrator answers; the report goes to the folder reactor.

[cyan]prefcal calibrate cstr --calibrator synthetic --tie-band 0.02 --answer-noise 0.05[/cyan]
  A calibrator who sees small differences as ties and errs now and then.

[cyan]prefcal calibrate cstr --start "T_s=0.5, N_p=30, log_Q=-1"[/cyan]
  The first experiment is your present tuning: everything is compared with that from the start.

[cyan]prefcal calibrate cstr --from mine --study hers[/cyan]
  Another person, or a similar plant: the best θ of the study called mine are tried early.

[cyan]prefcal calibrate cstr --agent glis[/cyan]
  What optimisation finds when it sees the score that you could not write down.

[cyan]prefcal calibrate cstr --agent glis --cost mine.py:cost[/cyan]
  Unattended by what you cared about: mine.py is written by `prefcal studies index`.

[cyan]prefcal calibrate own.py:plant --agent random --n-max 20[/cyan]
  Your own scenario, simulated or a rig that you run yourself; random search.
"""


_Scenario = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name (see `prefcal scenarios`) or own.py:name.")
]
_Calibrator = Annotated[
    str | None,
    typer.Option(
        help="Who compares: human, or one of the scenario's synthetic calibrators.",
        show_default="human",
    ),
]
_Agent = Annotated[
    str | None,
    typer.Option(
        help="Who proposes: glisp, glis (learns from the scenario's score, asks nobody), random or "
        "lhs.",
        show_default="glisp",
    ),
]
_Study = Annotated[
    str | None,
    typer.Option(
        metavar="NAME_OR_PATH",
        help="Study to begin or to go on with: a name in your data folder, or a file "
        "(with a / or a suffix).",
        show_default="a new one, SCENARIO-1; unattended: none",
    ),
]
_Seed = Annotated[
    int | None,
    typer.Option(help="Of the agent, the calibrator and the sides.", show_default="0"),
]
_Initial = Annotated[
    int | None,
    typer.Option(
        help="Experiments before learning starts.",
        show_default="10; glisp: 2 a knob; at most half of --n-max",
    ),
]
_Experiments = Annotated[
    int | None,
    typer.Option(help="Experiments in all; a study can be given more later.", show_default="50"),
]
_Delta = Annotated[
    float | None,
    typer.Option(help="How much glisp explores (δ of the paper).", show_default="the agent's"),
]
_Questions = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Most comparisons for each experiment: where runs are dear and looking is cheap, 3 "
        "or more spare experiments (glisp only). Another number changes that of a study.",
        show_default="1",
    ),
]
_Start = Annotated[
    list[str] | None,
    typer.Option(
        metavar="THETA",
        help="θ of the first experiment, your present tuning say: "
        '"KNOB=VALUE, ..." for every knob, or the name of one of the scenario\'s references. '
        "May be given several times.",
        show_default="the agent's",
    ),
]
_Earlier = Annotated[
    str | None,
    typer.Option(
        "--from",
        metavar="STUDY",
        help="An earlier study, another person's or of a similar plant: its best θ are among the "
        "first experiments. A name or the path of a file.",
    ),
]
_TieBand = Annotated[
    float | None,
    typer.Option(
        help="Costs this close are a tie to the synthetic calibrator.",
        show_default="the scenario's",
    ),
]
_Noise = Annotated[
    float | None,
    typer.Option(
        help="Standard deviation of his error in each cost.", show_default="the scenario's"
    ),
]
_NoOutcomes = Annotated[
    bool,
    typer.Option("--no-outcomes", help="glisp learns from θ alone, not from KPIs of experiments."),
]
_Cost = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:NAME",
        help="For glis: a function of an experiment, lower is better.",
        show_default="the scenario's score",
    ),
]
_Folder = Annotated[
    Path | None,
    typer.Option(help="Folder of the report; may exist.", show_default="./prefcal-SCENARIO-SEED"),
]
_Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]


_Terminal = Annotated[bool, typer.Option("--terminal", help="Ask here, not on a page.")]
_NoBrowser = Annotated[
    bool, typer.Option("--no-browser", help="Only print the page's link; open no browser.")
]
_Host = Annotated[
    str,
    typer.Option(help="Address to serve the page on. Other than loopback: others can reach it."),
]
_Port = Annotated[
    int, typer.Option(min=0, max=65535, help="Port of the page.", show_default="a free one")
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
    out: _Folder = None,
    terminal: _Terminal = False,
    no_browser: _NoBrowser = False,
    host: _Host = "127.0.0.1",
    port: _Port = 0,
    json: _Json = False,
) -> None:
    """Calibrate SCENARIO by preferences, and write a report of it.

    Proposes θ, runs the experiment, shows it beside the best so far, and learns
    from the answer: yours on a local page, or a synthetic calibrator's. Every
    answer is saved before the next question; Ctrl-C stops and leaves a report of
    the comparisons so far.
    """
    one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.fronts import Front
    from prefcal_scenarios.cli.session import run

    given = {
        "scenario": scenario, "calibrator": calibrator, "agent": agent, "seed": seed,
        "n_init": n_init, "n_max": n_max, "delta": delta, "tie_band": tie_band,
        "answer_noise": answer_noise, "questions_per_experiment": questions_per_experiment,
        "start": tuple(start) if start else None, "earlier": earlier,
        "outcomes": False if no_outcomes else None, "cost": cost,
    }  # fmt: skip
    front = Front(terminal, not no_browser, host, port)
    raise typer.Exit(run(given, study, out, front, json=json))
