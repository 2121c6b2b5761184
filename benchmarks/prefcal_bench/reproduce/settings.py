"""Compare the paper's values with the code's: parameters, ranges, settings of the algorithm."""

from prefcal_agents import GLISpSettings
from prefcal_agents.models.cross_validation import FOLDS
from prefcal_agents.models.preference_qp import Learning
from prefcal_env.envs.cstr import START
from prefcal_env.plants.cstr import CSTR, CSTRParams
from prefcal_scenarios.catalog import load
from prefcal_scenarios.presentation.wording import labeled, number

from .printed import ALGORITHM, CSTR_TABLE, N_INIT, N_MAX, RANGES

Row = tuple[str, str, str]
"""Name, printed value, and our value."""


def parameters() -> list[Row]:
    """Return the rows of Table tab:CSTR_para."""
    p = CSTRParams()
    start = float(CSTR().steady_state_at_concentration(START)[1][0])
    ours = (p.F_V, p.k_0, p.H, p.E, p.rho_Cp, p.US_V, p.R, start)
    return [
        (labeled(name, unit), number(value), number(own))
        for (name, (value, unit)), own in zip(CSTR_TABLE.items(), ours, strict=True)
    ]


def algorithm() -> list[Row]:
    """Return the settings of GLISp in section IV, and those of `GLISp.paper`."""
    s = GLISpSettings.paper()
    assert not isinstance(s.validate_at, str)
    ours = (
        N_MAX, N_INIT, s.delta, Learning().sigma, s.epsilon, FOLDS,
        s.validate_at[0], s.validate_at[-1],
    )  # fmt: skip
    return [
        (name, _short(value), _short(float(own)))
        for (name, value), own in zip(ALGORITHM.items(), ours, strict=True)
    ]


def ranges() -> list[Row]:
    """Return the ranges of the tuned parameters of both case studies."""
    rows = []
    for name, printed in RANGES.items():
        scenario = load(name)
        for knob in scenario.space:
            rows.append((
                f"{scenario.title}: {labeled(knob.name, knob.unit)}",
                _range(*printed[knob.name]),
                _range(knob.low, knob.high),
            ))  # fmt: skip
    return rows


def _range(low: float, high: float) -> str:
    return f"{number(low)} to {number(high)}"


def _short(value: float) -> str:
    return f"{value:g}"
