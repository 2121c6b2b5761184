"""The KPIs of a study as shares between the best and the worst."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from prefcal_agents.learned_cost import Outcomes
from prefcal_env.preferences.history import History
from support.histories import studied


def history_of(columns):
    """A history whose samples have these KPIs: name to values."""
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    known = [{name: v for name, v in row.items() if v is not None} for row in rows]
    points = np.random.default_rng(0).random((len(rows), 2))
    answers, rivals = [None, *[1] * len(rows)], [None, *[0] * len(rows)]
    return studied(points, answers=answers, rivals=rivals, kpis=known)


def test_shares_run_from_the_best_to_the_worst_and_one_lost_run_does_not_flatten_them():
    outcomes = Outcomes.of(history_of({"k": [1.0, 2.0, 3.0, 1e6]}))
    # Median 2.5: all above 2.5 + 2 * 1.5 = 5.5 counts as 5.5.
    assert outcomes.columns[:, 0] == pytest.approx([0, 1 / 4.5, 2 / 4.5, 1])
    assert outcomes.ranges[0] == pytest.approx((1.0, 5.5))


def test_what_cannot_teach_is_left_out():
    columns = {"same": [3.0] * 5, "rare": [1.0, 2.0, None, None, None], "nan": [np.nan] * 5}
    assert len(Outcomes.of(history_of(columns))) == 0
    assert len(Outcomes.of(History())) == 0
    assert Outcomes.of(history_of({**columns, "good": [1.0, 2.0, 3.0, 4.0, 5.0]})).names == ("good",)


KPI = st.none() | st.floats(width=64)


@given(st.lists(st.tuples(KPI, KPI), min_size=1, max_size=8))
@example([(1e300, -1e300), (-1e300, 1e300), (0.0, 0.0), (5e-324, 1.0)])
@example([(np.inf, -np.inf), (-np.inf, np.inf), (np.inf, 0.0)])
@example([(1.7e308, 0.0), (-1.7e308, 1.0), (0.0, 2.0)])
def test_whatever_the_values_shares_are_between_0_and_1(rows):
    first, second = zip(*rows, strict=True)
    history = history_of({"k": first, "l": second})
    outcomes = Outcomes.of(history)
    assert outcomes.columns.shape == (len(rows), len(outcomes))
    assert ((outcomes.columns >= 0) & (outcomes.columns <= 1)).all()
    for k, (name, (best, worst)) in enumerate(zip(outcomes.names, outcomes.ranges, strict=True)):
        values = np.array([v if v is not None else np.nan for v in (first if name == "k" else second)])
        assert best < worst
        assert (outcomes.columns[values == np.inf, k] == 1.0).all()
