"""Long tables keep rows from beginning to end."""

import numpy as np

from prefcal_env.tables.thinning import extreme_rows


def test_rows_of_many_columns_are_left_out_all_over_the_run():
    columns = list(np.random.default_rng(0).normal(size=(300, 5_000)))
    rows = extreme_rows(columns, 100)
    assert len(rows) == 100
    assert (rows[0], rows[-1]) == (0, 4_999)
    assert np.diff(rows).max() < 500
