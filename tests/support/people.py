"""Runs and rules made by hand or by hypothesis, for the tests of tastes."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st

from prefcal_bench.people import Runs
from prefcal_bench.people.eyes.ideal import Ideal, Wish
from prefcal_bench.people.eyes.majority import Majority
from prefcal_bench.people.eyes.noticing import Eyes
from prefcal_bench.people.eyes.order import Criterion, Order
from prefcal_bench.people.eyes.ranks import Ranks, Scale
from prefcal_bench.people.eyes.trade import Share, Trade
from prefcal_bench.people.limited import Limit, Limited
from prefcal_bench.people.priorities import Priorities, Priority
from prefcal_bench.people.rising import Standards
from prefcal_bench.people.weighted import Term, Weighted

NAMES = ("error", "effort", "noise")


def runs(*rows: Sequence[float], survived: Sequence[float] | None = None) -> Runs:
    """One row of KPIs an experiment, of the first `NAMES`; none was interrupted by default."""
    values = np.array(rows, dtype=float)
    end = np.full(len(rows), np.inf) if survived is None else np.array(survived, dtype=float)
    return Runs(NAMES[: values.shape[1]], values, end)


def only(every: Runs, row: int) -> Runs:
    """One of the experiments."""
    return every.take(np.array([row]))


_TRADE_OFF = Weighted(
    (
        Term("error", 0.5, good=0.0, scale=1.0, steepness=0.5),
        Term("effort", 0.3, good=0.0, scale=10.0, steepness=2.0),
        Term("noise", 0.2, good=0.0, scale=0.1, steepness=1.0),
    )
)
_STRICT = Weighted(tuple(Term(t.name, t.weight, t.good, t.scale / 4, t.steepness) for t in _TRADE_OFF.terms))
RULES: dict[str, Any] = {
    "weighted": _TRADE_OFF,
    "limited": Limited((Limit("error", 1.0, 0.5), Limit("noise", 0.2, 0.1)), _TRADE_OFF),
    "priorities": Priorities(
        (Priority("error", 0.2, relative=True), Priority("effort", 1.0), Priority("noise", 0.0))
    ),
    "standards": Standards(_TRADE_OFF, _STRICT),
    "order": Eyes(Order((Criterion("error", 0.2, at_most=0.5), Criterion("effort", 1.0)))),
    "majority": Eyes(Majority((Criterion("error", 0.2), Criterion("effort", 1.0), Criterion("noise", 0.1)))),
    "ideal": Eyes(Ideal((Wish("error", 0.1, 2.0), Wish("noise", 0.0, 0.1)), 2.0, 0.3)),
    "ranks": Eyes(
        Ranks((Scale("error", (0.0, 1.0, 4.0), (0.1, 0.5, 0.9)), Scale("noise", (0.5,), (0.5,))), 0.2)
    ),
    "trade": Eyes(Trade((Share("error", 0.6, 0.0, 0.5, 1.5), Share("effort", 0.4, 0.0, 2.0, 1.0)), 0.1)),
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
