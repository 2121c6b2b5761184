"""Run `prefcal identify`: a plant of a record, its numbers with what is open of them, and a picture."""

import shlex
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from prefcal_app.terminal.showing import say
from prefcal_env.errors import SettingsError
from prefcal_env.plants.identify import Identified, interval
from prefcal_env.tables import TableColumns
from prefcal_env.wording import labeled
from prefcal_scenarios.described.identified import Found, StepTest, ends, identified, step_test
from prefcal_scenarios.names import KEPT_PLANT
from prefcal_scenarios.wording import number, picture_at, put, quantity

from .look_run import mapped
from .options import IdentifyOptions
from .result import plain


def run(options: IdentifyOptions) -> int:
    """Identify the record; return the exit code."""
    path = Path(options.record).expanduser()
    target = picture_at(options.out or path.with_suffix(".png"))
    about = TableColumns(
        time=options.time, time_format=options.time_format, units=mapped("--unit", options.unit, "level=m")
    )
    test = step_test(path, about, options.output, options.input)
    limits = _limits(options.limits)
    found, made = identified(path, test, resolution=options.resolution, limits=limits)
    console = Console(emoji=False)
    say(console, f"{test.output.name} by {test.input.name}, {len(test.t)} rows; {test.said}", made.reason)
    console.print(_numbers(found))
    for line in (*_conditions(found, made), *made.notes):
        say(console, line)
    kept = _keep(found, path)
    put(target, picture(test, made))
    say(console, f"Picture: {target}", *kept)
    return 0


def _keep(found: Found, record: Path) -> tuple[str, ...]:
    """Keep what was found beside its record; return where, and what comes next, or why it cannot be kept."""
    path = record.with_suffix(KEPT_PLANT)
    try:
        found.write(path)
    except OSError as error:
        return (f"Plant:   not kept, since {path} cannot be written: {error.strerror}",)
    following = shlex.join(["prefcal", "calibrate", "pid", "--plant", str(record)])
    return f"Plant:   {path}, which is found by its record", f"Next:    {following}"


def _limits(text: str) -> tuple[float, float] | None:
    """Return the numbers of "0:100"; None of nothing."""
    if not text:
        return None
    try:
        low, high = (float(end) for end in text.split(":"))
    except ValueError:
        low, high = np.nan, np.nan
    if not low < high:
        raise SettingsError(
            f"--limits must be LOW:HIGH in the unit of the input, such as 0:100, got {text!r}"
        )
    return low, high


def _numbers(found: Found) -> Table:
    """Return the numbers of the best model, and the 90 % interval of each over the models that have it."""
    headings = "number", "best", "5 %", "95 %", "models"
    table = Table(*headings, box=None, header_style="bold")
    for name, value in found.models[found.best].numbers.items():
        low, high, count = interval(found.models, name)
        texts = number(float(f"{value:.3g}")), *ends(low, high), str(count)
        table.add_row(plain(labeled(name, found.unit(name))), *texts)
    return table


def _conditions(found: Found, made: Identified) -> tuple[str, ...]:
    """Return what the model holds for, a sentence each."""
    (u, y), (of_u, of_y), (low, high) = found.start, found.units, found.limits
    start = f"{found.output} = {_quantity(y, of_y)} and {found.input} = {_quantity(u, of_u)}"
    # Limits go to the plant with the controller: people must know which ones nobody stated.
    assumed = ", which is assumed, twice as far as the record moves it: state --limits"
    by = assumed if found.guessed else " (--limits)"
    return (
        f"Each interval is over those of {len(found.models)} models, which explain the record about as well, "
        "that have the number.",
        f"Noise of {_quantity(made.noise, of_y)}, drift of {_quantity(made.drift, of_y)} over the record.",
        f"The plant is linear around the start, {start}; {found.input} may reach "
        f"{number(low)} to {_quantity(high, of_u)}{by}.",
    )


def _quantity(value: float, unit: str) -> str:
    return quantity(float(f"{value:.3g}"), unit)


def picture(test: StepTest, made: Identified) -> bytes:
    """Return a PNG of the record with the model over it, what is left, and the input."""
    # Imported here: plotting takes half a second, and invalid options must fail fast.
    from prefcal_scenarios.style import BEST, FAINT, OTHERS, canvas, png, style

    with style():
        figure = canvas(5.6)
        axes = figure.subplots(3, 1, sharex=True, height_ratios=(3, 1, 1))
        axes[0].plot(made.t, made.y, ".", color=FAINT, markersize=2.5, label="record")
        axes[0].plot(made.t, made.fit, color=BEST, label="model")
        axes[0].set_ylabel(test.output.label)
        axes[0].legend(loc="best")
        axes[1].axhline(0.0, color=FAINT, linewidth=0.8)
        axes[1].plot(made.t, made.y - made.fit, color=OTHERS[0], linewidth=0.8)
        axes[1].set_ylabel("residual")
        axes[2].step(made.t, made.u, where="post", color=BEST)
        axes[2].set_ylabel(test.input.label)
        axes[2].set_xlabel(labeled("time", test.time_unit))
        return png(figure)
