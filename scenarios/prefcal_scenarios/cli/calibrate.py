"""`prefcal calibrate`: one study from start to report."""

import os
from pathlib import Path
from typing import Annotated

import typer

EPILOG = """\
[bold]Examples[/bold]

[cyan]prefcal calibrate cstr[/cyan]
  The paper's reactor: 50 experiments, 49 answers by its synthetic calibrator.

[cyan]prefcal calibrate cstr --seed 7 --out reactor[/cyan]
  Another start of the search; the report goes to the folder reactor.

[cyan]prefcal calibrate cstr --calibrator synthetic --tie-band 0.02 --answer-noise 0.05[/cyan]
  A calibrator who sees small differences as ties and errs now and then.

[cyan]prefcal calibrate own.py:plant --agent random --n-max 20 --json[/cyan]
  Your own scenario, random search, result as JSON for a program.
"""


_Scenario = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name (see `prefcal scenarios`) or own.py:name.")
]
_Calibrator = Annotated[
    str, typer.Option(help="Who compares: one of the scenario's synthetic calibrators.")
]
_Agent = Annotated[str, typer.Option(help="Who proposes: glisp, random or lhs.")]
_Seed = Annotated[int, typer.Option(help="Of the agent and the calibrator.")]
_Initial = Annotated[
    int | None,
    typer.Option(
        help="Experiments before learning starts.",
        show_default="10, or half of --n-max if that is less",
    ),
]
_Experiments = Annotated[int, typer.Option(help="Experiments in all.")]
_Delta = Annotated[
    float | None,
    typer.Option(help="How much glisp explores (δ of the paper).", show_default="the agent's"),
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
_Folder = Annotated[
    Path | None,
    typer.Option(help="Folder of the report; may exist.", show_default="./prefcal-SCENARIO-SEED"),
]
_Json = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on stdout.")
]


def calibrate(
    scenario: _Scenario,
    calibrator: _Calibrator = "synthetic",
    agent: _Agent = "glisp",
    seed: _Seed = 0,
    n_init: _Initial = None,
    n_max: _Experiments = 50,
    delta: _Delta = None,
    tie_band: _TieBand = None,
    answer_noise: _Noise = None,
    out: _Folder = None,
    json: _Json = False,
) -> None:
    """Calibrate SCENARIO by preferences, and write a report of it.

    Proposes θ, runs the experiment, has it compared with the best so far, and learns from the
    answer. Ctrl-C stops and leaves a report of the comparisons so far.
    """
    _one_thread()
    # Here, not above: --help must not wait for it, and numpy reads the environment once.
    from prefcal_scenarios.cli.options import Options
    from prefcal_scenarios.cli.session import run

    options = Options(
        scenario, calibrator, agent, seed, _initial(n_init, n_max), n_max, delta, tie_band,
        answer_noise,
    )  # fmt: skip
    raise typer.Exit(run(options, out, json=json))


def _one_thread() -> None:
    """Keep linear algebra on one thread, unless the user has said otherwise.

    Our matrices are small: threads spend twice the time, most of it waiting for each other.
    """
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def _initial(n_init: int | None, n_max: int) -> int:
    return min(10, max(1, n_max // 2)) if n_init is None else n_init
