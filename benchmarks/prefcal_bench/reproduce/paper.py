"""The values printed in the paper beside the code's, and every deviation as data."""

from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from prefcal_agents import GLISpSettings
from prefcal_agents.surrogate import FOLDS, Learning
from prefcal_env.envs.cstr import START
from prefcal_env.plants.cstr import CSTR, CSTRParams
from prefcal_scenarios.catalog import load
from prefcal_scenarios.wording import labeled, number

N_INIT, N_MAX, COMPARISONS = 10, 50, 49
"""Number of initial experiments, of experiments, and of comparisons of each study."""

THETA = MappingProxyType(
    {
        "cstr-preferences": (0.31, 26.0, -1.79),
        "cstr-automated": (0.25, 26.0, -0.91),
        "overtake-preferences": (0.085, 0.310, 16.0, 0.261, 0.918),
    }
)
"""Calibrated θ of each study, in the order of the scenario's knobs."""

T_COMP = 0.0808  # largest computation time of an MPC step at the car's calibrated θ [s]

Row = tuple[str, str, str]  # name, printed value, and our value


def parameters() -> list[Row]:
    """Return the rows of Table tab:CSTR_para."""
    p = CSTRParams()
    start = float(CSTR().steady_state_at_concentration(START)[1][0])
    rows = (
        ("F/V", "1/h", 1.0, p.F_V),
        ("k_0", "1/h", 3.49e7, p.k_0),
        ("H", "kcal/kgmol", 5960.0, p.H),
        ("E", "kcal/kgmol", 11843.0, p.E),
        ("ρC_p", "kcal/(m³ K)", 500.0, p.rho_Cp),
        ("US/V", "kcal/(m³ K h)", 150.0, p.US_V),
        ("R", "kcal/(kgmol K)", 1.987, p.R),
        ("T_c0", "K", 298.0, start),
    )
    return [(labeled(name, unit), number(said), number(ours)) for name, unit, said, ours in rows]


def algorithm() -> list[Row]:
    """Return the settings of GLISp at the beginning of section IV, and those of `GLISp.paper`."""
    s = GLISpSettings.paper()
    assert not isinstance(s.validate_at, str)
    rows = (
        ("experiments N_max", 50, N_MAX),
        ("initial experiments N_init", 10, N_INIT),
        ("exploration δ", 0.3, s.delta),
        ("tolerance σ", 1e-6, Learning().sigma),
        ("initial ε", 1, s.epsilon),
        ("folds K", 3, FOLDS),
        ("first cross-validation", 10, s.validate_at[0]),
        ("last cross-validation", 40, s.validate_at[-1]),
    )
    return [(name, f"{said:g}", f"{ours:g}") for name, said, ours in rows]


def ranges() -> list[Row]:
    """Return the ranges of the tuned parameters of both case studies."""
    printed = {
        "cstr": ((0.25, 1.5), (4.0, 40.0), (-5.0, 3.0)),
        "overtake": ((0.085, 0.5), (0.1, 1.0), (10.0, 30.0), (-5.0, 3.0), (-5.0, 3.0)),
    }
    return [
        (f"{scenario.title}: {labeled(knob.name, knob.unit)}", _range(*said), _range(*ours))
        for scenario, limits in ((load(name), limits) for name, limits in printed.items())
        for knob, said in zip(scenario.space, limits, strict=True)
        for ours in [(knob.low, knob.high)]
    ]


def _range(low: float, high: float) -> str:
    return f"{number(low)} to {number(high)}"


TABLE = Path(__file__).with_name("deviations.md").read_text("utf-8")
"""Deviations in Markdown, as in docs/deviations.md: the case studies before the agent."""


@dataclass(frozen=True, slots=True)
class Deviation:
    """A point in which prefcal differs from the paper, or decides where the paper is silent."""

    paper: str  # what the paper says, with the label of its equation or section
    ours: str  # what prefcal does
    why: str  # reason for the deviation
    effect: str  # measured effect, or the reason why there can be none


def _deviation(line: str) -> Deviation:
    _, *cells, _ = map(str.strip, line.split("|"))
    return Deviation(*cells)


DEVIATIONS = tuple(map(_deviation, TABLE.splitlines()[2:]))  # all deviations, a row each
