"""How numbers and names read, for terminals, HTML and plots alike."""

import re
from collections.abc import Mapping
from html import escape
from math import inf, isfinite
from typing import Any

from prefcal_env.experiment import Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preference import Mark
from prefcal_scenarios.scenario import KPI

_SUBSCRIPTED = re.compile(r"([^\W_]+)_(\w+)")


def number(value: float | None) -> str:
    """Four significant digits; a dash where there is no number."""
    if value is None or value != value:
        return "–"
    if not isfinite(value):
        return "∞" if value > 0 else "−∞"
    text = f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    return "0" if text == "-0" else text


def measured(kpi: KPI, experiment: Experiment) -> str:
    """The value of a KPI; an infinite time is "never"."""
    value = experiment.kpis.get(kpi.name)
    if value == inf and kpi.unit == experiment.channels.time_unit:
        return "never"
    return number(value)


def earlier_text(taken: Mapping[str, Any]) -> str:
    """What a study has taken over from an earlier one, as its configuration says."""
    count = len(taken["thetas"])
    which = "its best θ" if count == 1 else f"its {count} best θ"
    return f"{taken['study']} ({taken['scenario']}): {which} of {taken['experiments']} experiments"


def mark_text(mark: Mark) -> str:
    """A mark in the words of the tables, whose columns are "new" and "best"."""
    return mark.value.replace("challenger", "new").replace("incumbent", "best")


def quantity(value: float | None, unit: str) -> str:
    """A number with its unit."""
    return with_unit(number(value), unit)


def with_unit(text: str, unit: str) -> str:
    """A number that is written already with its unit; words such as "never" have none."""
    return f"{text} {unit}" if unit not in ("", "-") and text[:1] in "-0123456789" else text


def printable(text: object) -> str:
    """`text` without what would steer a terminal: a study may come from somebody else."""
    return "".join(c if c.isprintable() else " " for c in str(text))


def labelled(name: str, unit: str) -> str:
    """A name with its unit, for plain text headings."""
    return f"{name} [{unit}]" if unit else name


def theta_text(space: KnobSpace, theta: object) -> str:
    """θ on one line: name, value and unit of each knob."""
    values = space.named(theta)  # type: ignore[arg-type]
    return " · ".join(f"{k.name} {quantity(values[k.name], k.unit)}" for k in space)


def mathtext(name: str) -> str:
    """`name` for matplotlib, with what follows an underscore as a subscript."""
    return _SUBSCRIPTED.sub(
        lambda m: f"${m[1]}_{{{m[2].replace('_', ' ')}}}$", name.replace("$", r"\$")
    )


def html(name: str) -> str:
    """`name` for HTML, escaped, with what follows an underscore as a subscript."""
    return _SUBSCRIPTED.sub(r"\1<sub>\2</sub>", escape(name))


def knob_axis(knob: Knob) -> str:
    """Axis label of a knob in mathtext."""
    return labelled(mathtext(knob.name), knob.unit)
