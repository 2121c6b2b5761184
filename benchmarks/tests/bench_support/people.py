"""Runs and rules made by hand or by hypothesis, for the tests of tastes."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from prefcal_bench.people import Runs
from prefcal_bench.people.judgements import Loss, Majority, Noticed, Order, Rank, Total, Wish
from prefcal_bench.people.rule import Noticing
from prefcal_bench.people.trade_off import Standards, Term, TradeOff

NAMES = ("error", "effort", "noise")


def runs(*rows: Sequence[float], survived: Sequence[float] | None = None) -> Runs:
    """One row of KPIs an experiment, of the first `NAMES`; none was interrupted by default."""
    values = np.array(rows, dtype=float)
    end = np.full(len(rows), np.inf) if survived is None else np.array(survived, dtype=float)
    return Runs(NAMES[: values.shape[1]], values, end)


def only(every: Runs, row: int) -> Runs:
    """One of the experiments."""
    return every.take(np.array([row]))


_TRADE_OFF = TradeOff(
    (Term("error", 0.5, 0.0, 1.0, 0.5), Term("effort", 0.3, 0.0, 10.0, 2.0), Term("noise", 0.2, 0.0, 0.1))
)
_STRICT = TradeOff(tuple(Term(t.name, t.weight, t.good, t.scale / 4, t.steepness) for t in _TRADE_OFF.terms))
_PRIORITIES = (Noticed("error", 0.2, relative=True), Noticed("effort", 1.0), Noticed("noise", 0.0))
RULES: dict[str, Any] = {
    "weighted": _TRADE_OFF,
    "limited": TradeOff(_TRADE_OFF.terms, (Term("error", 1.0, 1.0, 0.5), Term("noise", 1.0, 0.2, 0.1))),
    "priorities": Noticing(Order(_PRIORITIES), ties_count=True),
    "standards": Standards(_TRADE_OFF, _STRICT),
    "order": Noticing(Order((Noticed("error", 0.2, at_most=0.5), Noticed("effort", 1.0)))),
    "majority": Noticing(Majority((Noticed("error", 0.2), Noticed("effort", 1.0), Noticed("noise", 0.1)))),
    "ideal": Noticing(Total((Wish("error", 0.1, 2.0), Wish("noise", 0.0, 0.1)), 0.3, 2.0)),
    "ranks": Noticing(
        Total((Rank("error", (0.0, 1.0, 4.0), (0.1, 0.5, 0.9)), Rank("noise", (0.5,), (0.5,))), 0.2)
    ),
    "trade": Noticing(Total((Loss("error", 0.6, 0.0, 0.5, 1.5), Loss("effort", 0.4, 0.0, 2.0, 1.0)), 0.1)),
}
"""One rule of every class that does not change."""

EYES = ("order", "ideal", "majority", "ranks", "curves", "trade")
"""Kinds of people with eyes, whose draws take seconds."""


def kinds(names: Iterable[str]) -> list[Any]:
    """Names of tastes as parameters, those of people with eyes in the extended part."""
    eyes = pytest.mark.slow
    return [pytest.param(n, marks=eyes if n.partition("-")[0] in EYES else ()) for n in names]


_VALUES = st.floats(0.0, allow_nan=False, allow_infinity=True) | st.sampled_from([0.0, 0.5, 1.0, np.inf])
_SURVIVED = st.just(np.inf) | st.floats(0.0, 1e4).map(lambda value: round(value, 3))


@st.composite
def any_runs(draw: Any, size: int | None = None) -> Runs:
    """Runs of any values of 0 or more, some of them infinite, some interrupted."""
    count = draw(st.integers(1, 6)) if size is None else size
    rows = draw(st.lists(st.tuples(*[_VALUES] * len(NAMES)), min_size=count, max_size=count))
    survived = draw(st.lists(_SURVIVED, min_size=count, max_size=count))
    return runs(*rows, survived=survived)
