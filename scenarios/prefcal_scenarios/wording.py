"""Numbers, names and PIDs as people read them, and the folder that a report goes to."""

import os
import re
from collections.abc import Sequence
from math import ceil, floor, inf, isfinite, isinf, log10, nan
from pathlib import Path

from markupsafe import Markup, escape

from prefcal_env.disk import whole_file
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.wording import labeled as labeled

from .scenario import KPI

# --- Format numbers and names for terminals, HTML and plots.

_SUBSCRIPTED = re.compile(r"([^\W_]+)_(\w+)")
# Not between quotes, whose end is an entity in HTML: what is there is typed.
# A slash is of a path, unless it is that of a quotient of symbols: 1/T_i, K_p/T_i, T_d/N.
_SYMBOL = re.compile(
    r"(?:(?<![\w./:;-])|(?<=\b[A-Z]_[a-z]/)|(?<=\b1/)|(?<=[)′]/))"
    r"([A-Za-z])_(\w{1,2})(?!\w|=|[.:]\w|/(?!([A-Z]_[a-z]|N)\b(?![./]\w))\w)"
)
# The space between a number and a unit: one letter, or a word that is no plain one; or a sign and its number.
_BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=[a-z]?[^a-z\d\s\-(]|[a-z](?![a-z])|[a-z]+[A-Z/²³·]|(?:min|ms|mm|cm|km|kg|rad|rpm|bar|mol)\b)"
    r"|(?<=[≤≥]) (?=[−\d])"
)

MISSING = "–"  # text of a value that is not known


def number(value: float | None) -> str:
    """Return a number with four significant digits and a typographic minus; a dash if missing."""
    if value is None or value != value:
        return MISSING
    if not isfinite(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return "0" if text == "-0" else text.replace("-", "−")


def exact_number(value: float) -> str:
    """Return a number of a result with the digits that files have, but 0.9 for 0.8999999999999998."""
    return f"{value + 0.0:.10g}".replace("-", "−")


def knob_number(knob: Knob, value: float) -> str:
    """Return a knob's value, rounded to its resolution or else to a thousandth of its range.

    Values that read the same are indistinguishable to the person who sets the knob.
    """
    if knob.integer:
        return number(float(value))
    if knob.scale == "log10":
        return number(float(f"{value:.3g}"))
    step = knob.resolution
    digits = _decimals(step) if step else floor(-log10((knob.high - knob.low) / 1000))
    digits = max(digits, 0)
    text = f"{round(float(value), digits) + 0.0:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if digits else text).replace("-", "−")


def _decimals(step: float) -> int:
    """Return the decimal places that tell neighbors apart, and any more that `step` has."""
    least = ceil(-log10(step) - 1e-9)
    return next((k for k in (least, least + 1) if abs(round(step, k) - step) < 1e-9), least)


def measured(kpi: KPI, experiment: Experiment) -> str:
    """Return the value of a KPI as text; an infinite time is "never"."""
    return measured_texts([kpi], experiment)[0]


def measured_texts(
    kpis: Sequence[KPI], experiment: Experiment, beside: Experiment | None = None
) -> list[str]:
    """Return the values of many KPIs as text; with `beside`, in the digits that compare the two."""
    unit, shown = experiment.channels.time_unit, [e for e in (experiment, beside) if e is not None]
    values = [[e.kpis.get(kpi.name, nan) for e in shown] for kpi in kpis]
    if beside is None:
        return [value_text(kpi, value, unit) for kpi, (value,) in zip(kpis, values, strict=True)]
    return [read_text(kpi, comparable(kpi, pair)[0], unit) for kpi, pair in zip(kpis, values, strict=True)]


def value_text(kpi: KPI, value: float | None, time_unit: str) -> str:
    """Return a value of a KPI as text, without its unit; an infinite time is "never"."""
    return read_text(kpi, None if value is None else kpi.read(value), time_unit)


def read_text(kpi: KPI, read: float | None, time_unit: str) -> str:
    """Return what is read of a KPI as text, as `value_text` does; see `comparable`."""
    if kpi.margin and read == inf and kpi.goal == "lower":
        return "unstable"
    return "never" if read == inf and kpi.unit == time_unit else number(read)


def comparable(kpi: KPI, values: Sequence[float]) -> list[float]:
    """Return values of a KPI, two that stand side by side, in the digits that tell them apart.

    Those are three of the larger one, but more, up to all that are read, while rounding changes
    their difference by more than a twentieth, or what is said of an objective, or makes something 0.
    A KPI with a resolution of its own is shown in that.
    """
    read = [kpi.read(value) for value in values]
    known = [abs(value) for value in read if isfinite(value) and value]
    if not known or kpi.resolution is not None:
        return read
    places = 2 - floor(log10(max(known)))
    for digits in range(places, places + _FINEST):
        fewer = [round(value, digits) + 0.0 for value in read]
        if _says_the_same(kpi, fewer, read):
            return fewer
    return read


_FINEST = 8  # decimal places after the third digit of the larger value, after which all digits are shown


def _says_the_same(kpi: KPI, fewer: list[float], read: list[float]) -> bool:
    """Return whether rounded values say the same as those that are read."""
    apart, still = (max(each) - min(each) for each in (read, fewer))
    return (
        not abs(still - apart) > apart / 20  # no number without two finite values
        and all((a == 0) == (b == 0) for a, b in zip(fewer, read, strict=True))
        and (not objective(kpi) or [*map(kpi.met, fewer)] == [*map(kpi.met, read)])
    )


def join_words(words: Sequence[str]) -> str:
    """Return words as people list them: "a, b and c"; "" of none."""
    *most, last = words or ("",)
    return " and ".join([", ".join(most), last] if most else [last])


_COMMAND = re.compile(r" --[a-z-]+ ('[^']*'|\S+)$")


def sentence(text: str) -> str:
    """Return a text with a capital and a full stop, which none has that ends with a command to paste."""
    return f"{text[:1].upper()}{text[1:]}{'' if _COMMAND.search(text) else '.'}"


def objective(kpi: KPI) -> str:
    """Return the objective of a KPI as text; empty if there is none."""
    limits = (("≥", kpi.at_least), ("≤", kpi.at_most))
    return " and ".join(f"{sign} {number(limit)}" for sign, limit in limits if not isinf(limit))


def limits_text(kpi: KPI) -> str:
    """Return the objective of a KPI with its unit; empty if there is none."""
    words = objective(kpi)
    return f"{words} {kpi.unit}".strip() if words else ""


def meaning(kpi: KPI) -> str:
    """Return what a KPI means, and what studies aim at where that is not its limit."""
    if kpi.aim is None:
        return kpi.about
    aims = (
        f"Of simulated tunings, those with {number(kpi.aim)} or {kpi.goal} come first, unless that costs an "
        "objective: a tenth of the limit is left for plants that differ."
    )
    return f"{kpi.about} {aims}".lstrip()


INTERRUPTED = "unsafe: run interrupted"
"""Text for an experiment that counts as unsafe although no person marked it."""
CUT_SHORT = "run cut short, it could no longer win"  # text for an experiment whose run was cut short


def ended_text(experiment: Experiment) -> str:
    """Return why an experiment ended; after what time if it was cut short."""
    if experiment.end is not End.CUT_SHORT:
        return str(experiment.end.value)
    after = quantity(experiment.duration, experiment.channels.time_unit)
    return f"cut short after {after}: could no longer win"


def mark_text(mark: Mark, *, automatic: bool = False) -> str:
    """Return a mark as in the tables, which name the challenger first."""
    words = mark.value.replace("challenger ", "first: ").replace("incumbent ", "second: ")
    words = words.replace("cut short", CUT_SHORT)
    return words.replace("unsafe", INTERRUPTED) if automatic else words


def marks_text(answer: Answer) -> list[str]:
    """Return the marks of an answer, with the reason for automatic ones."""
    return [mark_text(mark, automatic=mark in answer.automatic) for mark in answer.marks]


def quantity(value: float | None, unit: str) -> str:
    """Return a number with its unit."""
    return with_unit(number(value), unit)


def with_unit(text: str, unit: str) -> str:
    """Return a formatted number with its unit; words such as "never" have none."""
    return f"{text} {unit}" if unit not in ("", "-") and text[:1] in "-−+0123456789" else text


def range_ends(name: str) -> str:
    """Return that the range of an input ends where it is needed, and what helps, after other words."""
    return (
        f"{name} is at its limit for most of the time that an output is away from its reference: try a "
        "smaller step or load, or a larger range, before another controller"
    )


def counted(count: int, noun: str) -> str:
    """Return a number of things in words, such as "1 answer" and "2 answers"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def printable(text: object) -> str:
    """Return `text` without control characters, since a study may come from another person."""
    return "".join(c if c.isprintable() else " " for c in str(text))


def printable_lines(text: str) -> str:
    """Return `text` of several lines without other control characters."""
    return "\n".join(map(printable, text.split("\n")))


def theta_text(space: KnobSpace, theta: object) -> str:
    """Return θ on one line: name, value and unit of each knob."""
    values = space.named(theta)  # type: ignore[arg-type]
    return " · ".join(f"{k.name} {with_unit(knob_number(k, values[k.name]), k.unit)}" for k in space)


def typed_number(value: float) -> str:
    """Return a number as commands take it: in plain ASCII, with all its digits."""
    return repr(int(value) if float(value).is_integer() and abs(value) < 1e15 else float(value))


def typed_name(knob: Knob, space: KnobSpace) -> str:
    """Return the name of a knob as commands take it: with _ for spaces, up to its first letter beyond ASCII.

    If that part is not only its own, it is the whole name.
    """
    names = [name.replace(" ", "_") for name in space.names]
    name = knob.name.replace(" ", "_")
    short = name[: next((i for i, letter in enumerate(name) if not letter.isascii()), None)].rstrip("_")
    return short if short and sum(each.startswith(short) for each in names) == 1 else name


def typed_theta(space: KnobSpace, theta: Sequence[float]) -> str:
    """Return θ, physical, as --start takes it: exactly, in plain ASCII where names allow that."""
    pairs = zip(space, theta, strict=True)
    return ", ".join(f"{typed_name(knob, space)}={typed_number(value)}" for knob, value in pairs)


def mathtext(name: str) -> str:
    """Return `name` for matplotlib, with the part after an underscore as a subscript."""
    return _SUBSCRIPTED.sub(lambda m: f"${m[1]}_{{{m[2].replace('_', ' ')}}}$", name.replace("$", r"\$"))


def with_subscripts(name: str) -> Markup:
    """Return `name` for HTML, escaped, with the part after an underscore as a subscript."""
    # On plain text: Markup would escape the tags that are inserted.
    return Markup(_SUBSCRIPTED.sub(r"\1<sub>\2</sub>", str(escape(name))))


def symbols_in(text: str) -> Markup:
    """Return a sentence for HTML, escaped, with symbols such as K_p and no line that ends before a unit.

    Names of files stay as they are, and options of a command.
    """
    together = _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", str(escape(text)))
    return Markup(_SYMBOL.sub(r"\1<sub>\2</sub>", together))


def knob_axis(knob: Knob) -> str:
    """Return the axis label of a knob in mathtext."""
    return labeled(mathtext(knob.name), knob.unit)


# --- Make the folder of a report, check the file of a picture, and write them.


def folder_for(path: str | Path) -> Path:
    """Return the folder `path`, created with its parents if necessary.

    Raises:
        SettingsError: If it is a file, or cannot be created or written to.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise SettingsError(f"--out must be a folder, but {error.filename!r} is a file") from error
    except OSError as error:
        raise SettingsError(f"cannot make the folder {path!s}: {error.strerror}") from error
    if not os.access(folder, os.W_OK):
        raise SettingsError(f"cannot write into the folder {path!s}")
    return folder


def picture_at(path: str | Path) -> Path:
    """Return the file of a picture, whose folder must exist: a report has many files, this is one.

    Raises:
        SettingsError: If it is no PNG, or its folder does not exist or cannot be written to.
    """
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise SettingsError(f"out must be a file that ends in .png, got {str(path)!r}")
    if not target.parent.is_dir():
        raise SettingsError(f"out must be in an existing folder, got {str(path)!r}")
    folder_for(target.parent)
    return target


def put(path: Path, content: bytes) -> None:
    """Write a file atomically: an interruption never leaves a partial file."""
    with whole_file(path) as part:
        part.write_bytes(content)
