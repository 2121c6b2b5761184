"""Options that describe a scenario: its knobs, what to show, references, plant and stop time."""

from typing import Annotated

from typer import Option

KnobOption = Annotated[
    tuple[str, ...],
    Option(
        "--knob",
        metavar="KNOB",
        help="Knob of an FMU or a standard controller: NAME=LOW:HIGH[:log][:int] UNIT, for example "
        '"K_p=0.1:50:log %/m". Repeat the option for more.',
        show_default="found, for a standard controller",
    ),
]
ShowOption = Annotated[
    tuple[str, ...],
    Option(
        "--show",
        metavar="NAMES",
        help="Curves to show, for example level,valve; of an FMU also in another unit, "
        r'"T \[degC]".',
        show_default="all outputs and inputs",
    ),
]
ReferenceOption = Annotated[
    tuple[str, ...],
    Option(
        "--reference",
        metavar="NAME=NUMBER",
        help="Desired value of an output, for example level=2. Repeat the option for more.",
        show_default="none; a standard controller finds one",
    ),
]
PlantOption = Annotated[
    str | None,
    Option(
        "--plant",
        metavar="FILE.py:NAME",
        help="Plant of a standard controller: a prefcal plant, a system of python-control or "
        "scipy, or (A, B, C, D).",
    ),
]
StopTimeOption = Annotated[
    float | None,
    Option(
        "--stop-time",
        metavar="TIME",
        help="Duration of an experiment, in the model's unit of time.",
        show_default="that of the model",
    ),
]
